"""Levels, clipping, gaps, dropouts and hum of signals whose truth is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.recording import ACCELERATION, FORCE, UNKNOWN, Channel
from ema.io.formats import read_file
from ema.signals import signal_checks as signal_summary
from ema.signals.clipping_and_hum import Plateaus
from ema.signals.signal_checks import signal_findings, summarise

RATE_HZ = 2000.0


def channel_of(samples, quantity=ACCELERATION, **more):
    return Channel("A01", quantity, "m/s^2", np.asarray(samples), **more)


def summary_of(samples, rate_hz=RATE_HZ, **more):
    return summarise(channel_of(samples, **more), rate_hz)


def checks(samples, rate_hz=RATE_HZ, **more):
    channel = channel_of(samples, **more)
    found = signal_findings(summarise(channel, rate_hz), "run.csv", channel)
    return {finding.check: finding.detail for finding in found}


def noise(n=40_000, seed=1, smooth=1):
    """Gaussian noise of rms 1; band-limited by a moving mean where `smooth` is more than 1."""
    samples = np.random.default_rng(seed).normal(size=n + smooth - 1)
    samples = np.convolve(samples, np.ones(smooth), "valid")
    return samples / samples.std()


def time(duration_s=20.0, rate_hz=RATE_HZ):
    return np.arange(round(duration_s * rate_hz)) / rate_hz


def test_a_sine_on_a_constant():
    found = summary_of(50 + 3 * np.sin(2 * np.pi * 25 * time()))
    assert found.mean == pytest.approx(50, rel=1e-12)
    assert found.rms_ac == pytest.approx(3 / np.sqrt(2), rel=1e-12)
    assert found.rms == pytest.approx(np.sqrt(2500 + 4.5), rel=1e-12)
    assert found.peak == pytest.approx(53)
    assert found.crest_factor == pytest.approx(np.sqrt(2), rel=1e-12)
    assert found.clipped_share == 0


def test_levels_are_in_si():
    found = summary_of([1, -3, 1, 1], scale_to_si=-9.80665)
    assert found.peak == pytest.approx(29.41995)
    assert found.highest == pytest.approx(29.41995)
    assert found.rms_ac == pytest.approx(9.80665 * np.sqrt(3))


def test_small_waves_on_a_large_constant_keep_their_digits():
    found = summary_of(1e6 + 1e-3 * np.sin(2 * np.pi * 10 * time()))
    assert found.rms_ac == pytest.approx(1e-3 / np.sqrt(2), rel=1e-6)


@given(
    st.lists(
        st.sampled_from([0.0, 1.0, 1.0, 2.0, -1.0, np.nan, np.inf]) | st.floats(-5, 5),
        min_size=1,
        max_size=60,
    ),
    st.integers(1, 20),
)
def test_pieces_make_no_difference(values, piece):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(signal_summary, "_PIECE", piece)
        cut = summary_of(values)
    whole = summary_of(values)
    for name in ("mean", "rms", "rms_ac", "lowest", "highest"):
        expected = pytest.approx(getattr(whole, name), rel=1e-9, abs=1e-12, nan_ok=True)
        assert getattr(cut, name) == expected
    for name in ("n_missing", "first_missing", "longest_hold", "longest_hold_start"):
        assert getattr(cut, name) == getattr(whole, name)


@given(st.lists(st.integers(-2, 2), min_size=1, max_size=50), st.data())
def test_runs_do_not_depend_on_the_cuts(values, data):
    samples = np.array(values, dtype=float)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(values)), max_size=5)))
    plateaus = Plateaus()
    for piece in np.split(samples, cuts):
        plateaus.add(piece)
    edges = np.r_[0, np.flatnonzero(np.diff(samples)) + 1, samples.size]
    assert plateaus.longest == np.diff(edges).max()
    assert plateaus.longest_start == edges[np.diff(edges).argmax()]


@pytest.mark.parametrize("limit", [0.8, 1.5, 2.5])
@pytest.mark.parametrize("dtype", ["float64", "float32", "int16"])
def test_the_clipped_share_is_counted(limit, dtype):
    samples = noise(smooth=20)
    clipped = np.clip(samples, -limit, limit) * 32767 / limit
    runs = np.abs(samples) >= limit
    edges = np.flatnonzero(np.diff(np.r_[False, runs, False]))
    lengths = edges[1::2] - edges[::2]
    expected = lengths[lengths >= 3].sum() / samples.size
    found = summary_of(np.round(clipped).astype(dtype))
    assert found.clipped_share == pytest.approx(expected, rel=0.02)


def test_clipping_is_told_in_words():
    samples = np.clip(noise(smooth=20) * 25, -49.9, 49.9)
    assert "% of the samples" in checks(samples)["clipped"]
    assert "lie flat at ±49.9 m/s^2" in checks(samples)["clipped"]


def test_clipping_on_one_side():
    found = summary_of(np.clip(noise(smooth=20), -1e9, 2.0))
    assert found.n_clipped_low == 0
    assert found.n_clipped_high > 100


def test_a_clipped_run_that_ends_the_signal():
    samples = np.r_[noise(1000), 9.0, 9.0, 9.0, 9.0]
    assert summary_of(samples).n_clipped_high == 4


@pytest.mark.parametrize(
    "samples",
    [
        noise(),
        np.round(noise(smooth=20) * 4),  # a quiet signal in coarse steps
        np.round(noise(smooth=20) * 3000),
        np.round(32767 * np.sin(2 * np.pi * 0.7 * time())),  # smooth tops, rounded
        np.round(2000 * np.sin(2 * np.pi * 5 * time())),
        np.sign(np.sin(2 * np.pi * 20.3 * time())),  # a square wave or trigger
        np.sin(2 * np.pi * 500 * time()),  # the same four values again and again
        np.where(time() % 2.0 < 0.01, 100.0 * np.sin(np.pi * (time() % 2.0) / 0.01), 0.0),
        np.where(time() % 2.0 < 1.0, noise(), 0.0),  # bursts
    ],
    ids=["noise", "coarse", "16 bit", "sine", "12 bit", "square", "synchronous", "impact", "burst"],
)
def test_flat_tops_that_are_no_clipping(samples):
    assert summary_of(samples).clipped_share == 0


def test_missing_samples_are_counted_and_left_out():
    samples = noise()
    samples[[100, 7000]] = np.nan
    samples[9000] = np.inf
    samples[9001] = 1e35  # what some programs write for "no value"
    found = summary_of(samples)
    assert (found.n_missing, found.first_missing) == (4, 100)
    assert found.rms_ac == pytest.approx(1, rel=1e-3)
    assert (found.n_impossible, found.first_impossible) == (1, 9001)
    assert {"missing samples", "impossible samples"} <= checks(samples).keys()


def test_nothing_but_missing_samples():
    found = summary_of([np.nan] * 10)
    assert np.isnan(found.rms)
    assert np.isnan(found.peak)
    assert found.is_silent
    assert checks([np.nan] * 10) == {"missing samples": "there is no number in it"}


def test_a_silent_channel():
    samples = np.full(5000, 0.1)
    found = summary_of(samples)
    assert found.is_silent
    assert found.rms_ac == 0
    assert np.isnan(found.crest_factor)
    assert checks(samples) == {"silent": "it holds nothing but the value 0.1 m/s^2"}


def test_a_channel_that_drops_out():
    samples = noise()
    samples[12_000:15_000] = samples[12_000]
    assert checks(samples)["dropout"] == ("3000 samples in a row hold one value, from sample 12000")
    assert "dropout" not in checks(samples, quantity=FORCE)  # the rest between two impacts


@pytest.mark.parametrize("mains_hz", [50.0, 60.0])
@pytest.mark.parametrize("rate_hz", [2000.0, 51_200.0])
def test_hum_is_measured(mains_hz, rate_hz):
    t = time(10.0, rate_hz)
    tone = 0.1 * np.sin(2 * np.pi * 1.0005 * mains_hz * t)
    tone += 0.2 * np.sin(2 * np.pi * 1.0005 * 3 * mains_hz * t)
    hum = summary_of(noise(t.size) + tone, rate_hz).hum
    assert hum.mains_hz == mains_hz
    assert hum.frequency_hz == 3 * mains_hz
    assert hum.rms == pytest.approx(np.sqrt((0.01 + 0.04) / 2), rel=0.2)


def test_hum_is_told_in_words():
    samples = noise() + 0.3 * np.sin(2 * np.pi * 50 * time())
    assert checks(samples)["hum"].startswith("hum of the 50 Hz mains makes 2")
    assert checks(samples)["hum"].endswith("% of the rms, strongest at 50 Hz")
    assert "hum" not in checks(samples, float("nan"))


def resonance(frequency_hz, damping_ratio, seed=3):
    """Response of a mode to noise."""
    from scipy.signal import lfilter

    omega = 2 * np.pi * frequency_hz / RATE_HZ
    radius = np.exp(-damping_ratio * omega)
    samples = lfilter([1], [1, -2 * radius * np.cos(omega), radius**2], noise(80_000, seed))
    return samples[40_000:] / samples[40_000:].std()


@pytest.mark.parametrize(
    "samples",
    [
        *(noise(seed=seed) for seed in range(10)),
        resonance(50.0, 0.03),
        resonance(60.0, 0.002),  # of steel rather than rubber
        resonance(100.0, 0.001),
        np.sin(2 * np.pi * 37.0 * time()),
        np.tile(noise(2000), 20),  # periodic: lines at every 1 Hz, the mains' among them
        np.tile(noise(200), 200),  # every 10 Hz
        np.sin(2 * np.pi * (5 + 20 * time() / 2) * time()),  # a sweep
    ],
)
def test_what_is_no_hum(samples):
    assert summary_of(samples).hum is None


def test_a_signal_too_short_to_tell_hum():
    assert summary_of(noise(15_000) + np.sin(2 * np.pi * 50 * time(7.5))).hum is None


def test_signals_of_any_size_and_kind_are_summarised():
    for samples in ([1e29, -1e29] * 5000, [5e-324, 0.0] * 5000, np.arange(9, dtype=np.uint8)):
        assert np.isfinite(summary_of(samples).rms)
    for rate_hz in (1e-300, 1e300, np.inf, -1.0, 0.0):
        assert summary_of(noise(), rate_hz).hum is None
    assert summary_of([]).is_silent


def test_an_unknown_quantity_has_no_unit():
    assert checks([3.0] * 9, quantity=UNKNOWN)["silent"].endswith("the value 3")


def test_the_sample_campaign_is_in_order(sample_campaign):
    recording = read_file(sample_campaign / "config_3.uff").recording
    for channel in recording.channels:
        summary = summarise(channel, recording.sampling_rate_hz)
        assert signal_findings(summary, "config_3.uff", channel) == []
        assert 3.5 < summary.crest_factor < 6
