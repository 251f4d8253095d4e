"""Tyre property files and rings: what a ring changes in a file, and the way back."""

from dataclasses import replace
from datetime import UTC, datetime
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from library import SET
from tyre_property_files import content

from ema.core.errors import InputError
from model import damping_ratios, natural_frequencies_hz, torsion_frequency_hz
from model.foundation import with_pressure_load
from model.parameters import GROWTH
from model.tuning_problem import TuningProblem
from model.verdict import Evidence, Reason, RingVerdict
from pipelines.export.belt import VALUES
from pipelines.export.tir_file import tir_of
from pipelines.export.tir_update import plan_update, ring_from_tir
from pipelines.results.parameter_set import Parameter
from pipelines.results.verdict import Basis, Covariance, MeasuredOrder

FILES = {name: tir_of(content(in_mm=name == "mm"), "tyre.tir") for name in ("SI", "mm")}
RING = SET.ring_parameters
FOUND_AGAIN = (
    "mean_radius_m",
    "mass_per_area_kg_m2",
    "radial_stiffness_n_m3",
    "circumferential_stiffness_n_m3",
)


@pytest.fixture(params=list(FILES))
def tir(request):
    return FILES[request.param]


@pytest.fixture
def si():
    return FILES["SI"]


def varied(**values):
    ring = {name: replace(own, value=values.get(name, own.value)) for name, own in SET.ring.items()}
    return replace(SET, ring=ring)


def found_again(tir, parameters, like=None, width_m=0.19):
    """From all digits: the way back is exact."""
    parameters = replace(parameters, basis=Basis("dead"))
    for change in plan_update(tir, parameters).changes:
        tir = tir.with_value(tir.find(change.key), repr(change.new))
    written = tir_of(tir.content, "written.tir")
    return ring_from_tir(written, width_m, like).parameters


def assert_same_ring(found, parameters):
    for name in FOUND_AGAIN:
        assert found.ring[name].value == pytest.approx(parameters.ring[name].value, rel=1e-9), name
    assert found.conditions["inflation_pressure_pa"] == pytest.approx(220000.0, rel=1e-11)


def test_an_update_changes_the_lines_of_the_ring_only(tir):
    update = plan_update(tir, SET)
    assert {change.key for change in update.changes} == set(VALUES)
    assert not (update.unchanged or update.missing or update.open_ones)
    lines = zip(tir.lines, update.after.lines, strict=True)
    changed = {number for number, (old, new) in enumerate(lines, 1) if old != new}
    assert changed == {change.line for change in update.changes}
    again = plan_update(update.after, SET)
    assert set(again.unchanged) == set(VALUES)
    assert again.after.content == update.after.content


def test_values_are_those_of_the_ring(si):
    new = {change.key: change.new for change in plan_update(si, SET, 0.2).changes}
    a, rho_h = 0.33, 19.7
    assert new["BELT_MASS"] == pytest.approx(2 * pi * a * rho_h * 0.2)
    assert new["BELT_IYY"] == pytest.approx(2 * pi * a**3 * rho_h * 0.2)
    assert new["FREQ_LONG"] == pytest.approx(float(natural_frequencies_hz(RING, 1)), rel=1e-7)
    torsion_hz = torsion_frequency_hz(RING, pressure_load="follower")
    assert new["FREQ_WINDUP"] == pytest.approx(torsion_hz)
    assert new["DAMP_LONG"] == pytest.approx(float(damping_ratios(RING, SET.ring_damping, 1)))
    assert new["DAMP_WINDUP"] == pytest.approx(850.0 / (4 * pi * rho_h * torsion_hz))
    assert new["INFLPRES"] == 220000.0


def test_the_wind_up_is_the_same_under_both_pressure_models(si):
    other = with_pressure_load(RING, "dead", "follower")
    ring = {name: replace(own, value=getattr(other, name)) for name, own in SET.ring.items()}
    follower = replace(SET, ring=ring, basis=Basis("follower"))
    new, old = (
        {change.key: change.new for change in plan_update(si, each).changes}
        for each in (follower, replace(SET, basis=Basis("dead")))
    )
    for key, rel in (("FREQ_WINDUP", 1e-9), ("FREQ_LONG", 1e-3), ("DAMP_WINDUP", 1e-9)):
        assert new[key] == pytest.approx(old[key], rel=rel), key
    written = tir_of(plan_update(si, follower).after.content, "written.tir")
    again = ring_from_tir(written, 0.19, follower).parameters
    assert again.basis.pressure_load == "follower"
    for name in FOUND_AGAIN:
        assert again.ring[name].value == pytest.approx(follower.ring[name].value, rel=1e-4), name


def test_a_torsion_below_that_of_a_dead_load_needs_a_follower_load(si):
    soft = replace(RING, circumferential_stiffness_n_m3=4e5)
    soft_hz = torsion_frequency_hz(soft, pressure_load="follower")
    file = plan_update(si, SET).after
    file = file.with_value(file.find("FREQ_WINDUP"), f"{soft_hz:.12g}")
    made = ring_from_tir(file, 0.19).parameters
    assert made.basis.pressure_load == "follower"
    found = made.ring["circumferential_stiffness_n_m3"].value
    assert found == pytest.approx(4e5, rel=0.05)


def test_the_covariance_of_the_set_gives_the_plus_minus(si):
    pair = ("mass_per_area_kg_m2", "belt_width_m")
    mass, width = (SET.ring[name].value for name in pair)
    opposed = ((mass**2 * 1e-4, -mass * width * 1e-4), (-mass * width * 1e-4, width**2 * 1e-4))
    basis = Basis(covariance=Covariance(pair, opposed))
    std = {each.key: each.std for each in plan_update(si, replace(SET, basis=basis)).changes}
    assert std["BELT_MASS"] == pytest.approx(0.0, abs=1e-3)


def test_values_are_in_the_units_of_the_file():
    one, other = (
        {change.key: change for change in plan_update(file, SET).changes} for file in FILES.values()
    )
    sizes = {"BELT_IYY": 1e6, "INFLPRES": 1e-6}
    for key, change in one.items():
        assert other[key].new == pytest.approx(sizes.get(key, 1.0) * change.new)
        assert other[key].percent == pytest.approx(change.percent)
    assert (other["BELT_IYY"].unit, other["INFLPRES"].unit) == ("kg mm²", "N/mm²")


def test_plus_minus_where_one_parameter_decides(si):
    std = {change.key: change.std for change in plan_update(si, SET).changes}
    mass = 2 * pi * 0.33 * 19.7 * 0.19
    assert std["BELT_MASS"] == pytest.approx(mass * 0.2 / 19.7, rel=1e-3)
    assert std["FREQ_LONG"] is None
    assert std["INFLPRES"] is None


@settings(max_examples=25)
@given(st.floats(10.0, 30.0), st.floats(4e6, 2e7), st.floats(5e5, 4e6), st.floats(0.0, 20.0))
def test_a_tuned_ring_is_found_again(mass, radial, circumferential, bending):
    """Tuned without order 0, K follows from the growth on inflation that is typical."""
    growth = TuningProblem(
        np.array([1]), np.array([80.0]), 0.33, 220000.0, radial_growth_m=GROWTH * 0.33
    )
    parameters = varied(
        mass_per_area_kg_m2=mass,
        radial_stiffness_n_m3=radial,
        circumferential_stiffness_n_m3=circumferential,
        axial_stiffness_n_m=growth.axial_stiffness_n_m(radial),
        bending_stiffness_n_m=bending,
    )
    for file in FILES.values():
        assert_same_ring(found_again(file, parameters), parameters)


@pytest.mark.parametrize("stiffness_n_m", [1.2e7, 2.5e7, 9.0e7])
def test_any_ring_is_found_again_with_its_membrane_stiffness(tir, stiffness_n_m):
    parameters = varied(axial_stiffness_n_m=stiffness_n_m)
    like = replace(parameters, basis=Basis("dead"))
    found = found_again(tir, parameters, like=like, width_m=None)
    assert_same_ring(found, parameters)
    for name in ("axial_stiffness_n_m", "bending_stiffness_n_m", "belt_width_m"):
        assert found.ring[name].value == parameters.ring[name].value


def test_assumptions_are_noted(si):
    made = ring_from_tir(si, 0.19)
    assert "--like SET" in made.notes[0]
    hows = {name: entry.how for name, entry in made.parameters.ring.items()}
    assert {name for name, how in hows.items() if how == "not identified"} == {
        "axial_stiffness_n_m",
        "bending_stiffness_n_m",
    }
    assert made.parameters.damping == {}
    assert made.parameters.ring_parameters.mean_radius_m == pytest.approx((0.72 / 7.1) ** 0.5)


def without(tir, *keys):
    lines = [line for line in tir.lines if not line.startswith(tuple(f"{key} " for key in keys))]
    return replace(tir, lines=tuple(lines))


def changed(tir, key, text, section=None):
    return tir.with_value(tir.find(key, section), text)


def test_missing_keys_are_listed_and_added_on_request(si):
    dead = replace(SET, basis=Basis("dead"))
    small = without(si, "BELT_MASS", "FREQ_WINDUP")
    assert plan_update(small, dead).missing == ("BELT_MASS", "FREQ_WINDUP")
    update = plan_update(small, dead, add=True)
    assert update.missing == ()
    added = {change.key: change.section for change in update.changes if change.line is None}
    assert added == {"BELT_MASS": "INERTIA", "FREQ_WINDUP": "STRUCTURAL"}
    back = ring_from_tir(update.after, 0.19, dead).parameters
    for name in FOUND_AGAIN:
        assert back.ring[name].value == pytest.approx(dead.ring[name].value, rel=1e-4), name


def test_the_plus_minus_decides_on_the_digits(si):
    texts = {change.key: change.text for change in plan_update(si, SET).changes}
    assert texts["BELT_MASS"] == "7.761"  # ± 0.079
    assert len(texts["FREQ_LONG"].replace(".", "")) == 6  # unknown
    mass = replace(SET.ring["mass_per_area_kg_m2"], std=2e-4)
    sharp = replace(SET, ring={**SET.ring, "mass_per_area_kg_m2": mass})
    texts = {change.key: change.text for change in plan_update(si, sharp).changes}
    assert texts["BELT_MASS"] == "7.76093"


def measured(*reasons, left_out=()):
    orders = (MeasuredOrder(1, 78.728, 0.036, 0.005, 4e-5), MeasuredOrder(2, 100.3, 0.033))
    verdict = RingVerdict(tuple(Evidence(each, "found") for each in reasons), 3.0, 2, (1, 2))
    basis = Basis(verdict=replace(verdict, orders_left_out=left_out), measured=orders)
    return replace(SET, basis=basis)


def test_order_1_is_that_measured(si):
    changes = {change.key: change for change in plan_update(si, measured()).changes}
    assert (changes["FREQ_LONG"].text, changes["FREQ_LONG"].std) == ("78.728", 0.005)
    assert (changes["DAMP_LONG"].text, changes["DAMP_LONG"].std) == ("0.036", 4e-5)
    assert "as measured" in changes["FREQ_LONG"].basis
    alone = replace(measured(), damping={})
    assert "DAMP_LONG" not in plan_update(si, alone).open_ones


@pytest.mark.parametrize("doubt", [{"left_out": (1,)}, {"reasons": (Reason.RIM,)}])
def test_order_1_of_a_rim_that_moves_is_not_taken(si, doubt):
    moved = measured(*doubt.get("reasons", ()), left_out=doubt.get("left_out", ()))
    update = plan_update(si, moved, accept_warnings=True)
    changes = {change.key: change for change in update.changes}
    assert changes["FREQ_LONG"].new == pytest.approx(float(natural_frequencies_hz(RING, 1)))


@pytest.mark.parametrize("reason", [Reason.SHIFTED, Reason.MASSES])
def test_a_set_in_doubt_needs_a_word(si, reason):
    """From Python as from the command line."""
    with pytest.raises(InputError, match=r"(?s)found.*accept_warnings=True"):
        plan_update(si, measured(reason))
    assert plan_update(si, measured(reason), accept_warnings=True).changes


def test_a_torsion_unlike_published_ones_is_noted(si):
    """Published sets have 0.86 to 0.88 of FREQ_LONG."""
    assert any("published" in note for note in plan_update(si, SET).notes)
    usual = varied(circumferential_stiffness_n_m3=5e6)
    assert not any("published" in note for note in plan_update(si, usual).notes)


def test_a_comment_says_where_the_values_come_from(tir):
    after = plan_update(tir, measured(), comment="tyre@3").after
    assert after.lines[:-1] == plan_update(tir, measured()).after.lines
    line = after.lines[-1]
    assert line.startswith("$ ") and line.endswith(tir.lines[0][-1])
    for words in ("BELT_MASS, ", "tyre@3", "verdict good", str(datetime.now(UTC).year)):
        assert words in line
    again = plan_update(after, measured(), comment="tyre@3")
    assert not again.changes and again.after.content == after.content


def test_what_a_set_does_not_determine_stays(si):
    bare = {name: entry for name, entry in SET.ring.items() if name != "belt_width_m"}
    loose = {**bare, "circumferential_stiffness_n_m3": Parameter(0.0, "at bound")}
    follower = Basis("follower")
    update = plan_update(si, replace(SET, ring=loose, damping={}, basis=follower))
    assert {change.key for change in update.changes} == {"INFLPRES", "FREQ_LONG"}
    reasons = update.open_ones
    assert "--belt-width-m" in reasons["BELT_MASS"]
    assert "no damping" in reasons["DAMP_LONG"]
    assert "k_θ of the set is too small" in reasons["FREQ_WINDUP"]


def test_related_keys_are_left_with_a_reason(si):
    left = plan_update(si, SET).left_alone
    reasons = {key: reason for reason, keys in left.items() for key in keys}
    assert set(reasons) == {
        *("MASS", "IYY", "BELT_IXX", "FREQ_YAW", "DAMP_YAW"),
        *("NOMPRES", "UNLOADED_RADIUS", "WIDTH"),
    }
    assert "plane" in reasons["FREQ_YAW"]


def test_contradictions_are_noted(si):
    vague = {**SET.ring, "radial_stiffness_n_m3": Parameter(8e6, "not identified")}
    notes = plan_update(si, replace(SET, ring=vague), 0.3).notes
    assert any("BELT_MASS is now above MASS" in note for note in notes)
    assert any("FREQ_LONG depends on k_r" in note for note in notes)
    heavy = changed(si, "NOMPRES", "180000")
    assert any("INFLPRES and NOMPRES differ" in note for note in plan_update(heavy, SET).notes)
    minutes = changed(si, "TIME", "min", "UNITS")
    assert any("in Hz" in note for note in plan_update(minutes, SET).notes)
    unstated = without(si, "LENGTH", "TIME")
    assert any("its unit of LENGTH, TIME" in note for note in plan_update(unstated, SET).notes)
    light = changed(si, "BELT_IYY", "0.3")
    assert any("UNLOADED_RADIUS" in note for note in ring_from_tir(light, 0.19).notes)


def test_keys_given_twice_are_refused_where_it_matters(si):
    def twice(key):
        return replace(si, lines=(*si.lines, "[MORE]\r\n", f"{key} = 9.0\r\n"))

    assert len(plan_update(twice("MASS"), SET).changes) == len(VALUES)
    with pytest.raises(InputError, match=r"BELT_MASS: given in lines 23 and 35"):
        plan_update(twice("BELT_MASS"), SET)


def test_files_of_no_ring_are_refused(si):
    with pytest.raises(InputError, match=r"BELT_IYY: not given"):
        ring_from_tir(without(si, "BELT_IYY"), 0.19)
    with pytest.raises(InputError, match=r"translation 75.5 Hz, torsion 120 Hz"):
        ring_from_tir(changed(si, "FREQ_WINDUP", "120"), 0.19)
    with pytest.raises(InputError, match=r"no belt width; .*WIDTH of 0.225 m"):
        ring_from_tir(si)
    with pytest.raises(InputError, match=r"--belt-width-m: -1"):
        ring_from_tir(si, -1.0)
    with pytest.raises(InputError, match=r"LENGTH: 'metres'; .*'metre'"):
        plan_update(changed(si, "LENGTH", "metres", "UNITS"), SET)
    with pytest.raises(InputError, match=r"BELT_MASS: 'seven'"):
        plan_update(changed(si, "BELT_MASS", "seven"), SET)


@pytest.mark.parametrize("value", ["0", "-1", "-0", "1e308", "-1e308", "1e400", "nan", "inf"])
def test_a_nominal_pressure_that_cannot_be_is_refused(si, value):
    with pytest.raises(InputError) as refused:
        plan_update(changed(si, "NOMPRES", value), SET)
    assert "NOMPRES" in refused.value.where


@pytest.mark.parametrize("value", ["0", "-1", "1e308", "1e-320", "nan"])
@pytest.mark.parametrize("key", ["BELT_IYY", "BELT_MASS", "FREQ_LONG", "INFLPRES"])
def test_no_ring_is_made_of_values_that_cannot_be(si, key, value):
    with pytest.raises(InputError) as refused:
        ring_from_tir(changed(si, key, value), 0.19)
    assert key in refused.value.where


def test_a_given_width_keeps_the_error_bars_of_the_set(si):
    """Of torsion and translation; the mass has that of ρh alone."""
    theta = "circumferential_stiffness_n_m3"
    names = ("mean_radius_m", "belt_width_m", "mass_per_area_kg_m2", theta)
    values = tuple(map(tuple, np.diag([1e-3, 5e-3, 0.4, 3e4]) ** 2))
    ring = {**SET.ring, "belt_width_m": Parameter(0.19, std=5e-3)}
    known = replace(SET, ring=ring, basis=Basis("dead", covariance=Covariance(names, values)))
    of_set, given = (
        {change.key: change.std for change in plan_update(si, known, width).changes}
        for width in (None, 0.19)
    )
    assert given["FREQ_WINDUP"] == pytest.approx(of_set["FREQ_WINDUP"])
    assert 0 < given["BELT_MASS"] < of_set["BELT_MASS"]
