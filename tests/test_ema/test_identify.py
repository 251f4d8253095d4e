"""Identification as a whole: accuracy against known tyres, nothing missed, nothing invented."""

import numpy as np
import pytest
import systems

from ema.core.errors import InputError
from ema.core.modes import Pair
from ema.identify import identify_modes
from pipelines.simulate.truth import truth_modes

BAND_HZ = (20.0, 260.0)
TYRE = truth_modes()
SEVEN = systems.of_orders(TYRE)


@pytest.fixture(scope="module")
def healthy():
    return identify_modes(systems.campaign_frf(TYRE, 34, seed=3))


@pytest.mark.parametrize("seed", range(2))
def test_at_40_db_frequencies_hold_within_2e_4_and_damping_within_one_percent(seed):
    found = identify_modes(systems.campaign_frf(TYRE, 40, seed=seed))
    systems.assert_modes(found.model, SEVEN, frequency=2e-4, damping=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_at_10_db_frequencies_hold_within_5e_4_and_damping_within_two_percent(seed):
    frf = systems.campaign_frf(TYRE, 10, seed=seed)
    shown = (frf.frequency_hz > 40) & (frf.frequency_hz < 235)
    assert np.median(frf.coherence[:, shown]) == pytest.approx(0.7, abs=0.02)
    systems.assert_modes(identify_modes(frf).model, SEVEN, frequency=5e-4, damping=0.02)


def test_the_other_estimator_first_gives_the_same_modes(healthy):
    frf = systems.campaign_frf(TYRE, 34, seed=3)
    other = identify_modes(frf, method="plscf")
    np.testing.assert_allclose(other.model.frequencies_hz, healthy.model.frequencies_hz, rtol=1e-5)
    np.testing.assert_allclose(other.model.damping_ratios, healthy.model.damping_ratios, rtol=1e-3)
    assert {opinion.method for opinion in other.opinions} == {"lsce"}


def test_a_healthy_campaign_has_nothing_to_find(healthy):
    assert healthy.findings == ()
    assert healthy.frf.n_positions == 72
    assert not healthy.model.drift.applied
    assert all(opinion.agrees for opinion in healthy.opinions)
    assert Pair.RESOLVED not in {mode.pair for mode in healthy.model.modes}


def test_each_mode_has_error_bars_that_hold_it(healthy):
    for mode, true in zip(healthy.model.modes, SEVEN, strict=False):
        assert 0 < mode.frequency_std_hz < 1e-3 * mode.frequency_hz
        assert abs(mode.frequency_hz - true.frequency_hz) < 4 * mode.frequency_std_hz
        assert abs(mode.damping_ratio - true.damping_ratio) < 4 * mode.damping_std


def test_lost_positions_cost_no_mode():
    frf = systems.campaign_frf(TYRE, 20)
    kept = np.setdiff1d(np.arange(72), [4, 5, 6, 31, 32, 60])
    systems.assert_modes(identify_modes(frf.rows(kept)).model, SEVEN, damping=0.02)


def test_pinned_frequencies_replace_the_diagram_s_choice():
    frf = systems.campaign_frf(TYRE, 34)
    eight = systems.of_orders(TYRE, range(1, 9))
    pins = [0.998 * mode.frequency_hz for mode in eight]
    systems.assert_modes(identify_modes(frf, pinned_hz=pins).model, eight)


def test_an_excluded_mode_costs_the_others_nothing():
    frf = systems.campaign_frf(TYRE, 34, seed=3)
    found = identify_modes(frf, excluded_hz=[145.45]).model
    assert not np.any(np.abs(found.frequencies_hz - 145.45) < 5)
    others = [mode for mode in SEVEN if abs(mode.frequency_hz - 145.45) > 5]
    systems.assert_modes(found, others, frequency=2e-4, damping=0.01)
    assert any("Left out by hand" in note for note in found.notes)


def test_modes_beside_a_pinned_one_cost_it_nothing():
    frf = systems.campaign_frf(TYRE, 34, seed=3)
    found = identify_modes(frf, pinned_hz=[145.0]).model
    assert found.frequencies_hz.size == 1
    systems.assert_modes(found, [SEVEN[3]], frequency=2e-4, damping=0.01)


def test_without_a_usable_channel_there_is_nothing_to_identify():
    frf = systems.campaign_frf(TYRE, 34)
    everything = np.arange(72)
    with pytest.raises(InputError, match="at least one response must be usable"):
        identify_modes(systems.edited(frf, everything, clipped=0.5), BAND_HZ)
