"""A few samples lost in all channels at once: found where the FRF explains the rest."""

import numpy as np
import pytest
import recordings as rec
import systems

import ema
from ema.core.campaign import Processing
from ema.core.finding import Check
from ema.signals.damage import without_lost_samples
from ema.signals.excitation import plan_blocks
from ema.signals.spectra import measure_spectra


def estimated(*runs, **processing):
    return ema.estimate_frf(systems.campaign_of(*runs, **processing))


def spectra_of(run):
    plan = plan_blocks(run.force.n_samples, rec.RATE_HZ, Processing(), run.name)
    return measure_spectra(run, plan), plan


def dropped(start, n=1):
    return lambda samples: np.delete(samples, np.s_[start : start + n])


@pytest.mark.parametrize("bits", [None, 12])
@pytest.mark.parametrize("start", [3000, 8049, 14_500])
@pytest.mark.parametrize("n", [2, 3, 8, 1000])
def test_lost_lines_are_named_and_their_place_is_left_out(n, start, bits):
    run = rec.healthy(2) if bits is None else rec.in_steps(rec.healthy(2), bits)
    frf = estimated(rec.edited(run, dropped(start, n)), block_seconds=1.0)
    assert [(f.run, f.channel, f.check) for f in frf.findings] == [
        ("run_1.uff", "", Check.LOST_SAMPLES)
    ]
    assert 0 < frf.missing.max() <= 2 / 28  # of overlapping blocks two hold the joint


@pytest.mark.parametrize("seed", [2, 4, 5])
def test_a_single_line_is_enough(seed):
    frf = estimated(rec.edited(rec.healthy(seed), dropped(8000)))
    assert [(f.channel, f.check) for f in frf.findings] == [("", Check.LOST_SAMPLES)]


@pytest.mark.parametrize("n", [2, 5, 30])
def test_lines_written_twice_are_found_too(n):
    (finding,) = estimated(rec.edited(rec.healthy(2), rec.doubled(7000, n))).findings
    assert (finding.run, finding.check) == ("run_1.uff", Check.LOST_SAMPLES)


def test_several_joints_are_all_found():
    damaged = rec.edited(rec.edited(rec.healthy(), dropped(11_000)), dropped(4000, 2))
    assert [finding.check for finding in estimated(damaged).findings] == [Check.LOST_SAMPLES] * 2


def test_the_place_is_right_to_a_few_samples():
    run = rec.edited(rec.healthy(2), dropped(8049, 3))
    usable, findings = without_lost_samples(run, *spectra_of(run))
    assert len(findings) == 1
    (((start, stop),),) = {channel.gaps for channel in usable.channels}
    assert abs(start - 8049) <= 3 and stop == start + 1


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.3])
def test_a_knock_is_no_joint(seed, noise):
    """Somebody hits the rig: all sensors answer what the force does not explain."""
    force = rec.shaker_noise(seed=seed)
    hit = np.zeros(rec.N)
    hit[9000 : 9000 + 6] = 300.0
    knock = systems.responses_to(hit, rec.RATE_HZ, rec.POLES, rec.RESIDUES[::-1])
    run = rec.run(force, rec.answers(force, seed, noise) + knock)
    assert estimated(run).findings == ()


def test_a_run_too_short_to_judge_is_left_alone():
    force = rec.shaker_noise(1500)
    run = rec.run(force, rec.answers(force))
    assert estimated(rec.edited(run, dropped(700))).findings == ()
