"""MATLAB files of level 5 and 7.3: the layouts that labs use, and faults."""

import re
import struct
import zlib

import h5py
import numpy as np
import pytest
import scipy.io
from damage import assert_no_other_exception, assert_truncations_named
from hypothesis import given, settings
from hypothesis import strategies as st

from ema.core.errors import RecordingFormatError
from ema.io.formats import read_file

RATE_HZ = 2000.0
N = 50
NOISE = np.random.default_rng(3).standard_normal((N, 3))
TIME_S = np.arange(N) / RATE_HZ


def cell(*texts):
    return np.array(texts, dtype=object)


def write_5(path, variables):
    scipy.io.savemat(path, variables)


def write_5_compressed(path, variables):
    scipy.io.savemat(path, variables, do_compression=True)


def write_73(path, variables, compression=None):
    """As MATLAB does: column-major, classes as attributes, cells as references."""
    with h5py.File(path, "w", userblock_size=512) as file:
        _write_fields(file, variables, compression)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")


def _write_fields(group, fields, compression):
    for name, value in fields.items():
        if isinstance(value, dict):
            _write_fields(group.create_group(name), value, compression)
            group[name].attrs["MATLAB_class"] = np.bytes_("struct")
        elif isinstance(value, list):
            _write_array_of_structs(group.create_group(name), value)
        elif isinstance(value, str):
            _write_text(group, name, value)
        elif np.asarray(value).dtype == object:
            cells = group.create_dataset(name, (len(value), 1), dtype=h5py.ref_dtype)
            cells.attrs["MATLAB_class"] = np.bytes_("cell")
            for row, text in enumerate(value):
                place = f"#refs#/{name}{row}"
                cells[row, 0] = _write_text(group.file, place, text).ref
        else:
            stored = np.atleast_2d(value).T
            packed = compression if stored.size > 1 else None
            group.create_dataset(name, data=stored, compression=packed)
            group[name].attrs["MATLAB_class"] = np.bytes_("double")


def _write_array_of_structs(group, structs):
    group.attrs["MATLAB_class"] = np.bytes_("struct")
    for name in structs[0]:
        cells = group.create_dataset(name, (len(structs), 1), dtype=h5py.ref_dtype)
        for row, each in enumerate(structs):
            _write_fields(group.file, {f"#refs#/{name}{row}": each[name]}, None)
            cells[row, 0] = group.file[f"#refs#/{name}{row}"].ref


def _write_text(group, name, text):
    codes = np.frombuffer(text.encode("utf-16-le"), "<u2")[:, None]
    written = group.create_dataset(name, data=codes if text else np.zeros(2, "u8"))
    written.attrs["MATLAB_class"] = np.bytes_("char")
    if not text:
        written.attrs["MATLAB_empty"] = 1
    return written


def write_73_compressed(path, variables):
    write_73(path, variables, "gzip")


WRITERS = [write_5, write_5_compressed, write_73, write_73_compressed]
SINGLY = {"force": NOISE[:, 0], "A01": NOISE[:, 1], "A02": NOISE[:, 2]}
NAMES = cell("force", "A01", "A02")
UNITS = cell("N", "g", "mm/s²")
BY_NAME = dict(zip(SINGLY, UNITS, strict=True))
SAME = {
    "vectors": {**SINGLY, "fs": RATE_HZ, "units": BY_NAME},
    "dt": {**SINGLY, "dt": 1 / RATE_HZ, "units": BY_NAME},
    "row vectors": {
        **{name: each[None] for name, each in SINGLY.items()},
        "t": TIME_S[None],
        "units": BY_NAME,
    },
    "matrix": {"data": NOISE, "names": NAMES, "units": UNITS, "Fs": RATE_HZ},
    "matrix of rows": {"x": NOISE.T, "channels": NAMES, "units": UNITS, "fsamp": RATE_HZ},
    "units in names": {
        "data": NOISE,
        "labels": cell("force [N]", "A01 [g]", "A02 [mm/s²]"),
        "sample_rate": RATE_HZ,
    },
    "time in the matrix": {
        "data": np.column_stack([TIME_S, NOISE]),
        "names": cell("time [s]", "force [N]", "A01 [g]", "A02 [mm/s²]"),
    },
    "struct": {"run_1": {"data": NOISE, "names": NAMES, "units": UNITS, "time": TIME_S}},
    "struct beside a rate": {"run_1": {**SINGLY, "units": BY_NAME}, "Fs": RATE_HZ},
    "struct in a struct": {"a": {"b": {**SINGLY, "fs": RATE_HZ, "units": BY_NAME}}},
}


@pytest.mark.parametrize("write", WRITERS)
@pytest.mark.parametrize("layout", SAME)
def test_layouts_of_one_recording(tmp_path, write, layout):
    write(tmp_path / "a.mat", SAME[layout])
    found = read_file(tmp_path / "a.mat")
    assert sorted(found.recording.names) == ["A01", "A02", "force"]  # 7.3 sorts variables by name
    assert found.recording.sampling_rate_hz == pytest.approx(RATE_HZ, rel=1e-12)
    channels = {each.name: each for each in found.recording.channels}
    expected = {"force": ("force", 1.0), "A01": ("acceleration", 9.80665)}
    expected["A02"] = ("acceleration", 1e-3)
    for name, (quantity, factor) in expected.items():
        assert channels[name].quantity == quantity
        np.testing.assert_allclose(channels[name].block(0, N), factor * SINGLY[name], rtol=1e-15)
    assert not any(each.samples.flags.writeable for each in found.recording.channels)
    assert found.findings == ()


@pytest.mark.parametrize("dtype", ["f4", "f8", "i2", "u1", "i4", "u4", "i8"])
@pytest.mark.parametrize("compressed", [False, True])
def test_numbers_keep_their_precision(tmp_path, dtype, compressed):
    samples = (NOISE[:, 0] * 20 + 100).astype(dtype)
    scipy.io.savemat(tmp_path / "a.mat", {"a": samples}, do_compression=compressed)
    found = read_file(tmp_path / "a.mat").recording.channels[0].samples
    assert found.dtype == samples.dtype
    np.testing.assert_array_equal(found, samples)


@pytest.mark.parametrize("write", [write_5, write_73])
def test_uncompressed_samples_stay_on_disk(tmp_path, write):
    write(tmp_path / "a.mat", SAME["matrix"])
    samples = read_file(tmp_path / "a.mat").recording.channels[1].samples
    assert not samples.flags.owndata
    assert samples.dtype.itemsize == 8


@pytest.mark.parametrize("write", WRITERS)
def test_what_is_no_signal_is_left_out_and_named(tmp_path, write):
    extra = {"note": "tread worn", "temperature": 21.5, "empty": ""}
    write(tmp_path / "a.mat", {**SINGLY, "fs": RATE_HZ, **extra})
    found = read_file(tmp_path / "a.mat")
    assert set(found.recording.names) == set(SINGLY)
    assert {each.channel for each in found.findings} == set(extra)
    assert {each.check for each in found.findings} == {"content"}


def test_character_matrices_hold_names(tmp_path):
    names = np.array(["force", "A01", "A02"])
    scipy.io.savemat(tmp_path / "a.mat", {"data": NOISE, "names": names, "units": "N"})
    channels = read_file(tmp_path / "a.mat").recording.channels
    assert [(each.name, each.unit) for each in channels] == [(name, "N") for name in names]


def test_a_matrix_without_names(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"data": NOISE.T})
    recording = read_file(tmp_path / "a.mat").recording
    assert recording.names == ("channel 1", "channel 2", "channel 3")
    assert np.isnan(recording.sampling_rate_hz)


COUNTS = np.arange(N, dtype="i2") % 7
AMBIGUOUS = {
    "two matrices": ({"a": NOISE, "b": NOISE}, "matrices a, b"),
    "matrix and vector": ({"a": NOISE, "b": TIME_S + 1}, "matrices a and vectors b"),
    "two structs": ({"a": SINGLY, "b": SINGLY}, "the same channels in structs a, b"),
    "names that do not fit": ({"a": NOISE, "names": cell("x", "y")}, "50 × 3 and 2 names"),
    "square": ({"a": NOISE[:3], "names": NAMES}, "3 × 3 and 3 names"),
    "units in a list": ({**SINGLY, "units": UNITS}, "a list of 3 units beside the vectors"),
    "units that do not fit": ({"a": NOISE, "units": cell("g", "N")}, "2 units for 3 channels"),
    "lengths": ({"a": NOISE[:, 0], "b": NOISE[1:, 0]}, "50 samples of 'a', 49 of 'b'"),
    "two rates": ({**SINGLY, "fs": 2.0, "dt": 1.0}, "2 Hz by 'fs', 1 Hz by 'dt'"),
    "rate against time": ({**SINGLY, "fs": 2.0, "t": TIME_S}, "2 Hz by 'fs', 2000 Hz"),
    "no rate": ({**SINGLY, "fs": 0.0}, "one positive number"),
    "a rate in words": ({**SINGLY, "fs": "high"}, "one positive number"),
    "nothing": ({"fs": 2.0, "note": "x"}, "note (text)"),
    "complex": ({"H": NOISE + 1j}, "(complex numbers); FRFs need their frequencies"),
    "logical": ({"on": NOISE > 0}, "on (logical values)"),
    "spectra": ({"H": NOISE, "df": 0.5}, "df and neither a rate nor frequencies"),
    "integers": ({"a": {"y": COUNTS, "gain": 0.5}, "b": {"y": COUNTS}}, "gain of integers"),
    "struct array": ({"run": [{"a": 1.0}, {"a": 2.0}]}, "no vectors"),
}


@pytest.mark.parametrize(("variables", "message"), AMBIGUOUS.values(), ids=AMBIGUOUS)
def test_what_can_be_understood_in_two_ways_is_named(tmp_path, variables, message):
    scipy.io.savemat(tmp_path / "a.mat", variables)
    with pytest.raises(RecordingFormatError, match=re.escape(message)) as caught:
        read_file(tmp_path / "a.mat")
    assert "a.mat" in caught.value.where


HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"


def element(kind, content):
    padding = b"" if kind == 15 else bytes(-len(content) % 8)
    return struct.pack("<II", kind, len(content)) + content + padding


def array(kind, shape, *rest, name=b"x"):
    flags = element(6, struct.pack("<II", kind, 0))
    dimensions = element(5, struct.pack(f"<{len(shape)}i", *shape))
    return element(14, flags + dimensions + element(1, name) + b"".join(rest))


def nested(depth):
    inner = array(6, (1, 1), element(9, bytes(8)))
    for _ in range(depth):
        inner = array(1, (1, 1), inner)
    return inner


TWO = element(9, struct.pack("<2d", 1, 2))
MALFORMED = {
    "empty": (b"", "the file is empty"),
    "text": (b"time,A01\n" * 20, "begins with b'time,A01"),
    "level 4": (struct.pack("<5i", 0, 2, 1, 0, 2) + bytes(200), "level 5 or 7.3"),
    "an HDF5 signature alone": (b"\x89HDF\r\n\x1a\n" + bytes(500), "MATLAB file of level 7.3"),
    "claims 10^12 numbers": (HEADER + array(6, (10**6, 10**6), TWO), "2 numbers in an array"),
    "claims 10^9 cells": (HEADER + array(1, (10**9, 1)), "0 of 1000000000 cells"),
    "negative size": (HEADER + array(6, (-1, -2), TWO), "dimensions (-1, -2)"),
    "no class": (HEADER + array(44, (1, 2), TWO), "class 44"),
    "nested without end": (HEADER + nested(40), "nested more than"),
    "two of a name": (HEADER + array(6, (1, 2), TWO) * 2, "two variables 'x'"),
    "odd bytes": (HEADER + array(6, (1, 2), element(9, b"12345")), "5 bytes of numbers of 8"),
    "element beyond the end": (HEADER + struct.pack("<II", 14, 2**31), "0 of 2147483648 bytes"),
    "not packed": (HEADER + element(15, b"no zlib stream"), "a compressed variable"),
    "claims 2 GB packed": (
        HEADER + element(15, zlib.compress(struct.pack("<II", 14, 2**31))),
        "2147483648 bytes of numbers claimed",
    ),
    "silence of 40 MB": (
        HEADER
        + element(15, zlib.compress(array(9, (1, 40_000_000), element(1, bytes(40_000_000))))),
        "bytes of numbers claimed by a file of",
    ),
}


@pytest.mark.parametrize(("content", "message"), MALFORMED.values(), ids=MALFORMED)
def test_malformed_files_are_named(tmp_path, content, message):
    (tmp_path / "a.mat").write_bytes(content)
    with pytest.raises(RecordingFormatError, match=re.escape(message)) as caught:
        read_file(tmp_path / "a.mat")
    assert "a.mat" in caught.value.where


def test_big_endian_and_what_matlab_keeps_for_itself(tmp_path):
    words = HEADER[:126] + b"MI"
    flags = struct.pack(">II4x4x", 6, 8)[:8] + struct.pack(">II", 6, 0)
    shape = struct.pack(">II2i", 5, 8, 1, 2)
    name = struct.pack(">HH4s", 1, 1, b"a")
    body = flags + shape + name + struct.pack(">II2d", 9, 16, 1, -2)
    unnamed = flags + shape + struct.pack(">II", 1, 0) + struct.pack(">II2d", 9, 16, 1, -2)
    content = words + b"".join(struct.pack(">II", 14, len(each)) + each for each in (body, unnamed))
    (tmp_path / "a.mat").write_bytes(content)
    recording = read_file(tmp_path / "a.mat").recording
    assert recording.names == ("a",)
    np.testing.assert_array_equal(recording.block(0, 2), [[1, -2]])


@pytest.mark.parametrize("write", WRITERS)
def test_every_truncation_is_named(tmp_path, write):
    write(tmp_path / "a.mat", {"data": NOISE, "names": NAMES})
    # A file that ends with a variable is whole; two variables, cut between them, still hold data.
    whole = (tmp_path / "a.mat").read_bytes()
    first = 136 + struct.unpack("<I", whole[132:136])[0]
    if write in (write_73, write_73_compressed):
        assert_truncations_named(tmp_path / "a.mat", read_file, step=331)
    else:
        (tmp_path / "a.mat").write_bytes(whole[:first])
        assert_truncations_named(tmp_path / "a.mat", read_file, step=61)


@pytest.mark.parametrize("write", WRITERS)
@settings(max_examples=40)
@given(data=st.data())
def test_no_damage_escapes_as_another_exception(tmp_path_factory, write, data):
    path = tmp_path_factory.mktemp("damage") / "a.mat"
    write(path, SAME["struct"])
    assert_no_other_exception(path, read_file, lambda *ends: data.draw(st.integers(*ends)))


_FORCE, _MOTION = np.random.default_rng(8).standard_normal((2, 64))


@pytest.mark.parametrize("apart", [True, False])
def test_times_of_dewesoft_belong_to_their_channels(tmp_path, apart):
    channels = {"Data1_AI_1": _FORCE, "Data1_AI_2": _MOTION}
    times = {"Data1_time_AI_1": np.arange(64) / 512, "Data1_time_AI_2": (np.arange(64) + 4) / 512}
    mixed = dict(sorted((times | channels).items()))
    scipy.io.savemat(tmp_path / "a.mat", times | channels if apart else mixed)
    found = read_file(tmp_path / "a.mat").recording
    assert found.names == ("Data1_AI_1", "Data1_AI_2")
    np.testing.assert_array_equal(found.channels[0].samples, _FORCE[4:])
    np.testing.assert_array_equal(found.channels[1].samples, _MOTION[:60])


FORCE, SENSOR = NOISE[:, 0], NOISE[:, 1]
STRUCTS = {
    "times and units": {
        "force": {"time": TIME_S, "data": FORCE, "Units": "N"},
        "A01": {"time": TIME_S, "data": SENSOR, "Units": "g"},
    },
    "names in headers": {
        "File_Header": {"SampleFrequency": RATE_HZ},
        "Channel_1_Header": {"SignalName": "force", "Unit": "N"},
        "Channel_1_Data": FORCE,
        "Channel_2_Header": {"SignalName": "A01", "Unit": "g"},
        "Channel_2_Data": SENSOR,
    },
    "x and y": {
        "t1": {"X": TIME_S, "Y": FORCE, "XUnit": "s", "YUnit": "N", "Name": "force"},
        "t2": {"X": TIME_S, "Y": SENSOR, "XUnit": "s", "YUnit": "g", "Name": "A01"},
    },
    "x in ms": {
        "t1": {"X": 1e3 * TIME_S, "Y": FORCE, "XUnit": "ms", "YUnit": "N", "Name": "force"},
        "t2": {"X": 1e3 * TIME_S, "Y": SENSOR, "XUnit": "ms", "YUnit": "g", "Name": "A01"},
    },
    "a time in the unit of its name": {
        "time": 1e3 * TIME_S,
        "force": FORCE,
        "A01": SENSOR,
        "units": {"time": "ms", "force": "N", "A01": "g"},
    },
    "an array": {
        "fs": RATE_HZ,
        "channel": [
            {"name": "force", "unit": "N", "y": FORCE},
            {"name": "A01", "unit": "g", "y": SENSOR},
        ],
    },
    "nested with a time": {
        "run": {
            "time": TIME_S,
            "force": {"unit": "N", "values": FORCE},
            "A01": {"unit": "g", "values": SENSOR},
        }
    },
    "nested in channels with a time": {
        "run": {
            "note": "x",
            "channels": {
                "time": TIME_S,
                "force": {"unit": "N", "values": FORCE},
                "A01": {"unit": "g", "values": SENSOR},
            },
        }
    },
    "nested": {
        "run": {
            "fs": RATE_HZ,
            "force": {"unit": "N", "values": FORCE, "t0": 5.0},
            "A01": {"unit": "g", "values": SENSOR, "t0": 5.0},
        }
    },
}


@pytest.mark.parametrize("variables", STRUCTS.values(), ids=STRUCTS)
@pytest.mark.parametrize("write", [write_5, write_73])
def test_a_struct_for_each_channel(tmp_path, write, variables):
    write(tmp_path / "a.mat", variables)
    recording = read_file(tmp_path / "a.mat").recording
    assert recording.sampling_rate_hz == RATE_HZ
    channels = {each.name: each for each in recording.channels}
    assert {name: each.quantity for name, each in channels.items()} == {
        "force": "force",
        "A01": "acceleration",
    }
    np.testing.assert_array_equal(channels["force"].block(0, N), FORCE)
    np.testing.assert_array_equal(channels["A01"].block(0, N), 9.80665 * SENSOR)


@pytest.mark.parametrize("start", ["t0", "time"])
def test_structs_that_start_apart_are_aligned(tmp_path, start):
    late = {"t0": 5 / RATE_HZ} if start == "t0" else {"time": TIME_S + 5 / RATE_HZ}
    first = {"t0": 0.0} if start == "t0" else {"time": TIME_S}
    structs = {"force": {"y": FORCE, **first}, "A01": {"y": SENSOR, **late}, "fs": RATE_HZ}
    scipy.io.savemat(tmp_path / "a.mat", structs)
    recording = read_file(tmp_path / "a.mat").recording
    assert [each.samples[0] for each in recording.channels] == [FORCE[5], SENSOR[0]]
    assert recording.n_samples == N - 5


def test_frfs_in_structs_share_their_frequencies(tmp_path):
    lines, values = np.arange(1, N + 1), NOISE[:, 0] + 1j * NOISE[:, 1]
    structs = {"H11": {"f": lines, "H": values}, "H21": {"f": lines, "H": 2 * values}}
    scipy.io.savemat(tmp_path / "a.mat", structs)
    found = read_file(tmp_path / "a.mat")
    assert found.frf_names == ("H11", "H21")
    np.testing.assert_array_equal(found.frf.values, [values, 2 * values])


@pytest.mark.parametrize(
    "slow",
    [
        {"window": np.array([1.0, 2.0])},
        {"Data1_T": np.arange(5.0), "Data1_time_T": np.arange(5.0)},
        {"temperature": {"fs": 200.0, "data": np.arange(5.0), "unit": "°C"}},
    ],
    ids=lambda each: next(iter(each)),
)
def test_slow_channels_and_a_few_values_are_left_out(tmp_path, slow):
    scipy.io.savemat(tmp_path / "a.mat", {**SINGLY, "fs": RATE_HZ, **slow})
    found = read_file(tmp_path / "a.mat")
    assert (found.recording.names, found.recording.sampling_rate_hz) == (tuple(SINGLY), RATE_HZ)
    assert [each.channel for each in found.findings] == list(slow)


def test_integers_beside_a_scale_are_refused(tmp_path):
    counts = (1e3 * FORCE).astype("i2")
    scipy.io.savemat(tmp_path / "a.mat", {"fs": RATE_HZ, "force": counts, "scale": 1e-3})
    with pytest.raises(RecordingFormatError, match="scale of integers"):
        read_file(tmp_path / "a.mat")


def test_a_struct_may_have_no_fields(tmp_path):
    path = tmp_path / "run.mat"
    content = {"force": NOISE[:, 0], "fs": 512.0, "about": {"terms": {}, "axis": "Z"}}
    scipy.io.savemat(path, content)
    recording = read_file(path).recording
    assert [each.name for each in recording.channels] == ["force"]
