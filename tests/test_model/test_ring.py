"""The ring at rest against the paper, exact results and its own symmetries."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from model import (
    InstabilityError,
    ParameterError,
    RingParameters,
    displacement_ratio,
    equilibrium,
    harmonics,
    modal_mass_kg,
    natural_frequencies_hz,
    torsion_frequency_hz,
)
from model.parameters import TABLE_3_FREQUENCIES_HZ, TABLE_4_RING

AT_REST_HZ = [75.509, 100.742, 122.375, 145.435, 170.276, 196.645, 224.305]


def test_table_4_gives_its_frequencies():
    frequencies = natural_frequencies_hz(TABLE_4_RING, range(1, 8))
    np.testing.assert_allclose(frequencies, AT_REST_HZ, atol=5.1e-4)


@pytest.mark.parametrize(
    ("pressure", "within"), [(2.14e5, False), (2.16e5, True), (2.22e5, True), (2.23e5, False)]
)
def test_only_near_2_2_bar_table_4_gives_table_3(pressure, within):
    model = natural_frequencies_hz(
        replace(TABLE_4_RING, inflation_pressure_pa=pressure), range(1, 8)
    )
    error = np.abs(model / TABLE_3_FREQUENCIES_HZ - 1)
    assert (error[1:].max() < 0.01) == within
    assert model[0] - TABLE_3_FREQUENCIES_HZ[0] == pytest.approx(-3.2, abs=0.1)


def test_without_preload_the_frequencies_fall_short():
    slack = replace(TABLE_4_RING, inflation_pressure_pa=0.0)
    short = natural_frequencies_hz(slack, range(1, 8)) / TABLE_3_FREQUENCIES_HZ - 1
    assert short.min() == pytest.approx(-0.5, abs=0.01)


def test_steady_radial_displacement():
    rest = equilibrium(TABLE_4_RING, [0.0, 67.3])
    np.testing.assert_allclose(rest.radial_displacement_m, [9.142383e-4, 1.036368e-3], rtol=1e-6)


def test_equilibrium_balances_the_printed_cubic():
    ring, speed = TABLE_4_RING, 150.0
    k, a, w = ring.axial_stiffness_n_m, ring.mean_radius_m, equilibrium(ring, speed)
    w = float(w.radial_displacement_m)
    spin = ring.mass_per_area_kg_m2 * speed**2
    linear = k / a**2 + ring.radial_stiffness_n_m3 - spin
    cubic = k * w**3 / (2 * a**4) + 3 * k * w**2 / (2 * a**3) + w * linear
    load = spin * a + ring.inflation_pressure_pa
    assert cubic == pytest.approx(load, rel=1e-12)


def test_follower_pressure_acts_on_the_grown_ring():
    rest = equilibrium(TABLE_4_RING, pressure_load="follower")
    carried = TABLE_4_RING.radial_resistance_pa(float(rest.hoop_strain))
    grown = TABLE_4_RING.inflation_pressure_pa * (1.0 + float(rest.hoop_strain))
    assert carried == pytest.approx(grown, rel=1e-12)


def test_no_equilibrium_at_an_absurd_speed():
    with pytest.raises(ParameterError, match="speed_rad_s: 2500"):
        equilibrium(TABLE_4_RING, [0.0, 2500.0])


def test_unknown_pressure_load_is_refused():
    with pytest.raises(ParameterError, match="pressure_load: 'gas'"):
        equilibrium(TABLE_4_RING, pressure_load="gas")


def test_follower_load_leaves_rigid_translation_and_softens_torsion():
    orders = np.arange(1, 8)
    dead = natural_frequencies_hz(TABLE_4_RING, orders)
    follower = natural_frequencies_hz(TABLE_4_RING, orders, pressure_load="follower")
    assert follower[0] == pytest.approx(dead[0], abs=1e-3)
    np.testing.assert_allclose((follower - dead)[[1, 6]], [2.6, 2.1], atol=0.05)
    assert torsion_frequency_hz(TABLE_4_RING) == pytest.approx(40.9, abs=0.05)
    assert torsion_frequency_hz(TABLE_4_RING, pressure_load="follower") == pytest.approx(
        28.5, abs=0.05
    )


STEEL = RingParameters(
    mean_radius_m=0.25,
    mass_per_area_kg_m2=7850 * 5e-3,
    radial_stiffness_n_m3=0.0,
    circumferential_stiffness_n_m3=0.0,
    axial_stiffness_n_m=210e9 * 5e-3,
    bending_stiffness_n_m=210e9 * 5e-3**3 / 12,
    inflation_pressure_pa=0.0,
)


def test_steel_ring_bends_as_in_hoppe():
    n = np.arange(2, 6)
    d, mass, a = STEEL.bending_stiffness_n_m, STEEL.mass_per_area_kg_m2, STEEL.mean_radius_m
    hoppe = np.sqrt(d * n**2 * (n**2 - 1.0) ** 2 / (mass * a**4 * (n**2 + 1.0))) / (2 * np.pi)
    np.testing.assert_allclose(hoppe, [51.011, 144.280, 276.644, 447.393], atol=6e-4)
    np.testing.assert_allclose(
        natural_frequencies_hz(STEEL, n), [51.008, 144.272, 276.628, 447.365], atol=6e-4
    )


def test_steel_ring_breathes():
    assert natural_frequencies_hz(STEEL, 0) == pytest.approx(3292.72, abs=0.005)


def test_nafems_ring_in_plane():
    section, inertia = np.pi * 0.1**2 / 4, np.pi * 0.1**4 / 64
    ring = RingParameters(1.0, 8000 * section, 0.0, 0.0, 200e9 * section, 200e9 * inertia, 0.0)
    assert natural_frequencies_hz(ring, 2) == pytest.approx(53.38, rel=0.01)
    assert natural_frequencies_hz(ring, 3) == pytest.approx(151.0, rel=0.01)


def test_a_free_ring_moves_as_a_rigid_body_without_stiffness():
    np.testing.assert_allclose(harmonics(STEEL, [1, -1]).determinant, 0.0, atol=0.0)
    assert natural_frequencies_hz(STEEL, 1) == 0.0


def test_determinant_is_that_of_the_matrix():
    terms = harmonics(TABLE_4_RING, np.arange(-20, 21), 67.3)
    np.testing.assert_allclose(terms.determinant, terms.m11 * terms.m22 - terms.c**2, rtol=1e-9)


def test_displacement_ratio_is_odd_and_close_to_inextensional():
    orders = np.arange(1, 8)
    ratio = displacement_ratio(TABLE_4_RING, orders)
    np.testing.assert_allclose(ratio, 1.0 / orders, rtol=0.02)
    np.testing.assert_allclose(displacement_ratio(TABLE_4_RING, -orders), -ratio, rtol=1e-14)
    assert displacement_ratio(TABLE_4_RING, 0) == 0.0


def test_modal_mass_integrates_the_shape():
    ring, theta = TABLE_4_RING, np.linspace(0.0, 2 * np.pi, 360, endpoint=False)
    ratio = displacement_ratio(ring, 3)
    squared = np.cos(3 * theta) ** 2 + (ratio * np.sin(3 * theta)) ** 2
    line = ring.mass_per_area_kg_m2 * ring.belt_width_m * ring.mean_radius_m
    assert modal_mass_kg(ring, 3) == pytest.approx(line * squared.mean() * 2 * np.pi)
    assert modal_mass_kg(ring, 0) == pytest.approx(2 * np.pi * line)


def test_modal_mass_needs_the_width():
    with pytest.raises(ParameterError, match="belt width"):
        modal_mass_kg(replace(TABLE_4_RING, belt_width_m=None), 1)


def test_order_must_be_whole():
    with pytest.raises(ParameterError, match=r"2\.5"):
        natural_frequencies_hz(TABLE_4_RING, [1, 2.5])


def test_negative_stiffness_is_an_instability():
    slack = replace(TABLE_4_RING, circumferential_stiffness_n_m3=0.0, inflation_pressure_pa=5e6)
    with pytest.raises(InstabilityError, match="order 0"):
        torsion_frequency_hz(slack, pressure_load="follower")


@given(factor=st.floats(0.1, 10.0))
def test_scaling_mass_stiffness_and_pressure_changes_no_frequency(factor):
    names = (
        "mass_per_area_kg_m2",
        "radial_stiffness_n_m3",
        "circumferential_stiffness_n_m3",
        "axial_stiffness_n_m",
        "bending_stiffness_n_m",
        "inflation_pressure_pa",
    )
    scaled = replace(TABLE_4_RING, **{n: factor * getattr(TABLE_4_RING, n) for n in names})
    np.testing.assert_allclose(
        natural_frequencies_hz(scaled, range(8)), natural_frequencies_hz(TABLE_4_RING, range(8))
    )
