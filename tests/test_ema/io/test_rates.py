"""Sampling rates of printed steps and rounded stamps; starts of channels; columns that count."""

import h5py
import numpy as np
import pytest
import scipy.io

from ema.core.errors import InputError
from ema.core.finding import Check, Verdict
from ema.io.formats import read_file
from ema.io.rates import exact_rate, rate_of_stamps, rate_of_step

NOISE = np.random.default_rng(5).standard_normal((4096, 2))


@pytest.mark.parametrize("hz", [512, 1000, 1024, 2000, 2048, 2560, 5120, 8192, 12800, 25600, 65536])
def test_six_decimals_of_a_step_give_the_rate_of_the_hardware(hz):
    rate = rate_of_step(f"{1 / hz:.6f}", "Delta_X")
    assert rate.hz == hz
    assert rate.allows(hz)


def test_rates_that_look_alike_are_doubted():
    rate = rate_of_step(f"{1 / 51200:.6f}", "Delta_X")  # as it would print 50 kHz
    assert rate.allows(51200.0)
    assert not rate.is_sure


@pytest.mark.parametrize("text", ["0.002", "0.0005", "3.90625E-05"])
def test_a_step_whose_inverse_is_such_a_rate_is_exact(text):
    rate = rate_of_step(text, "dt")
    assert not rate.is_open
    assert rate.hz == pytest.approx(1 / float(text), rel=1e-12)


@pytest.mark.parametrize("hz", [512.0, 2048.0, 2560.0, 4096.0])
@pytest.mark.parametrize("decimals", [3, 4, 6])
@pytest.mark.parametrize("rounding", [np.round, lambda x, n: np.floor(x * 10**n) / 10**n])
def test_stamps_of_few_decimals(hz, decimals, rounding):
    stamps = rounding(np.arange(3000) / hz, decimals)
    assert rate_of_stamps(stamps, "").hz == hz


@pytest.mark.parametrize("dropped", [50, 1500, 2900])
def test_a_dropped_sample_shows_in_rounded_stamps(dropped):
    stamps = np.delete(np.round(np.arange(3000) / 2048.0, 4), dropped)
    assert rate_of_stamps(stamps, "") is None


def csv(tmp_path, header, columns, name="a.csv"):
    path = tmp_path / name
    rows = "\n".join(",".join(f"{x}" for x in row) for row in zip(*columns, strict=True))
    path.write_text(f"{header}\n{rows}\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("unit", "factor"), [("ms", 1e3), ("µs", 1e6), ("us", 1e6), ("min", 1 / 60), ("h", 1 / 3600)]
)
def test_units_of_a_column_of_time(tmp_path, unit, factor):
    stamps = [f"{factor * k / 512:.12g}" for k in range(400)]
    path = csv(tmp_path, f"time [{unit}],A [g]", (stamps, NOISE[:400, 0]))
    assert read_file(path).recording.sampling_rate_hz == 512.0


def test_an_unknown_unit_of_time_is_refused(tmp_path):
    path = csv(tmp_path, "time [tick],A [g]", (range(400), NOISE[:400, 0]))
    with pytest.raises(InputError, match="tick"):
        read_file(path)


@pytest.mark.parametrize("name", ["count", "Index", "N°"])
def test_a_column_that_counts_is_no_sensor(tmp_path, name):
    content = read_file(csv(tmp_path, f"{name},F [N]", (range(400), NOISE[:400, 0])))
    assert content.recording.names == ("F",)
    assert np.isnan(content.recording.sampling_rate_hz)
    assert [each.check for each in content.findings] == [Check.IGNORED]


@pytest.mark.parametrize(
    ("header", "first", "step", "hz"),
    [
        ("Date,F [N]", 20261129, 0, np.nan),  # all the same day
        ("Datum,F [N]", 46354.3, 1 / 86400 / 512, 512.0),  # as a spreadsheet counts
        ("Time,F [N]", 0.41, 1 / 86400 / 512, 512.0),  # its part of a day
    ],
)
def test_numbers_that_are_dates_are_no_sensors(tmp_path, header, first, step, hz):
    path = csv(tmp_path, header, (first + step * np.arange(400), NOISE[:400, 0]))
    content = read_file(path)
    assert content.recording.names == ("F",)
    np.testing.assert_equal(content.recording.sampling_rate_hz, hz)
    assert len(content.findings) == 1


def test_a_time_without_a_unit_that_nothing_is_recorded_at_is_refused(tmp_path):
    hours = 0.4 + np.arange(400) / 3600 / 512
    with pytest.raises(InputError, match=r"Write its unit"):
        read_file(csv(tmp_path, "Time,F [N]", (hours, NOISE[:400, 0])))


def test_a_spectrum_beside_a_recording_is_no_sensor(tmp_path):
    t, noise = np.arange(400) / 512, NOISE[:400]
    header = "time [s],A [g],{},Amplitude [g]"
    path = csv(tmp_path, header.format("Frequency [Hz]"), (t, noise[:, 0], 2 * t, noise[:, 1]))
    assert read_file(path).recording.names == ("A",)
    sweep = csv(tmp_path, header.format("f [Hz]"), (t, noise[:, 0], 20 + t, noise[:, 1]))
    assert read_file(sweep).recording.names == ("A", "Amplitude")


@pytest.mark.parametrize("names", [("X1", "X2"), ("X", "X"), ("time", "X2"), ("F_x", "A_x")])
def test_a_second_time_without_a_name_is_compared(tmp_path, names):
    t, noise = np.arange(400) / 512, NOISE[:400]
    header = f"{names[0]},F [N],{names[1]},A [g]"
    path = csv(tmp_path, header, (t, noise[:, 0], t / 2, noise[:, 1]))
    with pytest.raises(InputError, match=r"512 Hz by .*1024 Hz by"):
        read_file(path)
    late = read_file(csv(tmp_path, header, (t, noise[:, 0], t + 10 / 512, noise[:, 1])))
    np.testing.assert_array_equal(late.recording.channels[0].samples, noise[10:, 0])


@pytest.mark.parametrize("key", ["Start [s]", "Begin", "t_start", "First sample", "Start [ms]"])
def test_rows_of_starts(tmp_path, key):
    late = 10 / 512 * (1e3 if "ms" in key else 1.0)
    path = csv(tmp_path, f"{key},0,{late}\nfs,512\nF [N],A [g]", NOISE[:400].T)
    found = read_file(path).recording
    np.testing.assert_array_equal(found.channels[0].samples, NOISE[10:400, 0])


def test_delays_that_differ_are_refused(tmp_path):
    above = "Trigger delay [s],0,{}\nfs,512\nF [N],A [g]"
    with pytest.raises(InputError, match="either way"):
        read_file(csv(tmp_path, above.format(10 / 512), NOISE[:400].T))
    assert read_file(csv(tmp_path, above.format(0), NOISE[:400].T)).recording.n_samples == 400


@pytest.mark.parametrize(
    ("line", "hz"),
    [
        ("Sample rate: 2.05 kHz", 2048.0),
        ("Sample rate: 1706.7", 51200 / 30),
        ("Sample rate: 2050", 2050.0),
        ("Sample rate: 51.2 kHz", 51200.0),
        ("Sample rate: 2.0507 kHz", 2050.7),
        ("Sample rate: 7e3", 7000.0),
    ],
)
def test_a_printed_rate_is_an_interval(tmp_path, line, hz):
    recording = read_file(csv(tmp_path, f"{line}\nF [N],A [g]", NOISE.T)).recording
    assert recording.sampling_rate_hz == pytest.approx(hz, rel=1e-12)


@pytest.mark.parametrize(
    ("step", "hz"), [(0.000488, 2048.0), (1 / 2048, 2048.0), (0.0003, 1e4 / 3)]
)
def test_a_step_that_somebody_typed_is_an_interval(tmp_path, step, hz):
    scipy.io.savemat(tmp_path / "a.mat", {"dt": step, "F": NOISE[:, 0], "A": NOISE[:, 1]})
    found = read_file(tmp_path / "a.mat").recording
    assert found.sampling_rate_hz == pytest.approx(hz, rel=1e-12)


@pytest.mark.parametrize(
    "stated",
    [
        {"fs": 2.048, "fs_unit": "kHz"},
        {"fs": "2.048 kHz"},
        {"dt": 1e3 / 2048, "dtUnit": "ms"},
        {"fs": 2048.0, "fs_units": "Hz"},
    ],
)
def test_the_unit_of_a_rate_counts(tmp_path, stated):
    scipy.io.savemat(tmp_path / "a.mat", {**stated, "F": NOISE[:, 0], "A": NOISE[:, 1]})
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs.update(stated)
        file["F"], file["A"] = NOISE.T
    for name in ("a.mat", "a.h5"):
        found = read_file(tmp_path / name)
        assert found.recording.sampling_rate_hz == pytest.approx(2048, rel=1e-12)
        assert found.findings == ()
    scipy.io.savemat(tmp_path / "b.mat", {"fs": 2.0, "fs_unit": "furlong", "F": NOISE[:, 0]})
    with pytest.raises(InputError, match="furlong"):
        read_file(tmp_path / "b.mat")


def test_a_second_column_of_time_is_no_sensor(tmp_path):
    t = np.arange(400) / 512
    header, noise = "time [s],F [N],time [s],A [g]", NOISE[:400]
    recording = read_file(csv(tmp_path, header, (t, noise[:, 0], t, noise[:, 1]))).recording
    assert recording.names == ("F", "A")
    late = read_file(csv(tmp_path, header, (t, noise[:, 0], t + 10 / 512, noise[:, 1]), "b.csv"))
    np.testing.assert_array_equal(late.recording.channels[0].samples, noise[10:, 0])
    np.testing.assert_array_equal(late.recording.channels[1].samples, noise[:-10, 1])
    assert [each.check for each in late.findings] == [Check.START]


def test_channels_at_two_rates_or_between_samples_are_refused(tmp_path):
    t = np.arange(400) / 512
    header, noise = "time [s],F [N],time [s],A [g]", NOISE[:400]
    for other, message in ((t / 2, "1024 Hz"), (t + 10.4 / 512, "begins 0.0203125 s after")):
        with pytest.raises(InputError, match=message):
            read_file(csv(tmp_path, header, (t, noise[:, 0], other, noise[:, 1])))


def test_a_wide_range_is_said(tmp_path):
    path = csv(tmp_path, "dt = 0.000488\nF [N],A [g]", NOISE.T)
    content = read_file(path)
    (finding,) = content.findings
    assert (finding.check, finding.verdict) == (Check.SAMPLING_RATE, Verdict.OK)
    assert content.recording.sampling_rate_hz == 2048.0
    low, high = content.recording.rate_range_hz
    assert low < 2048 < 2050 < high


@pytest.mark.parametrize("line", ["Sampling rate [Hz],1e-320", "dt = 1e-320", "fs = 1e320"])
def test_no_rate_that_cannot_be_is_taken(tmp_path, line):
    recording = read_file(csv(tmp_path, f"{line}\nF [N],A [g]", NOISE.T)).recording
    assert np.isnan(recording.sampling_rate_hz)


def test_an_exact_rate_is_not_open():
    assert not exact_rate(2000.0).is_open
    assert exact_rate(2000.0).allows(2000.01)
    assert not exact_rate(2000.0).allows(2001.0)


@pytest.mark.parametrize("digits", [3, 4, 5, 6])
def test_stamps_of_few_significant_digits(digits):
    stamps = np.array([float(f"{k / 2048:.{digits}g}") for k in range(40_000)])
    rate = rate_of_stamps(stamps, "column 't'")
    assert rate.hz == 2048.0
    dropped = np.delete(stamps, 1000)
    assert digits < 5 or rate_of_stamps(dropped, "column 't'") is None
