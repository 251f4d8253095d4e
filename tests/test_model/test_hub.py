"""Ring and wheel: rigid motions, equilibrium of forces, Newton's law."""

from dataclasses import replace

import numpy as np
import pytest

from model import (
    ForcedRing,
    ParameterError,
    RingDamping,
    Wheel,
    equilibrium,
    free_hub_roots,
    harmonics,
    hub_response,
    inertance,
    natural_frequencies_hz,
    torsion_frequency_hz,
)
from model.parameters import REFITTED_DAMPING, TABLE_4_RING

WHEEL = Wheel(mass_kg=12.0, inertia_kg_m2=0.6)
UNDAMPED = RingDamping(0.0, 0.0, 0.0)
SPEEDS = [0.0, 67.3, 200.0]


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_free_wheel_turns_without_stiffness_at_every_speed(speed):
    roots = free_hub_roots(TABLE_4_RING, WHEEL, 0, speed)
    assert np.sort(np.abs(roots))[:2] == pytest.approx([0.0, 0.0], abs=1e-3)
    assert np.sort(np.abs(roots))[2] > 200.0


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize("load", ["dead", "follower"])
def test_a_free_tyre_translates_as_a_rigid_body(speed, load):
    """The double root ω = Ω: at rest in space."""
    roots = free_hub_roots(TABLE_4_RING, WHEEL, 1, speed, pressure_load=load)
    assert np.sort(np.abs(roots - speed))[:2] == pytest.approx([0.0, 0.0], abs=1e-3)


def test_rigid_motions_are_null_vectors_of_the_static_matrices():
    ring = TABLE_4_RING
    for speed in SPEEDS:
        rest = equilibrium(ring, speed, pressure_load="follower")
        radius, growth = float(rest.radius_m), float(rest.radial_displacement_m)
        turning = harmonics(ring, 0, speed, pressure_load="follower")
        coupling = -radius * ring.circumferential_stiffness_n_m3
        coupling += ring.radial_stiffness_n_m3 * growth
        assert turning.m22 * radius + coupling == pytest.approx(0.0, abs=1e-3)
        forced = ForcedRing(ring, UNDAMPED, speed, WHEEL)
        own_coupling, own = forced.turning_terms(np.zeros(1))
        assert own_coupling[0].real == pytest.approx(coupling)
        assert coupling * radius + own[0].real == pytest.approx(0.0, abs=1e-3)
        moving = harmonics(ring, 1, speed, pressure_load="follower")
        omega = 50.0
        rho = ring.mass_per_area_kg_m2
        m11 = moving.m11 - rho * omega**2
        m12 = 1j * (moving.c - 2 * rho * speed * omega)
        radial_row = m11 + 1j * m12 - ring.radial_stiffness_n_m3
        assert radial_row == pytest.approx(-rho * (omega - speed) ** 2, abs=1e-3)


def test_the_papers_dead_load_restrains_the_rotation_of_the_wheel():
    roots = free_hub_roots(TABLE_4_RING, WHEEL, 0, pressure_load="dead")
    assert np.abs(roots).min() > 100.0


def test_an_immovable_wheel_is_a_fixed_hub():
    heavy = Wheel(1e12, 1e12)
    turning = np.abs(free_hub_roots(TABLE_4_RING, heavy, 0)) / (2 * np.pi)
    fixed = torsion_frequency_hz(TABLE_4_RING, pressure_load="follower")
    assert np.abs(turning - fixed).min() < 1e-4
    moving = np.abs(free_hub_roots(TABLE_4_RING, heavy, 1)) / (2 * np.pi)
    fixed = natural_frequencies_hz(TABLE_4_RING, 1, pressure_load="follower")
    assert np.abs(moving - fixed).min() < 1e-4


def test_two_masses_on_the_bed_set_the_translation():
    """Rigid belt and wheel: ω² = k(1/m_belt + 1/m_wheel), close for a belt without stretch."""
    stiff = replace(TABLE_4_RING, axial_stiffness_n_m=2.52e11)
    line = np.pi * 0.33 * 0.19
    bed = line * (stiff.radial_stiffness_n_m3 + stiff.circumferential_stiffness_n_m3)
    belt = 2 * line * stiff.mass_per_area_kg_m2
    expected = np.sqrt(bed * (1 / belt + 1 / WHEEL.mass_kg))
    roots = np.abs(free_hub_roots(stiff, WHEEL, 1))
    assert np.abs(roots / expected - 1).min() < 1e-3


@pytest.mark.parametrize("load", ["dead", "follower"])
def test_a_static_force_is_fully_transmitted_to_the_hub(load):
    forced = ForcedRing(TABLE_4_RING, UNDAMPED, pressure_load=load)
    angle = 0.4
    push = hub_response(forced, 1e-4, angle)
    np.testing.assert_allclose(push.force_x, np.cos(angle), rtol=1e-9)
    np.testing.assert_allclose(push.force_z, np.sin(angle), rtol=1e-9)
    np.testing.assert_allclose(push.moment_m, 0.0, atol=1e-9)
    pull = hub_response(forced, 1e-4, angle, force_direction="circumferential")
    np.testing.assert_allclose(pull.force_x, -np.sin(angle), rtol=1e-9)
    np.testing.assert_allclose(pull.force_z, np.cos(angle), rtol=1e-9)


def test_a_static_circumferential_force_has_the_arm_of_the_grown_ring():
    forced = ForcedRing(TABLE_4_RING, UNDAMPED, pressure_load="follower")
    radius = float(equilibrium(TABLE_4_RING, pressure_load="follower").radius_m)
    pull = hub_response(forced, 1e-4, 1.0, force_direction="circumferential")
    np.testing.assert_allclose(pull.moment_m, radius, rtol=1e-8)


def test_damping_and_stiffness_both_reach_the_hub():
    lines = np.array([40.0, 75.0, 90.0])
    forced = ForcedRing(TABLE_4_RING, REFITTED_DAMPING)
    orders = np.array([1])
    omega = 2 * np.pi * lines
    radial, cross, _ = forced.compliance(orders, omega)
    bed_r, bed_t = forced.bed(omega)
    expected = bed_r * radial[0] - 1j * bed_t * cross[0]  # cos and sin parts are equal at rest
    np.testing.assert_allclose(hub_response(forced, lines).force_x, expected, rtol=1e-9)


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_free_wheel_obeys_newton(speed):
    lines = np.array([5.0, 30.0, 80.0])
    forced = ForcedRing(TABLE_4_RING, REFITTED_DAMPING, speed, WHEEL, frame="absolute")
    found = hub_response(forced, lines, 0.3)
    acceleration = -((2 * np.pi * lines) ** 2)
    np.testing.assert_allclose(found.force_x, 12.0 * acceleration * found.x_m_n, rtol=1e-9)
    np.testing.assert_allclose(found.force_z, 12.0 * acceleration * found.z_m_n, rtol=1e-9)
    np.testing.assert_allclose(found.moment_m, 0.6 * acceleration * found.rotation_rad_n, rtol=1e-9)


def test_a_slow_force_accelerates_tyre_and_wheel_together():
    belt = 2 * np.pi * 0.33 * 0.19 * TABLE_4_RING.mass_per_area_kg_m2
    found = hub_response(ForcedRing(TABLE_4_RING, UNDAMPED, wheel=WHEEL), 0.01)
    together = -1.0 / ((12.0 + belt) * (2 * np.pi * 0.01) ** 2)
    np.testing.assert_allclose(found.x_m_n.real, together, rtol=1e-4)


def test_the_wheel_enters_the_inertance_of_the_belt():
    lines = np.arange(20.0, 160.0, 0.5)
    fixed = ForcedRing(TABLE_4_RING, REFITTED_DAMPING, pressure_load="follower")
    heavy = replace(fixed, wheel=Wheel(1e9, 1e9))
    free = replace(fixed, wheel=WHEEL)
    left, right = inertance(fixed, lines, 0.5), inertance(heavy, lines, 0.5)
    np.testing.assert_allclose(left, right, rtol=1e-5, atol=1e-6)
    assert np.abs(inertance(free, lines, 0.5) - left).max() > 0.1 * np.abs(left).max()


@pytest.mark.parametrize("order", [0, 1])
def test_damped_roots_decay(order):
    damping = RingDamping(686.0, 800.0, 0.014, on_pretension=False)
    roots = free_hub_roots(TABLE_4_RING, WHEEL, order, 67.3, damping=damping)
    forward = roots[roots.real > 100.0]
    assert np.all(forward.imag > 0)


def test_resonances_of_the_response_are_the_roots():
    forced = ForcedRing(TABLE_4_RING, RingDamping(2.0, 2.0, 0.0), 67.3, WHEEL)
    root = free_hub_roots(TABLE_4_RING, WHEEL, 1, 67.3).real.max() / (2 * np.pi)
    lines = np.linspace(root - 1.0, root + 1.0, 401)
    peak = lines[np.abs(hub_response(forced, lines).force_x).argmax()]
    assert peak == pytest.approx(root, abs=0.02)


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda: free_hub_roots(TABLE_4_RING, WHEEL, 2), "order"),
        (
            lambda: free_hub_roots(replace(TABLE_4_RING, belt_width_m=None), WHEEL, 1),
            "belt_width_m",
        ),
        (
            lambda: hub_response(
                ForcedRing(TABLE_4_RING, UNDAMPED), 50.0, force_direction="sideways"
            ),
            "force_direction",
        ),
    ],
)
def test_refusals(call, where):
    with pytest.raises(ParameterError, match=f"^{where}:"):
        call()
