"""Order 1 beneath order 2: found where it has a pole of its own, not where sensors mix the two."""

from dataclasses import replace

import numpy as np
import pytest
import systems

import ema
from pipelines.simulate.truth import truth_modes

ORDER_2 = (systems.TABLE_3_HZ[1], systems.TABLE_3_DAMPING[1])


def model_with_a_wave_of_order_1(share, frequency_hz, damping_ratio, truth=None):
    """The tyre of the paper with order 1 at another pole, of this share of order 2."""
    frf = systems.campaign_frf(truth or truth_modes(), 40, seed=3)
    poles = np.array([systems.pole(frequency_hz, damping_ratio)])
    shape = share * np.cos(np.deg2rad(frf.position_deg))
    residues = np.outer(shape, systems.residue(poles))
    wave = systems.inertance(frf.frequency_hz, poles, residues)
    return ema.identify_modes(replace(frf, values=frf.values + wave), (60.0, 160.0)).model


def modes_with_a_wave_of_order_1(*about):
    return [mode for mode in model_with_a_wave_of_order_1(*about).modes if mode.order in (1, 2)]


@pytest.mark.parametrize("share", [0.15, 0.25])
def test_what_is_mixed_into_an_order_has_no_pole_of_its_own(share):
    one, two = modes_with_a_wave_of_order_1(share, *ORDER_2)
    assert (one.order, two.order) == (1, 2)
    assert one.frequency_hz == pytest.approx(systems.TABLE_3_HZ[0], rel=1e-3)
    assert two.order_purity < 1 - share**2 / 2


@pytest.mark.parametrize(("hz", "ratio"), [(101.0, 0.05), (99.0, 0.045), (100.31, 0.05)])
def test_an_order_beneath_another_is_found_by_its_own_frfs(hz, ratio):
    _, *both = modes_with_a_wave_of_order_1(0.3, hz, ratio)
    beneath = next(mode for mode in both if mode.order == 1)
    above = next(mode for mode in both if mode.order == 2)
    assert beneath.frequency_hz == pytest.approx(hz, abs=min(0.3, 3 * beneath.frequency_std_hz))
    assert beneath.damping_ratio == pytest.approx(ratio, rel=0.05)
    assert above.frequency_hz == pytest.approx(ORDER_2[0], rel=1e-3)
    assert above.order_purity > 0.98


@pytest.mark.parametrize(
    ("share", "hz", "ratio"), [(0.05, 127.0, 0.045), (0.1, 125.0, 0.05), (0.1, 147.0, 0.04)]
)
def test_a_weak_mode_of_a_lower_order_is_found_by_the_frfs_of_that_order(share, hz, ratio):
    """Beneath order 3 or 4, half as broad; no pole of the diagram shows it, or it went astray."""
    *_, found = modes_with_a_wave_of_order_1(share, hz, ratio, truth_modes(split_percent=0.5))
    assert found.order == 1
    assert found.frequency_hz == pytest.approx(hz, abs=min(0.3, 3 * found.frequency_std_hz))
    assert found.damping_ratio == pytest.approx(ratio, rel=0.03)


@pytest.mark.parametrize(("share", "is_there"), [(0.1, True), (0.0, False)])
def test_what_order_1_does_without_a_mode_is_said(share, is_there):
    """Five times as broad as order 4, at the end of the band, no pole is determined."""
    model = model_with_a_wave_of_order_1(share, 146.0, 0.12, truth_modes(split_percent=0.5))
    assert [mode.order for mode in model.modes] == [1, 1, 2, 2, 3, 3, 4, 4]
    assert any("what order 1 does" in note for note in model.notes) == is_there


@pytest.mark.parametrize(("split_percent", "member", "share"), [(3.0, 0, 0.2), (0.5, 1, 0.35)])
def test_a_member_of_the_pair_above_is_no_pole_of_another_order(split_percent, member, share):
    truth = truth_modes(split_percent=split_percent, shaker_between=0.2)
    pair = sorted((m for m in truth if m.order == 2), key=lambda mode: mode.frequency_hz)
    of_pole = pair[member].frequency_hz, pair[member].damping_ratio
    found = modes_with_a_wave_of_order_1(share, *of_pole, truth)
    assert [mode.order for mode in found if mode.frequency_hz > 90] == [2, 2]
