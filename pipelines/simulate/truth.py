"""A tyre to simulate, and its known modes with their exact inertance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.errors import InputError
from model import (
    Bifurcation,
    HubResponse,
    bifurcation,
    damping_ratios,
    free_hub_roots,
    modal_mass_kg,
    natural_frequencies_hz,
)
from model.coefficients import PressureLoad
from model.errors import ParameterError
from model.foundation import with_pressure_load
from model.parameters import (
    DESIGNATION,
    REFITTED_DAMPING,
    TABLE_3_DAMPING_RATIOS,
    TABLE_3_FREQUENCIES_HZ,
    TABLE_3_ORDERS,
    TABLE_4_RING,
    TABLE_5_DAMPING,
    RingDamping,
    RingParameters,
    Wheel,
)
from model.ring import WaveFrame
from pipelines.library.library import read_source

FORCES = ("force_x", "force_z", "moment_m")
MOTIONS = ("x_m_n", "z_m_n", "rotation_rad_n")
HIGHEST_ORDER = 16
_LINES_AT_ONCE = 8192


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


Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Modes = NDArray[np.int_] | slice


@dataclass(frozen=True)
class TruthMode:
    """One real mode of a tyre with radial shape cos(n(θ − orientation))."""

    order: int  # circumferential order n
    member: str  # "a" or "b" of a split pair; empty if both members of the order coincide
    frequency_hz: float  # undamped natural frequency
    damping_ratio: float
    modal_mass_kg: float  # for a unit amplitude of the shape
    orientation_deg: float = 0.0  # angle of an antinode

    def shape(self, angles_deg: Floats) -> Floats:
        """Radial shape at `angles_deg`."""
        return np.asarray(np.cos(self.order * np.deg2rad(angles_deg - self.orientation_deg)))


def truth_modes(
    *, split_percent: float = 0.0, shaker_between: float = 0.5, both: bool = False
) -> tuple[TruthMode, ...]:
    """Modes of the tyre of the paper.

    Orders 1 to 7 have the frequencies and damping ratios of Table 3; orders 8 to 16 and the
    breathing mode those of the ring of Table 4 with the damping refitted to Table 3. Modal masses
    are those of the ring.

    `split_percent` is the distance between the two frequencies of each order n ≥ 1 in percent of
    their mean; without it a force at 0° excites the cosine member alone, and `both` adds the other
    one for forces elsewhere. `shaker_between` is the
    place of that force on a split order: 0 on an antinode of member a, 1 on one of member b.
    """
    orders = np.arange(HIGHEST_ORDER + 1)
    frequencies = natural_frequencies_hz(TABLE_4_RING, orders)
    ratios = damping_ratios(TABLE_4_RING, REFITTED_DAMPING, orders)
    frequencies[TABLE_3_ORDERS] = TABLE_3_FREQUENCIES_HZ
    ratios[TABLE_3_ORDERS] = TABLE_3_DAMPING_RATIOS
    masses = modal_mass_kg(TABLE_4_RING, orders)
    modes: list[TruthMode] = []
    rows = zip(frequencies.tolist(), ratios.tolist(), masses.tolist(), strict=True)
    for order, (frequency, ratio, mass) in enumerate(rows):
        if order == 0 or not (split_percent or both):
            modes.append(TruthMode(order, "", frequency, ratio, mass))
            continue
        turned = -90.0 / order * shaker_between
        for member, sign, angle in (("a", -1, turned), ("b", 1, turned + 90.0 / order)):
            moved = frequency * (1.0 + sign * split_percent / 200.0)
            modes.append(TruthMode(order, member, moved, ratio, mass, angle))
    return tuple(modes)


@dataclass(frozen=True, eq=False)
class System:
    """Poles and residue vectors of a structure in one state, driven at one point."""

    poles: Complexes  # shape (n_modes,); poles in the upper half plane, ascending, rad/s
    vectors: Complexes  # shape (n_coordinates, n_modes); mode shapes
    participation: Complexes  # shape (n_modes,); from shape to residue of receptance, unit force
    left: Complexes  # shape (n_modes, n_coordinates); velocity part of left vectors over the mass

    def residues(self, rows: Floats) -> Complexes:
        """Residues of receptance at points whose motion is ``rows @ coordinates``."""
        return np.asarray((rows @ self.vectors) * self.participation, dtype=complex)

    def inertance(self, rows: Floats, omega: Floats, modes: Modes = slice(None)) -> Complexes:
        """Inertance at points, of all or some `modes`, shape (n_points, n_lines), (m/s²)/N."""
        return _inertance(self.poles[modes], self.residues(rows)[:, modes], omega)


def solve(mass: Floats, damping: Floats, stiffness: Floats, drive: Floats) -> System:
    """Exact poles and residue vectors for a force on ``drive @ coordinates``."""
    size = len(mass)
    inverse = np.linalg.inv(mass)
    below = np.hstack([-inverse @ stiffness, -inverse @ damping])
    poles, vectors = np.linalg.eig(np.vstack([np.eye(size, 2 * size, size), below]))
    left = np.linalg.inv(vectors)[:, size:] @ inverse
    upper = np.flatnonzero(poles.imag > 0)
    upper = upper[np.argsort(np.abs(poles[upper]))]
    return System(poles[upper], vectors[:size, upper], left[upper] @ drive, left[upper])


def _inertance(poles: Complexes, residues: Complexes, omega: Floats) -> Complexes:
    """H = −ω² Σ_r [A_r/(jω − s_r) + A*_r/(jω − s*_r)] of residues A, shape (..., n_modes)."""
    values = np.empty((*residues.shape[:-1], omega.size), dtype=complex)
    for start in range(0, omega.size, _LINES_AT_ONCE):
        lines = slice(start, start + _LINES_AT_ONCE)
        s = 1j * omega[lines]
        values[..., lines] = residues @ (1 / (s - poles[:, None]))
        values[..., lines] += residues.conj() @ (1 / (s - poles.conj()[:, None]))
    return np.asarray(values * -(omega**2))


@dataclass(frozen=True, eq=False)
class ModalSum:
    """Inertance as a sum over poles."""

    poles: Complexes  # shape (n_modes,); poles s_r in the upper half plane, rad/s
    residues: Complexes  # shape (n_positions, n_modes); residues A_ir of receptance

    def inertance(self, position: int, omega: Floats) -> Complexes:
        """Inertance of one position at angular frequencies `omega`, (m/s²)/N."""
        return _inertance(self.poles, self.residues[position], omega)


def _along(mode: TruthMode, angles_deg: Floats) -> Floats:
    """Tangential part of a shape: a quarter wave further on, 1/n of the radial one."""
    if not mode.order:
        return np.zeros(angles_deg.size)
    return np.asarray(mode.shape(angles_deg + 90.0 / mode.order) / mode.order)


def modal_sum(
    modes: tuple[TruthMode, ...],
    angles_deg: Floats,
    force_deg: float,
    *,
    sensor_mass_kg: float = 0.0,
) -> ModalSum:
    """Poles and residues of the tyre with a sensor of some mass at each of `angles_deg`.

    The mass of the sensors is added in modal coordinates, so poles and residues are exact for the
    modes given. Sensors move along the belt too, which does not stretch: v' = −w.
    """
    omega = 2.0 * np.pi * np.array([mode.frequency_hz for mode in modes])
    mass = np.array([mode.modal_mass_kg for mode in modes])
    ratio = np.array([mode.damping_ratio for mode in modes])
    shapes = np.column_stack([mode.shape(angles_deg) for mode in modes])
    at_force = np.array([mode.shape(np.array([force_deg]))[0] for mode in modes])
    along = np.column_stack([_along(mode, angles_deg) for mode in modes])
    inertia = np.diag(mass) + sensor_mass_kg * (shapes.T @ shapes + along.T @ along)
    stiffness, damping = np.diag(mass * omega**2), np.diag(2.0 * mass * ratio * omega)
    system = solve(inertia, damping, stiffness, at_force)
    return ModalSum(system.poles, system.residues(shapes))
