"""The foundation from translation and torsion of the belt: inverse of the ring's frequencies."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from model import (
    ParameterError,
    RingDamping,
    characteristic_roots,
    foundation_from_belt_modes,
    natural_frequencies_hz,
    torsion_damping_ratio,
    torsion_frequency_hz,
    tune_ring,
)
from model.errors import InstabilityError
from model.foundation import with_pressure_load
from model.parameters import GROWTH, TABLE_4_RING, TABLE_5_DAMPING


def belt_modes(ring, load):
    translation = float(natural_frequencies_hz(ring, 1, pressure_load=load))
    return translation, torsion_frequency_hz(ring, pressure_load=load)


def known(ring):
    names = ("mean_radius_m", "mass_per_area_kg_m2", "inflation_pressure_pa")
    return {name: getattr(ring, name) for name in names}


@given(
    st.floats(4e6, 2e7),
    st.floats(8e5, 4e6),
    st.floats(0.7, 3.0),
    st.floats(0.0, 50.0),
    st.sampled_from(["dead", "follower"]),
)
def test_known_stiffnesses_are_found_again(radial, circumferential, stiffer, bending, load):
    ring = replace(
        TABLE_4_RING,
        radial_stiffness_n_m3=radial,
        circumferential_stiffness_n_m3=circumferential,
        axial_stiffness_n_m=stiffer * TABLE_4_RING.axial_stiffness_n_m,
        bending_stiffness_n_m=bending,
    )
    belt = {"axial_stiffness_n_m": ring.axial_stiffness_n_m, "bending_stiffness_n_m": bending}
    modes = belt_modes(ring, load)
    found = foundation_from_belt_modes(*modes, **known(ring), **belt, pressure_load=load)
    assert found.radial_stiffness_n_m3 == pytest.approx(radial, rel=1e-11)
    assert found.circumferential_stiffness_n_m3 == pytest.approx(circumferential, rel=1e-11)


def test_membrane_stiffness_is_assumed_as_in_a_tuning():
    orders = np.arange(1, 8)
    ring = tune_ring(
        orders,
        natural_frequencies_hz(TABLE_4_RING, orders),
        mean_radius_m=0.33,
        inflation_pressure_pa=2.2e5,
        radial_growth_m=GROWTH * 0.33,
    ).ring
    ring = replace(ring, bending_stiffness_n_m=0.0)
    modes = belt_modes(ring, "dead")
    found = foundation_from_belt_modes(*modes, **known(ring), pressure_load="dead")
    assert found.axial_stiffness_n_m == pytest.approx(ring.axial_stiffness_n_m, rel=1e-10)
    assert found.radial_stiffness_n_m3 == pytest.approx(ring.radial_stiffness_n_m3, rel=1e-10)


@pytest.mark.parametrize("frequencies", [(80.0, 120.0), (80.0, 0.0), (np.nan, 50.0)])
def test_frequencies_of_no_ring_are_refused(frequencies):
    with pytest.raises(ParameterError, match="frequencies"):
        foundation_from_belt_modes(*frequencies, **known(TABLE_4_RING))


@pytest.mark.parametrize("pressure_load", ["dead", "follower"])
@pytest.mark.parametrize("on_pretension", [True, False])
def test_damping_of_the_torsion_is_that_of_its_root(pressure_load, on_pretension):
    damping = RingDamping(1900.0, 1500.0, 0.025, on_pretension)
    roots = characteristic_roots(TABLE_4_RING, 0, pressure_load=pressure_load, damping=damping)
    ratio = torsion_damping_ratio(TABLE_4_RING, damping, pressure_load=pressure_load)
    assert ratio == pytest.approx(roots[0].imag / abs(roots[0]), rel=1e-9)


def test_viscous_damping_of_the_torsion():
    """Without η on the pretension it is an oscillator: ζ = c_θ/(2ρhω)."""
    damping = replace(TABLE_5_DAMPING, on_pretension=False)
    omega = 2 * np.pi * torsion_frequency_hz(TABLE_4_RING, pressure_load="follower")
    expected = damping.circumferential_n_s_m3 / (2 * TABLE_4_RING.mass_per_area_kg_m2 * omega)
    ratio = torsion_damping_ratio(TABLE_4_RING, damping, pressure_load="follower")
    assert ratio == pytest.approx(expected, rel=1e-12)


def test_a_ring_without_torsion_has_no_damping_of_it():
    loose = replace(TABLE_4_RING, circumferential_stiffness_n_m3=0.0)
    with pytest.raises(InstabilityError, match="order 0"):
        torsion_damping_ratio(loose, TABLE_5_DAMPING, pressure_load="follower")


def test_the_other_pressure_model_leaves_torsion_and_bending_as_they_are():
    other = with_pressure_load(TABLE_4_RING, "dead", "follower")
    assert torsion_frequency_hz(other, pressure_load="follower") == pytest.approx(
        torsion_frequency_hz(TABLE_4_RING), rel=1e-12
    )
    orders = np.arange(1, 9)
    np.testing.assert_allclose(
        natural_frequencies_hz(other, orders, pressure_load="follower"),
        natural_frequencies_hz(TABLE_4_RING, orders),
        rtol=1e-3,
    )
    stiff = replace(TABLE_4_RING, axial_stiffness_n_m=1e3 * TABLE_4_RING.axial_stiffness_n_m)
    np.testing.assert_allclose(
        natural_frequencies_hz(
            with_pressure_load(stiff, "dead", "follower"), orders, pressure_load="follower"
        ),
        natural_frequencies_hz(stiff, orders),
        rtol=2e-6,
    )
    back = with_pressure_load(other, "follower", "dead")
    assert back.axial_stiffness_n_m == pytest.approx(TABLE_4_RING.axial_stiffness_n_m, rel=1e-12)


def test_a_dead_load_does_not_carry_a_soft_torsion():
    with pytest.raises(ParameterError, match="pressure_load"):
        with_pressure_load(TABLE_4_RING, "follower", "dead")
