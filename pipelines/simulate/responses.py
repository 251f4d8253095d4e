"""Responses of the ring model: inertance, cleat response, frequencies over load."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import (
    CleatTest,
    ForcedRing,
    LoadedRing,
    RingParameters,
    Tread,
    Wheel,
    contact_patch,
    equilibrium,
    inertance,
    inextensional_inertance,
    load_ring,
    loaded_frequencies_hz,
    press_on_road,
)
from model.arguments import ReadonlyArrays
from model.cleat import Quantity
from model.coefficients import PressureLoad
from model.forced import Direction
from model.loaded import require_mode_count
from model.ring import Frame

PER_FORCE = "(m/s²)/N"
PER_LINE_FORCE = "(m/s²)/(N/m)"
UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s²"}
MOST_LOADS = 200  # each takes 0.1 s or more


@dataclass(frozen=True, eq=False)
class SimulatedInertance(ReadonlyArrays):
    """Inertance over frequency: acceleration over force, in `PER_FORCE` or `PER_LINE_FORCE`."""

    frequency_hz: NDArray[np.float64]
    values: NDArray[np.complex128]
    unit: str

    @property
    def magnitude(self) -> NDArray[np.float64]:
        """Modulus."""
        return np.abs(self.values)

    @property
    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Columns of a table."""
        return _complex_columns(self.frequency_hz, self.values)

    @property
    def peaks(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Frequencies in Hz and heights of the peaks of the magnitude."""
        inner = self.magnitude[1:-1]
        top = (inner > self.magnitude[:-2]) & (inner >= self.magnitude[2:])
        at = np.flatnonzero(top) + 1
        return self.frequency_hz[at], self.magnitude[at]


def _complex_columns(
    frequency_hz: NDArray[np.float64], values: NDArray[np.complex128]
) -> dict[str, NDArray[np.float64]]:
    return {
        "frequency_hz": frequency_hz,
        "real": values.real,
        "imag": values.imag,
        "magnitude": np.abs(values),
        "phase_deg": np.rad2deg(np.angle(values)),
    }


def simulate_inertance(
    forced: ForcedRing,
    frequency_hz: ArrayLike,
    at_deg: float,
    force_deg: float = 0.0,
    *,
    inextensional: bool = False,
) -> SimulatedInertance:
    """Radial inertance between two angles; per unit of width if the belt width is unknown."""
    per_width = forced.ring.belt_width_m is None
    form = inextensional_inertance if inextensional else inertance
    angles = np.deg2rad(at_deg), float(np.deg2rad(force_deg))
    values = form(forced, frequency_hz, *angles, per_width=per_width)
    unit = PER_LINE_FORCE if per_width else PER_FORCE
    return SimulatedInertance(np.asarray(frequency_hz), values.astype(complex), unit)


@dataclass(frozen=True)
class Observer:
    """A point where a response is read."""

    at_deg: float
    frame: Frame = "rotating"  # whether it is fixed to the tyre or in space
    direction: Direction = "radial"
    quantity: Quantity = "acceleration"

    @property
    def unit(self) -> str:
        """Unit of the quantity."""
        return UNITS[self.quantity]


@dataclass(frozen=True, eq=False)
class CleatResponse(ReadonlyArrays):
    """Response to an impact in time and frequency."""

    observer: Observer
    time_s: NDArray[np.float64]  # shape (n_times,); from the start of the impact
    response: NDArray[np.float64]  # shape (n_times,); in the observer's unit
    frequency_hz: NDArray[np.float64]  # shape (n_frequencies,)
    spectrum: NDArray[np.complex128]  # ∫x(t)e^{−jωt}dt there, in the observer's unit times s

    @property
    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Columns of a table over time."""
        return {"time_s": self.time_s, self.observer.quantity: self.response}

    @property
    def spectrum_columns(self) -> dict[str, NDArray[np.float64]]:
        """Columns of a table over frequency."""
        return _complex_columns(self.frequency_hz, self.spectrum)


def simulate_cleat(
    test: CleatTest, observer: Observer, times_s: ArrayLike, frequency_hz: ArrayLike
) -> CleatResponse:
    """Response of the rolling tyre to an impact, exact for the harmonics summed."""
    angle = float(np.deg2rad(observer.at_deg))
    times, lines = np.asarray(times_s), np.asarray(frequency_hz)
    seen = {name: getattr(observer, name) for name in ("frame", "direction", "quantity")}
    response, spectrum = test.response(times, angle, **seen), test.spectrum(lines, angle, **seen)
    return CleatResponse(observer, times, response, lines, spectrum.astype(complex))


@dataclass(frozen=True, eq=False)
class StaticCurve(ReadonlyArrays):
    """The tyre on a flat road over vertical load, each of shape (n_loads,)."""

    deflection_m: NDArray[np.float64]  # approach of road and axle since the first touch
    patch_length_m: NDArray[np.float64]
    stiffness_n_m: NDArray[np.float64]  # slope of load over deflection


@dataclass(frozen=True, eq=False)
class LoadedSweep(ReadonlyArrays):
    """Frequencies of a standing tyre over vertical load."""

    load_n: NDArray[np.float64]  # shape (n_loads,)
    frequency_hz: NDArray[np.float64]  # shape (n_loads, n_modes); ascending
    dominant_order: NDArray[np.int_]  # that with the largest share of each shape
    angle_deg: NDArray[np.float64]  # shape (n_angles,); angles from the contact
    deflection_m: NDArray[np.float64]  # there, radial, by the largest load, on the inflated tyre
    static: StaticCurve | None = None  # None for a given contact pressure

    @property
    def contact_deflection_m(self) -> float:
        """Deflection towards the axle in the middle of the contact at the largest load."""
        return 0.0 - float(self.deflection_m[np.argmin(np.abs(self.angle_deg))])

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns of a table, load by load and mode by mode."""
        n_loads, n_modes = self.frequency_hz.shape
        static = {} if self.static is None else vars(self.static)
        return {
            "load_n": np.repeat(self.load_n, n_modes),
            "mode": np.tile(np.arange(1, n_modes + 1), n_loads),
            "frequency_hz": self.frequency_hz.ravel(),
            "dominant_order": self.dominant_order.ravel(),
            **{name: np.repeat(values, n_modes) for name, values in static.items()},
        }


def simulate_loaded(
    ring: RingParameters,
    load_n: ArrayLike,
    n_modes: int,
    tread: Tread | None = None,
    *,
    wheel: Wheel | None = None,
    highest_order: int = 60,
    pressure_load: PressureLoad = "dead",
) -> LoadedSweep:
    """Frequencies of the lowest modes over vertical load, and the deflection by the largest one.

    A load of 0 is the free tyre; the ring needs a belt width. With a tread the tyre stands on a
    flat road and the patch is held, by a fixed hub or a free wheel. Without one the contact
    pressure is given and the patch vibrates freely.
    """
    loads = np.asarray(load_n, dtype=float)
    options: dict[str, Any] = {"highest_order": highest_order, "pressure_load": pressure_load}
    require_mode_count(n_modes, highest_order)
    if tread is None:
        frequencies, orders = loaded_frequencies_hz(ring, loads, n_modes, **options)
        angle, deflection = _deflection(ring, float(loads.max()), highest_order, pressure_load)
        return LoadedSweep(loads, frequencies, orders, angle, deflection)
    rows: dict[int, Any] = {}
    shape: Any = None
    for row in np.argsort(-loads):  # the largest first: an impossible one is refused at once
        pressed = press_on_road(ring, float(loads[row]), tread, **options)
        shape = shape or _shape(pressed.state)
        modes = pressed.modes(wheel=wheel)
        static = pressed.deflection_m, pressed.patch_length_m, pressed.stiffness_n_m
        rows[int(row)] = modes.frequency_hz[:n_modes], modes.dominant_order[:n_modes], *static
    columns = zip(*(rows[row] for row in range(loads.size)), strict=True)
    frequencies, orders, *curve = map(np.array, columns)
    angle, deflection = shape
    return LoadedSweep(loads, frequencies, orders, angle, deflection, StaticCurve(*curve))


def _deflection(
    ring: RingParameters, load_n: float, highest_order: int, pressure_load: PressureLoad
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles from −180° and the deflection relative to the inflated tyre."""
    if load_n == 0:
        angle = np.arange(-180.0, 180.0)
        return angle, np.zeros(angle.size)
    patch = contact_patch(ring, load_n)
    return _shape(load_ring(ring, patch, highest_order=highest_order, pressure_load=pressure_load))


def _shape(state: LoadedRing) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles from −180° and the radial deflection of a state relative to the inflated tyre."""
    rest = equilibrium(state.ring, pressure_load=state.pressure_load)
    inflated = float(rest.radial_displacement_m)
    angle = np.remainder(np.rad2deg(state.angles_rad) + 180.0, 360.0) - 180.0
    rising = np.argsort(angle)
    return angle[rising], state.radial_m[rising] - inflated
