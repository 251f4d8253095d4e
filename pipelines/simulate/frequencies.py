"""Natural frequencies of the rolling tyre, as numbers for files and programs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.errors import InputError
from model import Bifurcation, HubResponse, RingParameters, Wheel, bifurcation, free_hub_roots
from model.coefficients import PressureLoad
from model.waves import WaveFrame


def simulate_frequencies(
    ring: RingParameters,
    orders: ArrayLike,
    speed_rad_s: ArrayLike,
    frame: WaveFrame = "rotating",
    *,
    extensional: bool = False,
    pressure_load: PressureLoad = "dead",
) -> Bifurcation:
    """Frequencies of both waves of each order over speed, in any of the three frames.

    Parameters
    ----------
    ring : RingParameters
    orders : array_like of int, shape (n_orders,)
    speed_rad_s : array_like, shape (n_speeds,)
    frame : {"rotating", "absolute", "stationary"}
        In the stationary frame, which is another one for every order and speed, both waves of an
        order have the same frequency.
    extensional, pressure_load
        As `model.bifurcation`.
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
    single = found.speed_rad_s.size == 1
    content: dict[str, NDArray[Any]] = {} if single else {"speed_rad_s": found.speed_rad_s}
    content["orders"] = found.orders
    for name in ("regressive_hz", "progressive_hz"):
        values = getattr(found, name)
        content[name] = values[:, 0] if single else values
    return content


def instabilities(found: Bifurcation) -> tuple[str, ...]:
    """One sentence for each order that is unstable at some speed."""
    sentences = []
    for order, rates in zip(found.orders, found.growth_rate_1_s, strict=True):
        unstable = np.flatnonzero(rates > 0)
        if unstable.size:
            first = found.speed_rad_s[unstable[0]]
            sentences.append(
                f"Order {order} is unstable at {first:g} rad/s, where it grows by "
                f"{rates[unstable[0]]:.4g} 1/s: it has no frequency there."
            )
    return tuple(sentences)


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
