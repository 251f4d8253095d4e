"""The ring against an independent route: its energies on a grid, differentiated numerically.

Potential and kinetic energies (eqs 35 to 46 as corrected) are written down for nodes around the
ring and a wheel; equilibrium, stiffness, mass and gyroscopic matrices follow by differences that
are exact for polynomials of fourth degree. Nothing of the harmonics of the model enters.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from model import Wheel, bifurcation, equilibrium, free_hub_roots, torsion_frequency_hz
from model.parameters import TABLE_4_RING as RING

WHEEL = Wheel(mass_kg=12.0, inertia_kg_m2=0.6)
WIDTH = RING.belt_width_m
STEP = 3e-4  # m; rotations in units of STEP/a, and larger steps for the quadratic kinetic energy
SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0
FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
REACH = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])


def split(q, nodes):
    """u_r, u_θ at the nodes and x_w, z_w, θ_w of a batch of states."""
    return q[..., :nodes], q[..., nodes : 2 * nodes], q[..., 2 * nodes :]


def potential(q, nodes, load):
    """Strain, foundation and pressure energy per unit of width, for a batch of states."""
    a, k, d = RING.mean_radius_m, RING.axial_stiffness_n_m, RING.bending_stiffness_n_m
    radial, around, hub = split(q, nodes)
    arc = 2 * np.pi / nodes
    theta = arc * np.arange(nodes)

    def ahead(u):
        return np.roll(u, -1, axis=-1)

    def behind(u):
        return np.roll(u, 1, axis=-1)

    stretch = ((radial + ahead(radial)) / 2 + (ahead(around) - around) / arc) / a
    rotation = ((around + ahead(around)) / 2 - (ahead(radial) - radial) / arc) / a
    bending = (ahead(around) - behind(around)) / (2 * arc)
    bending = (bending - (ahead(radial) - 2 * radial + behind(radial)) / arc**2) / a**2
    strain = stretch + (stretch**2 + rotation**2) / 2
    belt = (k * strain**2 + d * bending**2).sum(axis=-1) / 2

    x, z, turned = (hub[..., k, None] for k in range(3))
    if load == "dead":
        long_r = radial - x * np.cos(theta) - z * np.sin(theta)
        long_t = around + x * np.sin(theta) - z * np.cos(theta) - a * turned
        work = RING.inflation_pressure_pa * radial.sum(axis=-1) * a * arc
    else:
        across_r = a + radial - x * np.cos(theta) - z * np.sin(theta)
        across_t = around + x * np.sin(theta) - z * np.cos(theta)
        long_r = across_r * np.cos(turned) + across_t * np.sin(turned) - a
        long_t = across_t * np.cos(turned) - across_r * np.sin(turned)
        place_x = (a + radial) * np.cos(theta) - around * np.sin(theta)
        place_z = (a + radial) * np.sin(theta) + around * np.cos(theta)
        area = (place_x * ahead(place_z) - ahead(place_x) * place_z).sum(axis=-1) / 2
        work = RING.inflation_pressure_pa * area
    k_r, k_t = RING.radial_stiffness_n_m3, RING.circumferential_stiffness_n_m3
    bed = (k_r * long_r**2 + k_t * long_t**2).sum(axis=-1) / 2
    return (belt + bed) * a * arc - work


def kinetic(state, nodes, speed):
    """Kinetic energy of belt and wheel per unit of width; a state is [q, dq/dt]."""
    half = state.shape[-1] // 2
    radial, around, hub = split(state[..., :half], nodes)
    radial_rate, around_rate, hub_rate = split(state[..., half:], nodes)
    a, arc = RING.mean_radius_m, 2 * np.pi / nodes
    outward = radial_rate - speed * around
    forward = around_rate + speed * (a + radial)
    belt = RING.mass_per_area_kg_m2 * a * arc / 2 * (outward**2 + forward**2).sum(axis=-1)
    x, z, _ = np.moveaxis(hub, -1, 0)
    x_rate, z_rate, turning = np.moveaxis(hub_rate, -1, 0)
    moving = (x_rate - speed * z) ** 2 + (z_rate + speed * x) ** 2
    wheel = WHEEL.mass_kg * moving + WHEEL.inertia_kg_m2 * (speed + turning) ** 2
    return belt + wheel / (2 * WIDTH)


def curvature(function, place, units):
    """Second derivatives by the five-point rule along coordinates and pairs of them."""
    size = place.size
    rows, columns = np.triu_indices(size, 1)
    along = np.zeros((size + rows.size, size))
    along[np.arange(size), np.arange(size)] = 1.0
    along[size + np.arange(rows.size), rows] = 1.0
    along[size + np.arange(rows.size), columns] = 1.0
    second = np.empty(along.shape[0])
    for start in range(0, second.size, 1000):
        part = along[start : start + 1000] * units
        values = function(place + REACH[:, None, None] * part)
        second[start : start + 1000] = SECOND @ values
    matrix = np.diag(second[:size])
    mixed = (second[size:] - second[rows] - second[columns]) / 2
    matrix[rows, columns] = matrix[columns, rows] = mixed
    return matrix / np.outer(units, units)


def uniform(nodes, growth):
    return np.r_[np.full(nodes, growth), np.zeros(nodes + 3)]


def steady_growth(nodes, speed, load):
    """u_r° where the derivative of potential minus kinetic energy vanishes."""

    def slope(growth):
        states = np.array([uniform(nodes, growth + STEP * r) for r in REACH])
        rates = np.concatenate([states, np.zeros_like(states)], axis=1)
        return FIRST @ (potential(states, nodes, load) - kinetic(rates, nodes, speed))

    return brentq(slope, 0.0, 0.05, xtol=1e-14)


def frequencies(nodes, speed, load, free):
    """Imaginary parts of all poles in the rotating frame, rad/s, and the order of each shape."""
    place = uniform(nodes, steady_growth(nodes, speed, load))
    units = np.full(place.size, STEP)
    units[-1] = STEP / RING.mean_radius_m
    stiffness = curvature(lambda q: potential(q, nodes, load), place, units)
    kinetic_curvature = curvature(
        lambda s: kinetic(s, nodes, speed), np.r_[place, 0 * place], np.r_[100 * units, 1e5 * units]
    )
    size = place.size
    spin, cross = kinetic_curvature[:size, :size], kinetic_curvature[size:, :size]
    mass = kinetic_curvature[size:, size:]
    kept = slice(None) if free else slice(0, 2 * nodes)
    mass, cross = mass[kept, kept], cross[kept, kept]
    stiffness = (stiffness - spin)[kept, kept]
    size = mass.shape[0]
    state = np.zeros((2 * size, 2 * size))
    state[:size, size:] = np.eye(size)
    state[size:, :size] = -np.linalg.solve(mass, stiffness)
    state[size:, size:] = -np.linalg.solve(mass, cross - cross.T)
    poles, shapes = np.linalg.eig(state)
    assert np.abs(poles.real).max() < 1e-3 * np.abs(poles).max()
    waves = np.abs(np.fft.fft(shapes[: 2 * nodes].reshape(2, nodes, -1), axis=1)).sum(axis=0)
    orders = np.rint(np.fft.fftfreq(nodes, 1.0 / nodes)).astype(int)[waves.argmax(axis=0)]
    return poles.imag, orders if speed else np.abs(orders)


def expected_fixed(speed, load):
    """Order, signed as in e^{i(nθ + ωt)}, and ω > 0; at rest both signs coincide."""
    waves = bifurcation(RING, [1, 2, 3], speed, pressure_load=load)
    regressive, progressive = (
        2 * np.pi * part[:, 0] for part in (waves.regressive_hz, waves.progressive_hz)
    )
    found = list(zip((1, 2, 3), regressive, strict=True))
    if speed:
        return found + list(zip((-1, -2, -3), progressive, strict=True))
    return [*found, (0, 2 * np.pi * torsion_frequency_hz(RING, pressure_load=load))]


def expected_free(speed, load):
    moving = free_hub_roots(RING, WHEEL, 1, speed, pressure_load=load).real
    elastic = moving[(np.abs(moving - speed) > 1.0) & (np.abs(moving) < 1000.0)]
    turning = free_hub_roots(RING, WHEEL, 0, speed, pressure_load=load).real
    turning = turning[(turning > 1.0) & (turning < 1000.0)]
    signed = [(int(np.sign(root)) if speed else 1, abs(root)) for root in elastic]
    return signed + [(0, root) for root in turning]


def misfits(expected, nodes, speed, load, free):
    omega, orders = frequencies(nodes, speed, load, free)
    return np.array(
        [np.abs(omega[orders == order] - value).min() / value for order, value in expected]
    )


@pytest.mark.parametrize("speed", [0.0, 200.0])
@pytest.mark.parametrize("load", ["dead", "follower"])
@pytest.mark.parametrize("free", [False, True])
def test_the_grid_converges_to_the_model_at_second_order(speed, load, free):
    expected = (expected_free if free else expected_fixed)(speed, load)
    coarse = misfits(expected, 24, speed, load, free)
    fine = misfits(expected, 48, speed, load, free)
    assert fine.max() < 0.02
    np.testing.assert_array_less(np.abs(4.0 * fine - coarse), 0.1 * coarse.max())


@pytest.mark.parametrize("speed", [0.0, 200.0])
@pytest.mark.parametrize("load", ["dead", "follower"])
def test_the_grid_grows_like_the_ring(speed, load):
    exact = float(equilibrium(RING, speed, pressure_load=load).radial_displacement_m)
    coarse, fine = (steady_growth(nodes, speed, load) / exact - 1 for nodes in (20, 40))
    if load == "dead":
        assert abs(coarse) < 1e-9
    else:  # a polygon encloses less than its circle
        assert coarse / fine == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("speed", [0.0, 200.0])
def test_a_free_wheel_is_carried_along_by_the_grid_too(speed):
    omega, _ = frequencies(32, speed, "follower", True)
    assert np.abs(omega).min() < 2.0  # a double root, known to the square root of the rounding
    assert np.sum(np.abs(omega - speed) < 2.0) >= 2
