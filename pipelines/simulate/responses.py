"""A tyre to simulate, and what the ring model predicts for it: frequencies and responses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.errors import InputError
from model import (
    Bifurcation,
    CleatTest,
    ForcedRing,
    HubResponse,
    LoadedRing,
    RingDamping,
    RingParameters,
    Tread,
    Wheel,
    bifurcation,
    contact_patch,
    equilibrium,
    free_hub_roots,
    inertance,
    inextensional_inertance,
    load_ring,
    loaded_frequencies_hz,
    press_on_road,
)
from model.arguments import ReadonlyArrays
from model.cleat import Quantity
from model.coefficients import PressureLoad
from model.errors import ParameterError
from model.forced import Direction
from model.foundation import with_pressure_load
from model.loaded import require_mode_count
from model.parameters import DESIGNATION, TABLE_4_RING, TABLE_5_DAMPING
from model.ring import Frame, WaveFrame
from pipelines.library.library import read_source

PER_FORCE = "(m/s²)/N"
PER_LINE_FORCE = "(m/s²)/(N/m)"
UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s²"}
MOST_LOADS = 200  # each takes 0.1 s or more
FORCES = ("force_x", "force_z", "moment_m")
MOTIONS = ("x_m_n", "z_m_n", "rotation_rad_n")


@dataclass(frozen=True)
class SimulatedTyre:
    """A tyre ready for the model; damping and wheel are None if its parameter set has none."""

    name: str
    ring: RingParameters
    damping: RingDamping | None = None
    wheel: Wheel | None = None
    pressure_load: PressureLoad | None = None  # that the ring belongs to; None: as it is

    def under(self, pressure_load: PressureLoad | None) -> tuple[RingParameters, PressureLoad]:
        """The ring under a pressure model, and which; None leaves it at that of the set."""
        wanted = pressure_load or self.pressure_load or "dead"
        return with_pressure_load(self.ring, self.pressure_load or wanted, wanted), wanted


def tyre_to_simulate(path: Path | None, *, accept_changes: bool = False) -> SimulatedTyre:
    """The tyre of a parameter set or result folder; without one the sample (Tables 4 and 5).

    A file may be edited; a result folder must be as it was written.
    """
    if path is None:
        return SimulatedTyre(f"the sample tyre {DESIGNATION}", TABLE_4_RING, TABLE_5_DAMPING)
    found = read_source(path, accept_changes=accept_changes, lone=False)
    try:
        parts = found.ring_parameters, found.ring_damping, found.wheel_parameters
        return SimulatedTyre(str(path), *parts, found.basis.pressure_load)
    except ParameterError as error:
        raise InputError(f"{path}, {error.where}", error.found, error.rule, error.remedy) from error


def damping_of(tyre: SimulatedTyre, *, on_pretension: bool = True) -> RingDamping:
    """Damping of a tyre; `on_pretension`: the loss factor also acts on the hoop tension."""
    if tyre.damping is None:
        rule = "forced vibration needs damping"
        remedy = "Add radial_n_s_m3, circumferential_n_s_m3 and loss_factor"
        raise InputError(tyre.name, "no section [damping]", rule, remedy)
    return replace(tyre.damping, on_pretension=on_pretension)


def simulate_frequencies(
    ring: RingParameters,
    orders: ArrayLike,
    speed_rad_s: ArrayLike,
    frame: WaveFrame = "rotating",
    *,
    extensional: bool = False,
    pressure_load: PressureLoad = "dead",
) -> Bifurcation:
    """Frequencies of both waves of each order over speed.

    In the stationary frame, which differs by order and speed, both waves of an order have the same
    frequency. Otherwise as `model.bifurcation`.
    """
    seen = "rotating" if frame == "stationary" else frame
    found = bifurcation(
        ring, orders, speed_rad_s, frame=seen, extensional=extensional, pressure_load=pressure_load
    )
    if frame != "stationary":
        return found
    return replace(found, regressive_hz=found.standing_hz, progressive_hz=found.standing_hz)


def frequency_columns(found: Bifurcation) -> dict[str, NDArray[Any]]:
    """Columns of a table, speed by speed and order by order."""
    return {
        "speed_rad_s": np.repeat(found.speed_rad_s, found.orders.size),
        "order": np.tile(found.orders, found.speed_rad_s.size),
        "regressive_hz": found.regressive_hz.T.ravel(),
        "progressive_hz": found.progressive_hz.T.ravel(),
        "growth_rate_1_s": found.growth_rate_1_s.T.ravel(),
    }


def frequency_lists(found: Bifurcation) -> dict[str, NDArray[Any]]:
    """Content of ``--json``: one value per order, or one list over speed per order."""
    lists = {"regressive_hz": found.regressive_hz, "progressive_hz": found.progressive_hz}
    if found.speed_rad_s.size > 1:
        return {"speed_rad_s": found.speed_rad_s, "orders": found.orders, **lists}
    return {"orders": found.orders} | {name: values[:, 0] for name, values in lists.items()}


def instabilities(found: Bifurcation) -> tuple[str, ...]:
    """One sentence for each order that is unstable at some speed."""
    rows, first = np.flatnonzero(~found.stable.all(axis=1)), found.stable.argmin(axis=1)
    return tuple(
        f"Order {found.orders[row]} is unstable at {found.speed_rad_s[first[row]]:g} rad/s, where "
        f"it grows by {found.growth_rate_1_s[row, first[row]]:.4g} 1/s: it has no frequency there."
        for row in rows
    )


def hub_columns(found: HubResponse, *, free: bool) -> dict[str, NDArray[np.float64]]:
    """Columns of a table: real and imaginary part of each force, and of each motion if free."""
    columns = {"frequency_hz": found.frequency_hz}
    for name in (*FORCES, *MOTIONS) if free else FORCES:
        values = getattr(found, name)
        columns |= {f"{name}_real": values.real, f"{name}_imag": values.imag}
    return columns


def largest_at_hub(found: HubResponse) -> dict[str, NDArray[Any]]:
    """Largest magnitude of each force and of the moment, and its frequency."""
    sizes = np.abs([getattr(found, name) for name in FORCES])
    frequency_hz = found.frequency_hz[np.argmax(sizes, axis=1)]
    largest = sizes.max(axis=1)
    return {
        "at the hub": np.array(FORCES),
        "largest": largest,
        "frequency_hz": np.where(largest > 0, frequency_hz, np.nan),
    }


def wheel_of(known: Wheel | None, mass_kg: float | None, inertia_kg_m2: float | None) -> Wheel:
    """The wheel of a tyre's parameter set, replaced by values that are given."""
    mass = known.mass_kg if mass_kg is None and known else mass_kg
    inertia = known.inertia_kg_m2 if inertia_kg_m2 is None and known else inertia_kg_m2
    if mass is None or inertia is None:
        found, rule = "no mass or no moment of inertia", "a free hub needs both"
        remedy = "Give --wheel-mass-kg and --wheel-inertia-kg-m2, or add [wheel] to the tyre"
        raise InputError("wheel", found, rule, remedy)
    return Wheel(mass, inertia)


def free_frequencies(
    ring: RingParameters, wheel: Wheel, speed_rad_s: float
) -> dict[str, NDArray[np.float64]]:
    """Undamped roots of orders 0 and 1 with a free wheel in the rotating frame, ascending.

    Order 0 rotates the wheel, order 1 displaces it: positive frequencies are regressive waves,
    negative ones progressive. The rigid motions of the tyre are the double root 0 (order 0) and the
    speed (order 1).
    """
    turning, moving = (free_hub_roots(ring, wheel, order, speed_rad_s).real for order in (0, 1))
    orders = np.repeat([0, 1], [turning.size, moving.size])
    frequencies = np.concatenate([turning, moving]) / (2.0 * np.pi)
    return {"order": orders, "frequency_hz": np.round(frequencies, 6) + 0.0}


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
