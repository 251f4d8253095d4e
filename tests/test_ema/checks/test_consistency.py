"""Sensors against the modes that all others show: flipped, scaled, swapped, contradicting."""

from dataclasses import replace

import numpy as np
import pytest
import systems
from hypothesis import given, settings
from hypothesis import strategies as st

from ema.checks.corrections import followed_by
from ema.checks.sensor_consistency import check_consistency
from ema.core.errors import FitError
from ema.core.finding import Check, Verdict
from ema.core.modes import ModalModel, Mode, ResidualTerms
from ema.identify import identify_modes
from pipelines.simulate.truth import truth_modes

TYRE = truth_modes()
SEVEN = systems.of_orders(TYRE)
FULL_DEG = np.arange(72) * 5.0
STD = 1e-3
FRF = systems.campaign_frf(TYRE, 34, frequency_hz=np.arange(100, 140) / 2)


def checked(frf, model):
    check = check_consistency(frf, model)
    return check.frf, list(check.findings)


def model_of(gain, *, noise=STD, orders=range(1, 8), turned_deg=0.0):
    """Modes cos n(θ − θ_n) as sensors with these gains measure them."""
    rng = np.random.default_rng(0)
    modes = []
    for order in orders:
        shape = np.cos(order * np.deg2rad(FULL_DEG - turned_deg)) * 1j
        error = noise * (rng.standard_normal(72) + 1j * rng.standard_normal(72))
        pole = complex(systems.pole(70.0 + 20 * order, 0.02))
        std = np.full(72, noise) * np.abs(gain)
        modes.append(Mode(pole, 0.01, 1e-4, (shape + error) * gain, std, order, "", 1.0))
    zero = np.zeros(72)
    return ModalModel(
        modes=tuple(modes),
        guard_modes=(),
        residual_terms=ResidualTerms(zero, zero),
        band_hz=(20.0, 260.0),
        fit_band_hz=(20.0, 260.0),
        covariance=np.zeros((14, 14)),
        frac=zero,
        misfit=1.0,
        node=np.arange(72),
        position_deg=FULL_DEG,
    )


def gains(**changes):
    gain = np.ones(72, dtype=complex)
    for row, value in changes.items():
        gain[int(row[1:])] = value
    return gain


def test_healthy_sensors_are_left_alone():
    corrected, findings = checked(FRF, model_of(gains(), noise=0.02))
    assert findings == []
    np.testing.assert_array_equal(corrected.values, FRF.values)


@settings(max_examples=20)
@given(st.integers(0, 71), st.floats(0.85, 1.2))
def test_a_flipped_sensor_is_turned_and_keeps_its_calibration(row, sensitivity):
    corrected, findings = checked(FRF, model_of(gains(**{f"_{row}": -sensitivity})))
    (finding,) = findings
    assert (finding.check, finding.verdict) == ("flipped", Verdict.WARNING)
    assert (finding.run, finding.channel) == (FRF.run[row], FRF.channel[row])
    np.testing.assert_array_equal(corrected.values[row], -FRF.values[row])
    np.testing.assert_array_equal(corrected.std[row], FRF.std[row])


@settings(max_examples=30)
@given(st.integers(0, 71), st.sampled_from([1e-2, 0.1, 0.5, 2.0, 9.81, 100.0, 1000.0, -0.1, -10.0]))
def test_a_wrong_sensitivity_is_divided_out(row, gain):
    corrected, findings = checked(FRF, model_of(gains(**{f"_{row}": gain}), noise=1e-4))
    (finding,) = findings
    assert (finding.check, finding.verdict) == ("scaled", Verdict.WARNING)
    assert ("wrong sign" in finding.detail) is (gain < 0)
    np.testing.assert_allclose(corrected.values[row], FRF.values[row] / gain, rtol=0.01)
    np.testing.assert_allclose(corrected.std[row], FRF.std[row] / abs(gain), rtol=0.01)


@pytest.mark.parametrize("gain", [0.85, 1.0, 1.2])
def test_sensors_may_differ_as_sensors_do(gain):
    assert checked(FRF, model_of(gains(_7=gain)))[1] == []


def test_sensors_without_any_of_the_modes_are_left_out():
    corrected, findings = checked(FRF, model_of(gains(_20=1j)))
    (finding,) = findings
    assert (finding.check, finding.verdict) == ("inconsistent", Verdict.EXCLUDED)
    assert 100.0 not in corrected.position_deg


def swapped_model(first, second):
    model = model_of(gains(), turned_deg=3.0)
    modes = []
    for mode in model.modes:
        residues = np.array(mode.residues)
        residues[[first, second]] = residues[[second, first]]
        modes.append(replace(mode, residues=residues))
    return replace(model, modes=tuple(modes))


@pytest.mark.parametrize(("first", "second"), [(12, 30), (0, 6), (6, 42)])
def test_two_swapped_sensors_of_a_run_are_put_right(first, second):
    corrected, findings = checked(FRF, swapped_model(first, second))
    assert [(f.check, f.verdict) for f in findings] == [("swapped", Verdict.WARNING)] * 2
    assert FRF.channel[second] in findings[0].detail
    assert FRF.channel[first] in findings[1].detail
    np.testing.assert_array_equal(corrected.values[[first, second]], FRF.values[[second, first]])
    np.testing.assert_array_equal(corrected.position_deg, FRF.position_deg)


def test_two_of_twelve_sensors_may_be_swapped():
    nodes = np.arange(0, 72, 6)
    full = swapped_model(18, 24)
    modes = tuple(
        replace(mode, residues=mode.residues[nodes], residues_std=mode.residues_std[nodes])
        for mode in full.modes[:5]  # more are not told apart by twelve sensors
    )
    model = replace(full, modes=modes, node=nodes, position_deg=FULL_DEG[nodes])
    findings = checked(FRF.rows(nodes), model)[1]
    assert [f.check for f in findings] == ["swapped"] * 2


def test_sensors_of_different_runs_cannot_have_been_swapped():
    findings = checked(FRF, swapped_model(12, 31))[1]
    assert {finding.check for finding in findings} == {"inconsistent"}


def test_a_run_most_of_whose_sensors_disagree_is_blamed_as_a_whole():
    rows = np.flatnonzero(np.array(FRF.run) == "run_2")
    odd = gains(**{f"_{row}": 1j for row in rows})
    corrected, findings = checked(FRF, model_of(odd))
    (finding,) = findings
    assert (finding.run, finding.channel, finding.verdict) == ("run_2", "", Verdict.WARNING)
    assert "12 of 12 sensors" in finding.detail
    assert corrected.n_positions == 72


@pytest.mark.parametrize("runs", [(0,), (2,), (5,), (1, 4)])
def test_runs_with_a_reversed_force_are_turned(runs):
    """Their sensors sit at every sixth position: the shapes' purity falls to 0.44 and 0.11."""
    gain = np.ones(72, dtype=complex)
    for run in runs:
        gain[run::6] = -1
    sign = np.where(np.isin(range(6), runs), -1.0, 1.0)[:, None]
    fixed = replace(FRF.reference, values=FRF.reference.values * sign)
    corrected, findings = checked(replace(FRF, reference=fixed), model_of(gain))
    assert {finding.check for finding in findings} == {Check.FLIPPED}
    assert len(findings) == 12 * len(runs)
    np.testing.assert_allclose(corrected.values, FRF.values * gain[:, None])


def test_a_run_that_its_fixed_sensor_does_not_confirm_is_left_as_it_is():
    gain = np.ones(72, dtype=complex)
    gain[::6] = -1
    corrected, findings = checked(FRF, model_of(gain))
    assert {finding.check for finding in findings} == {Check.CORRECTIONS_WITHHELD}
    np.testing.assert_array_equal(corrected.values, FRF.values)


@pytest.mark.parametrize("gain", [0.25, 2.0, 4.448])
def test_a_force_of_wrong_scale_in_one_run_is_corrected(gain):
    factor = np.ones(72, dtype=complex)
    factor[2::6] = gain
    scale = np.where(np.arange(6) == 2, gain, 1.0)[:, None]
    fixed = replace(FRF.reference, values=FRF.reference.values * scale)
    corrected, findings = checked(replace(FRF, reference=fixed), model_of(factor))
    assert {(finding.check, finding.run) for finding in findings} == {(Check.SCALED, FRF.run[2])}
    np.testing.assert_allclose(corrected.values[2::6], FRF.values[2::6] / gain, rtol=0.01)


@pytest.mark.parametrize("rows", [(0, 6, 12, 18), tuple(range(0, 72, 9)), (1, 2, 3, 4, 5, 6, 7, 8)])
def test_sensors_do_not_fail_by_the_dozen(rows):
    corrected, findings = checked(FRF, model_of(gains(**{f"_{row}": 0.5 for row in rows})))
    assert [finding.check for finding in findings] == [Check.CORRECTIONS_WITHHELD]
    assert corrected is FRF


def test_one_sensor_that_is_wrong_in_all_its_runs_is_one_fault():
    """Two sensors of a wrong sensitivity are twelve rows, but not a dozen faults."""
    wrong = [row for row in range(72) if FRF.channel[row] in (FRF.channel[0], FRF.channel[12])]
    assert len(wrong) == 12
    _, findings = checked(FRF, model_of(gains(**{f"_{row}": 0.5 for row in wrong})))
    assert [finding.check for finding in findings] == [Check.SCALED] * 12


def test_a_gain_that_is_not_the_same_in_all_modes_is_no_sensitivity():
    model = model_of(gains())
    modes = [
        replace(mode, residues=mode.residues * np.where(np.arange(72) == 20, factor, 1.0))
        for mode, factor in zip(model.modes, (0.4, 1.0, 1.6, 0.7, 1.3, 0.5, 2.0), strict=True)
    ]
    _, findings = checked(FRF, replace(model, modes=tuple(modes)))
    assert Check.SCALED not in {finding.check for finding in findings}


def test_half_a_circle_blames_no_sensor():
    """There, order 3 looks like a mixture of orders 2 and 4: nothing is beyond doubt."""
    nodes = np.arange(0, 36, 3)
    full = model_of(gains(_6=-1.0, _9=0.5))
    modes = [
        replace(mode, residues=mode.residues[nodes], residues_std=mode.residues_std[nodes])
        for mode in full.modes
    ]
    model = replace(full, modes=tuple(modes), node=nodes, position_deg=FULL_DEG[nodes])
    assert checked(FRF.rows(nodes), model)[1] == []


def test_an_order_beyond_a_gap_in_the_circle_blames_no_healthy_sensor():
    # 15° apart, none from 180° to 210°: order 7 is not resolved there, and half looks like order 5.
    nodes = np.setdiff1d(np.arange(0, 72, 3), [36, 39, 42])
    flipped = np.isin(nodes, [18, 21])
    full = model_of(np.where(np.isin(np.arange(72), nodes[flipped]), -1.0, 1.0))
    model = replace(
        full,
        modes=tuple(
            replace(mode, residues=mode.residues[nodes], residues_std=mode.residues_std[nodes])
            for mode in full.modes
        ),
        node=nodes,
        position_deg=FULL_DEG[nodes],
    )
    corrected, findings = checked(FRF.rows(nodes), model)
    assert [finding.check for finding in findings] == ["flipped"] * 2
    assert [finding.position_deg for finding in findings] == [90.0, 105.0]
    assert corrected.n_positions == nodes.size


def test_a_single_mode_is_too_little_to_judge_by():
    assert checked(FRF, model_of(gains(_5=-1), orders=[3])) == (FRF, [])


def test_shapes_of_no_single_order_do_not_judge():
    model = model_of(gains(_5=-1))
    rng = np.random.default_rng(1)
    modes = tuple(replace(m, residues=rng.standard_normal(72)) for m in model.modes)
    assert checked(FRF, replace(model, modes=modes)) == (FRF, [])


# The same on FRFs, through the whole identification.
HEALTHY = systems.campaign_frf(TYRE, 30)
NOISE = np.random.default_rng(9).standard_normal((700, 2)) @ [1, 1j]


def faulty(name):
    frf, level = HEALTHY, np.sqrt(np.mean(np.abs(HEALTHY.values) ** 2))
    swap = {"values": frf.values[[30, 12]], "std": frf.std[[30, 12]]}
    turned = systems.edited(frf, 25, values=-frf.values[25])
    loud = {"values": level * NOISE, "coherence": 0.02, "std": level}
    scaled = {"values": 0.1 * frf.values[33], "std": 0.1 * frf.std[33]}
    return {
        "scaled": lambda: systems.edited(frf, 33, **scaled),
        "swapped": lambda: systems.edited(frf, [12, 30], **swap),
        "incoherent": lambda: systems.edited(frf, 33, **loud),
        "turned phase": lambda: systems.edited(frf, 33, values=frf.values[33] * 1j),
        "a cable each": lambda: systems.edited(
            systems.edited(turned, 10, values=1e-6 * NOISE, coherence=0.01),
            50,
            clipped=0.02,
            values=0.7 * frf.values[50],
        ),
    }[name]()


EXPECTED = {
    "scaled": {(33, "scaled", Verdict.WARNING)},
    "swapped": {(12, "swapped", Verdict.WARNING), (30, "swapped", Verdict.WARNING)},
    "incoherent": {(33, "incoherent", Verdict.EXCLUDED)},
    "turned phase": {(33, "inconsistent", Verdict.EXCLUDED)},
    "a cable each": {
        (10, "dead", Verdict.EXCLUDED),
        (25, "flipped", Verdict.WARNING),
        (50, "clipped", Verdict.EXCLUDED),
    },
}


@pytest.mark.parametrize("name", EXPECTED)
def test_faults_are_named_and_cost_no_accuracy(name):
    found = identify_modes(faulty(name))
    seen = {(round(f.position_deg / 5), f.check, f.verdict) for f in found.findings}
    assert seen == EXPECTED[name]
    lost = sum(verdict == Verdict.EXCLUDED for *_, verdict in EXPECTED[name])
    assert found.frf.n_positions == 72 - lost
    systems.assert_modes(found.model, SEVEN, frequency=5e-4, damping=0.02)


def test_a_humming_sensor_is_named_and_costs_no_accuracy():
    near = np.abs(HEALTHY.frequency_hz - 50) < 0.6
    values, std = np.array(HEALTHY.values), np.array(HEALTHY.std)
    values[20, near] += 3.0
    std[20, near] *= 100
    found = identify_modes(replace(HEALTHY, values=values, std=std))
    assert [(f.position_deg, f.check, f.verdict) for f in found.findings] == [
        (100.0, "hum", Verdict.WARNING)
    ]
    systems.assert_modes(found.model, SEVEN, frequency=5e-4, damping=0.02)


def test_a_band_beyond_the_lines_is_refused_before_anything_is_judged():
    with pytest.raises(FitError, match=r"only 0 frequency lines.* the FRFs end at"):
        identify_modes(HEALTHY, (5000.0, 6000.0))


@pytest.mark.parametrize(
    ("gain", "applied", "check", "factor"),
    [(1.27, 1.27, None, 1.0), (-1.27, 1.27, Check.FLIPPED, -1.0), (0.5, 5.0, Check.SCALED, 10.0)],
)
def test_a_factor_found_again_takes_the_place_of_the_first(gain, applied, check, factor):
    """A row is read by `gain` now, after a factor that the first look gave it was `applied`."""
    found = check_consistency(FRF, model_of(gains(r25=gain)), applied={25: applied})
    first = replace(found.corrections[0], factor=applied, check=Check.SCALED)
    made = followed_by(FRF, (first,), found.corrections)
    assert [(each.check, pytest.approx(each.factor, rel=0.01)) for each in made] == (
        [] if check is None else [(check, factor)]
    )
    assert [each.check for each in found.findings if not each.is_ok] == [
        each.check for each in made
    ]
