"""Samples that are missing cost averages, not accuracy."""

from dataclasses import replace

import numpy as np
import pytest
import systems

import ema
from ema.checks.corrections import screen
from ema.core.campaign import Processing
from ema.core.errors import InputError
from ema.core.finding import Verdict
from ema.signals.signal_checks import summarise

RATE_HZ = 1000.0
PROCESSING = Processing(block_seconds=1.0, window="boxcar")


@pytest.fixture(scope="module")
def whole():
    force = systems.white(20_000, 1)
    poles = systems.pole(np.array([60.0, 140.0]), np.array([0.02, 0.02]))
    residues = np.outer([1.0, -1.0, 0.5, 0.8], systems.residue(poles))
    motion = systems.responses_to(force, RATE_HZ, poles, residues)
    motion = motion + 0.05 * motion.std() * systems.white(20_000, 2, 4)
    return force, motion


def campaign(force, motion):
    return systems.campaign_of(systems.run_of(force, motion, RATE_HZ))


def lacking(signal, start, stop):
    damaged = signal.copy()
    damaged[..., start:stop] = np.nan
    return damaged


def test_blocks_with_gaps_are_left_out_of_that_channel_alone(whole):
    force, motion = whole
    damaged = motion.copy()
    damaged[1] = lacking(motion[1], 2100, 2150)  # in the third of twenty blocks
    expected = ema.estimate_frf(campaign(force, motion), PROCESSING)
    found = ema.estimate_frf(campaign(force, damaged), PROCESSING)
    others = [0, 2, 3]
    np.testing.assert_array_equal(found.values[others], expected.values[others])
    np.testing.assert_allclose(found.missing, [0, 0.05, 0, 0], atol=1e-12)
    parts = [
        systems.run_of(force[part], motion[:, part], RATE_HZ, name=f"part_{number}.uff")
        for number, part in enumerate((np.s_[:2000], np.s_[3000:]))
    ]
    without = ema.estimate_frf(systems.campaign_of(*parts), PROCESSING)
    np.testing.assert_allclose(found.values[1], without.values[1], rtol=1e-9)
    np.testing.assert_allclose(found.coherence[1], without.coherence[1], rtol=1e-9)
    np.testing.assert_allclose(found.std[1], without.std[1], rtol=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_gap_in_the_force_costs_all_channels_the_block(whole, value):
    force, motion = whole
    damaged = force.copy()
    damaged[5500] = value
    found = ema.estimate_frf(campaign(damaged, motion), PROCESSING)
    np.testing.assert_allclose(found.missing, 0.05, atol=1e-12)
    assert np.all(np.isfinite(found.values))


def test_gaps_are_reported_and_too_many_exclude(whole):
    force, motion = whole
    damaged = motion.copy()
    damaged[0, 100] = np.nan
    damaged[2] = lacking(motion[2], 0, 12_000)
    damaged[3] = np.nan
    found = ema.estimate_frf(campaign(force, damaged), PROCESSING)
    assert found.n_effective == 19
    usable, findings, _ = screen(found, (20.0, 200.0))
    assert usable.n_positions == 2
    assert [(f.check, f.verdict) for f in findings] == [
        ("missing samples", Verdict.WARNING),
        ("missing samples", Verdict.EXCLUDED),
        ("missing samples", Verdict.EXCLUDED),
    ]
    assert findings[0].detail == "5 % of the averages left out, as samples are missing"


def test_a_force_full_of_gaps_is_refused(whole):
    force, motion = whole
    damaged = force.copy()
    damaged[::500] = np.nan
    with pytest.raises(InputError, match="samples missing in every block of 1 s"):
        ema.estimate_frf(campaign(damaged, motion), PROCESSING)


def test_a_signalling_nan_of_single_precision_is_a_gap_like_any_other(whole):
    force, motion = whole
    single = motion.astype(np.float32)
    single[1].view(np.uint32)[2100] = 0x7FA00000
    built = campaign(force, motion)
    (run,) = built.runs
    responses = tuple(
        replace(each, channel=replace(each.channel, samples=row))
        for each, row in zip(run.responses, single, strict=True)
    )
    built = replace(built, runs=(replace(run, responses=responses),))
    np.testing.assert_allclose(
        ema.estimate_frf(built, PROCESSING).missing, [0, 0.05, 0, 0], atol=1e-12
    )


def test_a_signalling_nan_of_double_precision_is_quiet_in_blocks(whole):
    """Every computation with one that is left would warn."""
    force, _ = whole
    damaged = force.copy()
    damaged[700:701].view(np.uint64)[:] = 0xFFF0_0059_0021_0023
    (channel,) = systems.run_of(force, damaged[None], RATE_HZ).channels[1:]
    piece = channel.block(600, 800)
    assert np.flatnonzero(np.isnan(piece)).tolist() == [100]
    with np.errstate(all="raise"):
        assert np.isnan(np.diff(piece)).sum() == 2
        assert summarise(channel).n_missing == 1
