"""The verdict on a result: what makes it doubtful or bad, what comes first, what is withheld."""

from dataclasses import replace

import numpy as np
import pytest
from results import structure_result, tyre_result
from systems import common_drift

from ema.core.finding import Check, Finding, Verdict
from ema.core.modes import Flag
from ema.identify import SensorMass
from ema.poles.stability import Opinion
from model.identifiability import IDENTIFIED
from model.parameters import RING_NAMES
from model.verdict import Evidence, Reason, State
from pipelines.results.verdict import judge, orders_in_doubt, ring_is_usable


def finding(check, verdict=Verdict.WARNING, channel="A01"):
    return Finding("run_1", channel, 0.0, check, verdict, "something was found")


@pytest.fixture(scope="module")
def clean():
    """A result with nothing to remark."""
    result = tyre_result(findings=(), sensor_mass=SensorMass(0.0, {}))
    how = dict.fromkeys(result.tuning.how, IDENTIFIED)
    verdict = replace(result.tuning.verdict, evidence=())
    damping = replace(result.damping, how=dict.fromkeys(result.damping.how, IDENTIFIED))
    tuning = replace(result.tuning, how=how, verdict=verdict)
    measured = replace(result.measured, forces=dict.fromkeys(result.measured.run))
    return replace(result, tuning=tuning, damping=damping, measured=measured)


def test_a_result_with_nothing_to_remark_is_good(clean):
    found = judge(clean)
    assert (found.state, found.remarks) == (State.GOOD, ())
    assert found.line.startswith("Good: 7 modes of orders 1 to 7; ring model within ")


@pytest.mark.parametrize(
    ("name", "how", "state"),
    [
        ("axial_stiffness_n_m", "not identified", State.GOOD),  # no fault of the test
        ("radial_stiffness_n_m3", "not identified", State.DOUBTFUL),
        ("bending_stiffness_n_m", "at bound", State.DOUBTFUL),
    ],
)
def test_a_parameter_that_is_not_identified_is_stated(clean, name, how, state):
    found = judge(replace(clean, tuning=replace(clean.tuning, how=clean.tuning.how | {name: how})))
    assert (found.state, len(found.remarks)) == (state, 1)
    title = " ".join(RING_NAMES[name][:2])
    assert title in found.remarks[0].text
    assert found.line.endswith(f" {RING_NAMES[name][1]}.") == (state == State.GOOD)


def test_a_sensor_mass_is_stated_where_it_matters_and_in_doubt_where_it_changes_the_object(clean):
    model = clean.modal_model
    assert judge(replace(clean, sensor_mass=None)).state == State.GOOD
    assert judge(replace(clean, sensor_mass=None)).remarks[0].section == "modes"
    vague = tuple(replace(m, frequency_std_hz=0.01 * m.frequency_hz) for m in model.modes)
    result = replace(clean, sensor_mass=None, modal_model=replace(model, modes=vague))
    assert judge(result).remarks == ()
    light = tuple(replace(m, residues=10 * m.residues) for m in model.modes)  # a tenth of the mass
    result = replace(clean, sensor_mass=None, modal_model=replace(model, modes=light))
    assert judge(result).state == State.DOUBTFUL


def test_angles_in_doubt_are_bad_and_withhold_the_ring(clean):
    result = replace(clean, findings=(finding(Check.HUM), finding(Check.POSITIONS)))
    found = judge(result)
    assert found.state == found.remarks[0].state == State.BAD
    assert "angles" in found.line
    assert orders_in_doubt(result)
    assert not ring_is_usable(result)


def test_a_ring_that_does_not_fit_is_withheld(clean):
    evidence = (Evidence(Reason.MISFIT, "χ² = 99"),)
    verdict = replace(clean.tuning.verdict, evidence=evidence)
    result = replace(clean, tuning=replace(clean.tuning, verdict=verdict))
    assert judge(result).state == State.BAD
    assert not ring_is_usable(result)
    assert not orders_in_doubt(result)


@pytest.mark.parametrize(("percent", "state"), [(0.3, State.DOUBTFUL), (2.0, State.BAD)])
def test_a_large_drift_is_bad(clean, percent, state):
    drift = common_drift(("run_1", "run_2"), [0.0, percent], [0.0, 0.01])
    model = replace(clean.modal_model, drift=drift)
    result = replace(clean, modal_model=model, findings=(finding(Check.DRIFT),))
    found = judge(result)
    assert (found.state, ring_is_usable(result)) == (state, state == State.DOUBTFUL)
    assert f"{percent:.2g} %" in found.remarks[0].text


@pytest.mark.parametrize(("n_out", "state"), [(4, State.DOUBTFUL), (12, State.BAD)])
def test_many_dead_sensors_are_bad_and_their_other_warnings_concern_nobody(clean, n_out, state):
    names = [f"A{k:02}" for k in range(n_out)]
    dead = [finding(Check.DEAD, Verdict.EXCLUDED, name) for name in names]
    weak = [finding(Check.COHERENCE, channel=name) for name in names]
    kept = clean.frf.rows(np.arange(n_out, 72))
    result = replace(clean, frf=kept, findings=(*dead, *weak))
    found = judge(result)
    assert (found.state, len(found.remarks)) == (state, 1)
    assert ring_is_usable(result) == (state == State.DOUBTFUL)
    assert f"{n_out} of 72 positions are excluded" in found.remarks[0].text


def test_a_second_estimator_that_sees_other_modes_is_bad(clean):
    agreed = Opinion("plscf", 78.7, 78.7, 0.04, agrees=True)
    apart = replace(agreed, agrees=False)
    assert judge(replace(clean, opinions=(agreed,) * 7)).state == State.GOOD
    assert judge(replace(clean, opinions=(agreed, apart))).state == State.DOUBTFUL
    alone = replace(apart, mode_hz=float("nan"))
    assert judge(replace(clean, opinions=(agreed, alone))).state == State.GOOD
    assert judge(replace(clean, opinions=(alone,) * 7)).state == State.BAD


def test_a_mode_of_air_or_rim_is_stated_and_no_doubt(clean):
    first, *others = clean.modal_model.modes
    for flag, state in ((Flag.NOT_RING_MODE, State.GOOD), (Flag.AT_BOUND, State.DOUBTFUL)):
        modes = (replace(first, flags=(flag,)), *others)
        found = judge(replace(clean, modal_model=replace(clean.modal_model, modes=modes)))
        assert (found.state, len(found.remarks)) == (state, 1)


def test_no_modes_are_bad_and_a_structure_needs_no_ring(clean):
    model = replace(clean.modal_model, modes=())
    bare = replace(clean, modal_model=model, tuning=None, damping=None, validation=None)
    assert judge(bare).state == State.BAD
    found = judge(structure_result())
    assert found.line == "Good: 7 modes."


def test_the_worst_remarks_come_first(clean):
    checks = (Check.HUM, Check.COHERENCE, Check.DRIVE_POINT)
    result = replace(clean, findings=tuple(map(finding, checks)))
    assert judge(result).remarks[0].text.startswith("Drive point: run_1 A01: something was found")
