"""The tyre on a flat road: unilateral contact through the tread, static stiffness, modes.

The tread is a layer of springs normal to the road. Where the belt would be nearer to the road than
its thickness it is compressed and presses; elsewhere there is a gap. The patch is the solution: the
integral over it ends where the compression is zero, not at a point of a grid. While the tyre is
pressed down the patch slides freely. In vibration it sticks: springs along the road act as well.
Angles are measured from the middle of the contact, the road is normal to θ = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from model.arguments import Array, ReadonlyArrays, finite_array, require_number, require_order_limit
from model.circle_fields import LoadedModes, circle_fields, fourier_basis
from model.coefficients import PressureLoad, equilibrium, harmonics, require_pressure_load
from model.errors import ParameterError
from model.loaded import LoadedRing, in_load_steps, number_of_points, refuse_buckling
from model.parameters import RingParameters, Wheel
from model.ring import belt_width_m

#: Deflection over radius beyond which linear sidewalls and bending are not valid.
LARGEST_DEFLECTION = 0.2
_ITERATIONS = 40
_HALVINGS = 45  # from the angle between points to the machine precision
#: A free wheel rolls at 0 Hz. The linear bending strain of eq 3 changes as the belt turns, which
#: leaves a stiffness of either sign: allowed is this part of the first elastic one.
_ROLLING = 1e-3


@dataclass(frozen=True)
class Tread:
    """Stiffness of the tread per area of contact.

    The defaults are those of a car tyre: brush models have 2·10⁷ N/m² along the road (slip
    stiffness 2·c·(L/2)² of 10⁵ N with half a patch of 50 mm) on a width of 0.19 m, and blocks of
    rubber are about four times as stiff in compression as in shear.

    Parameters
    ----------
    radial_n_m3 : float
        Normal to the road, N/m³.
    tangential_n_m3 : float
        Along the road, N/m³.
    """

    radial_n_m3: float = 4e8
    tangential_n_m3: float = 1e8

    def __post_init__(self) -> None:
        require_number("tread radial_n_m3", self.radial_n_m3, zero_allowed=True)
        require_number("tread tangential_n_m3", self.tangential_n_m3, zero_allowed=True)


@dataclass(frozen=True, eq=False)
class PressedRing(ReadonlyArrays):
    """A ring that stands on a road, in static equilibrium.

    Parameters
    ----------
    state : LoadedRing
        The deflected ring, without its contact pressure.
    road_m : float
        Distance of the uncompressed tread's inner side from the axle, m.
    tread : Tread
    """

    state: LoadedRing
    road_m: float
    tread: Tread

    @property
    def deflection_m(self) -> float:
        """Approach of road and axle since the first touch, m."""
        rest = equilibrium(self.state.ring, pressure_load=self.state.pressure_load)
        return float(rest.radius_m) - self.road_m

    @property
    def edges_rad(self) -> Array:
        """First and last angle of each part of the patch, shape (n_parts, 2), rad."""
        angles = np.sort(np.remainder(self.state.angles_rad + np.pi / 2.0, 2.0 * np.pi))
        angles = angles[angles < np.pi] - np.pi / 2.0  # the half that faces the road
        pressed = np.concatenate([[False], self.compression_m(angles[1:-1]) > 0, [False]])
        changes = np.flatnonzero(np.diff(pressed.astype(int)))
        enters = pressed[changes + 1]
        outside = np.where(enters, angles[changes], angles[changes + 1])
        inside = np.where(enters, angles[changes + 1], angles[changes])
        for _ in range(_HALVINGS):
            middle = (outside + inside) / 2.0
            touches = self.compression_m(middle) > 0
            outside, inside = np.where(touches, outside, middle), np.where(touches, middle, inside)
        return np.asarray(inside.reshape(-1, 2))

    @property
    def patch_length_m(self) -> float:
        """Length of the patch along the road, from its first to its last point, m."""
        if self.edges_rad.size == 0:
            return 0.0
        _, along = self._place(self.edges_rad[[0, -1], [0, 1]])
        return float(along[1] - along[0])

    @property
    def load_n(self) -> float:
        """Vertical load, N."""
        angles, weights = self._points()
        force = weights @ self.pressure_pa(angles)
        return float(force * belt_width_m(self.state.ring))

    @property
    def stiffness_n_m(self) -> float:
        """Vertical stiffness dF/dδ in this state, N/m."""
        tangent = self.tangent
        compliance = np.linalg.solve(tangent[:-1, :-1], tangent[:-1, -1])
        own = tangent[-1, -1] - tangent[-1, :-1] @ compliance
        return float(own * belt_width_m(self.state.ring))

    def compression_m(self, angles_rad: ArrayLike) -> Array:
        """Compression of the tread, negative where there is a gap, m."""
        across, _ = self._place(np.atleast_1d(finite_array("angles_rad", angles_rad)))
        return across - self.road_m

    def pressure_pa(self, angles_rad: ArrayLike) -> Array:
        """Pressure of the road, Pa per area of the belt before inflation."""
        return self.tread.radial_n_m3 * np.maximum(self.compression_m(angles_rad), 0.0)

    def modes(self, tread: Tread | None = None, *, wheel: Wheel | None = None) -> LoadedModes:
        """Natural frequencies and shapes with the patch held by the tread.

        Parameters
        ----------
        tread : Tread or None
            Springs of the patch in vibration, by default those that carry the load. With zeros the
            patch vibrates freely under a constant pressure.
        wheel : Wheel or None
            A wheel that is free to move in its plane; the hub is fixed without one. Pressure must
            be a follower load then: a dead one holds the wheel against rotation.

        Raises
        ------
        ParameterError
            For a free wheel under a dead load.
        InstabilityError
            Where the state is unstable.
        """
        held = tread or self.tread
        angles, weights = self._points()
        across, along = self._rows(angles)
        springs = held.radial_n_m3 * (across.T * weights) @ across
        springs += held.tangential_n_m3 * (along.T * weights) @ along
        if wheel is not None and self.state.pressure_load == "dead":
            rule = "a dead load holds a free wheel against rotation"
            raise ParameterError("pressure_load", "dead", rule, "Use a follower load")
        stiffness, mass = _with_wheel(self.state, wheel)
        size = across.shape[1]
        stiffness[:size, :size] += springs
        root = np.sqrt(mass)
        squared, shapes = np.linalg.eigh(stiffness / np.outer(root, root))
        rolling = 0.0 if wheel is None else _ROLLING * float(squared[3])
        refuse_buckling(float(squared[0]) + rolling)
        frequency_hz = np.sqrt(np.maximum(squared, 0.0)) / (2.0 * np.pi)
        return LoadedModes(self.state.fields, frequency_hz, (shapes / root[:, None])[:size])

    def _rows(self, angles_rad: Array) -> tuple[Array, Array]:
        """Rows that give displacements normal to the road and along it."""
        basis = fourier_basis(self.state.fields.highest_order, angles_rad)
        sine, cosine = (turn(angles_rad)[:, None] * basis for turn in (np.sin, np.cos))
        return np.hstack([cosine, -sine]), np.hstack([sine, cosine])

    def _place(self, angles_rad: Array) -> tuple[Array, Array]:
        """Where the belt is, normal to the road and along it, m."""
        across, along = self._rows(angles_rad)
        place, a = self.state.coefficients, self.state.ring.mean_radius_m
        return across @ place + a * np.cos(angles_rad), along @ place + a * np.sin(angles_rad)

    def _points(self) -> tuple[Array, Array]:
        """Gauss points of the patch and their lengths on the belt, m."""
        edges = self.edges_rad
        if edges.size == 0:
            return np.empty(0), np.empty(0)
        count = 32 + int(np.ceil(self.state.fields.highest_order * np.diff(edges).max()))
        nodes, weights = np.polynomial.legendre.leggauss(count)
        middle, half = edges.mean(axis=1), np.diff(edges)[:, 0] / 2.0
        angles = middle[:, None] + half[:, None] * nodes
        lengths = self.state.ring.mean_radius_m * half[:, None] * weights
        return angles.ravel(), lengths.ravel()

    @property
    def tangent(self) -> Array:
        """Tangent stiffness over coefficients and place of the road, per unit of width."""
        angles, weights = self._points()
        across, _ = self._rows(angles)
        rows = np.hstack([across, np.full((angles.size, 1), -1.0)])
        tangent = self.tread.radial_n_m3 * (rows.T * weights) @ rows
        tangent[:-1, :-1] += self.state.stiffness
        return np.asarray(tangent)

    def imbalance(self, load_n: float) -> Array:
        """Unbalanced forces over the same unknowns, per unit of width."""
        angles, weights = self._points()
        across, _ = self._rows(angles)
        force = weights * self.pressure_pa(angles)
        lacking = load_n / belt_width_m(self.state.ring) - force.sum()
        return np.append(self.state.imbalance + across.T @ force, lacking)


def press_on_road(
    ring: RingParameters,
    load_n: float,
    tread: Tread | None = None,
    *,
    highest_order: int = 60,
    pressure_load: PressureLoad = "dead",
) -> PressedRing:
    """Find the patch and the deflection under a vertical load, on a flat and rigid road.

    Parameters
    ----------
    ring : RingParameters
        Ring with belt width.
    load_n : float
        Vertical load, N; 0 is a tyre that just touches the road.
    tread : Tread or None
        Stiffness of the tread, by default that of a car tyre.
    highest_order : int
        N, highest harmonic of the deflected shape.
    pressure_load : {"dead", "follower"}
        See `equilibrium`.

    Raises
    ------
    ParameterError
        Where no equilibrium is found, or the tread has no stiffness normal to the road.
    InstabilityError
        Where the equilibrium is unstable.
    """
    require_order_limit(highest_order)
    require_pressure_load(pressure_load)
    require_number("load_n", load_n, zero_allowed=True)
    tread = tread or Tread()
    require_number("tread radial_n_m3", tread.radial_n_m3)
    fields = circle_fields(ring, highest_order, number_of_points(highest_order))
    rest = equilibrium(ring, pressure_load=pressure_load)
    grown, none = fields.uniform_radial(rest.radial_displacement_m.item()), 0.0 * fields.angles_rad
    free = LoadedRing(ring, fields, grown, none, 0.0, pressure_load)
    refuse_buckling(float(np.linalg.eigvalsh(free.stiffness)[0]))
    touching = PressedRing(free, float(rest.radius_m), tread)
    if load_n == 0:
        return touching
    linear = _point_deflection_m(ring, load_n, highest_order, pressure_load)

    def solve(before: PressedRing | None, share: float) -> PressedRing | None:
        begin = before or replace(touching, road_m=touching.road_m - share * linear)
        return _newton(begin, share * load_n)

    found = in_load_steps(solve, "load_n")
    if found.deflection_m > LARGEST_DEFLECTION * ring.mean_radius_m:
        rule = f"foundation and bending are linear up to {LARGEST_DEFLECTION:g} of the radius"
        deflected = f"{load_n:g} deflects the belt by {found.deflection_m:.3f} m"
        raise ParameterError("load_n", deflected, rule, "Lower the load")
    refuse_buckling(float(np.linalg.eigvalsh(found.tangent[:-1, :-1])[0]))
    return found


def _point_deflection_m(
    ring: RingParameters, load_n: float, highest_order: int, pressure_load: PressureLoad
) -> float:
    """Deflection under a point load without non-linear terms: where to start."""
    terms = harmonics(
        ring, np.arange(-highest_order, highest_order + 1), pressure_load=pressure_load
    )
    compliance = np.sum(terms.m22 / terms.determinant)
    return float(compliance * load_n / (2.0 * np.pi * ring.mean_radius_m * belt_width_m(ring)))


def _newton(pressed: PressedRing, load_n: float) -> PressedRing | None:
    """Equilibrium under a load, or None where Newton's method does not converge."""
    for _ in range(_ITERATIONS):
        if pressed.edges_rad.size == 0 or pressed.road_m <= 0:
            return None
        change = np.linalg.solve(pressed.tangent, pressed.imbalance(load_n))
        place = pressed.state.coefficients - change[:-1]
        state = replace(pressed.state, coefficients=place)
        pressed = replace(pressed, state=state, road_m=pressed.road_m - float(change[-1]))
        size = np.abs(change).max() / state.ring.mean_radius_m
        if size < 1e-13:
            return pressed
        if size > 1.0:
            return None
    return None


def _with_wheel(state: LoadedRing, wheel: Wheel | None) -> tuple[Array, Array]:
    """Stiffness and inertia over the coefficients and, if free, x, z and angle of the wheel.

    The foundation turns with the wheel; its forces in the deflected state act through the second
    derivatives of its stretch.
    """
    ring, fields = state.ring, state.fields
    line = ring.mean_radius_m * fields.weight_rad
    mass = np.full(state.coefficients.size, ring.mass_per_area_kg_m2 * ring.mean_radius_m * np.pi)
    if wheel is None:
        return state.stiffness, mass
    cosine, sine = np.cos(fields.angles_rad)[:, None], np.sin(fields.angles_rad)[:, None]
    outer = state.radial_m[:, None]
    around = (fields.circumferential @ state.coefficients)[:, None]
    arm = ring.mean_radius_m + outer
    radial = np.hstack([fields.radial, -cosine, -sine, around])
    tangential = np.hstack([fields.circumferential, sine, -cosine, -arm])
    k_r, k_t = ring.radial_stiffness_n_m3, ring.circumferential_stiffness_n_m3
    bed = k_r * radial.T @ radial + k_t * tangential.T @ tangential
    turning = (k_r * outer * tangential - k_t * around * radial).sum(axis=0)
    bed[-1] += turning
    bed[:, -1] += turning
    bed[-1, -1] += (k_r * outer * arm + k_t * around**2).sum()
    stiffness = line * bed
    size = mass.size
    stiffness[:size, :size] = state.stiffness  # holds the bed already
    own = np.array([wheel.mass_kg, wheel.mass_kg, wheel.inertia_kg_m2]) / belt_width_m(ring)
    return stiffness, np.append(mass, own)
