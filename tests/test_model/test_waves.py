"""Roots, bifurcation and waves of the turning ring."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from model import (
    InstabilityError,
    ParameterError,
    RingDamping,
    RingParameters,
    bifurcation,
    characteristic_roots,
    eigenvector_ratios,
    harmonics,
    natural_frequencies_hz,
    wave_pair,
)
from model.coefficients import REAL_ROOT
from model.parameters import REFITTED_DAMPING, TABLE_4_RING

ORDERS = np.arange(1, 8)
SPEED = 67.3  # 80 km/h
REGRESSIVE_HZ = [86.219, 110.131, 131.392, 155.142, 181.178, 208.974, 238.167]
PROGRESSIVE_HZ = [64.799, 92.890, 118.454, 144.995, 172.885, 201.980, 232.129]
STEEL = RingParameters(0.25, 7850 * 5e-3, 0.0, 0.0, 1.05e9, 210e9 * 5e-3**3 / 12, 0.0)


def test_table_4_at_80_km_h():
    found = bifurcation(TABLE_4_RING, ORDERS, SPEED)
    np.testing.assert_allclose(found.regressive_hz[:, 0], REGRESSIVE_HZ, atol=6e-4)
    np.testing.assert_allclose(found.progressive_hz[:, 0], PROGRESSIVE_HZ, atol=6e-4)
    assert found.stable.all()


def test_roots_at_rest_are_the_natural_frequencies():
    found = bifurcation(TABLE_4_RING, ORDERS, 0.0)
    expected = natural_frequencies_hz(TABLE_4_RING, ORDERS)
    np.testing.assert_allclose(found.regressive_hz[:, 0], expected, rtol=1e-12)
    np.testing.assert_allclose(found.progressive_hz[:, 0], expected, rtol=1e-12)


@given(
    order=st.integers(-60, 60),
    speed=st.floats(-300.0, 300.0),
    load=st.sampled_from(["dead", "follower"]),
)
def test_every_root_solves_the_quartic(order, speed, load):
    roots = characteristic_roots(TABLE_4_RING, order, speed, pressure_load=load)
    a3, a2, a1, a0 = harmonics(TABLE_4_RING, order, speed, pressure_load=load).polynomial
    value = ((a3 * roots**2 + a2) * roots + a1) * roots + a0
    terms = np.abs(a3 * roots**4) + np.abs(a2 * roots**2) + np.abs(a1 * roots) + np.abs(a0)
    assert np.all(np.abs(value) < 1e-10 * terms)


@given(order=st.integers(1, 40), speed=st.floats(0.0, 300.0))
def test_negative_orders_and_speeds_mirror_the_roots(order, speed):
    """Table 1 as corrected: n ≤ −1 inverts every sign; so does Ω → −Ω with the waves swapped."""
    roots = characteristic_roots(TABLE_4_RING, order, speed)
    np.testing.assert_allclose(characteristic_roots(TABLE_4_RING, -order, speed), -roots)
    turned = characteristic_roots(TABLE_4_RING, order, -speed)
    np.testing.assert_allclose(turned, -roots[[1, 0, 3, 2]])


def test_signs_of_table_2():
    forward = eigenvector_ratios(TABLE_4_RING, 3, SPEED)
    assert np.all(forward[:2] > 0)
    assert np.all(forward[2:] < 0)
    np.testing.assert_allclose(eigenvector_ratios(TABLE_4_RING, -3, SPEED), -forward)
    at_rest = eigenvector_ratios(TABLE_4_RING, 3, 0.0)
    assert at_rest[0] == pytest.approx(at_rest[1])
    assert at_rest[2] == pytest.approx(at_rest[3])


def test_eigenvectors_annihilate_the_matrix():
    terms = harmonics(TABLE_4_RING, 4, SPEED)
    roots = characteristic_roots(TABLE_4_RING, 4, SPEED).real
    ratios = eigenvector_ratios(TABLE_4_RING, 4, SPEED)
    rho = TABLE_4_RING.mass_per_area_kg_m2
    for omega, ratio in zip(roots, ratios, strict=True):
        coupling = 1j * (terms.c - 2 * rho * SPEED * omega)
        matrix = np.array(
            [[terms.m11 - rho * omega**2, coupling], [-coupling, terms.m22 - rho * omega**2]]
        )
        product = matrix @ [1.0, 1j * ratio]
        assert np.abs(product).max() < 1e-9 * np.abs(matrix).max()


@pytest.mark.parametrize(("order", "minimum"), [(2, 569.0), (3, 87.0), (4, 36.0)])
def test_progressive_frequency_has_its_minimum(order, minimum):
    speeds = np.linspace(0.5 * minimum, 1.5 * minimum, 801)
    progressive = bifurcation(TABLE_4_RING, order, speeds).progressive_hz[0]
    assert speeds[progressive.argmin()] == pytest.approx(minimum, abs=1.0)


def test_order_1_on_a_fixed_hub_splits_by_the_speed():
    found = bifurcation(TABLE_4_RING, 1, 200.0)
    middle = 0.5 * (found.regressive_hz + found.progressive_hz)[0, 0]
    half = 0.5 * (found.regressive_hz - found.progressive_hz)[0, 0]
    assert half == pytest.approx(200.0 / (2 * np.pi), abs=0.01)
    assert middle == pytest.approx(natural_frequencies_hz(TABLE_4_RING, 1), abs=0.01)


def test_bryan_split_of_a_steel_ring():
    orders = np.array([2, 3, 4])
    found = bifurcation(STEEL, orders, 2 * np.pi * 10.0)
    split = (found.regressive_hz - found.progressive_hz)[:, 0]
    np.testing.assert_allclose(2 * 2 * orders / (orders**2 + 1) * 10, [16, 12, 9.412], atol=6e-4)
    np.testing.assert_allclose(split, [16.002, 12.005, 9.420], atol=6e-4)


def test_a_spun_string_stands_still_in_space():
    string = replace(STEEL, bending_stiffness_n_m=0.0, axial_stiffness_n_m=1e12)
    found = bifurcation(string, [2, 3, 5], 50.0)
    n = found.orders
    regressive = 2 * np.pi * found.regressive_hz[:, 0] / 50.0
    progressive = 2 * np.pi * found.progressive_hz[:, 0] / 50.0
    np.testing.assert_allclose(regressive, n, rtol=1e-6)
    np.testing.assert_allclose(progressive, n * (n**2 - 3) / (n**2 + 1), rtol=1e-6)
    np.testing.assert_allclose(progressive[:2], [0.4, 1.8], rtol=1e-6)


def test_absolute_frame_shifts_by_the_rotation():
    turning = bifurcation(TABLE_4_RING, ORDERS, [0.0, SPEED])
    still = bifurcation(TABLE_4_RING, ORDERS, [0.0, SPEED], frame="absolute")
    shift = ORDERS[:, None] * [0.0, SPEED] / (2 * np.pi)
    np.testing.assert_allclose(still.regressive_hz, turning.regressive_hz - shift)
    np.testing.assert_allclose(still.progressive_hz, turning.progressive_hz + shift)


def test_extensional_pair_is_the_outer_one():
    found = bifurcation(STEEL, 2, 0.0, extensional=True)
    assert found.regressive_hz[0, 0] == pytest.approx(7363.06, abs=0.005)


def test_an_unstable_order_has_no_frequency():
    """A belt turned by pressure against a soft bed: order 0 under a follower load diverges."""
    slack = replace(
        TABLE_4_RING,
        circumferential_stiffness_n_m3=0.0,
        radial_stiffness_n_m3=5e7,
        inflation_pressure_pa=2e6,
    )
    roots = characteristic_roots(slack, 0, pressure_load="follower")
    assert np.abs(roots[:2].imag).min() > 1.0
    np.testing.assert_array_equal(roots[2:].imag, 0.0)


def test_real_roots_are_exactly_real_and_damped_ones_decay():
    roots = characteristic_roots(TABLE_4_RING, range(8), SPEED)
    np.testing.assert_array_equal(roots.imag, 0.0)
    damped = characteristic_roots(TABLE_4_RING, range(8), SPEED, damping=REFITTED_DAMPING)
    assert np.all(damped[..., [0, 2]].imag > 0)
    light = characteristic_roots(
        TABLE_4_RING, range(8), SPEED, damping=RingDamping(1e-3, 1e-3, 0.0)
    )
    np.testing.assert_allclose(light.real, roots.real, rtol=REAL_ROOT)


@pytest.mark.parametrize("extensional", [False, True])
@pytest.mark.parametrize("frame", ["rotating", "absolute"])
@settings(deadline=None)
@given(speed=st.floats(0.0, 200.0), time=st.floats(0.0, 0.1))
def test_fields_are_products_of_pattern_and_pulse(extensional, frame, speed, time):
    """Eqs 22a and 27a from eqs 21a and 25a."""
    pair = wave_pair(TABLE_4_RING, 3, speed, extensional=extensional)
    angles = np.linspace(0, 2 * np.pi, 50)
    first, second = pair.frequencies_rad_s(frame)
    product = (
        4
        * np.cos(3 * angles + 0.5 * (first - second) * time)
        * np.cos(0.5 * (first + second) * time)
    )
    np.testing.assert_allclose(pair.radial(angles, time, frame)[:, 0], product, atol=1e-9)


def test_at_rest_the_pair_stands():
    """Eq 20."""
    pair = wave_pair(TABLE_4_RING, 3)
    angles, times = np.linspace(0, 2 * np.pi, 40), np.linspace(0, 0.02, 30)
    pulse = 4 * np.cos(pair.regressive_rad_s * times)
    np.testing.assert_allclose(
        pair.radial(angles, times), np.cos(3 * angles)[:, None] * pulse, atol=1e-9
    )
    np.testing.assert_allclose(
        pair.circumferential(angles, times),
        -pair.regressive_ratio * np.sin(3 * angles)[:, None] * pulse,
        atol=1e-9,
    )


@pytest.mark.parametrize("frame", ["rotating", "absolute"])
def test_the_standing_frequency_is_that_of_the_stationary_frame(frame):
    found = bifurcation(TABLE_4_RING, ORDERS, SPEED, frame=frame)
    for order, standing_hz in zip(ORDERS, found.standing_hz[:, 0], strict=True):
        seen = wave_pair(TABLE_4_RING, order, SPEED).frequencies_rad_s("stationary")
        np.testing.assert_allclose(np.array(seen) / (2 * np.pi), standing_hz, rtol=1e-12)


def test_in_the_stationary_frame_the_pair_stands_at_any_speed():
    """Eqs 30 to 32, 30b as corrected."""
    pair = wave_pair(TABLE_4_RING, 3, SPEED)
    first, second = pair.propagation_speeds_rad_s("stationary")
    assert first == pytest.approx(second)
    assert first == pytest.approx((pair.regressive_rad_s + pair.progressive_rad_s) / 6)
    assert pair.pattern_speed_rad_s("stationary") == pytest.approx(0.0, abs=1e-9)
    assert pair.pattern_speed_rad_s("rotating") == pytest.approx(abs(pair.beta_rad_s))
    nodes = (np.arange(6) + 0.5) * np.pi / 3
    field = pair.radial(nodes, np.linspace(0, 0.05, 40), "stationary")
    np.testing.assert_allclose(field, 0.0, atol=1e-9)


@given(speed=st.floats(0.0, 300.0), time=st.floats(0.0, 0.1))
def test_all_frames_show_one_field(speed, time):
    """Eqs 1c and 29: θ = φ − Ωt = γ + βt."""
    pair = wave_pair(TABLE_4_RING, 2, speed)
    theta = np.linspace(0.0, 2 * np.pi, 20)
    for component in (pair.radial, pair.circumferential):
        on_tyre = component(theta, time)
        in_space = component(theta + speed * time, time, "absolute")
        standing = component(theta - pair.beta_rad_s * time, time, "stationary")
        np.testing.assert_allclose(in_space, on_tyre, atol=1e-7)
        np.testing.assert_allclose(standing, on_tyre, atol=1e-7)


def test_in_space_the_regressive_wave_slows_and_the_progressive_speeds_up():
    """Eqs 23 and 26."""
    pair = wave_pair(TABLE_4_RING, 3, SPEED)
    turning, still = (pair.propagation_speeds_rad_s(f) for f in ("rotating", "absolute"))
    assert still[0] == pytest.approx(turning[0] - SPEED)
    assert still[1] == pytest.approx(turning[1] + SPEED)


def test_free_waves_satisfy_the_equations_of_motion():
    """Eqs 6 and 7 (as corrected), by differences in space and time of the real fields."""
    ring, speed, order = TABLE_4_RING, SPEED, 2
    pair = wave_pair(ring, order, speed)
    terms = harmonics(ring, order, speed)
    rho, step = ring.mass_per_area_kg_m2, 1e-6
    theta, t = np.array([0.3]), 0.012
    r = [pair.radial(theta, t + k * step)[0, 0] for k in (-1, 0, 1)]
    c = [pair.circumferential(theta, t + k * step)[0, 0] for k in (-1, 0, 1)]
    turned = theta + np.pi / (2 * order)  # cos → −sin: the derivative over θ by a shift
    r_slope = order * pair.radial(turned, t)[0, 0]
    c_slope = order * pair.circumferential(turned, t)[0, 0]
    radial = (
        rho * (r[2] - 2 * r[1] + r[0]) / step**2
        - 2 * rho * speed * (c[2] - c[0]) / (2 * step)
        + terms.m11 * r[1]
        + terms.c / order * c_slope
    )
    around = (
        rho * (c[2] - 2 * c[1] + c[0]) / step**2
        + 2 * rho * speed * (r[2] - r[0]) / (2 * step)
        + terms.m22 * c[1]
        - terms.c / order * r_slope
    )
    size = float(terms.m11)
    assert abs(radial) < 1e-4 * size
    assert abs(around) < 1e-4 * size


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda: bifurcation(TABLE_4_RING, 0, 10.0), "orders"),
        (lambda: bifurcation(TABLE_4_RING, 1, 10.0, frame="moon"), "frame"),
        (lambda: bifurcation(TABLE_4_RING, 1, np.nan), "speed_rad_s"),
        (lambda: bifurcation(TABLE_4_RING, 1, 5e3), "speed_rad_s"),
        (lambda: eigenvector_ratios(TABLE_4_RING, [0, 1]), "orders"),
        (lambda: wave_pair(TABLE_4_RING, 2, 10.0).radial(0.0, 0.0, "moon"), "frame"),
    ],
)
def test_refusals(call, where):
    with pytest.raises(ParameterError, match=f"^{where}:"):
        call()


def test_growth_is_refused_as_a_frequency_and_reported_as_growth(monkeypatch):
    unstable = np.array([300.0 - 5j, 300.0 + 5j, 5000.0, -5000.0])
    monkeypatch.setattr("model.ring.characteristic_roots", lambda *_, **__: unstable)
    with pytest.raises(InstabilityError, match="grows by 5"):
        wave_pair(TABLE_4_RING, 2, 10.0)
    monkeypatch.setattr("model.ring.characteristic_roots", lambda *_, **__: unstable[None, None])
    found = bifurcation(TABLE_4_RING, 2, 10.0)
    assert np.isnan(found.regressive_hz).all()
    assert found.growth_rate_1_s[0, 0] == 5.0
    assert not found.stable.any()
