"""Valid and invalid parameters of the ring model."""

import math
import pickle
from dataclasses import replace

import pytest

from model import ParameterError, RingDamping, Wheel
from model.parameters import TABLE_4_RING


def test_thickness_follows_from_the_two_belt_stiffnesses():
    assert TABLE_4_RING.thickness_m == pytest.approx(math.sqrt(12 * 7.45 / 2.52e7))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("radial_stiffness_n_m3", -1.0),
        ("circumferential_stiffness_n_m3", -1.0),
        ("bending_stiffness_n_m", -1.0),
        ("inflation_pressure_pa", -1.0),
        ("mean_radius_m", 0.0),
        ("mass_per_area_kg_m2", 0.0),
        ("axial_stiffness_n_m", 0.0),
        ("belt_width_m", 0.0),
        ("radial_stiffness_n_m3", math.nan),
        ("inflation_pressure_pa", math.inf),
        ("bending_stiffness_n_m", 1e5),
        ("axial_stiffness_n_m", 1e3),
        ("inflation_pressure_pa", 1e8),
    ],
)
def test_refuses_an_invalid_ring(name, value):
    with pytest.raises(ParameterError) as refusal:
        replace(TABLE_4_RING, **{name: value})
    assert name in refusal.value.where
    assert refusal.value.remedy


def test_the_message_names_the_highest_possible_pressure():
    soft = replace(TABLE_4_RING, axial_stiffness_n_m=3e5, bending_stiffness_n_m=0.0)
    bearable = soft.radial_resistance_pa(0.2)
    with pytest.raises(ParameterError, match=f"{bearable:g}"):
        replace(soft, inflation_pressure_pa=1.01 * bearable)


@pytest.mark.parametrize("bad", [-1.0, math.nan])
def test_refuses_negative_damping_and_a_massless_wheel(bad):
    with pytest.raises(ParameterError):
        RingDamping(bad, 0.0, 0.0)
    with pytest.raises(ParameterError):
        RingDamping(0.0, 0.0, bad)
    with pytest.raises(ParameterError):
        Wheel(mass_kg=bad, inertia_kg_m2=1.0)
    with pytest.raises(ParameterError):
        Wheel(mass_kg=1.0, inertia_kg_m2=0.0)


def test_the_four_parts_of_a_refusal_survive_pickling():
    with pytest.raises(ParameterError) as refusal:
        replace(TABLE_4_RING, mean_radius_m=-1.0)
    copy = pickle.loads(pickle.dumps(refusal.value))  # noqa: S301  our own bytes
    assert str(copy) == str(refusal.value)
    assert (copy.where, copy.found) == ("mean_radius_m", "-1")
