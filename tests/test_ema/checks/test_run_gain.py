"""A run that reads the others times a factor, against what a tyre can do by itself."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.checks.quality import check_reference, gain_findings, odd_gains
from ema.core.finding import Verdict
from pipelines.simulate.truth import truth_modes

BAND_HZ = (20.0, 260.0)
RUNS = 6


def reference(snr_db=30.0, drift_percent=0.0, runs=RUNS, damping_percent=0.0):
    """The reference sensor of some runs; frequencies rise evenly, damping in run 3 alone."""
    modes = truth_modes()
    drift = np.linspace(0, drift_percent, RUNS)
    frf = systems.campaign_frf(modes, snr_db, drift_percent=tuple(drift)).reference
    if damping_percent:
        more = [
            replace(m, damping_ratio=m.damping_ratio * (1 + damping_percent / 100)) for m in modes
        ]
        other = systems.campaign_frf(more, snr_db).reference
        frf = systems.edited(frf, 2, values=other.values[2])
    return frf.rows(np.arange(runs))


def with_gain(frf, factor, row=2):
    return systems.edited(frf, row, values=factor * frf.values[row], std=abs(factor) * frf.std[row])


def found(frf):
    return odd_gains(check_reference(frf, BAND_HZ))


@pytest.mark.parametrize("drift_percent", [0.0, 0.9])
@pytest.mark.parametrize("snr_db", [10.0, 34.0])
@pytest.mark.parametrize("factor", [0.9, 1.1, -1.0, 0.102, 1000.0])
def test_a_run_of_another_gain_is_named_with_its_factor(factor, snr_db, drift_percent):
    (odd,) = found(with_gain(reference(snr_db, drift_percent), factor))
    assert odd.run == "run_3"
    assert odd.factor == pytest.approx(factor, rel=0.01)
    assert odd.std < 0.01 * abs(factor)


def test_three_runs_are_enough_for_a_majority():
    assert [odd.run for odd in found(with_gain(reference(runs=3), 1.1))] == ["run_3"]
    assert not found(with_gain(reference(runs=2), 1.1, row=1))


def test_it_becomes_a_finding_about_the_run():
    (finding,) = gain_findings(check_reference(with_gain(reference(), 1.1), BAND_HZ))
    assert (finding.run, finding.channel, finding.check) == ("run_3", "reference", "gain")
    assert finding.verdict == Verdict.WARNING


@pytest.mark.parametrize("snr_db", [0.0, 34.0])
@pytest.mark.parametrize("drift_percent", [0.1, 0.3, 0.6, 0.9, 3.0])
def test_a_drift_is_no_gain(drift_percent, snr_db):
    assert not found(reference(snr_db, drift_percent))


@pytest.mark.parametrize("damping_percent", [-20.0, -5.0, 5.0, 20.0])
def test_damping_that_changes_is_no_gain(damping_percent):
    assert not found(reference(damping_percent=damping_percent))


@pytest.mark.parametrize("dead", [slice(2, 3), slice(0, 5)])
def test_a_dead_reference_has_no_gain(dead):
    assert not found(systems.edited(reference(), dead, values=0.0))


def test_unknown_noise_lets_nothing_be_told():
    assert not found(systems.edited(with_gain(reference(), 1.1), slice(None), std=np.nan))
