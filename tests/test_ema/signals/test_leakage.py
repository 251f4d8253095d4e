"""What windows do to the FRFs of a random excitation, and how well it is undone."""

import numpy as np
import pytest
import systems

from ema.core.block_plan import BlockPlan
from ema.signals.bias_and_noise import leakage_bias
from ema.signals.frf_estimation import estimate_frf

RATE_HZ = 500.0
POLES = systems.pole([60.0, 90.0], [0.004, 0.01])
RESIDUES = np.array([[1.0, 0.4], [0.3, -1.0]]) * systems.residue(POLES)
BAND_HZ = (40.0, 120.0)


def blocks(window, block_s=1.0):
    n = round(block_s * RATE_HZ)
    return BlockPlan(RATE_HZ, n, n, 2, window)


def bias(window, block_s=1.0, poles=POLES, residues=RESIDUES):
    plan = blocks(window, block_s)
    lines_hz = plan.frequency_hz
    return leakage_bias(plan, lines_hz, poles, residues)


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
