"""What windows do to the FRFs of a random excitation, and how well it is undone."""

import numpy as np
import pytest
import systems

from ema.core.frf import FRF
from ema.core.recording import BlockPlan
from ema.signals import leakage
from ema.signals.frf_estimation import estimate_frf

RATE_HZ = 500.0
POLES = systems.pole([60.0, 90.0], [0.004, 0.01])
RESIDUES = np.array([[1.0, 0.4], [0.3, -1.0]]) * systems.residue(POLES)
BAND_HZ = (40.0, 120.0)


def blocks(window, block_s=1.0):
    n = round(block_s * RATE_HZ)
    return BlockPlan(RATE_HZ, n, n, 2, window)


def leakage_bias(plan, lines_hz, poles, residues):
    """Bias under random noise, without the force itself."""
    size = (len(residues), plan.frequency_hz.size)
    frf = FRF(
        frequency_hz=plan.frequency_hz,
        values=np.zeros(size, complex),
        coherence=np.ones(size),
        std=np.ones(size),
        node=np.arange(size[0]),
        position_deg=np.full(size[0], np.nan),
        run=("run",) * size[0],
        blocks=plan,
    )
    return leakage.leakage_bias(frf, lines_hz, {"run": poles}, residues)


def bias(window, block_s=1.0, poles=POLES, residues=RESIDUES):
    plan = blocks(window, block_s)
    return leakage_bias(plan, plan.frequency_hz, poles, residues)


@pytest.fixture(scope="module", params=["boxcar", "hann"])
def measured(request):
    """Half an hour of noise in blocks of 1 s: modes that ring for seconds leak visibly."""
    force = systems.white(900_000, seed=11)
    responses = systems.responses_to(force, RATE_HZ, POLES, RESIDUES)
    run = systems.run_of(force, responses, RATE_HZ)
    return estimate_frf(systems.campaign_of(run, block_seconds=1.0, window=request.param))


def test_the_predicted_bias_is_the_one_of_recordings(measured):
    lines = (measured.frequency_hz > BAND_HZ[0]) & (measured.frequency_hz < BAND_HZ[1])
    lines_hz = measured.frequency_hz[lines]
    error = measured.values[:, lines] - systems.inertance(lines_hz, POLES, RESIDUES)
    predicted = leakage_bias(measured.blocks, lines_hz, POLES, RESIDUES)
    left = error - predicted
    assert np.linalg.norm(left) < 0.06 * np.linalg.norm(error)
    # What is left is random: one-third of the lines lie beyond one σ of each quadrature.
    beyond = np.abs(left.real) > measured.std[:, lines]
    assert 0.2 < np.mean(beyond) < 0.45


@pytest.mark.parametrize("window", ["boxcar", "hann"])
def test_the_bias_is_linear_in_the_residues(window):
    doubled = bias(window, residues=2 * RESIDUES)
    np.testing.assert_allclose(doubled, 2 * bias(window), rtol=1e-12)
    single = sum(
        bias(window, poles=POLES[[r]], residues=RESIDUES[:, [r]]) for r in range(POLES.size)
    )
    np.testing.assert_allclose(single, bias(window), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(("window", "power"), [("boxcar", 1), ("hann", 2)])
def test_the_bias_vanishes_with_longer_blocks(window, power):
    """Like 1/T for a boxcar, whose autocorrelation starts with a slope, like 1/T² for Hann."""
    peak_hz = 90.0
    sizes = []
    for block_s in (8.0, 16.0):
        plan = blocks(window, block_s)
        error = leakage_bias(plan, np.array([peak_hz]), POLES, RESIDUES)
        sizes.append(np.abs(error).max())
    assert sizes[0] / sizes[1] == pytest.approx(2**power, rel=0.1)


def test_a_resonance_looks_too_low():
    exact = systems.inertance(np.array([60.0]), POLES, RESIDUES)
    plan = blocks("hann")
    seen = exact + leakage_bias(plan, np.array([60.0]), POLES, RESIDUES)
    assert np.all(np.abs(seen) < 0.7 * np.abs(exact))


@pytest.mark.parametrize("window", ["boxcar", "hann"])
@pytest.mark.parametrize("kind", ["noise", "hits", "bursts"])
def test_with_the_force_at_hand_nothing_random_is_left(window, kind):
    """Few averages of modes that ring for seconds: the leakage of this very force, not its mean."""
    n, past = 20_000, 5_000
    rng = np.random.default_rng(3)
    force = systems.white(n + past, seed=11)
    if kind == "hits":
        hits = np.sort(rng.integers(100, n - 2000, 9))
        force = np.convolve(np.bincount(hits, minlength=n), np.hanning(7), "same")
    if kind == "bursts":
        force = force * (np.arange(force.size) % 3137 < 900)
    responses = systems.responses_to(force, RATE_HZ, POLES, RESIDUES)[:, -n:]
    run = systems.run_of(force[-n:], responses, RATE_HZ)
    frf = estimate_frf(systems.campaign_of(run, block_seconds=4.0, window=window))
    lines = (frf.frequency_hz > BAND_HZ[0]) & (frf.frequency_hz < BAND_HZ[1])
    lines_hz = frf.frequency_hz[lines]
    error = frf.values[:, lines] - systems.inertance(lines_hz, POLES, RESIDUES)
    left = error - leakage.leakage_bias(frf, lines_hz, dict.fromkeys(frf.run, POLES), RESIDUES)
    # Of noise, what was before the recording is unknown: it rings into the first block.
    most = 0.7 if kind == "noise" else 0.05
    assert np.linalg.norm(left) < most * np.linalg.norm(error)


def test_windows_that_mix_many_lines_reach_beyond_the_last_one():
    # Lines above half the sampling rate are those below it, mirrored.
    force = systems.white(20_000, seed=3) * (np.arange(20_000) % 3137 < 900)
    run = systems.run_of(force, systems.responses_to(force, RATE_HZ, POLES, RESIDUES), RATE_HZ)
    frf = estimate_frf(systems.campaign_of(run, block_seconds=4.0, window="flattop"))
    found = leakage.leakage_bias(frf, frf.frequency_hz, {frf.run[0]: POLES}, RESIDUES)
    error = frf.values - systems.inertance(frf.frequency_hz, POLES, RESIDUES)
    assert np.linalg.norm(error - found) < 0.05 * np.linalg.norm(error)
