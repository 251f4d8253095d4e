"""LabVIEW measurement files: headers, columns of time, comments, segments, and faults."""

import re
from pathlib import Path

import numpy as np
import pytest

import ema
from ema.core.errors import RecordingFormatError
from ema.io.text.lvm import read as read_lvm

MEASURED = Path(__file__).parents[5] / "shared/data/real/beam_impact/acceleration.lvm"
DATE = "2026/03/04"
ROWS = [(0.5, -1.25), (1.5, 2.0), (-3.0, 0.125), (4.0, 5.0)]


def general(x_columns="No", decimal=".", separator="Tab"):
    return (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\n"
        f"Separator\t{separator}\nDecimal_Separator\t{decimal}\nMulti_Headings\tYes\n"
        f"X_Columns\t{x_columns}\nTime_Pref\tRelative\nOperator\tMia\nDate\t{DATE}\n"
        "***End_of_Header***\t\n\t\n"
    )


def segment(rows, names=("A01", "force"), units="g\tN", samples=4, delta="0.0005", x="No"):
    heading = "".join(f"X_Value\t{name}\t" for name in names)
    if x != "Multi":
        heading = "X_Value\t" + "\t".join(names) + "\t"
    return (
        f"Channels\t{len(names)}\t\t\n"
        f"Samples\t{samples}\t{samples}\t\n"
        f"Date\t{DATE}\t{DATE}\t\n"
        f"Y_Unit_Label\t{units}\t\n"
        "X_Dimension\tTime\tTime\t\n"
        "X0\t0.0\t0.0\t\n"
        f"Delta_X\t{delta}\t{delta}\t\n"
        "***End_of_Header***\t\t\t\n"
        f"{heading}Comment\n" + "".join(f"{row}\n" for row in rows)
    )


NO = [f"\t{a}\t{f}" for a, f in ROWS]
ONE = [f"{k / 2000}\t{a}\t{f}" for k, (a, f) in enumerate(ROWS)]
MULTI = [f"{k / 2000}\t{a}\t{k / 2000}\t{f}" for k, (a, f) in enumerate(ROWS)]
PLAIN = general() + segment(NO)


def spread(text):
    """With an empty place in the header above each further column of time, as LabVIEW writes."""
    header, end, rows = text.partition("***End_of_Header***")
    return re.sub(r"(?m)^((?!Channels)\w+\t[^\t\n]*\t)([^\t\n]+)", r"\1\t\2", header) + end + rows


def read(tmp_path, text):
    path = tmp_path / "a.lvm"
    path.write_bytes(text.encode("cp1252"))
    return read_lvm(path)


@pytest.mark.parametrize(
    "text",
    [
        PLAIN,
        PLAIN.replace("\n", "\r\n"),
        PLAIN.replace(".", ","),
        PLAIN.replace("\t", ",").replace("Tab", "Comma"),
        PLAIN.rstrip("\n"),
        general("One") + segment(ONE),
        general("Multi") + segment(MULTI, x="Multi"),
        general("Multi") + spread(segment(MULTI, x="Multi")),
        general("One") + segment(ONE).replace("Delta_X", "Unknown"),
        general() + segment([NO[0] + "\tstarted, here\tor there", NO[1], NO[2] + "\t", NO[3]]),
        general() + segment([f"{row}\t" for row in NO]),
        general() + "***Start_Special***\t\nChannels\t9\n***End_Special***\n" + segment(NO),
    ],
)
def test_forms_of_one_recording(tmp_path, text):
    found = read(tmp_path, text)
    recording = found.recording
    assert recording.names == ("A01", "force")
    assert [channel.unit for channel in recording.channels] == ["g", "N"]
    assert recording.sampling_rate_hz == 2000.0
    samples = np.stack([channel.samples for channel in recording.channels])
    np.testing.assert_array_equal(samples, np.transpose(ROWS))
    assert found.findings == ()


@pytest.mark.parametrize("rows", ["NO", "MULTI"])
def test_times_of_day_of_channels_are_starts(tmp_path, rows):
    """Two samples apart at 2000 Hz; X0 is the same."""
    form, lines = ("No", NO) if rows == "NO" else ("Multi", MULTI)
    header = segment(lines) if rows == "NO" else segment(lines, x="Multi")
    clocks = "Time\t23:59:59.9995\t00:00:00.0005\n"
    text = general(form) + header.replace("X_Dimension", clocks + "X_Dimension", 1)
    found = read(tmp_path, text).recording
    late, early = (np.array([row[k] for row in ROWS]) for k in (0, 1))
    np.testing.assert_array_equal(found.channels[0].samples, late[2:])
    np.testing.assert_array_equal(found.channels[1].samples, early[:-2])


def test_later_segments_are_left_out_and_said_so(tmp_path):
    found = read(tmp_path, PLAIN + "\t\t\n\n" + segment(NO))
    assert found.recording.n_samples == 4
    assert [(each.check, each.verdict) for each in found.findings] == [("segments", "warning")]


def test_a_shorter_channel_lacks_samples(tmp_path):
    rows = [*NO[:3], "\t4.0\t"]
    text = general() + segment(rows).replace("Samples\t4\t4", "Samples\t4\t3")
    found = read(tmp_path, text)
    assert np.isnan(found.recording.channels[1].samples[3])
    assert [(each.channel, each.check) for each in found.findings] == [("force", "missing samples")]


def test_without_steps_and_times_there_is_no_rate(tmp_path):
    found = read(tmp_path, PLAIN.replace("Delta_X", "Unknown"))
    assert np.isnan(found.recording.sampling_rate_hz)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time\ta\n0\t1\n", "begins with 'LabVIEW Measurement'"),
        (general(), "1 lines ***End_of_Header***"),
        (general() + segment([]), "blank rows only"),
        (
            general() + segment(NO[:3]),
            "3 rows of numbers, 4 samples by the header; the file is cut",
        ),
        (PLAIN[:-4], "line 25: the last row ends in ''"),
        (PLAIN[:-5], "line 25: 2 cells, 3 columns"),
        (PLAIN.replace("Tab", "Star"), "Separator: 'star'"),
        (PLAIN.replace("Decimal_Separator\t.", "Decimal_Separator\t;"), "point or comma"),
        (PLAIN.replace("X_Columns\tNo", "X_Columns\tTwo"), "no, one or multi"),
        (PLAIN.replace("Channels\t2", "Channels\t7"), "Channels: '7'; "),
        (PLAIN.replace("Channels\t2", "Channels\t1000000000000"), "Channels: "),
        (PLAIN.replace("Samples\t4", "Samples\tall"), "Samples: "),
        (PLAIN.replace("Dimension\tTime", "Dimension\tFrequency"), "X_Dimension: Frequency, Time"),
        (PLAIN.replace("Delta_X\t0.0005\t", "Delta_X\t0.001\t"), "Delta_X: "),
        (PLAIN.replace("Delta_X\t0.0005", "Delta_X\t0"), "time step"),
        (PLAIN.replace("Delta_X\t0.0005", "Delta_X\tfast"), "time step"),
        (general("One") + segment(ONE, delta="0.001"), "2000 Hz by column"),
        (
            general("Multi") + segment([*MULTI[:3], "0.0015\t1\t0.0025\t2"], x="Multi"),
            "time is not at equal steps",
        ),
        (PLAIN.replace("\t4.0", "\tfour"), "line 25, column 'A01': 'four'"),
    ],
)
def test_faults_are_named(tmp_path, text, message):
    with pytest.raises(RecordingFormatError) as caught:
        read(tmp_path, text)
    assert message in str(caught.value)
    assert caught.value.where.startswith("a.lvm")


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured impact is not at hand")
def test_a_measured_impact():
    campaign = ema.read_campaign(MEASURED)
    (run,) = campaign.runs
    assert run.recording.sampling_rate_hz == 50_000.0
    assert run.recording.n_samples == 50_030
    assert run.force.name == "Force (Trigger)"
    assert run.force.unit == "Newtons"
    assert run.responses[0].channel.name == "Acceleration (Trigger)"
    assert run.responses[0].channel.unit == "g"
    assert run.responses[0].channel.samples[0] == -0.007387
    assert run.force.samples[-1] == 0.298803
    assert [finding.check for finding in campaign.findings] == ["node"]


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured impact is not at hand")
def test_modes_of_a_measured_impact():
    campaign = ema.read_campaign(MEASURED)
    frf = ema.estimate_frf(campaign, ema.Processing(averages=1, window="boxcar"))
    modes = ema.identify_modes(frf, band_hz=(300.0, 10_000.0), max_order=24).model.modes
    found_hz = np.array([mode.frequency_hz for mode in modes])
    for known_hz in (695.8, 1898.0, 3671.3, 5975.1, 8746.3):
        assert np.min(np.abs(found_hz - known_hz)) < 0.005 * known_hz
