"""Damping ratios of the ring, and damping identified from them."""

import numpy as np
import pytest

from model import ParameterError, RingDamping, damping_ratios, identify_damping
from model import natural_frequencies_hz as frequencies_hz
from model.parameters import (
    REFITTED_DAMPING,
    TABLE_3_DAMPING_RATIOS,
    TABLE_3_ORDERS,
    TABLE_4_RING,
    TABLE_5_DAMPING,
)


def test_table_5_overstates_the_ratios_of_table_3():
    ratios = damping_ratios(TABLE_4_RING, TABLE_5_DAMPING, TABLE_3_ORDERS)
    np.testing.assert_allclose(ratios[[0, 6]], [0.091, 0.044], atol=5e-4)
    assert np.mean(ratios / TABLE_3_DAMPING_RATIOS) == pytest.approx(2.4, abs=0.2)


def test_refit_to_table_3():
    result = identify_damping(TABLE_4_RING, TABLE_3_ORDERS, TABLE_3_DAMPING_RATIOS)
    assert result.damping.circumferential_n_s_m3 == pytest.approx(800.0, abs=1.0)
    assert result.damping.radial_n_s_m3 == pytest.approx(686.0, abs=0.5)
    assert result.damping.loss_factor == pytest.approx(0.0140, abs=1e-4)
    expected = [0.0399, 0.0295, 0.0255, 0.0229, 0.0209, 0.0193, 0.0180]
    np.testing.assert_allclose(result.model, expected, atol=1e-4)
    assert [name for name, how in result.how.items() if how != "identified"] == ["loss_factor"]
    rounded = damping_ratios(TABLE_4_RING, REFITTED_DAMPING, TABLE_3_ORDERS)
    np.testing.assert_allclose(rounded, result.model, atol=5e-5)


def test_the_loss_factor_without_pretension_is_too_large():
    on = identify_damping(TABLE_4_RING, TABLE_3_ORDERS, TABLE_3_DAMPING_RATIOS)
    off = identify_damping(
        TABLE_4_RING, TABLE_3_ORDERS, TABLE_3_DAMPING_RATIOS, on_pretension=False
    )
    assert not off.damping.on_pretension
    assert off.damping.loss_factor > 10 * on.damping.loss_factor


@pytest.mark.parametrize("on_pretension", [True, False])
def test_known_damping_is_found_again(on_pretension):
    truth = RingDamping(900.0, 300.0, 0.03, on_pretension)
    ratios = damping_ratios(TABLE_4_RING, truth, TABLE_3_ORDERS)
    found = identify_damping(
        TABLE_4_RING, TABLE_3_ORDERS, ratios, 0.01 * ratios, on_pretension=on_pretension
    )
    assert found.damping.radial_n_s_m3 == pytest.approx(900.0, rel=1e-6)
    assert found.damping.circumferential_n_s_m3 == pytest.approx(300.0, rel=1e-6)
    assert found.damping.loss_factor == pytest.approx(0.03, rel=1e-6)
    assert set(found.std) == set(found.how)


def test_equal_dampers_act_on_every_shape_alike():
    """Equal dampers are mass-proportional: ζ = c/(2ρhω) whatever the shape."""
    damping = RingDamping(500.0, 500.0, 0.0)
    omega = 2 * np.pi * frequencies_hz(TABLE_4_RING, 1)
    ratio = damping_ratios(TABLE_4_RING, damping, 1)
    assert ratio == pytest.approx(500.0 / (2 * 19.69 * omega), rel=1e-9)


def test_no_damping_no_ratio():
    none = RingDamping(0.0, 0.0, 0.0)
    np.testing.assert_allclose(damping_ratios(TABLE_4_RING, none, range(8)), 0.0, atol=1e-12)


def test_breathing_is_damped_by_radial_dampers_alone():
    damping = RingDamping(500.0, 0.0, 0.0)
    omega = 2 * np.pi * frequencies_hz(TABLE_4_RING, 0)
    ratio = damping_ratios(TABLE_4_RING, damping, 0)
    assert ratio == pytest.approx(500.0 / (2 * 19.69 * omega), rel=1e-9)


def test_damping_is_never_negative():
    truth = damping_ratios(TABLE_4_RING, RingDamping(800.0, 400.0, 0.0), TABLE_3_ORDERS)
    falling = truth * (1 - 0.02 * np.arange(7))
    found = identify_damping(TABLE_4_RING, TABLE_3_ORDERS, falling)
    assert found.damping.loss_factor == 0.0
    assert found.how["loss_factor"] == "at bound"
    assert any("loss_factor" in note for note in found.notes)


def test_two_ratios_determine_no_parameter():
    found = identify_damping(TABLE_4_RING, [1, 2], [0.039, 0.033])
    assert set(found.how.values()) == {"not identified"}
    assert found.std == {}


@pytest.mark.parametrize(
    ("ratios", "std", "where"),
    [
        ([0.03, 0.0], None, "damping_ratios"),
        ([0.03], None, "damping_ratios"),
        ([0.03, 0.02], [0.001, 0.0], "damping_std"),
        ([0.03, np.inf], None, "damping_ratios"),
    ],
)
def test_refusals(ratios, std, where):
    with pytest.raises(ParameterError, match=f"^{where}:"):
        identify_damping(TABLE_4_RING, [1, 2], ratios, std)
