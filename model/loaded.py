"""The tyre pressed on the road: static deflection and vibration around it (orders couple).

The strain of eq 3 is kept whole (energies of eqs 43 and 46), for a load that varies around the
ring; the hub is fixed. Fields are those seen from space, so that the deflected shape stands still
while the ring turns through it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import finite_array, readonly, require_order_limit
from model.circle_fields import (
    Array,
    CircleFields,
    area_curvature,
    circle_fields,
    elastic_curvature,
    elastic_slope,
    pressure_force,
)
from model.contact import ContactPatch, contact_patch
from model.errors import InstabilityError, ParameterError
from model.parameters import RingParameters
from model.steady_state import PressureLoad, equilibrium, require_pressure_load

_POINTS_PER_ORDER = 12
_FEWEST_POINTS = 360
_ITERATIONS = 25
_SMALLEST_STEP = 1.0 / 256.0


@dataclass(frozen=True, eq=False)
class LoadedRing:
    """A ring in static equilibrium under a load that varies around it.

    Parameters
    ----------
    ring : RingParameters
        The ring.
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

    def __post_init__(self) -> None:
        for name in ("coefficients", "contact_pa"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    @property
    def angles_rad(self) -> Array:
        """Points of the circle, rad."""
        return self.fields.angles_rad

    @property
    def radial_m(self) -> Array:
        """Static radial displacement at the points, m."""
        return np.asarray(self.fields.radial @ self.coefficients)

    @property
    def circumferential_m(self) -> Array:
        """Static circumferential displacement at the points, m."""
        return np.asarray(self.fields.circumferential @ self.coefficients)

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
        """What is missing to equilibrium (zero there), over the coefficients, N/m."""
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
            _refuse_buckling(float(squared[0]))
            return LoadedModes(self.fields, np.sqrt(squared) / (2.0 * np.pi), shapes)
        size = self.coefficients.size
        state = np.zeros((2 * size, 2 * size))
        state[:size, size:] = np.eye(size)
        state[size:, :size] = -self.stiffness / self._mass
        state[size:, size:] = -2.0 * self.speed_rad_s * self.fields.convection
        poles, shapes = np.linalg.eig(state)
        growth = float(poles.real.max())
        _refuse_growth(growth if growth > 1e-6 * np.abs(poles).max() else 0.0)
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
        The ring.
    contact : ContactPatch or array_like, shape (n_points,)
        A patch, or contact pressures in Pa (positive towards the axle) at equidistant angles from
        0; at least twice as many as harmonics are needed to carry a field.
    speed_rad_s : float
        Angular speed Ω, rad/s.
    highest_order : int
        N, highest harmonic.
    pressure_load : {"dead", "follower"}
        See `equilibrium`. The follower load belongs to the enclosed area.
    start : LoadedRing or None
        A solution of the same size to start from, e.g. at a smaller load.

    Returns
    -------
    LoadedRing
        In equilibrium.

    Raises
    ------
    ParameterError
        Where the load is too large for the search to find an equilibrium.
    InstabilityError
        Where the equilibrium of a standing ring is unstable.
    """
    require_order_limit(highest_order)
    require_pressure_load(pressure_load)
    finite_array("speed_rad_s", speed_rad_s)
    fields, pressure = _fields_and_pressure(ring, contact, highest_order)
    rest = equilibrium(ring, speed_rad_s, pressure_load=pressure_load)
    state = LoadedRing(
        ring,
        fields,
        fields.uniform_radial(float(rest.radial_displacement_m)),
        np.zeros(pressure.size),
        float(speed_rad_s),
        pressure_load,
    )
    if start is not None and start.coefficients.size == state.coefficients.size:
        state = _moved(state, start.coefficients, _resampled(start, fields))
    state = _press(state, pressure)
    if state.speed_rad_s == 0:
        _refuse_buckling(float(np.linalg.eigvalsh(state.stiffness)[0]))
    return state


def loaded_frequencies_hz(
    ring: RingParameters,
    loads_n: ArrayLike,
    n_modes: int,
    *,
    highest_order: int = 60,
    pressure_load: PressureLoad = "dead",
) -> tuple[NDArray[np.float64], NDArray[np.int_]]:
    """Natural frequencies of the standing tyre over vertical load.

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
        For more modes than so many harmonics have, and as `load_ring`.
    """
    _require_modes(n_modes, highest_order)
    loads = np.atleast_1d(finite_array("loads_n", loads_n))
    frequencies = np.empty((loads.size, n_modes))
    orders = np.empty((loads.size, n_modes), dtype=int)
    free = np.zeros(_points(highest_order))
    # All at first: a load that no tyre carries is refused before hours have gone into the others.
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


def _require_modes(n_modes: int, highest_order: int) -> None:
    require_order_limit(highest_order)
    most = 2 * (2 * highest_order + 1)
    if not 1 <= n_modes <= most:
        raise ParameterError(
            "n_modes",
            f"{n_modes}",
            f"harmonics up to {highest_order} have 1 to {most} modes",
            "Ask for fewer modes or raise the highest order",
        )


def _points(highest_order: int) -> int:
    return max(_FEWEST_POINTS, _POINTS_PER_ORDER * highest_order)


def _fields_and_pressure(
    ring: RingParameters, contact: ContactPatch | ArrayLike, highest_order: int
) -> tuple[CircleFields, Array]:
    if isinstance(contact, ContactPatch):
        fields = circle_fields(ring, highest_order, _points(highest_order))
        return fields, _patch_pressure(contact, fields)
    pressure = finite_array("contact", contact)
    if pressure.ndim != 1 or pressure.size <= 2 * highest_order:
        raise ParameterError(
            "contact",
            f"shape {pressure.shape}",
            f"a list of more than {2 * highest_order} values carries {highest_order} harmonics",
            "Refine the angles or lower the highest order",
        )
    return circle_fields(ring, highest_order, pressure.size), pressure


def _patch_pressure(patch: ContactPatch, fields: CircleFields) -> Array:
    """Pressure at the points, each the mean over its angle: the patch may end between them."""
    fine = (np.arange(16) + 0.5) / 16.0 - 0.5
    angles = fields.angles_rad[:, None] + fine * fields.weight_rad
    return np.asarray(patch.pressure_pa(angles).mean(axis=1))


def _resampled(start: LoadedRing, fields: CircleFields) -> Array:
    return np.interp(fields.angles_rad, start.angles_rad, start.contact_pa, period=2.0 * np.pi)


def _moved(state: LoadedRing, coefficients: Array, contact_pa: Array) -> LoadedRing:
    return LoadedRing(
        state.ring,
        state.fields,
        coefficients,
        contact_pa,
        state.speed_rad_s,
        state.pressure_load,
    )


def _press(state: LoadedRing, target_pa: Array) -> LoadedRing:
    """Raise the contact pressure in steps; halve a step that does not converge."""
    reached, step = 0.0, 1.0
    begin = state.contact_pa
    while reached < 1.0:
        share = min(reached + step, 1.0)
        found = _newton(state, (1.0 - share) * begin + share * target_pa)
        if found is not None:
            state, reached, step = found, share, 2.0 * step
            continue
        step /= 2.0
        if step < _SMALLEST_STEP:
            raise ParameterError(
                "contact",
                f"no equilibrium beyond {100 * reached:.0f} % of the contact pressure",
                "the ring buckles or flattens more than its strains allow",
                "Lower the load or raise the inflation pressure",
            )
    return state


def _newton(state: LoadedRing, contact_pa: Array) -> LoadedRing | None:
    """Equilibrium at a contact pressure, or None where Newton's method does not settle."""
    state = _moved(state, state.coefficients, contact_pa)
    for _ in range(_ITERATIONS):
        change = np.linalg.solve(state.stiffness, state.imbalance)
        state = _moved(state, state.coefficients - change, contact_pa)
        size = np.abs(change).max() / state.ring.mean_radius_m
        if size < 1e-13:
            return state
        if size > 1.0:
            return None
    return None


def _refuse_buckling(lowest_stiffness: float) -> None:
    if lowest_stiffness < 0:
        raise InstabilityError(
            "contact",
            f"a stiffness of {lowest_stiffness:.4g}",
            "the equilibrium found is unstable: the ring buckles",
            "Lower the load or raise the inflation pressure",
        )


def _refuse_growth(growth_1_s: float) -> None:
    if growth_1_s > 0:
        raise InstabilityError(
            "speed_rad_s",
            f"a motion grows by {growth_1_s:.4g} 1/s",
            "an unstable state has no natural frequencies",
            "Lower the load or the speed",
        )


@dataclass(frozen=True, eq=False)
class LoadedModes:
    """Modes of a loaded ring.

    Parameters
    ----------
    fields : CircleFields
        Basis of the shapes.
    frequency_hz : ndarray, shape (n_modes,)
        Natural frequencies seen from space, ascending, Hz.
    shapes : ndarray, shape (n_coefficients, n_modes)
        Shapes in the coefficients of the fields; complex where the ring turns.
    """

    fields: CircleFields
    frequency_hz: Array
    shapes: NDArray[np.inexact[Any]]

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency_hz", readonly(self.frequency_hz))
        object.__setattr__(self, "shapes", readonly(self.shapes, self.shapes.dtype))

    @property
    def share_of_order(self) -> Array:
        """Share of each order in the power of each shape, (highest_order + 1, n_modes)."""
        power = np.abs(self.shapes) ** 2
        orders = self.fields.orders
        shares = np.stack(
            [power[orders == order].sum(axis=0) for order in range(self.fields.highest_order + 1)]
        )
        return np.asarray(shares / shares.sum(axis=0))

    @property
    def dominant_order(self) -> NDArray[np.int_]:
        """Order with the largest share, per mode."""
        return np.asarray(self.share_of_order.argmax(axis=0))

    def radial(self, mode: int) -> NDArray[np.inexact[Any]]:
        """Radial shape of one mode at the points of the circle."""
        return np.asarray(self.fields.radial @ self.shapes[:, mode])
