"""Tyre to simulate, and its natural frequencies: over speed, with a fixed or a free hub."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.errors import InputError
from model import Bifurcation, HubResponse, bifurcation, free_hub_roots
from model.coefficients import PressureLoad
from model.errors import ParameterError
from model.foundation import with_pressure_load
from model.parameters import (
    DESIGNATION,
    TABLE_4_RING,
    TABLE_5_DAMPING,
    RingDamping,
    RingParameters,
    Wheel,
)
from model.waves import WaveFrame
from pipelines.library.library import read_source

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
