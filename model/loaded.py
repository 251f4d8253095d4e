"""The tyre pressed on the road: contact patch, static deflection, vibration around it.

Orders couple. All terms of the strain of eq 3 are kept (energies of eqs 43 and 46), for a load that
varies around the ring; the hub is fixed. Fields are seen from space: the deflected shape is
constant while the ring turns through it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, ReadonlyArrays, finite_array, require_number, require_order_limit
from model.circle_fields import (
    CircleFields,
    LoadedModes,
    area_curvature,
    circle_fields,
    elastic_curvature,
    elastic_slope,
    pressure_force,
)
from model.coefficients import PressureLoad, equilibrium, require_pressure_load
from model.errors import InstabilityError, ParameterError
from model.parameters import RingParameters
from model.ring import belt_width_m

_POINTS_PER_ORDER = 12
_FEWEST_POINTS = 360
_ITERATIONS = 25
_SMALLEST_STEP = 1.0 / 256.0  # of the load
State = TypeVar("State")
_LOWER_LOAD = "Lower the load or raise the inflation pressure"


@dataclass(frozen=True)
class ContactPatch:
    """Parabolic contact pressure, directed to the axle.

    Parameters
    ----------
    mean_pressure_pa : float
        Mean pressure over the patch, Pa.
    half_angle_rad : float
        Half the angle that the patch covers, rad.
    contact_rad : float
        Angle of its middle, rad.
    """

    mean_pressure_pa: float
    half_angle_rad: float
    contact_rad: float = 0.0

    def __post_init__(self) -> None:
        require_number("mean_pressure_pa", self.mean_pressure_pa, zero_allowed=True)
        finite_array("contact_rad", self.contact_rad)
        if not 0 < self.half_angle_rad < np.pi / 2:
            found, rule = f"half angle {self.half_angle_rad:g} rad", "must be between 0 and π/2"
            remedy = "Check the load, the pressure and the belt width"
            raise ParameterError("contact patch", found, rule, remedy)

    def pressure_pa(self, angles_rad: ArrayLike) -> Array:
        """Contact pressure at `angles_rad`, Pa."""
        off = finite_array("angles_rad", angles_rad) - self.contact_rad
        inside = (np.remainder(off + np.pi, 2.0 * np.pi) - np.pi) / self.half_angle_rad
        return 1.5 * self.mean_pressure_pa * np.maximum(1.0 - inside**2, 0.0)


def contact_patch(ring: RingParameters, load_n: float, *, contact_rad: float = 0.0) -> ContactPatch:
    """Patch that carries a vertical load at a mean pressure equal to the inflation pressure.

    The length L = F/(p_o·b) is that of a belt without stiffness; measured patches are close to it.

    Parameters
    ----------
    ring : RingParameters
        Ring with belt width and inflation pressure.
    load_n : float
        Vertical load, N, greater than zero.
    contact_rad : float
        Angle of the contact, rad.

    Returns
    -------
    ContactPatch
        With a vertical force of `load_n`.

    Raises
    ------
    ParameterError
        For a load that is not positive or too large for the tyre, or a ring without width.
    """
    require_number("load_n", load_n)
    if ring.inflation_pressure_pa == 0:
        rule = "must be > 0 to give the length of the patch"
        raise ParameterError("inflation_pressure_pa", "0", rule, "Give a ContactPatch")
    width, a = belt_width_m(ring), ring.mean_radius_m
    half = load_n / (ring.inflation_pressure_pa * width) / (2.0 * a)
    patch = ContactPatch(ring.inflation_pressure_pa, half, contact_rad)
    # ∫ 1.5(1 − (x/h)²) cos x dx over the patch, against 2h for a flat one
    vertical = 6.0 * (math.sin(half) - half * math.cos(half)) / half**2
    return replace(patch, mean_pressure_pa=patch.mean_pressure_pa * 2.0 * half / vertical)


@dataclass(frozen=True, eq=False)
class LoadedRing(ReadonlyArrays):
    """A ring in static equilibrium under a load that varies around it.

    Parameters
    ----------
    ring : RingParameters
    fields : CircleFields
        Basis and points.
    coefficients : ndarray, shape (n_coefficients,)
        Static displacement, u_r° included.
    contact_pa : ndarray, shape (n_points,)
        Contact pressure towards the axle, Pa.
    speed_rad_s : float
        Angular speed Ω, rad/s.
    pressure_load : {"dead", "follower"}
        See `equilibrium`.
    """

    ring: RingParameters
    fields: CircleFields
    coefficients: Array
    contact_pa: Array
    speed_rad_s: float
    pressure_load: PressureLoad

    @property
    def angles_rad(self) -> Array:
        """Points of the circle, rad."""
        return self.fields.angles_rad

    @property
    def radial_m(self) -> Array:
        """Static radial displacement at the points, m."""
        return np.asarray(self.fields.radial @ self.coefficients)

    @property
    def stiffness(self) -> Array:
        """Tangent stiffness over the coefficients, per unit of belt width, N/m².

        With the convective inertia ρhΩ²W² of the turning ring; a full matrix over harmonics.
        """
        curvature = elastic_curvature(self.ring, self.fields, self.coefficients)
        if self.pressure_load == "follower":
            curvature = curvature - self.ring.inflation_pressure_pa * area_curvature(self.fields)
        matrix = curvature + self._spin
        return np.asarray(0.5 * (matrix + matrix.T))

    @property
    def imbalance(self) -> Array:
        """Unbalanced forces (zero in equilibrium), over the coefficients, N/m."""
        place = self.coefficients + self.fields.uniform_radial(self.ring.mean_radius_m)
        line = self.ring.mean_radius_m * self.fields.weight_rad
        return np.asarray(
            elastic_slope(self.ring, self.fields, self.coefficients)
            - pressure_force(self.ring, self.fields, place, self.pressure_load)
            + line * self.fields.radial.T @ self.contact_pa
            + self._spin @ place
        )

    @property
    def _spin(self) -> Array:
        """Convective inertia ρhΩ²W² (eq 36 seen from space)."""
        convection = self.fields.convection
        return np.asarray(self._mass * self.speed_rad_s**2 * convection @ convection)

    @property
    def _mass(self) -> float:
        return self.ring.mass_per_area_kg_m2 * self.ring.mean_radius_m * np.pi

    def modes(self) -> LoadedModes:
        """Natural frequencies and shapes around the loaded state, seen from space.

        Raises
        ------
        InstabilityError
            Where a root grows in time.
        """
        if self.speed_rad_s == 0:
            squared, shapes = np.linalg.eigh(self.stiffness / self._mass)
            refuse_buckling(float(squared[0]))
            return LoadedModes(self.fields, np.sqrt(squared) / (2.0 * np.pi), shapes)
        size = self.coefficients.size
        coriolis = 2.0 * self.speed_rad_s * self.fields.convection
        below = np.hstack([-self.stiffness / self._mass, -coriolis])
        poles, shapes = np.linalg.eig(np.vstack([np.eye(size, 2 * size, size), below]))
        growth = float(poles.real.max())
        if growth > 1e-6 * np.abs(poles).max():
            found = f"a motion grows by {growth:.4g} 1/s"
            rule = "an unstable state has no natural frequencies"
            raise InstabilityError("speed_rad_s", found, rule, "Lower the load or the speed")
        upper = np.flatnonzero(poles.imag > 0)
        upper = upper[np.argsort(poles[upper].imag)]
        return LoadedModes(self.fields, poles[upper].imag / (2.0 * np.pi), shapes[:size, upper])


def load_ring(
    ring: RingParameters,
    contact: ContactPatch | ArrayLike,
    *,
    speed_rad_s: float = 0.0,
    highest_order: int = 60,
    pressure_load: PressureLoad = "dead",
    start: LoadedRing | None = None,
) -> LoadedRing:
    """Find the static deflection under a contact pressure by Newton's method, in load steps.

    Parameters
    ----------
    ring : RingParameters
    contact : ContactPatch or array_like, shape (n_points,)
        A patch, or contact pressures in Pa (positive towards the axle) at equidistant angles from
        0; more than twice as many as harmonics.
    speed_rad_s : float
        Angular speed Ω, rad/s.
    highest_order : int
        N, highest harmonic.
    pressure_load : {"dead", "follower"}
        See `equilibrium`. The follower load belongs to the enclosed area.
    start : LoadedRing or None
        A solution of the same size to start from, e.g. at a smaller load.

    Raises
    ------
    ParameterError
        Where the load is too large for the search to find an equilibrium.
    InstabilityError
        Where the equilibrium of a ring at rest is unstable.
    """
    require_order_limit(highest_order)
    require_pressure_load(pressure_load)
    finite_array("speed_rad_s", speed_rad_s)
    fields, pressure = _fields_and_pressure(ring, contact, highest_order)
    rest = equilibrium(ring, speed_rad_s, pressure_load=pressure_load)
    grown, free = fields.uniform_radial(rest.radial_displacement_m.item()), np.zeros(pressure.size)
    state = LoadedRing(ring, fields, grown, free, float(speed_rad_s), pressure_load)
    if start is not None and start.coefficients.size == state.coefficients.size:
        begin = np.interp(fields.angles_rad, start.angles_rad, start.contact_pa, period=2.0 * np.pi)
        state = replace(state, coefficients=start.coefficients, contact_pa=begin)
    first = state

    def solve(before: LoadedRing | None, share: float) -> LoadedRing | None:
        pressed = (1.0 - share) * first.contact_pa + share * pressure
        return _newton(before or first, pressed)

    state = in_load_steps(solve, "contact")
    if state.speed_rad_s == 0:
        refuse_buckling(float(np.linalg.eigvalsh(state.stiffness)[0]))
    return state


def loaded_frequencies_hz(
    ring: RingParameters,
    loads_n: ArrayLike,
    n_modes: int,
    *,
    highest_order: int = 60,
    pressure_load: PressureLoad = "dead",
) -> tuple[Array, NDArray[np.int_]]:
    """Natural frequencies of the tyre at rest over vertical load.

    Parameters
    ----------
    ring : RingParameters
        Ring with belt width.
    loads_n : array_like, shape (n_loads,)
        Vertical loads, N; 0 is the free tyre.
    n_modes : int
        How many of the lowest modes.
    highest_order, pressure_load
        As `load_ring`.

    Returns
    -------
    frequency_hz : ndarray, shape (n_loads, n_modes)
        Ascending frequencies, Hz. Each order gives two: one symmetric about the contact, one not.
    dominant_order : ndarray of int, shape (n_loads, n_modes)
        Order with the largest share of each shape.

    Raises
    ------
    ParameterError
        For more modes than these harmonics have, and as `load_ring`.
    """
    require_mode_count(n_modes, highest_order)
    loads = np.atleast_1d(finite_array("loads_n", loads_n))
    frequencies = np.empty((loads.size, n_modes))
    orders = np.empty((loads.size, n_modes), dtype=int)
    free = np.zeros(number_of_points(highest_order))
    # First all patches: an impossible load is refused before the others take hours.
    contacts = [contact_patch(ring, float(load)) if load != 0 else free for load in loads]
    state: LoadedRing | None = None
    for row in np.argsort(loads):
        state = load_ring(
            ring,
            contacts[row],
            highest_order=highest_order,
            pressure_load=pressure_load,
            start=state,
        )
        modes = state.modes()
        frequencies[row] = modes.frequency_hz[:n_modes]
        orders[row] = modes.dominant_order[:n_modes]
    return frequencies, orders


def require_mode_count(n_modes: int, highest_order: int) -> None:
    """Refuse more modes than harmonics up to `highest_order` have."""
    require_order_limit(highest_order)
    most = 2 * (2 * highest_order + 1)
    if not 1 <= n_modes <= most:
        rule = f"harmonics up to {highest_order} have 1 to {most} modes"
        raise ParameterError("n_modes", f"{n_modes}", rule, "Ask for fewer modes")


def number_of_points(highest_order: int) -> int:
    """Points of the circle for harmonics up to `highest_order`."""
    return max(_FEWEST_POINTS, _POINTS_PER_ORDER * highest_order)


def _fields_and_pressure(
    ring: RingParameters, contact: ContactPatch | ArrayLike, highest_order: int
) -> tuple[CircleFields, Array]:
    if isinstance(contact, ContactPatch):
        fields = circle_fields(ring, highest_order, number_of_points(highest_order))
        # Each point has the mean over its angle: the patch may end between points.
        fine = (np.arange(16) + 0.5) / 16.0 - 0.5
        angles = fields.angles_rad[:, None] + fine * fields.weight_rad
        return fields, np.asarray(contact.pressure_pa(angles).mean(axis=1))
    pressure = finite_array("contact", contact)
    if pressure.ndim != 1 or pressure.size <= 2 * highest_order:
        rule = f"must be a list of more than {2 * highest_order} values for this highest order"
        remedy = "Refine the angles or lower the highest order"
        raise ParameterError("contact", f"shape {pressure.shape}", rule, remedy)
    return circle_fields(ring, highest_order, pressure.size), pressure


def in_load_steps(solve: Callable[[State | None, float], State | None], where: str) -> State:
    """Solve for the whole load in steps; halve a step that does not converge.

    `solve` takes the last state (None at first) and the share of the load.
    """
    found: State | None = None
    reached, step = 0.0, 1.0
    while reached < 1.0 or found is None:
        share = min(reached + step, 1.0)
        solved = solve(found, share)
        if solved is not None:
            found, reached, step = solved, share, 2.0 * step
            continue
        step /= 2.0
        if step < _SMALLEST_STEP:
            limit = f"no equilibrium beyond {100 * reached:.0f} % of the load"
            rule = "the ring buckles or its strains become too large"
            raise ParameterError(where, limit, rule, _LOWER_LOAD)
    return found


def _newton(state: LoadedRing, contact_pa: Array) -> LoadedRing | None:
    """Equilibrium at a contact pressure, or None where Newton's method does not converge."""
    state = replace(state, contact_pa=contact_pa)
    for _ in range(_ITERATIONS):
        change = np.linalg.solve(state.stiffness, state.imbalance)
        state = replace(state, coefficients=state.coefficients - change)
        size = np.abs(change).max() / state.ring.mean_radius_m
        if size < 1e-13:
            return state
        if size > 1.0:
            return None
    return None


def refuse_buckling(lowest_stiffness: float) -> None:
    """Refuse an equilibrium in which a motion has a negative stiffness."""
    if lowest_stiffness < 0:
        found = f"a stiffness of {lowest_stiffness:.4g}"
        rule = "the equilibrium found is unstable: the ring buckles"
        raise InstabilityError("contact", found, rule, _LOWER_LOAD)
