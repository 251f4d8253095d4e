"""How recordings are cut: lengths, windows, overlap, and what averages are worth."""

import math
from dataclasses import replace

import numpy as np
import pytest
import systems
from hypothesis import given
from hypothesis import strategies as st

from ema.core.campaign import Processing
from ema.core.errors import InputError
from ema.core.recording import BlockPlan, ExponentialWindow
from ema.fitting.covariance import line_correlation
from ema.signals.excitation import plan_blocks

RATE_HZ = 2000.0


def plan(duration_s=20.0, *, steady=True, period_samples=0, **processing):
    return plan_blocks(
        round(duration_s * RATE_HZ),
        RATE_HZ,
        Processing(**processing),
        "run_1.uff",
        steady=steady,
        period_samples=period_samples,
    )


def test_a_tyre_gets_four_second_hann_blocks_overlapping_by_half():
    default = plan(20)
    assert (default.block_s, default.overlap, default.n_blocks) == (4.0, 0.5, 9)
    assert default.window == "hann"


def test_a_short_recording_still_gets_averages():
    assert plan(8).block_s == 2.0
    assert plan(8).n_blocks == 7


def test_the_papers_setting_is_ten_blocks_of_25_s():
    paper = plan(250, averages=10, window="boxcar")
    assert (paper.block_s, paper.overlap, paper.n_blocks) == (25.0, 0.0, 10)
    assert paper.frequency_hz[0] == pytest.approx(0.04)


def test_an_event_stays_one_block_without_window():
    event = plan(2, steady=False)
    assert (event.block_s, event.n_blocks, event.window) == (2.0, 1, "boxcar")
    assert plan(2, steady=False, block_seconds=0.5).n_blocks > 1


@pytest.mark.parametrize("steady", [True, False])
@pytest.mark.parametrize("asked", [{}, {"block_seconds": 2.5}], ids=["default", "the same asked"])
def test_a_force_that_repeats_gets_blocks_of_one_period(steady, asked):
    repeated = plan(20, steady=steady, period_samples=5000, **asked)
    assert (repeated.block_s, repeated.n_blocks, repeated.window) == (2.5, 8, "boxcar")
    assert repeated.is_one_period


@pytest.mark.parametrize("asked", [{"window": "hann"}, {"block_seconds": 5.0}, {"averages": 4}])
def test_other_blocks_stay_as_asked_for_and_are_not_one_period(asked):
    chosen = plan(20, period_samples=5000, **asked)
    assert chosen.window == "hann"
    assert not chosen.is_one_period
    assert chosen.period_s == 2.5
    assert not plan(20).is_one_period


def test_lines_leave_out_zero_and_nyquist():
    for block_samples in (8, 9):
        lines = BlockPlan(8.0, block_samples, block_samples, 1, "boxcar").frequency_hz
        np.testing.assert_allclose(np.diff(lines), 8 / block_samples)
        assert lines[0] > 0
        assert lines[-1] < 4.0
        assert lines[-1] + 8 / block_samples >= 4.0


@given(
    n_samples=st.integers(4_000, 100_000),
    averages=st.integers(1, 12),
    overlap=st.sampled_from([0.0, 0.25, 0.5, 2 / 3, 0.75, 0.9]),
)
def test_as_many_averages_as_asked_for_and_all_inside_the_recording(n_samples, averages, overlap):
    processing = Processing(averages=averages, window="hann", overlap=overlap)
    blocks = plan_blocks(n_samples, RATE_HZ, processing, "run_1.uff")
    assert blocks.n_blocks == len(blocks.starts) == averages
    assert blocks.starts[-1] + blocks.block_samples <= n_samples
    assert n_samples - blocks.starts[-1] - blocks.block_samples <= 2 * averages


@given(window=st.sampled_from(["boxcar", "hann", "blackman", "flattop"]), n=st.integers(8, 4096))
def test_windows_have_a_mean_square_of_one(window, n):
    taper = BlockPlan(1.0, n, n, 1, window).taper
    assert np.mean(taper**2) == pytest.approx(1)


def test_blocks_side_by_side_are_independent():
    for window in ("boxcar", "hann"):
        assert plan(20, block_seconds=1, window=window, overlap=0).n_effective == pytest.approx(20)


@pytest.mark.parametrize(
    ("window", "overlap", "correlations"),
    [
        ("boxcar", 0.5, [1 / 2]),
        ("boxcar", 0.75, [3 / 4, 1 / 2, 1 / 4]),
        ("hann", 0.5, [1 / 6]),
        ("hann", 0.75, [0.659155, 1 / 6, 0.007512]),  # Harris (1978), table 1: 65.9 %, 16.7 %
    ],
)
def test_overlapping_blocks_count_for_less(window, overlap, correlations):
    """K / (1 + 2 Σ (1 − k/K) c_k²) (Welch 1967)."""
    blocks = plan(20, block_seconds=2, window=window, overlap=overlap)
    lags = 1 + np.arange(len(correlations))
    worth = 1 + 2 * np.sum((1 - lags / blocks.n_blocks) * np.square(correlations))
    assert blocks.n_effective == pytest.approx(blocks.n_blocks / worth, rel=1e-5)


def test_overlap_gains_averages_from_a_window_but_not_without_end():
    side_by_side, half, most = (
        plan(100, block_seconds=2, window="hann", overlap=overlap).n_effective
        for overlap in (0, 0.5, 0.9)
    )
    assert 1.8 * side_by_side < half < most < 2.2 * side_by_side


def test_neighbouring_lines_share_information_as_the_window_says():
    """N Σw⁴/(Σw²)²: 1 for a boxcar, 35·8/(3²·16) for Hann."""
    frf = systems.tyre_frf()
    assert line_correlation(frf) == 1
    boxcar, hann = (replace(frf, blocks=plan(window=name)) for name in ("boxcar", "hann"))
    assert line_correlation(boxcar) == pytest.approx(1)
    assert line_correlation(hann) == pytest.approx(35 * 8 / (9 * 16))


@pytest.mark.parametrize("time_constant_s", [0.2, 2.0, 100.0])
def test_neighbouring_lines_share_information_as_an_exponential_window_says(time_constant_s):
    frf = systems.tyre_frf()  # blocks of 4 s
    window = np.exp(-np.arange(0, 4, 1e-4) / time_constant_s)
    shared = window.size * np.sum(window**4) / np.sum(window**2) ** 2
    windowed = replace(frf, exponential_window=ExponentialWindow(time_constant_s))
    assert line_correlation(windowed) == pytest.approx(shared, rel=1e-3)


def test_a_longer_run_gets_more_of_the_same_blocks():
    blocks = plan(20)
    longer = blocks.for_length(80_000)
    assert longer.n_blocks == 19
    np.testing.assert_array_equal(longer.frequency_hz, blocks.frequency_hz)


@pytest.mark.parametrize(
    "processing",
    [
        {"block_seconds": 30.0},
        {"block_seconds": 1e-3},
        {"block_seconds": 0.0},
        {"block_seconds": -1.0},
        {"averages": 100_000},
        {"averages": 0},
    ],
)
def test_blocks_that_do_not_fit_are_refused(processing):
    with pytest.raises(InputError, match=r"run_1\.uff: .*block"):
        plan(20, **processing)


@pytest.mark.parametrize("window", ["hamming-ish", "kaiser"])
def test_unknown_windows_are_refused(window):
    with pytest.raises(InputError, match=window):
        _ = plan(20, window=window).taper


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("Hanning", "hann"),
        ("Rectangular", "boxcar"),
        ("uniform", "boxcar"),
        ("Flat Top", "flattop"),
    ],
)
def test_windows_have_the_names_of_other_programs_too(name, known):
    assert Processing(window=name).window == known


@pytest.mark.parametrize("overlap", [0.5, 50, "50 %", "50%", "0.5"])
def test_an_overlap_is_a_share_or_percent(overlap):
    assert Processing(overlap=overlap).overlap == 0.5


@pytest.mark.parametrize("overlap", [1.0, 100, -0.1, "half", math.nan, "100 %"])
def test_an_overlap_that_is_none_is_refused(overlap):
    with pytest.raises(InputError, match="overlap"):
        Processing(overlap=overlap)
