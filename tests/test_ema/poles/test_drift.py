"""Six runs of one tyre that drifts: brought to one state, measured, reported."""

from dataclasses import replace

import numpy as np
import pytest
import systems
from hypothesis import given
from hypothesis import strategies as st

from ema.checks.quality import check_reference, drift_findings
from ema.core.drift import NO_DRIFT, Drift, of_runs
from ema.core.finding import Verdict
from ema.identify import identify_modes
from ema.poles.estimators import _shift, align_runs, stretched
from pipelines.simulate.truth import truth_modes

BAND_HZ = (20.0, 260.0)
TYRE = truth_modes()
SEVEN = systems.of_orders(TYRE)
LINES = slice(30, 540)
# Common shifts of run 2 … 6 in percent: temperature rising evenly, and a jump with a return.
DRIFTS = {
    "even": np.array([0, 0.06, 0.12, 0.18, 0.24, 0.3]),
    "back": np.array([0, -0.3, -0.05, 0.12, 0, -0.2]),
}


def modes_moved_by(percent):
    return [replace(m, frequency_hz=m.frequency_hz * (1 + percent / 100)) for m in TYRE]


@pytest.fixture(scope="module", params=DRIFTS)
def drifted(request):
    percent = DRIFTS[request.param]
    frf = systems.campaign_frf(TYRE, 26, seed=1, drift_percent=percent)
    return percent, frf, identify_modes(frf, BAND_HZ)


@pytest.fixture(scope="module")
def still():
    frf = systems.campaign_frf(TYRE, 26, seed=1)
    return frf, identify_modes(frf, BAND_HZ)


@given(st.floats(-0.5, 0.5))
def test_stretching_undoes_a_drift(percent):
    """On lines much finer than the resonances; damping ratios stay as they are."""
    lines_hz, angle_deg = np.arange(300, 520) / 2, np.array([0.0, 35.0])
    still, moved = (
        systems.true_inertance(modes, angle_deg, lines_hz)
        for modes in (TYRE, modes_moved_by(percent))
    )
    back = stretched(lines_hz, moved, 1 + percent / 100)
    error = np.abs(back - still)[:, 5:-5].max() / np.abs(still).max()
    assert error < 1e-3


def test_stretching_by_nothing_changes_nothing():
    values = np.random.default_rng(0).standard_normal((2, 50)) @ np.eye(50) * (1 + 1j)
    np.testing.assert_allclose(stretched(np.arange(1.0, 51), values, 1.0), values)


def test_runs_are_brought_to_the_state_of_the_first():
    percent = DRIFTS["even"]
    frf = systems.campaign_frf(TYRE, 40, drift_percent=percent)
    first = systems.campaign_frf(TYRE, 40)
    apart = np.abs(frf.values - first.values)[:, LINES].max()
    aligned = np.abs(align_runs(frf, LINES) - first.values[:, LINES])[:, 5:-5].max()
    assert aligned < 0.1 * apart


@pytest.mark.parametrize("lost_run", ["", "run_3"])
def test_runs_of_one_state_are_left_nearly_as_they_are(lost_run):
    """Also where all rows of a run were excluded."""
    frf = systems.campaign_frf(TYRE, 26)
    frf = frf.rows(np.array(frf.run) != lost_run)
    change = np.abs(align_runs(frf, LINES) - frf.values[:, LINES])
    assert np.sqrt(np.mean(change**2)) < 0.2 * np.sqrt(np.mean(frf.std[:, LINES] ** 2))


def test_modes_of_the_first_run_come_back(drifted):
    _, frf, found = drifted
    systems.assert_modes(found.model, SEVEN, frequency=5e-4, damping=0.02)
    np.testing.assert_array_equal(found.frf.values, frf.values)  # no sensor looks faulty


def test_the_drift_of_each_run_comes_back_with_its_error_bar(drifted):
    percent, _, found = drifted
    drift = found.model.drift
    assert drift.applied
    assert drift.chance < 1e-4
    assert drift.run == tuple(f"run_{number}" for number in range(1, 7))
    np.testing.assert_allclose(drift.percent, percent, atol=0.01)
    assert np.all(np.abs(drift.percent - percent)[1:] < 4 * drift.std_percent[1:])


def test_the_reference_sensor_tells_the_same(drifted, still):
    _, frf, _ = drifted
    assert not check_reference(frf.reference, BAND_HZ).consistent
    assert check_reference(still[0].reference, BAND_HZ).consistent


def test_each_run_has_its_drift_in_the_findings(drifted):
    percent, _, found = drifted
    findings = drift_findings(found.model.drift, found.model.frequencies_hz)
    assert [finding.run for finding in findings] == [f"run_{n}" for n in range(2, 7)]
    for finding, true in zip(findings, percent[1:], strict=True):
        if abs(abs(true) - 0.05) > 0.02:  # what is smaller is no warning
            assert finding.verdict == (Verdict.WARNING if abs(true) > 0.05 else Verdict.OK)
        assert float(finding.detail.split()[2]) == pytest.approx(true, abs=0.01)


def test_a_tyre_that_stays_as_it_is_does_not_drift(still):
    drift = still[1].model.drift
    assert not drift.applied
    assert drift.chance > 1e-4
    assert np.all(np.abs(drift.percent) < 4 * drift.std_percent + 1e-12)
    assert {finding.verdict for finding in drift_findings(drift, np.array([80.0, 230.0]))} == {
        Verdict.OK
    }


@pytest.mark.parametrize("seed", range(2, 6))
def test_noise_alone_is_not_taken_for_drift(seed):
    frf = systems.campaign_frf(TYRE, 15, seed=seed)
    assert not identify_modes(frf, BAND_HZ).model.drift.applied


def test_synthesis_follows_the_state_of_each_run(drifted):
    _, frf, found = drifted
    shown = (frf.frequency_hz > 40) & (frf.frequency_hz < 235)
    lines_hz = frf.frequency_hz[shown]
    error = found.model.synthesise(lines_hz, run=frf.run) - frf.values[:, shown]
    noise = frf.std[:, shown]
    assert np.sqrt(np.mean(np.abs(error) ** 2 / (2 * noise**2))) == pytest.approx(1, abs=0.05)


def test_one_run_has_no_drift():
    assert drift_findings(NO_DRIFT, np.array([80.0])) == []
    assert NO_DRIFT.poles_in("any", np.array([1j])) == 1j


def test_a_drift_that_was_not_applied_moves_nothing():
    nothing = np.zeros(2)
    common = np.array([0, 0.1])
    seen = Drift(("a", "b"), common, common, nothing, nothing, nothing, nothing, applied=False)
    poles = np.array([-3 + 100j])
    np.testing.assert_array_equal(seen.poles_in("b", poles), poles)
    moved = replace(seen, applied=True).poles_in("b", poles)
    np.testing.assert_allclose(moved, 1.001 * poles)
    assert seen.left_out == pytest.approx((0.0005, 0.0))  # the mean of both runs is stated
    assert replace(seen, applied=True).left_out == (0.0, 0.0)


def drift_of(percent, damping_percent):
    shift = np.array(percent)
    names = tuple(f"run_{number}" for number in range(1, shift.size + 1))
    none, damping = 0 * shift, np.array(damping_percent)
    return Drift(names, shift, none, none, none, damping, none)


def test_a_steady_change_has_no_error_of_its_own():
    steady = drift_of(np.linspace(0, 0.5, 6), np.linspace(0, -3, 6))
    assert steady.unsteadiness(150.0) == pytest.approx((0.0, 0.0), abs=1e-15)
    assert drift_of([0, 1, 0], [0, 0, 0]).unsteadiness(150.0) == (0.0, 0.0)  # too few to tell


def test_states_that_scatter_show_their_standard_deviation():
    random = np.random.default_rng(1)
    scattered = drift_of(
        np.linspace(0, 5, 400) + 0.1 * random.standard_normal(400), random.standard_normal(400)
    )
    frequency, damping = scattered.unsteadiness(100.0)
    assert frequency == pytest.approx(1e-3, rel=0.1)
    assert damping == pytest.approx(1e-2, rel=0.1)


def test_a_steady_change_is_steady_where_a_run_was_left_out():
    run_by_run = drift_of(np.linspace(0, 0.5, 6), np.linspace(0, -3, 6))
    without = of_runs(run_by_run, tuple(name for name in run_by_run.run if name != "run_3"))
    assert without.unsteadiness(150.0) == pytest.approx((0.0, 0.0), abs=1e-15)


def test_runs_are_counted_by_their_place_in_the_campaign():
    frf = systems.campaign_frf(TYRE, 26, seed=1)
    names = frf.run_names
    left = frf.rows(np.array([run != names[2] for run in frf.run]))
    assert left.run_numbers == tuple(k for k in range(len(names)) if k != 2)


@pytest.mark.parametrize("percent", [0.0, 0.6, 1.5])
def test_members_of_pairs_are_not_taken_for_each_other_in_another_run(percent):
    hz, ratio = np.array([80.0, 100.0, 120.0, 145.0, 170.0]), 0.02
    first = 2 * np.pi * np.concatenate([hz, 1.01 * hz]) * (-ratio + 1j)
    moved = _shift(first, first * (1 + percent / 100), middle_hz=100.0)
    np.testing.assert_allclose(moved, [percent / 100, 0.0], atol=1e-6)


def test_the_law_is_carried_on_to_half_of_its_middle():
    drift = systems.common_drift(("a", "b"), np.array([0.0, -0.1]), np.zeros(2))
    steep = replace(drift, slope_percent=np.array([0.0, 0.2]), middle_hz=140.0)
    hz = np.array([20.0, 31.0, 70.0, 100.0])
    wanted = -0.1 + 0.2 * np.array([3.0, 3.0, 3.0, 0.96])
    np.testing.assert_allclose(steep.at(hz[:, None])[:, 1], wanted)
    poles = systems.pole(hz, np.full(4, 0.02))
    moved = systems.frequency_hz_of(steep.poles_in("b", poles)) / hz
    np.testing.assert_allclose(moved, 1 + wanted / 100, rtol=1e-6)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_mode_of_the_rim_far_below_stays_where_it_is(seed):
    """A law of the orders, carried on to it, moved it by up to a third from run to run."""
    rim = replace(systems.of_orders(TYRE, [1])[0], frequency_hz=31.4, damping_ratio=0.02)

    def in_state(mode, percent):
        share = max(1 - (100.0 / mode.frequency_hz) ** 2, 0.0)
        return replace(mode, frequency_hz=mode.frequency_hz * (1 + share * percent / 100))

    percent = np.array([0, -0.02, -0.04, -0.06, -0.08, -0.1])
    frf = systems.campaign_frf(
        [rim, *TYRE], 24, seed=seed, drift_percent=percent, in_state=in_state
    )
    model = identify_modes(frf, BAND_HZ).model
    found = model.modes[0]
    assert model.drift.applied
    assert abs(found.frequency_hz - 31.4) < 4 * found.frequency_std_hz < 0.2
