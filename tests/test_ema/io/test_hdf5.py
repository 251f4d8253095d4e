"""HDF5 files: where labs put samples, units and rates, and what must not be followed."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from hdf5_layouts import LAYOUTS, NOISE, RATE_HZ, N, add, of_file, written

from ema.core.errors import RecordingFormatError
from ema.core.recording import ACCELERATION, FORCE
from ema.io.formats import read_file


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("options", [{}, {"libver": "latest"}, {"userblock_size": 1024}])
def test_layouts_of_one_recording(tmp_path, layout, options):
    found = read_file(written(tmp_path, layout, **options))
    assert found.recording.sampling_rate_hz == RATE_HZ
    channels = {each.name: each for each in found.recording.channels}
    assert sorted(channels) == ["A01", "force"]
    assert channels["A01"].quantity == "acceleration"
    np.testing.assert_array_equal(channels["force"].block(0, N), NOISE[:, 0])
    np.testing.assert_array_equal(channels["A01"].block(0, N), 9.80665 * NOISE[:, 1])
    assert not any(each.samples.flags.writeable for each in channels.values())
    assert found.findings == ()


@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8", ">f8", "<i2", ">i4", "u1", "f2"])
@pytest.mark.parametrize("chunks", [None, (7,)])
def test_types_of_numbers(tmp_path, dtype, chunks):
    samples = (NOISE[:, 0] * 20 + 100).astype(dtype)
    path = written(tmp_path, lambda file: file.create_dataset("a", data=samples, chunks=chunks))
    found = read_file(path).recording.channels[0].samples
    np.testing.assert_array_equal(found, samples)
    assert found.flags.owndata is False or chunks


def test_odd_bit_layouts_are_converted(tmp_path):
    kind = h5py.h5t.STD_I32LE.copy()
    kind.set_precision(12)
    kind.set_offset(4)
    values = np.array([1, -2, 2047], dtype="i4")

    def write(file):
        space = h5py.h5s.create_simple((3,))
        made = h5py.h5d.create(file.id, b"a", kind, space)
        made.write(h5py.h5s.ALL, h5py.h5s.ALL, values)

    np.testing.assert_array_equal(
        read_file(written(tmp_path, write)).recording.block(0, 3), [values]
    )


def test_names_that_repeat_get_their_path(tmp_path):
    def write(file):
        add(file, "left/A01", NOISE[:, 0])
        add(file, "right/A01", NOISE[:, 1])

    found = read_file(written(tmp_path, write)).recording
    assert found.names == ("left/A01", "right/A01")
    assert np.isnan(found.sampling_rate_hz)


def external_link(file):
    file["odd"] = h5py.ExternalLink("other.h5", "/A01")


def soft_link(file):
    file["odd"] = h5py.SoftLink("/A01")


def second_name(file):
    file["odd"] = file["A01"]


def cycle(file):
    file.create_group("group")["odd"] = file["/"]


def virtual(file):
    layout = h5py.VirtualLayout((N,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "A01", (N,))
    file.create_virtual_dataset("odd", layout)


def external_numbers(file):
    file.create_dataset("odd", (N,), "f8", external=[("other.bin", 0, N * 8)])


def text(file):
    file["odd"] = ["worn", "new"]


def complex_numbers(file):
    file["odd"] = NOISE[:, 0] + 1j


def compound(file):
    file["odd"] = np.zeros(N, [("a", "S8"), ("b", "f8", (2,))])


def nothing(file):
    file["odd"] = h5py.Empty("f8")


def cube(file):
    file["odd"] = np.zeros((2, 3, 4))


ODD = [external_link, soft_link, second_name, cycle, virtual, external_numbers]
ODD += [text, complex_numbers, compound, nothing, cube]


@pytest.mark.parametrize("odd", ODD)
def test_what_is_elsewhere_or_no_signal_is_left_out(tmp_path, odd):
    with h5py.File(tmp_path / "other.h5", "w") as other:
        add(other, "A01", NOISE[:, 0])
    (tmp_path / "other.bin").write_bytes(NOISE[:, 0].tobytes())
    found = read_file(written(tmp_path, of_file, odd))
    assert found.recording.names == ("A01", "force")
    assert [each.channel.rpartition("/")[2] for each in found.findings] == ["odd"]
    with pytest.raises(RecordingFormatError, match=r"a channel is a dataset|FRFs need"):
        read_file(
            written(tmp_path, odd) if odd not in (soft_link, second_name) else _only(tmp_path)
        )


def _only(tmp_path):
    return written(tmp_path, lambda file: file.create_group("empty"))


def test_a_complex_sampling_rate_is_none(tmp_path):
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["A01"] = np.zeros(100)
        file.attrs["fs"] = 100 + 2j
    with pytest.raises(RecordingFormatError):
        read_file(path)


@pytest.mark.parametrize("layout", ["contiguous", "chunked"])
@pytest.mark.parametrize(
    "scales", [{"scale_factor": 0.01}, {"scale_factor": [0.5], "add_offset": 3}]
)
def test_integers_are_scaled_as_their_attributes_say(tmp_path, layout, scales):
    counts = np.arange(-30, 30, dtype=np.int16) ** 3
    with h5py.File(tmp_path / "a.h5", "w") as file:
        chunks = (7,) if layout == "chunked" else None
        file.create_dataset("force", data=counts, chunks=chunks).attrs.update(scales, unit="N")
        file.attrs["fs"] = RATE_HZ
    factor = np.ravel(scales["scale_factor"])[0]
    (force,) = read_file(tmp_path / "a.h5").recording.channels
    np.testing.assert_allclose(force.block(0, 60), counts * factor + scales.get("add_offset", 0))


def test_fill_values_are_missing_samples(tmp_path):
    samples = np.where(np.arange(N) == 7, -9999.0, NOISE[:, 0])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["force"] = samples
        file["force"].attrs.update({"_FillValue": [-9999.0], "unit": "N"})
    (force,) = read_file(tmp_path / "a.h5").recording.channels
    assert np.flatnonzero(np.isnan(force.block(0, N))).tolist() == [7]


def test_integers_with_a_gain_are_doubted(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["fs"] = RATE_HZ
        add(file, "A01", np.arange(-9, 9) % 7, "g", gain=0.01)
        add(file, "force", NOISE[:18, 0], "N", gain=0.01)
    (finding,) = [f for f in read_file(tmp_path / "a.h5").findings if "gain" in f.detail]
    assert (finding.channel, finding.verdict.value) == ("A01", "warning")


def test_scales_that_are_no_numbers_are_refused(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("force", data=np.arange(9)).attrs["scale_factor"] = "0.01"
    with pytest.raises(RecordingFormatError, match="scale_factor"):
        read_file(tmp_path / "a.h5")


def test_fields_of_a_compound_type_are_channels(tmp_path):
    table = np.zeros(N, dtype=[("time", "f8"), ("force [N]", "f4"), ("A01 [g]", "f8"), ("s", "S4")])
    table["time"] = np.arange(N) / RATE_HZ
    table["force [N]"], table["A01 [g]"] = NOISE.T
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("run/table", data=table)
    found = read_file(tmp_path / "a.h5").recording
    assert (found.names, found.sampling_rate_hz) == (("force", "A01"), RATE_HZ)
    np.testing.assert_array_equal(found.channels[1].samples, NOISE[:, 1])


def test_a_frame_of_pandas_has_its_names(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("df")
        group.attrs["pandas_type"] = "frame"
        group["axis0"] = group["block0_items"] = np.array(["force [N]", "A01 [g]"], "S")
        group["axis1"] = np.arange(N) / RATE_HZ
        group["block0_values"] = NOISE
    found = read_file(tmp_path / "a.h5")
    assert found.recording.names == ("force", "A01")
    assert found.recording.sampling_rate_hz == RATE_HZ
    np.testing.assert_array_equal(found.recording.channels[1].samples, NOISE[:, 1])
    assert [each.verdict for each in found.findings] == ["ok"]


@pytest.mark.parametrize("single", [False, True])
def test_a_table_of_pandas_has_its_names(tmp_path, single):
    """As `to_hdf(format="table")` writes it; the names are a pickled list, which is not loaded."""
    blocks = {0: ["time", "force [N]"], 1: ["A01 [m/s^2]"]}
    kinds = [("index", "i8"), ("values_block_0", "f8", 2)]
    table = np.zeros(N, dtype=[*kinds, ("values_block_1", "f4" if single else "f8", (1,))])
    table["index"], table["values_block_0"][:, 0] = np.arange(N), np.arange(N) / RATE_HZ
    table["values_block_0"][:, 1], table["values_block_1"][:, 0] = NOISE.T
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("df")
        group.attrs["pandas_type"] = "frame_table"
        group["table"] = table
        for number, names in blocks.items():
            pickled = "".join(f"V{name}\np{k}\na" for k, name in enumerate(names, 1))
            group["table"].attrs[f"values_block_{number}_kind"] = np.bytes_(f"(lp0\n{pickled}.")
        group["_i_table/index/ranges"] = np.zeros((0, 2))
    found = read_file(tmp_path / "a.h5").recording
    assert [(each.name, each.quantity) for each in found.channels] == [
        ("force", FORCE),
        ("A01", ACCELERATION),
    ]
    assert found.sampling_rate_hz == RATE_HZ


def test_other_pickles_are_not_names(tmp_path):
    table = np.zeros(N, dtype=[("values_block_0", "f8", (1,))])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["df/table"] = table
        file["df/table"].attrs["values_block_0_kind"] = np.bytes_(b"cos\nsystem\n(Vtrue\ntR.")
    with pytest.raises(RecordingFormatError, match="not numbers"):
        read_file(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("name", "starts"),
    [
        ("t0", (0.0, 0.002)),
        ("start_time", (1.764e9, 1.764e9 + 0.002)),
        ("start_time", ("2026-11-28T10:00:00", "2026-11-28T10:00:00.002")),
    ],
)
def test_channels_that_start_apart_are_aligned(tmp_path, name, starts):
    def write(file):
        file.attrs["fs"] = 2000.0
        samples = np.random.default_rng(0).normal(size=64)
        for channel, start in zip(("force", "A01"), starts, strict=True):
            file[channel] = samples
            file[channel].attrs[name] = start

    recording = read_file(written(tmp_path, write)).recording
    assert recording.n_samples == 60
    first = {each.name: each.samples[0] for each in recording.channels}
    samples = np.random.default_rng(0).normal(size=64)
    assert first == {"force": samples[4], "A01": samples[0]}


def test_a_start_that_is_no_time_is_refused(tmp_path):
    def write(file):
        file["force"], file["A01"] = NOISE[:64].T[:2]
        file["force"].attrs["t0"] = "noon"

    with pytest.raises(RecordingFormatError, match="'noon'"):
        read_file(written(tmp_path, write))


def test_many_datasets_take_few_open_files(tmp_path):
    def write(file):
        file.attrs["fs"] = RATE_HZ
        for number in range(60):
            file[f"A{number}"] = NOISE[:, 0]

    descriptors = Path("/proc/self/fd")
    if not descriptors.is_dir():
        pytest.skip("the system does not list open files")
    path = written(tmp_path, write)
    before = len(list(descriptors.iterdir()))
    found = read_file(path).recording
    assert len(found.channels) == 60
    assert len(list(descriptors.iterdir())) <= before + 2


@pytest.mark.parametrize("late_s", [0.0, 0.0005 * 4])
@pytest.mark.parametrize("names", [("force", "time"), ("A01", "t")])
def test_each_group_has_its_own_time(tmp_path, late_s, names):
    def write(file):
        for place, start_s in (("a", 0.0), ("b", late_s)):
            signal, time = names
            file[f"{place}/{signal}"] = NOISE[:, 0]
            file[f"{place}/{time}"] = start_s + np.arange(N) / RATE_HZ

    found = read_file(written(tmp_path, write)).recording
    n_late = round(late_s * RATE_HZ)
    first = [each.samples[0] for each in found.channels]
    assert (found.sampling_rate_hz, first) == (RATE_HZ, [NOISE[n_late, 0], NOISE[0, 0]])
    assert found.n_samples == N - n_late


def test_slow_groups_beside_a_recording_are_left_out(tmp_path):
    def write(file):
        for place, every in (("fast", 1), ("slow", 10)):
            file.create_group(place).attrs["fs"] = RATE_HZ / every
        file["time"] = np.arange(N) / RATE_HZ  # of no channel: each group states its rate
        add(file["fast"], "force", NOISE[:, 0], "N")
        add(file["fast"], "A01", NOISE[:, 1], "g")
        add(file["slow"], "temperature", NOISE[::10, 0])

    found = read_file(written(tmp_path, write))
    assert (found.recording.names, found.recording.sampling_rate_hz) == (("A01", "force"), RATE_HZ)
    assert [each.channel for each in found.findings] == ["/slow/temperature"]

    def write_force(file):
        write(file)
        del file["slow/temperature"]
        add(file["slow"], "force2", NOISE[::10, 0], "N")

    with pytest.raises(RecordingFormatError, match="sampled together"):
        read_file(written(tmp_path, write_force))
