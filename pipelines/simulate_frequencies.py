"""Natural frequencies of the rolling tyre, as numbers for files and programs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import Bifurcation, RingParameters, bifurcation
from model.steady_state import PressureLoad
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
