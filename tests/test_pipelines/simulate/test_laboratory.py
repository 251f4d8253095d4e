"""The laboratory: exact poles, exact responses, and each effect where it belongs."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from scipy.linalg import expm

import ema
from ema.core.errors import InputError
from model import damping_ratios, natural_frequencies_hz, torsion_frequency_hz
from model.parameters import REFITTED_DAMPING, TABLE_4_RING, RingDamping
from pipelines.simulate.laboratory import Laboratory, simulate_laboratory, truth_content
from pipelines.simulate.laboratory_chain import (
    SETTLING_S,
    Driven,
    Mounting,
    force_spectrum,
    frequencies,
    moving_responses,
    period_samples,
    responses,
    with_faults,
)
from pipelines.simulate.laboratory_effects import Effects, effects_from, parse_effect
from pipelines.simulate.laboratory_tyre import LaboratoryTyre, State

SHORT = {"duration_s": 4.0, "runs": 2}
UNEVEN = {"splice": 0.004, "stiffness_variation": 0.02, "damping_variation": 0.3}
EVERYTHING = {
    **UNEVEN,
    "mass_variation": 0.01,
    "rim_hz": (42.0, 60.0),
    "rim_turning_hz": 90.0,
    "lateral_hz": (48.0, 131.0),
    "cavity_coupling": 0.1,
}


def ring_hz(modes):
    return {
        order: [m.frequency_hz for m in modes if m.kind == "ring" and m.order == order]
        for order in range(1, 8)
    }


def plain_mounting(angles_deg):
    zeros = np.zeros(len(angles_deg))
    angles = np.array(angles_deg, dtype=float)
    return Mounting(angles, angles, zeros, zeros + 1, zeros)


def test_poles_of_an_even_tyre_are_those_of_the_ring_model():
    tyre = LaboratoryTyre(TABLE_4_RING, RingDamping(0.0, 0.0, 0.0), Effects())
    found = np.sort(np.abs(tyre.solve().poles)) / (2 * np.pi)
    orders = np.arange(1, 13)
    expected = np.repeat(natural_frequencies_hz(TABLE_4_RING, orders), 2)
    assert found[1:25] == pytest.approx(expected, rel=1e-6)
    assert found[0] == pytest.approx(torsion_frequency_hz(TABLE_4_RING), rel=1e-6)


def test_damping_of_an_even_tyre_is_close_to_that_of_the_loss_factor():
    tyre = LaboratoryTyre(TABLE_4_RING, REFITTED_DAMPING, Effects())
    poles = tyre.solve().poles[1:15:2]
    expected = damping_ratios(TABLE_4_RING, REFITTED_DAMPING, np.arange(1, 8))
    assert -poles.real / np.abs(poles) == pytest.approx(expected, rel=1e-3)


def test_residues_add_up_to_the_inverse_of_the_dynamic_stiffness():
    laboratory = Laboratory(Effects(**EVERYTHING))
    tyre, drive = laboratory.tyre, laboratory.drive
    rows = tyre.surface(np.array([10.0, 123.0]), np.array([0.0, 4.0]))
    omega = 2 * np.pi * np.array([30.0, 75.0, 203.0, 250.0])
    found = tyre.solve(State(), drive).inertance(rows, omega)
    for column, w in enumerate(omega):
        dynamic = tyre.stiffness() + 1j * w * tyre.damping_matrix() - w**2 * tyre.mass
        expected = -(w**2) * rows @ np.linalg.solve(dynamic, drive.astype(complex))
        assert found[:, column] == pytest.approx(expected, rel=1e-8)


def test_matrices_are_symmetric_and_definite():
    tyre = Laboratory(Effects(**EVERYTHING)).tyre
    for matrix in (tyre.mass, tyre.stiffness(), tyre.damping_matrix()):
        assert matrix == pytest.approx(matrix.T, rel=1e-9, abs=1e-9 * np.abs(matrix).max())
        assert np.linalg.eigvalsh(matrix).min() > 0


def test_kinds_of_modes():
    modes = Laboratory(Effects(**EVERYTHING)).truth.modes
    kinds = [mode.kind for mode in modes]
    assert {"ring", "torsion", "rim", "lateral", "cavity"} <= set(kinds)
    assert kinds.count("lateral") == kinds.count("cavity") == 2
    assert all(len(both) == 2 for both in ring_hz(modes).values())


def test_an_uneven_tyre_splits_its_pairs_and_has_complex_modes():
    even = Laboratory(Effects()).truth.modes
    uneven = Laboratory(Effects(**UNEVEN)).truth.modes
    split = [max(hz) - min(hz) for hz in ring_hz(uneven).values()]
    assert max(max(hz) - min(hz) for hz in ring_hz(even).values()) < 1e-6
    assert min(split) > 1e-3
    phases = [np.abs(np.sum(m.shape**2)) / np.sum(np.abs(m.shape) ** 2) for m in uneven[1:15]]
    assert min(phases) < 0.9999


def test_stiffness_moves_all_frequencies():
    soft, stiff = (Laboratory(Effects(stiffness=k)).truth.modes for k in (1.0, 1.44))
    for order, hz in ring_hz(soft).items():
        assert ring_hz(stiff)[order] == pytest.approx(1.2 * np.array(hz), rel=1e-6)


def test_pressure_moves_high_orders_and_leaves_order_1():
    laboratory = Laboratory(Effects(pressure_drift=0.02))
    first, last = (ring_hz(laboratory.bare_modes(run)) for run in (0, 5))
    shift = {order: last[order][0] / first[order][0] - 1 for order in first}
    assert shift[1] == pytest.approx(0, abs=1e-5)
    assert 0.006 < shift[7] < 0.009
    assert list(shift.values()) == sorted(shift.values())


def test_temperature_moves_all_frequencies_and_damping_ratios_alike():
    effects = Effects(temperature_drift=0.01, temperature_damping=-0.06, **UNEVEN)
    laboratory = Laboratory(effects)
    tyre = laboratory.tyre
    first, last = (tyre.solve(laboratory.state(run)).poles[:20] for run in (0, 5))
    assert np.abs(last) / np.abs(first) == pytest.approx(1.01, rel=1e-3)
    ratio = (last.real / np.abs(last)) / (first.real / np.abs(first))
    assert ratio == pytest.approx(0.94, rel=2e-3)
    assert laboratory.truth.runs_percent[-1] == pytest.approx(1.0, abs=0.01)


def test_sensors_move_the_poles_as_first_order_theory_says():
    light = 1e-5
    laboratory = Laboratory(Effects(sensor_mass_kg=light, **UNEVEN))
    bare = laboratory.tyre.solve(laboratory.state(0), laboratory.drive)
    angles = laboratory.mounting(0).actual_deg
    hung = sum(
        laboratory.tyre.hung(laboratory.tyre.surface(angles, tilt), light) for tilt in (0.0, 90.0)
    )
    vectors = bare.vectors
    change = -np.einsum("rc,cd,dr->r", bare.left, hung, vectors) * bare.poles**2
    loaded = laboratory.system(0)
    lowest = slice(1, 15)
    assert (loaded.poles - bare.poles)[lowest] == pytest.approx(change[lowest], rel=2e-2)
    assert np.all(change[lowest].imag < 0)


def test_live_mass_lowers_what_the_force_drives():
    bare, live = (Laboratory(Effects(live_mass_kg=mass)).system(0).poles for mass in (0.0, 0.05))
    assert np.abs(live[2]) < np.abs(bare[2]) * 0.9999 or np.abs(live[1]) < np.abs(bare[1]) * 0.9999


def test_responses_are_those_of_the_equations_of_motion():
    """Against stepping of the state by matrix exponentials at eight times the rate."""
    effects = Effects(duration_s=1.0, sampling_rate_hz=1000.0, **UNEVEN)
    laboratory = Laboratory(effects)
    tyre, drive = laboratory.tyre, laboratory.drive
    mounting = plain_mounting([10.0, 200.0])
    rows = tyre.surface(mounting.actual_deg)
    period, finer = period_samples(effects), 8
    omega = frequencies(effects, period)
    spectrum = force_spectrum(effects, np.random.default_rng(1))
    spectrum[omega > 2 * np.pi * 200] = 0
    found = responses(Driven(tyre.solve(State(), drive), rows, spectrum, omega, mounting))

    force = np.fft.irfft(spectrum, period * finer) * finer
    step, size = 1 / (effects.sampling_rate_hz * finer), tyre.size
    inverse = np.linalg.inv(tyre.mass)
    state = np.zeros((2 * size + 2, 2 * size + 2))
    state[:size, size : 2 * size] = np.eye(size)
    state[size : 2 * size, :size] = -inverse @ tyre.stiffness()
    state[size : 2 * size, size : 2 * size] = -inverse @ tyre.damping_matrix()
    state[size : 2 * size, -2] = inverse @ drive
    state[-2, -1] = 1  # the force between samples is a straight line
    whole = expm(state * step)
    along, held, climbing = whole[:-2, :-2], whole[:-2, -2], whole[:-2, -1] / step
    x, expected = np.zeros(2 * size), np.empty((2, period))
    for k in range(period * finer):
        if k % finer == 0:
            rate = state[size:-2, :-2] @ x + inverse @ drive * force[k]
            expected[:, k // finer] = rows @ rate
        following = force[(k + 1) % force.size]
        x = along @ x + held * force[k] + climbing * (following - force[k])
    kept = slice(period // 2, None)
    assert np.std((found - expected)[:, kept]) < 5e-3 * np.std(expected[:, kept])


def test_the_frf_of_a_campaign_converges_to_the_exact_one():
    effects = Effects(duration_s=60.0, runs=1, snr_db=200.0, force_snr_db=200.0, shaker=True)
    laboratory = Laboratory(effects)
    frf = ema.estimate_frf(laboratory.campaign())
    lines = (frf.frequency_hz > 60) & (frf.frequency_hz < 250)
    rows = laboratory.tyre.surface(frf.position_deg)
    exact = laboratory.system(0).inertance(rows, 2 * np.pi * frf.frequency_hz[lines])
    error = np.linalg.norm(frf.values[:, lines] - exact) / np.linalg.norm(exact)
    assert error < 0.02


def test_poles_that_move_by_a_constant_are_those_of_another_tyre():
    effects = Effects(duration_s=2.0, **UNEVEN)
    laboratory = Laboratory(effects)
    system = laboratory.tyre.solve(State(), laboratory.drive)
    mounting = plain_mounting([10.0])
    rows = laboratory.tyre.surface(mounting.actual_deg)
    period = period_samples(effects)
    omega = frequencies(effects, period)
    spectrum = force_spectrum(effects, np.random.default_rng(1))
    driven = Driven(system, rows, spectrum, omega, mounting)
    still = responses(driven)
    shift = np.zeros((4, period), dtype=complex)
    same = moving_responses(driven, shift)
    assert same == pytest.approx(still, abs=1e-9 * np.abs(still).max())

    shift[:] = 0.01 * system.poles[:4, None]
    moved = moving_responses(driven, shift)
    system.poles[:4] *= 1.01
    expected = responses(Driven(system, rows, spectrum, omega, mounting))
    kept = slice(round(SETTLING_S * effects.sampling_rate_hz), None)
    # Residues alone do not vanish in sum any more, which leaves a constant in the inertance.
    difference = (moved - expected)[:, kept]
    assert np.std(difference) < 1e-3 * np.std(expected)


@pytest.mark.parametrize(
    ("part", "state"), [(slice(0, 20_000), 0.985), (slice(-20_000, None), 1.015)]
)
def test_drift_within_a_run(part, state):
    """The first and the last quarter show the tyre as it is in their middle."""
    laboratory = Laboratory(Effects(duration_s=40.0, runs=1, drift_within=0.04, snr_db=200.0))
    signals = (laboratory.signals(0)[0], laboratory.signals(0)[1][3])
    force, found = (np.fft.rfft(x[part].reshape(5, -1) * np.hanning(4000)) for x in signals)
    frf = np.sum(found * force.conj(), axis=0) / np.sum(np.abs(force) ** 2, axis=0)
    omega = np.pi * np.arange(140, 500)
    rows = laboratory.tyre.surface(laboratory.mounting(0).actual_deg[[3]])
    factors = state + np.array([-0.01, -0.005, 0, 0.005, 0.01])
    errors = [
        np.linalg.norm(
            frf[140:500]
            - laboratory.tyre.solve(State(frequency=k), laboratory.drive).inertance(rows, omega)[0]
        )
        for k in factors
    ]
    assert np.argmin(errors) == 2
    assert errors[2] < 0.07 * np.linalg.norm(frf[140:500])


def test_softening_lowers_the_frequency_of_the_louder_run():
    effects = Effects(**SHORT, softening=0.02, level_step_db=6.0)
    laboratory = Laboratory(effects)
    stiff = Laboratory(Effects(**SHORT, level_step_db=6.0))
    quiet, loud = (
        np.std(laboratory.signals(run)[1] - stiff.signals(run)[1]) / np.std(stiff.signals(run)[1])
        for run in (0, 1)
    )
    assert loud > 1.5 * quiet > 0


def test_hammer_train():
    effects = Effects(duration_s=30.0, runs=1, excitation="hammer", hits=8, preload_n=50.0)
    force, _ = Laboratory(effects).signals(0)
    starts = np.flatnonzero((force[1:] > 1) & (force[:-1] <= 1))
    assert starts.size == 8
    gaps = np.diff(starts)
    assert gaps.std() > 0.05 * gaps.mean()
    widths = [np.count_nonzero(force[s : s + 40] > 1) for s in starts]
    assert len(set(widths)) > 1
    double = Effects(duration_s=30.0, runs=1, excitation="hammer", hits=8, double_hits=1.0)
    force, _ = Laboratory(double).signals(0)
    assert np.count_nonzero((force[1:] > 1) & (force[:-1] <= 1)) > 12


@pytest.mark.parametrize("excitation", ["pink", "burst", "sweep"])
def test_other_forces_have_the_same_rms(excitation):
    force, found = Laboratory(Effects(**SHORT, excitation=excitation)).signals(0)
    assert 5 < np.std(force) < 16
    assert np.all(np.isfinite(found))


def test_the_force_of_a_shaker_drops_at_resonances():
    omega = 2 * np.pi * np.arange(60.0, 250.0)
    laboratory = Laboratory(Effects(shaker=True, duration_s=60.0))
    force, _ = laboratory.signals(0)
    drive = np.abs(laboratory.system(0).inertance(laboratory.drive[None, :], omega)[0])
    blocks = np.abs(np.fft.rfft(force.reshape(60, 2000) * np.hanning(2000))) ** 2
    power = np.sqrt(blocks.mean(axis=0)[60:250])
    assert np.corrcoef(drive, power)[0, 1] < -0.3


def test_quantisation():
    _, coarse = Laboratory(Effects(**SHORT, bits=8)).recordings(0)
    steps = np.unique(np.round(coarse, 9))
    assert 20 < steps.size <= 256
    gaps = np.diff(steps)
    assert gaps == pytest.approx(gaps.min() * np.round(gaps / gaps.min()), rel=1e-6)


def test_clipping_and_gain_and_delay():
    _, clipped = Laboratory(Effects(**SHORT, clip=2.0)).recordings(0)
    assert np.count_nonzero(clipped[0] == clipped[0].max()) > 10
    plain = Laboratory(Effects(**SHORT)).signals(0)[1]
    late = Laboratory(Effects(**SHORT, delay_us=5000.0)).signals(0)[1]
    assert np.std(late) == pytest.approx(np.std(plain), rel=0.05)
    assert np.std(late - plain) > 0.1 * np.std(plain)


def test_faulty_sensors():
    effects = Effects(**SHORT, dead_sensor=1, flipped_sensor=2, scaled_sensor=3, swapped_sensor=4)
    assert effects.faulty_sensors == {1, 2, 3, 4, 5}
    good = Laboratory(Effects(**SHORT)).signals(0)[1]
    bad = with_faults(good, effects)
    assert np.std(bad[0]) < 1e-3 * np.std(good[0])
    assert bad[1] == pytest.approx(-good[1])
    assert bad[2] == pytest.approx(good[2] / 2)
    assert bad[[3, 4]] == pytest.approx(good[[4, 3]])


def test_one_effect_leaves_the_random_rest_alone():
    plain, uneven = Laboratory(Effects(seed=4)), Laboratory(Effects(seed=4, gain_error=0.1))
    assert plain.tyre.ring == uneven.tyre.ring
    assert plain.signals(0)[0] == pytest.approx(uneven.signals(0)[0])


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        ({"mirrored_step": True}, -5.0),
        ({"offset_deg": 5.0, "offset_run": 2}, 10.0),
        ({"reversed_sequence": True}, 5.0),
    ],
)
def test_sensors_elsewhere_than_declared(option, expected):
    mounting = Laboratory(Effects(**option)).mounting(1)
    assert mounting.declared_deg[0] == 5.0
    assert mounting.actual_deg[0] == expected


def test_partial_circle():
    campaign = Laboratory(Effects(circle_deg=(0.0, 165.0), runs=1, duration_s=2.0)).campaign()
    angles = [response.position_deg for response in campaign.runs[0].responses]
    assert angles == pytest.approx(np.arange(12) * 15.0)


def effects_of(path):
    content = json.loads(path.read_text(encoding="utf-8"))
    return Effects(seed=content["seed"], **content["options"])


def test_truth_round_trip(tmp_path):
    truth = Laboratory(Effects(seed=7, pressure_drift=0.01, lateral_hz=(48.0,), runs=3)).truth
    path = tmp_path / "truth.json"
    path.write_text(json.dumps(truth_content(truth)), encoding="utf-8")
    again = json.loads(path.read_text(encoding="utf-8"))
    assert effects_of(path) == truth.effects
    assert again["tyre"] == asdict(truth.ring) | asdict(truth.damping)
    assert tuple(again["runs_percent"]) == truth.runs_percent
    for mode, listed in zip(truth.modes, again["modes"], strict=True):
        assert (listed["kind"], listed["frequency_hz"]) == (mode.kind, mode.frequency_hz)
        shape = np.array(listed["re"]) + 1j * np.array(listed["im"])
        assert shape == pytest.approx(mode.shape, abs=1e-11)


@pytest.mark.parametrize(
    "options", [{"sensor_mass_kg": 0.003}, {"circle_deg": (0.0, 165.0), "runs": 1, "sensors": 12}]
)
def test_files_hold_what_the_campaign_in_memory_holds(tmp_path, options):
    effects = Effects(**SHORT | options)
    folder = simulate_laboratory(tmp_path / "virtual", effects)
    read, made = ema.read_campaign(folder), Laboratory(effects).campaign()
    assert read.sensor_mass_kg == made.sensor_mass_kg
    assert (read.excitation_deg, read.reference_deg) == (made.excitation_deg, made.reference_deg)
    assert [run.name for run in read.runs] == [run.name for run in made.runs]
    first, second = ema.estimate_frf(read), ema.estimate_frf(made)
    assert first.position_deg == pytest.approx(second.position_deg)
    assert first.values == pytest.approx(second.values)
    assert effects_of(folder / "truth.json") == effects
    with pytest.raises(InputError, match="empty folder"):
        simulate_laboratory(folder, effects)


def test_effects_on_the_command_line(ringmodal, tmp_path):
    file = tmp_path / "effects.toml"
    file.write_text('excitation = "hammer"\nhits = 3\nruns = 4\n', encoding="utf-8")
    code, output, errors = ringmodal(
        *("simulate", "campaign", tmp_path / "virtual", "--effects", file),
        *("--effect", "runs=1", "--effect", "rim_hz=[42, 60]", "--duration-s", 5, "--json"),
    )
    assert (code, errors) == (0, "")
    folder = tmp_path / "virtual"
    assert json.loads(output) == {"campaign": str(folder)}
    effects = effects_of(folder / "truth.json")
    expected = {"excitation": "hammer", "hits": 3, "runs": 1, "rim_hz": (42.0, 60.0)}
    assert effects == Effects(duration_s=5.0, snr_db=34.0, **expected)
    assert (folder / "run_1.uff").is_file()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--effect", "spice=1"), "known effects"),
        (("--effect", "splice"), "name=value"),
        (("--effect", "splice=much"), "a number"),
        (("--effects", "absent.toml"), "file not found"),
        (("--effect", "splice=0.01", "--split-percent", 1), "stiffness_variation"),
    ],
)
def test_unsuitable_effects_on_the_command_line(ringmodal, tmp_path, options, message):
    code, _, errors = ringmodal("simulate", "campaign", tmp_path / "virtual", *options)
    assert code == 2
    assert message in " ".join(errors.split())
    assert not (tmp_path / "virtual").exists()


def test_effects_are_checked():
    with pytest.raises(InputError, match="splice"):
        Effects(splice=2.0)
    with pytest.raises(InputError, match="hits"):
        Effects(hits=2.5)
    with pytest.raises(InputError, match="excitation"):
        Effects(excitation="kick")
    with pytest.raises(InputError, match="known effects"):
        effects_from({"spice": 0.1})
    assert parse_effect("rim_hz=[42, 60]") == ("rim_hz", [42, 60])
    assert parse_effect("excitation=burst") == ("excitation", "burst")


def test_runs_are_made_again_for_further_places_of_the_force(tmp_path):
    effects = Effects(
        duration_s=2.0, runs=2, splice=0.05, further_forces_deg=(22.5,), live_mass_kg=0.02
    )
    laboratory = Laboratory(effects)
    read = ema.read_campaign(simulate_laboratory(tmp_path / "two", effects))
    made = laboratory.campaign()
    assert [run.references for run in made.runs] == [((0.0, 0),)] * 2 + [((22.5, 0),)] * 2
    assert [run.references for run in read.runs] == [run.references for run in made.runs]
    assert laboratory.places(0) == laboratory.places(2)
    poles = [np.sort_complex(laboratory.system(run).poles) for run in (0, 2)]
    assert not np.allclose(*poles, rtol=1e-6)  # the live mass moved with the force
    rows = laboratory.tyre.surface(np.array([0.0, 22.5]))
    bare = [laboratory.tyre.solve(drive=laboratory.drive_in(run)) for run in (0, 2)]
    omega = 2 * np.pi * np.arange(50.0, 250.0)
    one, other = (system.inertance(rows, omega) for system in bare)
    np.testing.assert_allclose(one[1], other[0], rtol=1e-9)  # reciprocity
