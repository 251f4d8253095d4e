"""Sensors that weigh: taken off exactly, for tyres whose pairs are split or not, or told about."""

from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.checks.sensor_mass import (
    SensorMass,
    is_drift_lost,
    live_mass_note,
    loading_note,
    loading_percent,
    sensors_of_runs,
    with_mass_std,
    without_mass,
)
from ema.circumference.mass_loading import unloaded, without_live_mass
from ema.core.drift import NO_DRIFT, Drift
from ema.core.errors import InputError
from ema.core.finding import Verdict
from ema.core.modes import Pair
from ema.identify import fit_modes, identify_modes
from ema.signals.frf_estimation import estimate_frf
from pipelines.simulate.laboratory import Laboratory
from pipelines.simulate.laboratory_effects import Effects
from pipelines.simulate.truth import modal_sum, solve, truth_modes

MASS_KG = 0.004
SEATS = systems.seats_deg()
SENSORS = SensorMass(MASS_KG, SEATS)
TYRES = {
    "driven members only": truth_modes(),
    "both members alike": truth_modes(split_percent=1e-6, shaker_between=0.0),
    "split, shaker on an antinode": truth_modes(split_percent=2.5, shaker_between=0.0),
    "split, shaker in between": truth_modes(split_percent=2.5),
    "split, shaker off centre": truth_modes(split_percent=1.5, shaker_between=0.3),
}
LINES_HZ = np.arange(80, 500) / 2


def loaded_and_bare(modes, snr_db=60, **changes):
    options = {"frequency_hz": LINES_HZ} | changes
    loaded = systems.campaign_frf(modes, snr_db, sensor_mass_kg=MASS_KG, **options)
    return loaded, systems.campaign_frf(modes, snr_db, **options)


def away(frf, bare):
    return np.linalg.norm(frf.values - bare.values) / np.linalg.norm(bare.values)


@pytest.mark.parametrize("name", TYRES)
def test_frfs_of_the_bare_tyre_come_back(name):
    """The sensors change the FRFs by 10 to 20 %; what is left is a hundredth of that."""
    loaded, bare = loaded_and_bare(TYRES[name])
    found = unloaded(loaded, SEATS, MASS_KG)
    assert away(loaded, bare) > 0.1
    assert away(found, bare) < 0.02 * away(loaded, bare)
    assert away(found.reference, bare.reference) < 0.02 * away(loaded.reference, bare.reference)


def across_the_force(modes):
    """What each order answers across a force at 0° less what it answers along it."""
    found = {}
    for order in {mode.order for mode in modes if mode.order}:
        pair = [mode for mode in modes if mode.order == order]
        omega, ratio, mass_kg, angle = np.array(
            [
                (2 * np.pi * m.frequency_hz, m.damping_ratio, m.modal_mass_kg, m.orientation_deg)
                for m in pair
            ]
        ).T
        poles = omega * (-ratio + 1j * np.sqrt(1 - ratio**2))
        turn = np.cos(2 * order * np.deg2rad(angle))
        found[order] = poles, -turn / (2j * poles.imag * mass_kg)
    return found


def test_the_member_that_one_force_does_not_see_is_known_from_others():
    modes = truth_modes(split_percent=2.5, shaker_between=0.0, both=True)
    loaded, bare = loaded_and_bare(modes, snr_db=30)
    alone = unloaded(loaded, SEATS, MASS_KG)
    known = unloaded(loaded, SEATS, MASS_KG, across=across_the_force(modes))
    assert away(known, bare) < 0.3 * away(alone, bare)


def with_live_mass(frf, modes, mass_kg):
    """Inertances over the force ahead of a mass at 0°, from its entry in the mass matrix."""
    mass, omega, ratio = (
        np.array([getattr(mode, name) for mode in modes])
        for name in ("modal_mass_kg", "frequency_hz", "damping_ratio")
    )
    omega = 2 * np.pi * omega
    rows, at_force = (
        np.column_stack([mode.shape(angles) for mode in modes])
        for angles in (frf.position_deg, np.zeros(1))
    )
    inertia = np.diag(mass) + mass_kg * at_force.T @ at_force
    matrices = inertia, np.diag(2 * ratio * mass * omega), np.diag(mass * omega**2)
    values = solve(*matrices, at_force[0]).inertance(rows, 2 * np.pi * frf.frequency_hz)
    return replace(frf, values=values)


@pytest.mark.parametrize("name", TYRES)
def test_a_mass_between_load_cell_and_tyre_is_compensated(name):
    bare = systems.campaign_frf(TYRES[name], frequency_hz=LINES_HZ)
    live = with_live_mass(bare, TYRES[name], 0.05)
    live = replace(live, reference=with_live_mass(bare.reference, TYRES[name], 0.05))
    found = without_live_mass(live, 0.05, 0.0)
    assert away(live, bare) > 0.1
    assert away(found, bare) < 1e-6
    assert away(found.reference, bare.reference) < 1e-6


def test_a_mass_at_the_load_cell_of_a_tyre_that_drifts_is_compensated_run_by_run():
    modes, percent = TYRES["split, shaker in between"], np.linspace(0.0, 1.5, systems.N_RUNS)
    states = [
        [replace(m, frequency_hz=m.frequency_hz * (1 + p / 100)) for m in modes] for p in percent
    ]
    bare = systems.campaign_frf(modes, drift_percent=percent, frequency_hz=LINES_HZ)
    live = np.empty_like(bare.values)
    for name, state in zip(bare.run_names, states, strict=True):
        here = np.array(bare.run) == name
        live[here] = with_live_mass(bare.rows(here), state, 0.05).values
    live, nothing = replace(bare, values=live), np.zeros(systems.N_RUNS)
    known = Drift(bare.run_names, percent, *[nothing] * 5)
    alike, by_run = (without_live_mass(live, 0.05, 0.0, each) for each in (NO_DRIFT, known))
    assert away(by_run, bare) < 0.25 * away(alike, bare) < 0.1 * away(live, bare)


def test_lines_without_a_force_stay_noise():
    """Were noise taken for the inertance at the force, passes over it would grow without end."""
    frf, _ = loaded_and_bare(truth_modes(split_percent=2.5))
    silent = frf.frequency_hz > 220
    values, std = frf.values.copy(), frf.std.copy()
    values[:, silent] = 100 * random_rows(values[:, silent].shape)
    std[:, silent] = 70.0
    noisy = replace(frf, values=values, std=std)
    found = unloaded(noisy, SEATS, MASS_KG, live_mass_kg=0.05)
    assert np.linalg.norm(found.values[:, silent]) < 1.5 * np.linalg.norm(values[:, silent])
    heard = replace(frf, values=np.where(silent, 0.0, frf.values))
    expected = unloaded(heard, SEATS, MASS_KG, live_mass_kg=0.05).values[:, ~silent]
    np.testing.assert_allclose(found.values[:, ~silent], expected, rtol=0.05)


def random_rows(shape):
    parts = np.random.default_rng(5).normal(size=(2, *shape))
    return (parts[0] + 1j * parts[1]) / np.sqrt(2)


def test_lines_far_above_the_band_stay_as_measured():
    loaded, bare = loaded_and_bare(truth_modes())
    found = without_mass(loaded, replace(SENSORS, upper_hz=200.0))
    above = loaded.frequency_hz > 200
    for whole, own in ((found, loaded), (found.reference, loaded.reference)):
        np.testing.assert_array_equal(whole.values[:, above], own.values[:, above])
    measured, own, taken = (each.values[:, ~above] for each in (loaded, bare, found))
    assert np.linalg.norm(taken - own) < 0.05 * np.linalg.norm(measured - own)


def on_a_tyre(frf, tyre, own_kg, live_kg, seats=SEATS):
    """The FRFs as of a laboratory tyre with masses at the seats and at the force, at 0°."""
    drive, values = tyre.surface(np.zeros(1))[0], np.empty_like(frf.values)
    for run, angles in seats.items():
        hung = tyre.hung(drive[None, :], live_kg)
        for tilt in (0.0, 90.0):
            rows = tyre.surface(angles, tilt)
            hung += rows.T @ (own_kg[run][:, None] * rows)
        here = np.array(frf.run) == run
        system = tyre.solve(drive=drive, extra_mass=hung)
        seen = tyre.surface(frf.position_deg[here])
        values[here] = system.inertance(seen, 2 * np.pi * frf.frequency_hz)
    fixed = frf.reference
    reference = None if fixed is None else on_a_tyre(fixed, tyre, own_kg, live_kg, seats)
    return replace(frf, values=values, reference=reference)


@pytest.mark.parametrize("seed", [1, 3])
def test_masses_on_a_belt_that_stretches_are_compensated(seed):
    """Sensors of 10 g, a reference of 20 g and 60 g at the force, from a mass matrix of its own.

    With the motion along the belt of all runs together, twice as much is left.
    """
    tyre = Laboratory(Effects(seed=seed)).tyre
    frf = systems.campaign_frf(truth_modes(), frequency_hz=LINES_HZ)
    own_kg = {run: np.append(np.full(12, 0.01), 0.02) for run in SEATS}
    loaded, bare = (
        on_a_tyre(frf, tyre, own_kg, 0.06),
        on_a_tyre(frf, tyre, dict.fromkeys(SEATS, np.zeros(13)), 0.0),
    )
    mass = SensorMass(0.01, SEATS, live_mass_kg=0.06, own_kg=own_kg)
    assert away(without_mass(loaded, mass), bare) < 0.01 * away(loaded, bare)
    alike = replace(mass, own_kg={})
    assert away(without_mass(loaded, alike), bare) > 0.02 * away(loaded, bare)


@pytest.mark.parametrize("n_runs", [3, 9, 12, 18])
def test_the_mass_is_compensated_however_many_sensors_are_moved_at_a_time(n_runs):
    """From 24 sensors in three runs to four in eighteen."""
    tyre = Laboratory(Effects(seed=1, stiffness_variation=0.01)).tyre
    frf = replace(systems.campaign_frf(truth_modes(), frequency_hz=LINES_HZ), reference=None)
    run = tuple(f"run_{row % n_runs + 1}" for row in range(frf.n_positions))
    frf = replace(frf, run=run)
    seats = {name: frf.position_deg[np.array(run) == name] for name in dict.fromkeys(run)}
    heavy, none = (
        {name: np.full(at.size, kg) for name, at in seats.items()} for kg in (0.003, 0.0)
    )
    loaded, bare = (on_a_tyre(frf, tyre, own_kg, 0.0, seats) for own_kg in (heavy, none))
    found = without_mass(loaded, SensorMass(0.003, seats))
    assert away(found, bare) < 0.2 * away(loaded, bare)


def test_what_sensors_off_their_places_show_is_not_taken_for_their_mass():
    """By half a degree, on a tyre uneven by 1 %; the waves then miss far more than the noise."""
    tyre = Laboratory(Effects(seed=1, stiffness_variation=0.01)).tyre
    frf = replace(systems.campaign_frf(truth_modes(), frequency_hz=LINES_HZ), reference=None)
    off_deg = np.random.default_rng(1).uniform(-0.5, 0.5, frf.n_positions)
    there = replace(frf, position_deg=frf.position_deg + off_deg)
    seats = {name: there.position_deg[np.array(frf.run) == name] for name in SEATS}
    loaded, bare = (
        replace(frf, values=on_a_tyre(there, tyre, own_kg, 0.0, seats).values)
        for own_kg in ({name: np.full(12, kg) for name in SEATS} for kg in (0.003, 0.0))
    )
    stated = {name: frf.position_deg[np.array(frf.run) == name] for name in SEATS}
    found = without_mass(loaded, SensorMass(0.003, stated))
    assert away(found, bare) < 0.1 * away(loaded, bare)


def test_without_mass_nothing_changes():
    frf = loaded_and_bare(TYRES["split, shaker in between"])[1]
    np.testing.assert_allclose(unloaded(frf, SEATS, 0.0).values, frf.values, rtol=1e-12)


def test_the_correction_does_not_depend_on_where_zero_is():
    loaded, _ = loaded_and_bare(TYRES["split, shaker in between"])
    turned = replace(loaded, position_deg=loaded.position_deg + 40)
    turned = replace(turned, reference=replace(loaded.reference, position_deg=np.full(6, 42.5)))
    seats = {name: angles + 40 for name, angles in SEATS.items()}
    again = unloaded(turned, seats, MASS_KG, excitation_deg=40.0)
    np.testing.assert_allclose(again.values, unloaded(loaded, SEATS, MASS_KG).values, rtol=1e-7)


@pytest.mark.parametrize("lost", [[7], [0, 30, 31]])
def test_sensors_that_gave_nothing_still_weigh(lost):
    loaded, bare = loaded_and_bare(TYRES["split, shaker in between"])
    kept = np.setdiff1d(np.arange(72), lost)
    found = unloaded(loaded.rows(kept), SEATS, MASS_KG)
    assert away(found, bare.rows(kept)) < 0.1 * away(loaded, bare)


def test_a_run_that_gave_nothing_is_no_obstacle():
    loaded, bare = loaded_and_bare(TYRES["both members alike"])
    kept = np.flatnonzero(np.array(loaded.run) != "run_1")
    found = unloaded(loaded.rows(kept), SEATS, MASS_KG)
    assert away(found, bare.rows(kept)) < 0.1 * away(loaded, bare)


def test_the_reference_sensor_may_be_missing():
    loaded, bare = loaded_and_bare(TYRES["split, shaker in between"])
    found = unloaded(replace(loaded, reference=None), SEATS, MASS_KG)
    assert away(found, bare) < 0.05 * away(loaded, bare)


def test_a_reference_sensor_at_an_unknown_angle_is_left_as_it_is():
    loaded, bare = loaded_and_bare(TYRES["both members alike"])
    nowhere = replace(loaded.reference, position_deg=np.full(6, np.nan))
    found = unloaded(replace(loaded, reference=nowhere), SEATS, MASS_KG)
    assert away(found, bare) < 0.05 * away(loaded, bare)
    np.testing.assert_array_equal(found.reference.values, loaded.reference.values)


def test_unknown_noise_does_not_stop_the_correction():
    loaded, bare = loaded_and_bare(TYRES["split, shaker in between"])
    silent = replace(loaded, std=np.full(loaded.std.shape, np.nan), reference=None)
    assert away(unloaded(silent, SEATS, MASS_KG), bare) < 0.05 * away(loaded, bare)


def test_a_run_with_unknown_seats_is_an_error():
    loaded, _ = loaded_and_bare(TYRES["driven members only"])
    known = {name: angles for name, angles in SEATS.items() if name != "run_2"}
    with pytest.raises(InputError, match="run 'run_2': no sensors"):
        unloaded(loaded, known, MASS_KG)


@pytest.mark.parametrize(
    ("name", "member"),
    [
        ("driven members only", ""),
        ("both members alike", "a"),
        ("split, shaker on an antinode", "a"),
        ("split, shaker in between", None),
    ],
)
def test_bare_frequencies_come_back_through_the_whole_identification(name, member):
    """Order 6, which divides the sensors' spacing, moves by up to 0.6 % and differently by run."""
    frf = systems.campaign_frf(TYRES[name], 34, sensor_mass_kg=MASS_KG)
    found = identify_modes(frf, (110.0, 210.0), sensor_mass=SENSORS)
    seen = systems.of_orders(TYRES[name], range(3, 7), member)
    systems.assert_modes(found.model, seen, frequency=3e-4, damping=0.02)
    assert found.findings == ()
    assert not found.model.drift.applied
    single = {Pair.ONE_SEEN, Pair.NOT_SEPARABLE}
    allowed = single if len(seen) == 4 else {Pair.RESOLVED}
    assert {mode.pair for mode in found.model.modes} <= allowed


@pytest.fixture(scope="module")
def bare_model():
    modes = systems.of_orders(truth_modes(), range(1, 4))
    frf = systems.campaign_frf(modes, 60, frequency_hz=LINES_HZ[:200]).rows(np.arange(0, 72, 6))
    poles = systems.pole(*np.array([(m.frequency_hz, m.damping_ratio) for m in modes]).T)
    return fit_modes(frf, poles, (60.0, 130.0))


def test_the_error_bars_hold_what_is_not_known_of_the_compensation(bare_model):
    """Gain and phase of the sensors, to 1 %, of the shift."""
    lower = tuple(replace(mode, pole=0.99 * mode.pole) for mode in bare_model.modes)
    model = with_mass_std(bare_model, replace(bare_model, modes=lower))
    for mode, before in zip(model.modes, bare_model.modes, strict=True):
        known = mode.frequency_std_hz**2 - before.frequency_std_hz**2
        assert known == pytest.approx((1e-4 * mode.frequency_hz) ** 2, rel=0.03)
        assert mode.damping_std**2 - before.damping_std**2 == pytest.approx(1e-8, rel=0.03)
    added = np.diag(model.covariance - bare_model.covariance)
    assert added[1::2] == pytest.approx(1e-8, rel=0.03)


def test_orders_beyond_the_positions_may_be_as_far_off_as_the_mass_shifts_others(bare_model):
    """Taken for a lower order, what the sensors do to them is not taken off."""
    first, *others = bare_model.modes
    beyond = replace(bare_model, modes=(*others, replace(first, order=None)))
    lower = tuple(replace(mode, pole=0.99 * mode.pole) for mode in beyond.modes)
    model = with_mass_std(beyond, replace(beyond, modes=lower))
    known, unknown = model.modes[0], model.modes[-1]
    assert unknown.frequency_std_hz == pytest.approx(0.01 * unknown.frequency_hz, rel=0.05)
    assert unknown.damping_std > 0.01 * unknown.damping_ratio
    assert known.frequency_std_hz < 2e-3 * known.frequency_hz


def test_two_runs_that_drift_are_no_second_mode_of_each_order():
    """36 sensors turned once: order 3 of one run and of the other are orders 3 and 33 of both."""
    effects = Effects(
        seed=532, sensors=36, runs=2, duration_s=8.0, sampling_rate_hz=800.0, snr_db=44.0,
        temperature_drift=0.01, sensor_mass_kg=0.0035, stiffness_variation=0.002, tilt_deg=5.3,
    )  # fmt: skip
    laboratory = Laboratory(effects)
    campaign = laboratory.campaign()
    mass = SensorMass(0.0035, sensors_of_runs(campaign))
    model = identify_modes(estimate_frf(campaign), (20.0, 260.0), sensor_mass=mass).model
    assert not any(mode.doubtful for mode in model.modes)
    assert model.drift.percent[1] == pytest.approx(1.0, abs=0.1)
    true_hz = np.array([m.frequency_hz for m in laboratory.truth.modes if m.strength > 0.01])
    for mode in model.modes:
        away = np.min(np.abs(true_hz - mode.frequency_hz))
        assert away < max(4 * mode.frequency_std_hz, 1e-3 * mode.frequency_hz)


def test_a_drift_is_lost_where_the_bare_tyre_fits_worse(bare_model):
    two = {name: np.zeros(2) for name in ("percent", "slope_percent", "curvature_percent")}
    drift = replace(NO_DRIFT, run=("1", "2"), applied=True, **two)
    drifted = replace(bare_model, drift=drift)
    worse = replace(bare_model, misfit=2 * bare_model.misfit)
    moved = replace(drifted, drift=replace(drift, percent=np.array([0.0, 1.0])))
    assert is_drift_lost(moved, bare_model)
    assert is_drift_lost(moved, drifted)
    assert not is_drift_lost(moved, moved)
    assert is_drift_lost(drifted, worse)
    assert not is_drift_lost(drifted, bare_model)
    assert not is_drift_lost(bare_model, worse)


def test_a_flipped_sensor_is_found_beneath_the_mass():
    modes = TYRES["split, shaker in between"]
    frf = systems.campaign_frf(modes, 34, sensor_mass_kg=MASS_KG)
    frf = systems.edited(frf, 20, values=-frf.values[20])
    found = identify_modes(frf, sensor_mass=SENSORS)
    assert [(f.position_deg, f.check) for f in found.findings] == [(100.0, "flipped")]
    systems.assert_modes(found.model, systems.of_orders(modes), frequency=3e-4)
    assert {mode.pair for mode in found.model.modes} == {Pair.RESOLVED}


def test_without_the_mass_no_sensor_is_accused_and_the_note_tells_the_size():
    modes = TYRES["both members alike"]
    model_of = identify_modes(systems.campaign_frf(modes, 34, sensor_mass_kg=MASS_KG))
    assert not any(finding.verdict == Verdict.EXCLUDED for finding in model_of.findings)
    assert "antinodes" in loading_note(model_of.model, 1, 0.0)
    note = loading_note(model_of.model, 13, 0.0)
    typical, worst = (float(word) for word in note.split() if word.startswith("0."))
    fourth = next(mode for mode in model_of.model.modes if mode.order == 4)
    assert 4 * typical == pytest.approx(100 * (145.45 / fourth.frequency_hz - 1), rel=0.15)
    assert 0.12 < worst < 0.2


def test_the_note_tells_the_size_of_a_live_mass_that_is_not_given():
    modes = TYRES["both members alike"]
    model = identify_modes(systems.campaign_frf(modes, 34)).model
    low, high = (float(word) for word in live_mass_note(model, 0.0).split() if "0." in word)
    exact = [100 * 0.01 / 2 / m.modal_mass_kg for m in systems.of_orders(modes, member="a")]
    assert low == pytest.approx(min(exact), abs=0.006)
    assert high == pytest.approx(max(exact), abs=0.006)


def test_without_a_drive_point_the_note_gives_no_number():
    frf = systems.campaign_frf(TYRES["driven members only"], 34)
    model = identify_modes(frf.rows(np.arange(2, 71))).model
    note = loading_note(model, 13, 0.0)
    assert note == "Sensor mass not given: nothing was corrected for it."


@pytest.mark.parametrize("order", [6, 12])
def test_the_worst_loading_is_that_of_sensors_on_antinodes(order):
    """Exact frequencies with twelve small masses on antinodes, against the first-order formula."""
    mode = next(m for m in TYRES["driven members only"] if m.order == order)
    angles_deg, mass_kg = np.arange(12) * 30.0, 1e-5
    poles = modal_sum((mode,), angles_deg, 0.0, sensor_mass_kg=mass_kg).poles
    exact = 100 * (1 - np.abs(poles) / (2 * np.pi) / mode.frequency_hz)
    residues = modal_sum((mode,), angles_deg, 0.0).residues.T
    found = loading_percent(np.array([mode.frequency_hz]), residues, residues[:, 0], 12, mass_kg)
    np.testing.assert_allclose(found, exact, rtol=1e-3)


def test_seats_of_a_campaign_include_the_reference():
    rate, noise = 1000.0, systems.white(64, 0, 3)
    run = systems.run_of(noise[0], noise, rate, position_deg=[0, 30, 60], reference=noise[1])
    campaign = replace(systems.campaign_of(run), reference_deg=2.5)
    np.testing.assert_array_equal(sensors_of_runs(campaign)["run_1.uff"], [0, 30, 60, 2.5])
    unknown = replace(campaign, reference_deg=None)
    np.testing.assert_array_equal(sensors_of_runs(unknown)["run_1.uff"], [0, 30, 60])
