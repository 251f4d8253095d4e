"""What reaches the hub from a force on the belt, as columns of a table."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.errors import InputError
from model import HubResponse, RingParameters, Wheel, free_hub_roots

FORCES = ("force_x", "force_z", "moment_m")
MOTIONS = ("x_m_n", "z_m_n", "rotation_rad_n")


def hub_columns(found: HubResponse, *, free: bool) -> dict[str, NDArray[np.float64]]:
    """Columns of a table: real and imaginary part of each force, and of each motion where free.

    Parameters
    ----------
    found : HubResponse
    free : bool
        Whether the wheel moves.
    """
    columns = {"frequency_hz": found.frequency_hz}
    for name in (*FORCES, *MOTIONS) if free else FORCES:
        values = getattr(found, name)
        columns[f"{name}_real"] = values.real
        columns[f"{name}_imag"] = values.imag
    return columns


def largest_at_hub(found: HubResponse) -> dict[str, NDArray[Any]]:
    """Largest magnitude of each force and of the moment, and the frequency where it is."""
    sizes = np.abs([getattr(found, name) for name in FORCES])
    frequency_hz = found.frequency_hz[np.argmax(sizes, axis=1)]
    largest = sizes.max(axis=1)
    return {
        "at the hub": np.array(FORCES),
        "largest": largest,
        "frequency_hz": np.where(largest > 0, frequency_hz, np.nan),
    }


def wheel_of(known: Wheel | None, mass_kg: float | None, inertia_kg_m2: float | None) -> Wheel:
    """The wheel of a tyre's parameter set, with what was given in its place.

    Raises
    ------
    InputError
        If neither tells mass or inertia.
    """
    mass = known.mass_kg if mass_kg is None and known else mass_kg
    inertia = known.inertia_kg_m2 if inertia_kg_m2 is None and known else inertia_kg_m2
    if mass is None or inertia is None:
        raise InputError(
            "wheel",
            "no mass or no moment of inertia",
            "a free hub needs both",
            "Give --wheel-mass-kg and --wheel-inertia-kg-m2, or add [wheel] to the tyre",
        )
    return Wheel(mass, inertia)


def free_frequencies(
    ring: RingParameters, wheel: Wheel, speed_rad_s: float
) -> dict[str, NDArray[np.float64]]:
    """Undamped roots of orders 0 and 1 with a free wheel, seen from the tyre, ascending.

    Order 0 turns the wheel, order 1 moves it: positive frequencies are regressive waves, negative
    ones progressive. The rigid motions of the whole tyre come as the double root 0 (order 0) and
    as the speed itself (order 1).
    """
    turning, moving = (free_hub_roots(ring, wheel, order, speed_rad_s).real for order in (0, 1))
    orders = np.repeat([0, 1], [turning.size, moving.size])
    frequencies = np.concatenate([turning, moving]) / (2.0 * np.pi)
    return {"order": orders, "frequency_hz": np.round(frequencies, 6) + 0.0}
