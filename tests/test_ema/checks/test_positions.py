"""Angles of the sensors against the waves that the modes must be."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
import systems

from ema.checks.positions import check_positions, moved, position_findings
from ema.core.finding import Check, Verdict
from ema.core.modes import Flag
from ema.core.settings import CHECKS
from ema.identify import identify_modes
from ema.poles.stability import build_stability, select_poles
from pipelines.simulate.truth import truth_modes

TYRE = truth_modes()
BAND_HZ = (20.0, 260.0)
FRF = systems.campaign_frf(TYRE, 34)
POLES = select_poles(build_stability(FRF, BAND_HZ))
RUN = np.array([int(name[-1]) - 1 for name in FRF.run])
TRUE_DEG = FRF.position_deg


def stated(position_deg):
    return replace(FRF, position_deg=np.mod(position_deg, 360.0))


TURNED = stated(TRUE_DEG - 10.0 * RUN)
RUN_OFF = stated(np.where(RUN == 2, TRUE_DEG - 5.0, TRUE_DEG))


def checked(frf):
    return check_positions(frf, POLES, BAND_HZ)


@pytest.mark.parametrize(
    ("frf", "orders_hold"),
    [
        (TURNED, False),
        (stated(10.0 * RUN - TRUE_DEG), False),  # counted the other way
        (RUN_OFF, True),
        (stated(np.where(RUN == 0, TRUE_DEG + 40.0, TRUE_DEG)), True),
        (stated(np.where(RUN == 4, 65.0 - TRUE_DEG, TRUE_DEG)), True),  # one run counted so
    ],
)
def test_a_common_mistake_is_named_with_angles_that_fit(frf, orders_hold):
    check = checked(frf)
    assert check.hypothesis
    assert check.otherwise < 0.1 * check.unexplained
    # These shapes are symmetric to the force at 0°: an angle and its mirror image look the same.
    cosines = np.cos(np.deg2rad([moved(frf, check.moves), TRUE_DEG]))
    np.testing.assert_allclose(*cosines, atol=1e-9)
    assert check.orders_hold is orders_hold


def test_the_finding_has_the_line_of_the_manifest():
    first, second = position_findings(checked(RUN_OFF), RUN_OFF)
    assert (first.run, second.run) == ("", "run_3")
    assert {first.verdict, second.verdict} == {Verdict.WARNING}
    line = tomllib.loads(second.detail[second.detail.index("positions_deg") :])
    own = {FRF.channel[row]: TRUE_DEG[row] for row in np.flatnonzero(RUN == 2)}
    assert line == {"positions_deg": own | {"REF": 2.5}}


def faulty(rows, factor):
    return systems.edited(FRF, rows, values=factor * FRF.values[rows])


REVERSED = faulty(np.flatnonzero(RUN == 1), -1.0)


@pytest.mark.parametrize(
    "frf",
    [
        FRF,
        systems.campaign_frf(TYRE, 10, drift_percent=np.linspace(0, 1, 6)),
        stated(TRUE_DEG + np.random.default_rng(0).uniform(-1, 1, 72)),
        faulty([7, 20], -1.0),
        faulty([3, 30], 100.0),
        REVERSED,
        FRF.rows(np.flatnonzero(RUN == 0)),
        FRF.rows(np.flatnonzero(RUN == 0)[[0, 2, 3, 7, 10]]),
    ],
    ids=[
        *("healthy", "drift", "angles ±1°", "flipped", "scaled", "force reversed"),
        *("twelve sensors", "five sensors"),
    ],
)
def test_what_is_no_mistake_in_angles_is_not_taken_for_one(frf):
    check = checked(frf)
    assert not check.hypothesis
    assert (check.unexplained > CHECKS.no_wave_share) is (frf is REVERSED)


def test_one_order_does_not_tell_a_turn_from_a_force_of_wrong_sign():
    band_hz = (85.0, 110.0)  # order 2 alone
    poles = select_poles(build_stability(REVERSED, band_hz))
    check = check_positions(REVERSED, poles, band_hz)
    assert check.unexplained > CHECKS.no_wave_share
    assert not check.hypothesis


def test_orders_that_depend_on_the_angles_are_left_open_and_poles_are_right():
    found = identify_modes(TURNED)
    assert {mode.order for mode in found.model.modes} == {None}
    assert all(Flag.ORDER_UNKNOWN in mode.flags for mode in found.model.modes)
    np.testing.assert_array_equal(found.model.position_deg, TURNED.position_deg)
    assert {finding.check for finding in found.findings} == {Check.POSITIONS}
    true = identify_modes(FRF).model
    n = true.frequencies_hz.size
    np.testing.assert_allclose(found.model.frequencies_hz[:n], true.frequencies_hz, rtol=1e-4)
    np.testing.assert_allclose(found.model.damping_ratios[:n], true.damping_ratios, rtol=0.01)


def test_sensors_are_not_corrected_for_wrong_angles():
    found = identify_modes(RUN_OFF)
    assert found.corrections == ()
    assert Check.FLIPPED not in {finding.check for finding in found.findings}
    systems.assert_modes(found.model, systems.of_orders(TYRE))


def test_angles_at_random_leave_orders_uncertain():
    frf = stated(np.random.default_rng(1).permutation(TRUE_DEG))
    checks = [finding.check for finding in identify_modes(frf).findings]
    assert Check.POSITIONS in checks
