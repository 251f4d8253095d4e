"""TDMS files: groups, units, scaling, segments, and faults."""

import re
import struct
import sys

import nptdms
import numpy as np
import pytest
from damage import assert_no_other_exception, assert_truncations_named
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import RecordingFormatError
from ema.io.formats import read_file

RATE_HZ = 2000.0
FORCE = np.sin(np.arange(60.0))
COUNTS = np.arange(-30, 30, dtype=np.int16)
LINEAR = {
    "NI_Number_Of_Scales": 1,
    "NI_Scaling_Status": "unscaled",
    "NI_Scale[0]_Scale_Type": "Linear",
    "NI_Scale[0]_Linear_Slope": 0.25,
    "NI_Scale[0]_Linear_Y_Intercept": 3.0,
    "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
}


def channel(name, samples, group="run", unit="g", step=1 / RATE_HZ, **properties):
    stated = {"unit_string": unit, "wf_increment": step, **properties}
    return nptdms.ChannelObject(group, name, samples, properties=stated)


def write(path, *segments):
    with nptdms.TdmsWriter(path) as file:
        for segment in segments:
            file.write_segment(segment)
    return path


def plain(path):
    return write(path, [channel("force", FORCE, unit="N"), channel("A01", COUNTS)])


def test_channels_units_and_rate(tmp_path):
    found = read_file(plain(tmp_path / "a.tdms"))
    assert found.recording.names == ("force", "A01")
    assert [each.quantity for each in found.recording.channels] == ["force", "acceleration"]
    assert found.recording.sampling_rate_hz == RATE_HZ
    assert found.findings == ()
    np.testing.assert_allclose(found.recording.block(0, 60), [FORCE, 9.80665 * COUNTS], rtol=1e-15)


@pytest.mark.parametrize("cuts", [(), (20, 40), (1,)])
def test_segments_are_joined(tmp_path, cuts):
    pieces = zip(np.split(FORCE, cuts), np.split(COUNTS, cuts), strict=True)
    segments = [[channel("force", force), channel("A01", counts)] for force, counts in pieces]
    found = read_file(write(tmp_path / "a.tdms", *segments)).recording
    np.testing.assert_array_equal(found.channels[0].samples, FORCE)
    np.testing.assert_array_equal(found.channels[1].samples, COUNTS)


def test_scaling_is_applied(tmp_path):
    found = read_file(write(tmp_path / "a.tdms", [channel("A01", COUNTS, unit="N", **LINEAR)]))
    samples = found.recording.channels[0].samples
    np.testing.assert_array_equal(samples, 0.25 * COUNTS + 3.0)
    assert samples.dtype == np.float32  # 16 bit fit


@pytest.mark.parametrize("dtype", ["i1", "u2", "i4", "u8", "f4", "f8"])
def test_types_of_numbers(tmp_path, dtype):
    samples = (10 * FORCE + 20).astype(dtype)
    found = read_file(write(tmp_path / "a.tdms", [channel("a", samples)])).recording.channels[0]
    assert found.samples.dtype == samples.dtype
    np.testing.assert_array_equal(found.samples, samples)


def test_names_that_repeat_get_their_group(tmp_path):
    objects = [channel("A01", FORCE, "left"), channel("A01", FORCE, "right"), channel("B", FORCE)]
    assert read_file(write(tmp_path / "a.tdms", objects)).recording.names == (
        "left/A01",
        "right/A01",
        "B",
    )


def test_a_time_channel_gives_the_rate(tmp_path):
    time = nptdms.ChannelObject("run", "Time", np.arange(60) / RATE_HZ)
    found = read_file(
        write(tmp_path / "a.tdms", [time, channel("A01 [g]", FORCE, unit="", step=0)])
    )
    assert found.recording.sampling_rate_hz == RATE_HZ
    assert [(each.name, each.unit) for each in found.recording.channels] == [("A01", "g")]


def test_without_a_rate_it_is_unknown(tmp_path):
    bare = nptdms.ChannelObject("run", "A01", FORCE)
    assert np.isnan(read_file(write(tmp_path / "a.tdms", [bare])).recording.sampling_rate_hz)


def test_texts_and_empty_channels_are_left_out(tmp_path):
    notes = nptdms.ChannelObject("run", "notes", np.array(["a", "b"]))
    empty = nptdms.ChannelObject("run", "spare", np.zeros(0))
    found = read_file(write(tmp_path / "a.tdms", [notes, empty, channel("A01", FORCE)]))
    assert found.recording.names == ("A01",)
    assert {each.channel for each in found.findings} == {"notes", "spare"}


def segment(size, tag=b"TDSm"):
    return tag + struct.pack("<IIQQ", 0, 4713, size, 0)


BY_TYPE = {
    "two rates": (
        [channel("a", FORCE, "slow", step=0.5), channel("b", FORCE, "fast", step=0.25)],
        "4 Hz by 'fast/b/wf_increment', 2 Hz by 'slow/a/wf_increment'",
    ),
    "two lengths": ([channel("a", FORCE), channel("b", FORCE[:-1])], "60 samples of 'a', 59"),
    "negative step": ([channel("a", FORCE, step=-0.5)], "one positive number"),
    "scales": ([channel("a", COUNTS, **{**LINEAR, "NI_Number_Of_Scales": 10**9})], "is 1000000000"),
    "no numbers": ([nptdms.ChannelObject("run", "a", np.array(["x"]))], "columns none"),
}


@pytest.mark.parametrize(("objects", "message"), BY_TYPE.values(), ids=BY_TYPE)
def test_what_does_not_belong_together_is_named(tmp_path, objects, message):
    with pytest.raises(RecordingFormatError, match=re.escape(message)):
        read_file(write(tmp_path / "a.tdms", objects))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"TDS", "the file ends 25 bytes before"),
        (b"RIFF" + bytes(60), "begins with b'TDSm'"),
        (segment(0xFFFFFFFFFFFFFFFF), "cut short or was not closed"),
        (segment(10**12), "the file ends 1000000000000 bytes before"),
        (segment(0) + b"\0\0", "begins with b'TDSm'"),
    ],
)
def test_faults_are_named(tmp_path, content, message):
    (tmp_path / "a.tdms").write_bytes(content)
    with pytest.raises(RecordingFormatError, match=re.escape(message)) as caught:
        read_file(tmp_path / "a.tdms")
    assert "a.tdms" in caught.value.where


def test_every_truncation_is_named(tmp_path):
    assert_truncations_named(plain(tmp_path / "a.tdms"), read_file, step=23)


def test_an_index_of_another_file_is_not_believed(tmp_path):
    path = plain(tmp_path / "a.tdms")
    (tmp_path / "a.tdms_index").write_bytes(b"TDSh" + bytes(100))
    np.testing.assert_array_equal(read_file(path).recording.channels[0].samples, FORCE)


@given(st.data())
def test_no_damage_escapes_as_another_exception(tmp_path_factory, data):
    path = plain(tmp_path_factory.mktemp("damage") / "a.tdms")
    assert_no_other_exception(path, read_file, lambda *ends: data.draw(st.integers(*ends)))


def test_without_the_library_it_is_named(tmp_path, monkeypatch):
    path = plain(tmp_path / "a.tdms")
    monkeypatch.setitem(sys.modules, "nptdms", None)
    with pytest.raises(RecordingFormatError, match="pip install nptdms"):
        read_file(path)


def test_only_channels_over_time_are_read(tmp_path):
    spectrum = channel("PSD", FORCE, wf_xunit_string="Hz", wf_xname="Frequency")
    signal = channel("A01", FORCE, wf_xunit_string="s", wf_xname="Time")
    found = read_file(write(tmp_path / "a.tdms", [signal, spectrum]))
    assert found.recording.names == ("A01",)
    assert [each.channel for each in found.findings] == ["PSD"]
    angle = channel("A01", FORCE, wf_xunit_string="deg")
    for other, unit in ((spectrum, "Hz"), (angle, "deg")):
        with pytest.raises(RecordingFormatError, match=f"channels over {unit}"):
            read_file(write(tmp_path / "a.tdms", [other]))


def test_the_unit_of_the_axis_counts(tmp_path):
    late = {"wf_xunit_string": "ms", "step": 1e3 / RATE_HZ, "wf_start_offset": 4e3 / RATE_HZ}
    first = channel("force", FORCE, step=1e3 / RATE_HZ, wf_xunit_string="ms")
    found = read_file(write(tmp_path / "a.tdms", [first, channel("A01", FORCE, **late)])).recording
    assert found.sampling_rate_hz == RATE_HZ
    np.testing.assert_array_equal(found.channels[0].samples, FORCE[4:])
    np.testing.assert_array_equal(found.channels[1].samples, FORCE[:-4])


@pytest.mark.parametrize("step", [0, 1 / RATE_HZ])
def test_time_stamps_are_no_channel(tmp_path, step):
    since = (np.arange(60) * 1e6 / RATE_HZ).astype("timedelta64[us]")
    time = nptdms.ChannelObject("run", "Time", np.datetime64("2026-11-29T10:00:00") + since)
    found = read_file(write(tmp_path / "a.tdms", [time, channel("A01", FORCE, step=step)]))
    assert (found.recording.names, found.recording.sampling_rate_hz) == (("A01",), RATE_HZ)


def test_decimated_copies_of_a_single_channel_are_left_out(tmp_path):
    copy = channel("A01", FORCE[::10], group="decimated", step=10 / RATE_HZ)
    found = read_file(write(tmp_path / "a.tdms", [channel("A01", FORCE), copy])).recording
    assert (found.names, found.sampling_rate_hz, found.n_samples) == (("A01",), RATE_HZ, 60)
