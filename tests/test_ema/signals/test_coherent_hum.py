"""Mains hum that keeps its phase from block to block takes one line, not the modes."""

import numpy as np
import pytest

from ema.core.finding import Check
from ema.identify import identify_modes
from ema.signals.frf_estimation import estimate_frf
from ema.signals.leakage import with_coherent_tones
from pipelines.simulate.laboratory import Laboratory
from pipelines.simulate.laboratory_effects import Effects

SWEEPS = {"excitation": "sweep", "event_s": 2.0, "runs": 1, "duration_s": 30.0, "snr_db": 45.0}


def found(hum):
    """Sweeps of 2 s are 100 periods of 50 Hz."""
    campaign = Laboratory(Effects(seed=3, hum=hum, **SWEEPS)).campaign()
    return identify_modes(estimate_frf(campaign), (20.0, 260.0))


@pytest.fixture(scope="module")
def quiet():
    return found(0.0)


def test_modes_are_those_without_hum(quiet):
    loud = found(0.3)
    assert loud.model.frequencies_hz == pytest.approx(quiet.model.frequencies_hz, rel=2e-4)
    assert loud.model.damping_ratios == pytest.approx(quiet.model.damping_ratios, rel=0.02)
    assert [each.check for each in loud.findings if each.check is Check.HUM]
    # What is measured stays, what is fitted has the line of its neighbours.
    line = np.argmin(np.abs(loud.frf.frequency_hz - 50.0))
    measured, fitted = (np.abs(each.values[:, line]) for each in (loud.measured, loud.frf))
    assert np.median(measured / fitted) > 5


def test_frfs_without_hum_stay_as_they_are(quiet):
    np.testing.assert_array_equal(with_coherent_tones(quiet.measured).std, quiet.measured.std)
    np.testing.assert_array_equal(quiet.frf.values, quiet.measured.values)
