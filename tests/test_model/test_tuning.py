"""Tuning on the paper's frequencies, and on rings whose parameters are known."""

from dataclasses import replace

import numpy as np
import pytest

from model import (
    ParameterError,
    RingParameters,
    equilibrium,
    frequency_sensitivity,
    natural_frequencies_hz,
    tune_ring,
)
from model.parameters import RING_NAMES, TABLE_4_RING, TuningPriors
from model.parameters import TABLE_3_FREQUENCIES_HZ as MEASURED
from model.parameters import TABLE_3_ORDERS as ORDERS
from model.tuning_problem import TuningProblem
from model.verdict import Reason

TYRE = {"mean_radius_m": 0.33, "inflation_pressure_pa": 2.2e5}
MASS = {"mass_per_area_kg_m2": 19.69}
#: Only the errors of the frequencies.
EXACT = {"priors": TuningPriors(0.0, 0.0, 0.0, 0.0, 1e-6, 0.0)}


def test_every_frequency_of_table_3_within_one_percent():
    result = tune_ring(ORDERS, MEASURED, **TYRE)
    assert np.abs(result.error_percent).max() < 0.3
    assert result.how["mass_per_area_kg_m2"] == "identified"
    assert result.how["bending_stiffness_n_m"] == "not identified"
    assert any("bending stiffness D is not identified" in note for note in result.notes)


def test_given_mass_and_axial_stiffness_reproduce_the_relative_frequency_optimum():
    given = MASS | {"axial_stiffness_n_m": 2.52e7}
    result = tune_ring(ORDERS, MEASURED, given=given, **TYRE)
    assert result.ring.circumferential_stiffness_n_m3 == pytest.approx(1.68e6, rel=3e-3)
    assert result.ring.radial_stiffness_n_m3 == pytest.approx(7.98e6, rel=1e-3)
    assert result.ring.bending_stiffness_n_m == pytest.approx(9.86, rel=1e-3)
    expected = [-0.07, 0.32, 0.20, -0.49, -0.53, 0.09, 0.25]
    np.testing.assert_allclose(result.error_percent, expected, atol=6e-3)
    assert {result.how[name] for name in given} == {"given"}


def test_standard_deviations_at_half_a_percent_noise():
    given = MASS | {"axial_stiffness_n_m": 2.52e7}
    std_hz = 0.005 * MEASURED
    result = tune_ring(ORDERS, MEASURED, given=given, frequency_std_hz=std_hz, **EXACT, **TYRE)
    relative = {name: std / getattr(result.ring, name) for name, std in result.std.items()}
    assert relative["radial_stiffness_n_m3"] == pytest.approx(0.01, abs=3e-3)
    assert relative["circumferential_stiffness_n_m3"] == pytest.approx(0.09, abs=8e-3)
    assert relative["bending_stiffness_n_m"] == pytest.approx(0.18, abs=8e-3)


def test_standard_deviations_at_table_4():
    truth = natural_frequencies_hz(TABLE_4_RING, ORDERS)
    given = MASS | {"axial_stiffness_n_m": 2.52e7}
    std_hz = 0.005 * truth
    result = tune_ring(ORDERS, truth, given=given, frequency_std_hz=std_hz, **EXACT, **TYRE)
    relative = {name: std / getattr(result.ring, name) for name, std in result.std.items()}
    assert relative["circumferential_stiffness_n_m3"] == pytest.approx(0.21, abs=5e-3)
    assert relative["bending_stiffness_n_m"] == pytest.approx(0.24, abs=5e-3)


def test_the_papers_objective_weights_order_7_two_hundred_times_order_1():
    problem = TuningProblem(ORDERS, MEASURED, 0.33, 2.2e5, objective="paper")
    slope = problem.data_slope(TABLE_4_RING)
    assert slope[6] / slope[0] == pytest.approx(200.0, rel=0.02)


def test_standard_deviations_never_fall_below_those_of_the_residuals():
    result = tune_ring(ORDERS, MEASURED, given=MASS, frequency_std_hz=1e-6 * MEASURED, **TYRE)
    plain = tune_ring(ORDERS, MEASURED, given=MASS, **TYRE)
    assert result.std == pytest.approx(plain.std)


def test_standard_deviations_cover_the_scatter_of_noisy_tunings():
    truth = natural_frequencies_hz(TABLE_4_RING, ORDERS)
    given = MASS | {"axial_stiffness_n_m": 2.52e7}
    rng = np.random.default_rng(5)
    found = [
        tune_ring(
            ORDERS, truth * (1 + 0.002 * rng.standard_normal(7)), given=given, **TYRE
        ).ring.radial_stiffness_n_m3
        for _ in range(30)
    ]
    std_hz = 0.002 * truth
    stated = tune_ring(ORDERS, truth, given=given, frequency_std_hz=std_hz, **EXACT, **TYRE)
    assert np.std(found) == pytest.approx(stated.std["radial_stiffness_n_m3"], rel=0.4)


def test_the_papers_objective_trades_mode_1_for_the_others():
    result = tune_ring(ORDERS, MEASURED, objective="paper", **TYRE)
    error = np.abs(result.error_percent)
    assert 3.0 < error[0] < 5.0
    assert error[1:].max() < 1.0
    table_4 = [19.69, 8.27e6, 2.52e7, 7.45]
    names = ["mass_per_area_kg_m2", "radial_stiffness_n_m3", "axial_stiffness_n_m"]
    found = [getattr(result.ring, name) for name in (*names, "bending_stiffness_n_m")]
    np.testing.assert_allclose(found, table_4, rtol=0.06)


def test_axial_stiffness_hardly_changes_a_frequency():
    table = frequency_sensitivity(TABLE_4_RING, ORDERS)
    columns = dict(zip(table.parameters, table.values.T, strict=True))
    assert columns["axial_stiffness_n_m"].max() == pytest.approx(0.014, abs=5e-4)
    np.testing.assert_allclose(table.values.sum(axis=1), 0.0, atol=1e-7)
    np.testing.assert_allclose(columns["mass_per_area_kg_m2"], -0.5, atol=1e-6)


def test_axial_stiffness_comes_from_a_measured_growth_or_the_breathing_mode():
    growth = float(equilibrium(TABLE_4_RING).radial_displacement_m)
    given = {n: getattr(TABLE_4_RING, n) for n in ("mass_per_area_kg_m2", "bending_stiffness_n_m")}
    truth = natural_frequencies_hz(TABLE_4_RING, ORDERS)
    by_growth = tune_ring(ORDERS, truth, given=given, radial_growth_m=growth, **TYRE)
    assert by_growth.ring.axial_stiffness_n_m == pytest.approx(2.52e7, rel=1e-6)
    assert by_growth.how["axial_stiffness_n_m"] == "identified"
    orders = np.arange(8)
    truth = natural_frequencies_hz(TABLE_4_RING, orders)
    by_breathing = tune_ring(orders, truth, given=given, **TYRE)
    assert by_breathing.ring.axial_stiffness_n_m == pytest.approx(2.52e7, rel=1e-6)
    assert by_breathing.how["axial_stiffness_n_m"] == "identified"


def test_without_either_the_axial_stiffness_is_a_placeholder():
    result = tune_ring(ORDERS, MEASURED, **TYRE)
    assert result.how["axial_stiffness_n_m"] == "not identified"
    assert result.std["axial_stiffness_n_m"] > 0.5 * result.ring.axial_stiffness_n_m
    assert any("do not determine the axial stiffness" in note for note in result.notes)


@pytest.mark.parametrize("pressure", [1e5, 2.5e5, 9e5])
@pytest.mark.parametrize(("radius", "mass"), [(0.25, 10.0), (0.33, 19.69), (0.55, 45.0)])
def test_known_rings_are_found_again(pressure, radius, mass):
    axial = pressure * radius / 0.003
    ring = RingParameters(radius, mass, 4e5 * mass, 6e4 * mass, axial, 15.0, pressure)
    truth = natural_frequencies_hz(ring, ORDERS)
    result = tune_ring(
        ORDERS,
        truth,
        mean_radius_m=radius,
        inflation_pressure_pa=pressure,
        given={"axial_stiffness_n_m": axial},
    )
    for name in ("mass_per_area_kg_m2", "radial_stiffness_n_m3", "circumferential_stiffness_n_m3"):
        assert getattr(result.ring, name) == pytest.approx(getattr(ring, name), rel=1e-4)
    np.testing.assert_allclose(result.model_hz, truth, rtol=1e-7)


@pytest.mark.parametrize("objective", ["frequency", "paper"])
def test_follower_pressure_is_tuned_with_its_own_frequencies(objective):
    truth = natural_frequencies_hz(TABLE_4_RING, ORDERS, pressure_load="follower")
    given = {n: getattr(TABLE_4_RING, n) for n in ("mass_per_area_kg_m2", "axial_stiffness_n_m")}
    result = tune_ring(
        ORDERS, truth, given=given, objective=objective, pressure_load="follower", **TYRE
    )
    assert result.ring.radial_stiffness_n_m3 == pytest.approx(8.27e6, rel=1e-6)


def test_a_parameter_at_a_bound_is_reported():
    bounds = {"circumferential_stiffness_n_m3": (0.0, 8e5)}
    result = tune_ring(ORDERS, MEASURED, given=MASS, bounds=bounds, **TYRE)
    assert result.how["circumferential_stiffness_n_m3"] == "at bound"
    assert result.ring.circumferential_stiffness_n_m3 == 8e5
    assert result.std["circumferential_stiffness_n_m3"] > 0  # of what lies inside the bounds
    assert "circumferential_stiffness_n_m3" not in result.correlation.parameters
    assert any("k_θ" in note and "bound" in note for note in result.notes)


def test_bending_stiffness_is_never_negative():
    limp = replace(TABLE_4_RING, bending_stiffness_n_m=0.0)
    truth = natural_frequencies_hz(limp, ORDERS) * (1 - 1e-3 * (ORDERS / 7) ** 4)
    result = tune_ring(ORDERS, truth, given=MASS, **TYRE)
    assert result.ring.bending_stiffness_n_m == 0.0
    assert result.how["bending_stiffness_n_m"] == "at bound"


@pytest.mark.parametrize(
    ("count", "assumed"),
    [(3, ["bending_stiffness_n_m"]), (2, ["bending_stiffness_n_m", "mass_per_area_kg_m2"])],
)
def test_too_few_frequencies_leave_parameters_assumed(count, assumed):
    result = tune_ring(ORDERS[:count], MEASURED[:count], **TYRE)
    np.testing.assert_allclose(result.error_percent, 0.0, atol=1e-5)
    for name in assumed:
        expected = {"b": 8.0, "m": 20.0}[name[0]]
        assert getattr(result.ring, name) == pytest.approx(expected, rel=1e-6)
        assert result.how[name] == "not identified"
        assert any(
            f"{RING_NAMES[name][0]} {RING_NAMES[name][1]} was assumed" in note
            for note in result.notes
        )
    radial = "identified" if count == 3 else "not identified"
    assert result.how["radial_stiffness_n_m3"] == radial
    assert [each.reason for each in result.verdict.evidence] == [Reason.UNTESTED]


def test_assumed_parameters_widen_the_standard_deviations():
    truth = natural_frequencies_hz(TABLE_4_RING, [1, 2, 3])
    held = {"radial_growth_m": 9e-4, **EXACT, **TYRE}
    assumed = tune_ring([1, 2, 3], truth, start={"bending_stiffness_n_m": 7.0}, **held)
    given = tune_ring([1, 2, 3], truth, given={"bending_stiffness_n_m": 7.0}, **held)
    name = "mass_per_area_kg_m2"
    assert assumed.ring.mass_per_area_kg_m2 == pytest.approx(given.ring.mass_per_area_kg_m2)
    off = tune_ring([1, 2, 3], truth, given={"bending_stiffness_n_m": 7.7}, **held)
    moved = off.ring.mass_per_area_kg_m2 - given.ring.mass_per_area_kg_m2
    assert assumed.std[name] == pytest.approx(abs(moved) / 0.1, rel=0.05)


def test_too_few_frequencies_and_a_bound_at_once():
    bounds = {"circumferential_stiffness_n_m3": (0.0, 1e5)}
    result = tune_ring(ORDERS[:3], MEASURED[:3], bounds=bounds, **TYRE)
    assert result.how["circumferential_stiffness_n_m3"] == "at bound"
    assert result.how["bending_stiffness_n_m"] == "not identified"


def test_a_given_mass_makes_three_frequencies_enough():
    truth = natural_frequencies_hz(TABLE_4_RING, [1, 2, 6])
    given = MASS | {"axial_stiffness_n_m": 2.52e7}
    result = tune_ring([1, 2, 6], truth, given=given, frequency_std_hz=1e-3 * truth, **TYRE)
    assert result.ring.circumferential_stiffness_n_m3 == pytest.approx(6.56e5, rel=1e-5)
    assert result.how["radial_stiffness_n_m3"] == "identified"


def test_starting_values_do_not_change_the_answer():
    start = {"mass_per_area_kg_m2": 40.0, "radial_stiffness_n_m3": 2e7}
    result = tune_ring(ORDERS, MEASURED, start=start, **TYRE)
    plain = tune_ring(ORDERS, MEASURED, **TYRE)
    np.testing.assert_allclose(result.model_hz, plain.model_hz, rtol=1e-7)


ALL_GIVEN = {
    name: getattr(TABLE_4_RING, name)
    for name in (
        "mass_per_area_kg_m2",
        "radial_stiffness_n_m3",
        "circumferential_stiffness_n_m3",
        "bending_stiffness_n_m",
    )
}


@pytest.mark.parametrize(
    ("orders", "frequencies", "options", "where"),
    [
        ([1], [78.7], {}, "frequencies_hz"),
        ([1, 2], [78.7], {}, "frequencies_hz"),
        ([1, 1], [78.7, 78.9], {}, "orders"),
        ([1, 2], [78.7, -1.0], {}, "frequencies_hz"),
        ([1, 2], [78.7, np.nan], {}, "frequencies_hz"),
        (ORDERS, MEASURED, {"frequency_std_hz": np.zeros(7)}, "frequency_std_hz"),
        (ORDERS, MEASURED, {"given": {"mass": 1.0}}, "given"),
        (ORDERS, MEASURED, {"given": ALL_GIVEN}, "given"),
        (ORDERS, MEASURED, {"objective": "best"}, "objective"),
        ([0, 1, 2, 3, 4], [550.0, *MEASURED[:4]], {"objective": "paper"}, "orders"),
        (
            ORDERS,
            MEASURED,
            {"bounds": {"bending_stiffness_n_m": (2.0, 1.0)}},
            "bounds of bending_stiffness_n_m",
        ),
        (ORDERS, MEASURED, {"mean_radius_m": 0.0}, "mean_radius_m"),
        (ORDERS, MEASURED, {"inflation_pressure_pa": 0.0}, "inflation_pressure_pa"),
        (
            ORDERS,
            MEASURED,
            {"radial_growth_m": 1e-3, "given": {"axial_stiffness_n_m": 2e7}},
            "radial_growth_m",
        ),
    ],
)
def test_refusals(orders, frequencies, options, where):
    with pytest.raises(ParameterError, match=f"^{where}:"):
        tune_ring(orders, frequencies, **(TYRE | options))
