"""The tyre on a flat road: contact conditions, limits, and an independent discretisation."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.linalg import eigh

from model import (
    ParameterError,
    Tread,
    Wheel,
    free_hub_roots,
    load_ring,
    natural_frequencies_hz,
    press_on_road,
    torsion_frequency_hz,
)
from model.parameters import TABLE_4_RING as RING

LOAD_N = 4000.0
WHEEL = Wheel(mass_kg=12.0, inertia_kg_m2=0.6)
LOADS = ("dead", "follower")


@pytest.fixture(scope="module", params=LOADS)
def pressed(request):
    return press_on_road(RING, LOAD_N, pressure_load=request.param)


class SplineRing:
    """The same energies (eqs 43, 46, 47) over Cartesian positions of the belt, in B-splines.

    Nothing is shared with the model: the hoop strain is (|r'|²/a² − 1)/2, contact is summed over
    40 000 small cells.
    """

    def __init__(self, tread, pressure_load):
        self.tread, self.pressure_load = tread, pressure_load
        far = np.arange(12.0, 348.0 + 1e-9, 4.0)
        self.breaks = np.deg2rad(np.concatenate([far, 348.0 + np.arange(0.75, 24.0 + 1e-9, 0.75)]))
        nodes, weights = np.polynomial.legendre.leggauss(8)
        half = np.diff(self.breaks)[:, None] / 2.0
        self.angles = (self.breaks[:-1, None] + half * (nodes + 1.0)).ravel()
        self.lengths = RING.mean_radius_m * (half * weights).ravel()
        self.value, self.slope, self.bend = (self.basis(self.angles, k) for k in range(3))
        cell = np.deg2rad(22.0) / 40000
        self.cells = np.deg2rad(349.0) + cell * (np.arange(40000) + 0.5)
        self.cell_m = RING.mean_radius_m * cell
        self.touching = self.basis(self.cells)
        count = self.value.shape[1]
        out, around = self.directions(0.0)
        gram = self.value.T @ (self.lengths[:, None] * self.value)
        self.mass = RING.mass_per_area_kg_m2 * np.kron(np.eye(2), gram)
        self.stiff = self.gram(RING.radial_stiffness_n_m3, self.mix(out, self.value))
        self.stiff += self.gram(RING.circumferential_stiffness_n_m3, self.mix(around, self.value))
        turn = self.mix(out, self.bend) + self.mix(around, self.slope)
        self.stiff += self.gram(RING.bending_stiffness_n_m / RING.mean_radius_m**4, turn)
        pull = RING.radial_stiffness_n_m3 * RING.mean_radius_m
        self.force = pull * (self.mix(out, self.value).T @ self.lengths)
        if pressure_load == "dead":
            push = RING.inflation_pressure_pa * self.mix(out, self.value).T @ self.lengths
            self.force += push
        else:
            area = self.value.T @ (self.lengths[:, None] / RING.mean_radius_m * self.slope)
            zero, skew = np.zeros((count, count)), (area - area.T) / 2.0
            area = np.block([[zero, skew], [skew.T, zero]])
            self.stiff -= RING.inflation_pressure_pa * area

    def basis(self, angles, derivative=0):
        """Periodic splines of degree 5 at `angles`, (n_angles, n_splines)."""
        turn, degree = 2.0 * np.pi, 5
        inner = self.breaks[:-1]
        knots = np.concatenate([inner[-degree:] - turn, self.breaks, inner[1 : degree + 1] + turn])
        splines = BSpline(knots, np.eye(knots.size - degree - 1), degree)
        splines = splines.derivative(derivative) if derivative else splines
        full = splines(np.asarray(angles))
        full[:, :degree] += full[:, inner.size :]
        return full[:, : inner.size]

    def directions(self, turned):
        angles = self.angles + turned
        out = np.column_stack([np.cos(angles), np.sin(angles)])
        return out, np.column_stack([-out[:, 1], out[:, 0]])

    def mix(self, direction, part):
        return np.hstack([direction[:, :1] * part, direction[:, 1:] * part])

    def gram(self, factor, rows):
        return factor * rows.T @ (self.lengths[:, None] * rows)

    def stretch(self, place):
        """Hoop force, and slopes of the belt x', y' over a."""
        a, n = RING.mean_radius_m, self.value.shape[1]
        slopes = np.column_stack([self.slope @ place[:n], self.slope @ place[n:]]) / a
        return RING.axial_stiffness_n_m * ((slopes**2).sum(axis=1) - 1.0) / 2.0, slopes

    def derivatives(self, place):
        """Unbalanced forces and tangent stiffness without the road."""
        a = RING.mean_radius_m
        force, slopes = self.stretch(place)
        rows = self.mix(slopes, self.slope) / a
        tangent = self.stiff + self.gram(RING.axial_stiffness_n_m, rows)
        pulled = self.slope.T @ ((self.lengths * force / a**2)[:, None] * self.slope)
        tangent = tangent + np.kron(np.eye(2), pulled)
        return self.stiff @ place - self.force + rows.T @ (self.lengths * force), tangent

    def press(self, load_n):
        """Place of the belt and of the road, and the cells in contact."""
        n = self.value.shape[1]
        out, _ = self.directions(0.0)
        circle = np.linalg.solve(
            self.value.T @ self.value, self.value.T @ (RING.mean_radius_m * out)
        ).T.ravel()
        road, per_width = RING.mean_radius_m - 0.008, load_n / RING.belt_width_m
        place = circle
        for _ in range(60):
            inside = self.touching @ place[:n] > road
            rows = np.hstack([self.touching[inside], np.zeros((inside.sum(), n))])
            press = self.tread.radial_n_m3 * self.cell_m * (rows @ place - road)
            slope, tangent = self.derivatives(place)
            unbalanced = np.append(slope + rows.T @ press, per_width - press.sum())
            rows = np.hstack([rows, -np.ones((inside.sum(), 1))])
            full = self.tread.radial_n_m3 * self.cell_m * rows.T @ rows
            full[:-1, :-1] += tangent
            change = np.linalg.solve(full, unbalanced)
            place, road = place - change[:-1], road - change[-1]
            if np.abs(change).max() < 1e-12:
                return place, road, inside
        raise AssertionError("the comparison does not converge")

    def frequencies_hz(self, load_n, wheel):
        place, road, inside = self.press(load_n)
        _, tangent = self.derivatives(place)
        rows = self.touching[inside]
        for part, factor in enumerate((self.tread.radial_n_m3, self.tread.tangential_n_m3)):
            held = np.zeros((2, 2))
            held[part, part] = factor * self.cell_m
            tangent = tangent + np.kron(held, rows.T @ rows)
        mass = self.mass
        if wheel is not None:
            tangent = np.pad(tangent, (0, 3)) + self.wheel_part(place)
            own = np.array([wheel.mass_kg, wheel.mass_kg, wheel.inertia_kg_m2]) / RING.belt_width_m
            mass = np.pad(mass, (0, 3)) + np.diag(np.append(np.zeros(place.size), own))
        squared = eigh(tangent, mass, eigvals_only=True)
        return np.sqrt(np.maximum(squared, 0.0)) / (2.0 * np.pi), road

    def wheel_part(self, place):
        """What a wheel adds to the stiffness: differences over its angle, exact in its place."""
        known = np.append(place, [0.0, 0.0])

        def bed(turned):
            out, around = self.directions(turned)
            radial = np.hstack([self.mix(out, self.value), -out])
            tangential = np.hstack([self.mix(around, self.value), -around])
            long = radial @ known - RING.mean_radius_m
            k_r, k_t = RING.radial_stiffness_n_m3, RING.circumferential_stiffness_n_m3
            slope = k_r * radial.T @ (self.lengths * long)
            slope += k_t * tangential.T @ (self.lengths * (tangential @ known))
            energy = k_r * long**2 + k_t * (tangential @ known) ** 2
            stiff = self.gram(k_r, radial) + self.gram(k_t, tangential)
            return energy @ self.lengths / 2.0, slope, stiff

        step = 1e-4
        (before, slope_before, _), (here, _, stiff), (after, slope_after, _) = map(
            bed, (-step, 0.0, step)
        )
        full = np.pad(stiff, (0, 1))
        full[:-1, -1] = full[-1, :-1] = (slope_after - slope_before) / (2.0 * step)
        full[-1, -1] = (before - 2.0 * here + after) / step**2
        full[: place.size, : place.size] = 0.0  # the belt's own part is there already
        return full


@pytest.mark.parametrize(
    ("pressure_load", "wheel"), [("dead", None), ("follower", None), ("follower", WHEEL)]
)
def test_an_independent_discretisation_gives_the_same_frequencies(pressure_load, wheel):
    found = press_on_road(RING, LOAD_N, pressure_load=pressure_load, highest_order=120)
    expected, road = SplineRing(found.tread, pressure_load).frequencies_hz(LOAD_N, wheel)
    assert found.road_m == pytest.approx(road, abs=1e-9)
    hz = found.modes(wheel=wheel).frequency_hz
    rolls = 0 if wheel is None else 1
    np.testing.assert_allclose(hz[rolls:13], expected[rolls:13], atol=1e-3)
    assert np.all(hz[:rolls] < 0.2)


def test_pressure_and_gap_exclude_each_other_and_carry_the_load(pressed):
    angles = np.linspace(-np.pi, np.pi, 20001)
    compression, pressure = pressed.compression_m(angles), pressed.pressure_pa(angles)
    assert np.all(pressure >= 0)
    np.testing.assert_array_equal(pressure[compression <= 0], 0.0)
    np.testing.assert_allclose(pressure, 4e8 * np.maximum(compression, 0.0))
    np.testing.assert_allclose(pressed.compression_m(pressed.edges_rad.ravel()), 0.0, atol=1e-15)
    carried = pressure.sum() * (angles[1] - angles[0]) * RING.mean_radius_m * RING.belt_width_m
    assert carried == pytest.approx(LOAD_N, rel=1e-5)
    assert pressed.load_n == pytest.approx(LOAD_N, rel=1e-9)
    unbalanced = pressed.imbalance(LOAD_N)
    assert np.abs(unbalanced).max() < 1e-9 * LOAD_N / RING.belt_width_m


def test_the_patch_is_symmetric_and_grows_with_the_load(pressed):
    np.testing.assert_allclose(pressed.edges_rad[0, 0], -pressed.edges_rad[0, 1], rtol=1e-9)
    lighter = press_on_road(RING, LOAD_N / 2, pressure_load=pressed.state.pressure_load)
    assert 0 < lighter.patch_length_m < pressed.patch_length_m
    assert 0 < lighter.deflection_m < pressed.deflection_m


def test_stiffness_is_the_slope_of_load_over_deflection(pressed):
    step, load = 1.0, pressed.state.pressure_load
    less, more = (press_on_road(RING, LOAD_N + s, pressure_load=load) for s in (-step, step))
    slope = 2 * step / (more.deflection_m - less.deflection_m)
    assert pressed.stiffness_n_m == pytest.approx(slope, rel=1e-6)


def test_without_springs_the_patch_vibrates_under_a_constant_pressure(pressed):
    np.testing.assert_allclose(
        pressed.modes(Tread(0.0, 0.0)).frequency_hz, pressed.state.modes().frequency_hz, rtol=1e-9
    )
    angles = np.remainder(pressed.state.angles_rad + np.pi, 2 * np.pi) - np.pi
    given, load = pressed.pressure_pa(angles), pressed.state.pressure_load
    to_axle = load_ring(RING, given, highest_order=60, pressure_load=load).modes().frequency_hz
    limit = pressed.modes(Tread(1e-2, 1e-2)).frequency_hz
    np.testing.assert_allclose(limit[:15], to_axle[:15], atol=0.03)  # a patch ±8° wide


def test_a_held_patch_raises_every_frequency(pressed):
    free = pressed.modes(Tread(0.0, 0.0)).frequency_hz[:20]
    soft, held = (pressed.modes(t).frequency_hz[:20] for t in (Tread(4e7, 1e7), Tread()))
    assert np.all(soft > free) and np.all(held >= soft)


def test_without_a_load_it_is_the_free_tyre(pressed):
    load = pressed.state.pressure_load
    light = press_on_road(RING, 0.0, pressure_load=load, highest_order=20)
    assert (light.deflection_m, light.load_n, light.patch_length_m) == (0.0, 0.0, 0.0)
    hz = light.modes().frequency_hz
    free = natural_frequencies_hz(RING, range(1, 5), pressure_load=load)
    np.testing.assert_allclose(hz[1:9], np.repeat(free, 2), rtol=1e-9)
    assert hz[0] == pytest.approx(torsion_frequency_hz(RING, pressure_load=load), rel=1e-9)


def test_a_free_wheel_off_the_road_is_that_of_the_ring():
    light = press_on_road(RING, 0.0, pressure_load="follower", highest_order=20)
    hz = light.modes(wheel=WHEEL).frequency_hz
    turning, moving = (
        np.sort(np.abs(free_hub_roots(RING, WHEEL, n).real))[2] / (2 * np.pi) for n in (0, 1)
    )
    np.testing.assert_allclose(hz[:3], 0.0, atol=0.01)  # the rigid tyre, to rounding
    np.testing.assert_allclose(hz[3:6], [turning, moving, moving], rtol=1e-9)


def test_a_belt_without_support_lifts_in_the_middle():
    """An elastica between plates: the unilateral condition finds a patch of two parts."""
    soft = {"radial_stiffness_n_m3": 1e4, "bending_stiffness_n_m": 5.0}
    found = press_on_road(replace(RING, inflation_pressure_pa=0.0, **soft), 100.0, Tread(4e9, 1e9))
    assert found.edges_rad.shape == (2, 2)
    assert found.compression_m(0.0)[0] < 0
    np.testing.assert_allclose(found.edges_rad[0], -found.edges_rad[1, ::-1], rtol=1e-6)
    assert found.load_n == pytest.approx(100.0, rel=1e-9)


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda: press_on_road(RING, -1.0), "load_n"),
        (lambda: press_on_road(RING, 1e6, highest_order=20), "load_n"),
        (lambda: press_on_road(RING, 1.0, Tread(0.0, 1e8)), "tread radial_n_m3"),
        (lambda: Tread(-1.0), "tread radial_n_m3"),
        (lambda: press_on_road(replace(RING, belt_width_m=None), 1.0), "belt_width_m"),
        (lambda: press_on_road(RING, 1e3, highest_order=20).modes(wheel=WHEEL), "pressure_load"),
    ],
)
def test_refusals(call, where):
    with pytest.raises(ParameterError, match=f"^{where}:"):
        call()
