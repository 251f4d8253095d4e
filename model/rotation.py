"""How rotation splits each frequency in two, and the speeds at which a wave stands still."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from model.arrays import finite_array, readonly, whole_orders
from model.coefficients import characteristic_roots, harmonics
from model.errors import ParameterError
from model.parameters import RingParameters
from model.steady_state import PressureLoad

#: Where an observer is: turning with the wheel, or fixed in space.
Frame = Literal["rotating", "absolute"]

_SPEEDS = 400  # grid on which critical speeds are bracketed


@dataclass(frozen=True, eq=False)
class Bifurcation:
    """Frequencies of regressive and progressive waves over speed (Fig. 6).

    Parameters
    ----------
    orders : ndarray of int, shape (n_orders,)
        Circumferential orders n ≥ 1.
    speed_rad_s : ndarray, shape (n_speeds,)
        Angular speeds Ω, rad/s.
    regressive_hz, progressive_hz : ndarray, shape (n_orders, n_speeds)
        ω_{n,1}/2π and ω_{n,2}/2π (3 and 4 for the extensional pair); NaN where unstable. In the
        absolute frame a negative regressive frequency belongs to a wave that the rotation carries
        forward: the speed is above the critical one of this order.
    growth_rate_1_s : ndarray, shape (n_orders, n_speeds)
        Growth rate of an instability, 1/s; zero where stable.
    frame : {"rotating", "absolute"}
        Where the observer is.
    """

    orders: NDArray[np.int_]
    speed_rad_s: NDArray[np.float64]
    regressive_hz: NDArray[np.float64]
    progressive_hz: NDArray[np.float64]
    growth_rate_1_s: NDArray[np.float64]
    frame: Frame

    def __post_init__(self) -> None:
        object.__setattr__(self, "orders", readonly(self.orders, int))
        for name in ("speed_rad_s", "regressive_hz", "progressive_hz", "growth_rate_1_s"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    @property
    def standing_hz(self) -> NDArray[np.float64]:
        """Frequency of both waves in the frame in which the pair stands still (eqs 31, 32), Hz.

        (ω_{n,1} + ω_{n,2})/4π, the mean of the two in any frame; shape (n_orders, n_speeds).
        """
        return np.asarray(0.5 * (self.regressive_hz + self.progressive_hz))

    @property
    def stable(self) -> NDArray[np.bool_]:
        """Whether order and speed have frequencies at all."""
        return np.asarray(self.growth_rate_1_s == 0)


def bifurcation(
    ring: RingParameters,
    orders: ArrayLike,
    speed_rad_s: ArrayLike,
    *,
    frame: Frame = "rotating",
    extensional: bool = False,
    pressure_load: PressureLoad = "dead",
) -> Bifurcation:
    """Natural frequencies over speed, for an observer on the tyre or in space (eqs 14, 25).

    Parameters
    ----------
    ring : RingParameters
        The ring.
    orders : array_like of int, shape (n_orders,)
        Circumferential orders n ≥ 1.
    speed_rad_s : array_like, shape (n_speeds,)
        Angular speeds Ω, rad/s.
    frame : {"rotating", "absolute"}
        In the absolute frame ω_{n,1} − nΩ and ω_{n,2} + nΩ (eq 25).
    extensional : bool
        Whether to take the extensional pair.
    pressure_load : {"dead", "follower"}
        See `equilibrium`.

    Returns
    -------
    Bifurcation
        On the grid of orders and speeds.

    Raises
    ------
    ParameterError
        For an order below one, or a speed without acceptable equilibrium.
    """
    numbers = wave_orders(orders)
    speeds = np.atleast_1d(finite_array("speed_rad_s", speed_rad_s))
    roots = characteristic_roots(
        ring, numbers[:, None], speeds[None, :], pressure_load=pressure_load
    )
    pair = roots[..., 2:] if extensional else roots[..., :2]
    growth = np.abs(pair.imag).max(axis=-1)
    shift = require_frame(frame) * numbers[:, None] * speeds
    stable = np.where(growth == 0, 1.0, np.nan) / (2.0 * np.pi)
    return Bifurcation(
        orders=numbers,
        speed_rad_s=speeds,
        regressive_hz=stable * (pair[..., 0].real - shift),
        progressive_hz=stable * (-pair[..., 1].real + shift),
        growth_rate_1_s=growth,
        frame=frame,
    )


def critical_speeds_rad_s(
    ring: RingParameters,
    orders: ArrayLike,
    *,
    highest_rad_s: float,
    pressure_load: PressureLoad = "dead",
) -> NDArray[np.float64]:
    """Lowest speed at which the regressive wave of each order stands still in space.

    There ω_{n,1} = nΩ, so eq 26a is zero and a load that is constant in space, as that of the road,
    is in resonance with the order: standing waves on the tyre.

    Parameters
    ----------
    ring : RingParameters
        The ring.
    orders : array_like of int, shape (n_orders,)
        Circumferential orders n ≥ 1. Order 1 has none on a fixed hub: ω_{1,1} = ω_0 + Ω.
    highest_rad_s : float
        Where the search ends, rad/s.
    pressure_load : {"dead", "follower"}
        See `equilibrium`.

    Returns
    -------
    ndarray, shape (n_orders,)
        Critical speeds in rad/s; NaN where there is none up to `highest_rad_s`.

    Raises
    ------
    ParameterError
        For an order below one or a limit that is not above zero.
    """
    if not highest_rad_s > 0:
        raise ParameterError(
            "highest_rad_s", f"{highest_rad_s:g}", "a speed above zero", "Raise it"
        )
    numbers = wave_orders(orders)
    grid = np.linspace(0.0, highest_rad_s, _SPEEDS)
    values = _stiffness_to_standing_load(ring, numbers[:, None], grid, pressure_load)
    critical = np.full(numbers.size, np.nan)
    for row, order in enumerate(numbers):
        crossings = np.flatnonzero(np.signbit(values[row, 1:]) != np.signbit(values[row, :-1]))
        if crossings.size:
            low, high = grid[crossings[0]], grid[crossings[0] + 1]
            critical[row] = brentq(
                lambda speed, n=order: float(
                    _stiffness_to_standing_load(ring, n, speed, pressure_load)
                ),
                low,
                high,
            )
    return critical


def wave_orders(orders: ArrayLike) -> NDArray[np.int_]:
    """Take orders of waves, n ≥ 1."""
    numbers = np.atleast_1d(whole_orders(orders))
    if np.any(numbers < 1):
        raise ParameterError(
            "orders", f"{numbers.min()}", "waves have an order n ≥ 1", "Leave it out"
        )
    return numbers


def require_frame(frame: str) -> float:
    """Speed of the observer against the wheel, in Ω: 0 on the wheel, 1 in space; refuse others."""
    if frame not in ("rotating", "absolute"):
        raise ParameterError(
            "frame", f"{frame!r}", "an observer is in the 'rotating' or 'absolute' frame", "Choose"
        )
    return float(frame == "absolute")


def _stiffness_to_standing_load(
    ring: RingParameters, orders: ArrayLike, speed_rad_s: ArrayLike, pressure_load: PressureLoad
) -> NDArray[np.float64]:
    """Determinant of eq 12 at ω = nΩ over the membrane stiffness; zero at a critical speed.

    It is a_0 + a_1ω + a_2ω² + a_3ω⁴ (eq 14); its terms with S of `harmonics` are collected, so that
    no digits are lost to the membrane.
    """
    terms = harmonics(ring, orders, speed_rad_s, pressure_load=pressure_load)
    n2 = terms.orders.astype(float) ** 2
    spin = terms.mass_per_area_kg_m2 * terms.speed_rad_s**2
    moved = terms.determinant + spin * (
        4.0 * n2 * terms.c / np.where(terms.orders == 0, 1, terms.orders)
        - n2 * (terms.m11 + terms.m22)
        - 4.0 * n2 * spin
        + n2**2 * spin
    )
    return np.asarray(moved / ring.axial_stiffness_n_m)
