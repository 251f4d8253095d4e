"""The ring: natural frequencies, shapes and modal masses at rest, and its waves when it turns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arguments import (
    Array,
    ReadonlyArrays,
    finite_array,
    require_one_of,
    require_type,
    whole_orders,
)
from model.coefficients import (
    Harmonics,
    PressureLoad,
    characteristic_roots,
    eigenvector_ratios,
    harmonics,
    inextensional_roots,
)
from model.errors import InstabilityError, ParameterError
from model.parameters import RingParameters


def natural_frequencies_hz(
    ring: RingParameters, orders: ArrayLike, *, pressure_load: PressureLoad = "dead"
) -> Array:
    """Natural frequencies at Ω = 0 that a radial sensor sees, one per order.

    For n ≥ 1 the inextensional (smaller) root of eq 14, for n = 0 the breathing mode
    ω² = m11/(ρh); the torsion of order 0 has no radial part, see `torsion_frequency_hz`.

    Parameters
    ----------
    ring : RingParameters
    orders : array_like of int
        Circumferential orders; the sign does not matter at Ω = 0.
    pressure_load : {"dead", "follower"}
        See `equilibrium`.

    Returns
    -------
    ndarray
        Frequencies in Hz, in the shape of `orders`.

    Raises
    ------
    InstabilityError
        Where the static stiffness of an order is negative.

    Examples
    --------
    >>> import ringmodal as rm
    >>> from model.parameters import TABLE_4_RING
    >>> rm.natural_frequencies_hz(TABLE_4_RING, [2, 3, 4]).round(1)
    array([100.7, 122.4, 145.4])
    """
    terms = _at_rest(ring, orders, pressure_load)
    smaller = inextensional_roots(terms)
    breathing = terms.m11 / terms.mass_per_area_kg_m2
    return _frequency_hz(np.where(terms.orders == 0, breathing, smaller), terms.orders)


def torsion_frequency_hz(ring: RingParameters, *, pressure_load: PressureLoad = "dead") -> float:
    """Frequency of order 0 in which the belt turns against a fixed hub, ω² = m22/(ρh), Hz."""
    terms = harmonics(ring, 0, pressure_load=pressure_load)
    return float(_frequency_hz(terms.m22 / terms.mass_per_area_kg_m2, terms.orders))


def displacement_ratio(
    ring: RingParameters, orders: ArrayLike, *, pressure_load: PressureLoad = "dead"
) -> Array:
    """Ratio B_n of the inextensional eigenvector [1, iB_n] of Table 2 at Ω = 0.

    u_r = cos nθ·cos ωt comes with u_θ = −B_n sin nθ·cos ωt (eq 20). Close to 1/n; zero for the
    breathing mode n = 0; odd in n.
    """
    terms = _at_rest(ring, orders, pressure_load)
    smaller = inextensional_roots(terms)
    denominator = terms.m22 - terms.mass_per_area_kg_m2 * smaller
    flat = terms.orders == 0
    return np.asarray(np.where(flat, 0.0, terms.c / np.where(flat, 1.0, denominator)))


def modal_mass_kg(
    ring: RingParameters, orders: ArrayLike, *, pressure_load: PressureLoad = "dead"
) -> Array:
    """Modal mass of a mode with radial shape cos nθ of unit amplitude.

    ρh·b·a·π(1 + B_n²) for n ≥ 1 and 2π·ρh·b·a for the breathing mode (from eqs 35 and 20).

    Parameters
    ----------
    ring : RingParameters
        The ring, with its belt width.
    orders, pressure_load
        As `natural_frequencies_hz`.

    Returns
    -------
    ndarray
        Modal masses in kg, in the shape of `orders`.

    Raises
    ------
    ParameterError
        Where the ring has no belt width.
    """
    ratio = displacement_ratio(ring, orders, pressure_load=pressure_load)
    line = ring.mass_per_area_kg_m2 * belt_width_m(ring) * ring.mean_radius_m
    return np.pi * line * np.where(whole_orders(orders) == 0, 2.0, 1.0 + ratio**2)


def belt_width_m(ring: RingParameters) -> float:
    """Belt width of the ring, m; refuses a ring without one."""
    if ring.belt_width_m is None:
        rule = "required for masses and absolute amplitudes: the model is per unit of belt width"
        raise ParameterError("belt_width_m", "not given", rule, "Give belt_width_m")
    return ring.belt_width_m


def _at_rest(ring: RingParameters, orders: ArrayLike, pressure_load: PressureLoad) -> Harmonics:
    require_type("ring", ring, RingParameters)
    whole = whole_orders(orders)
    return _remembered(ring, whole.tobytes(), whole.shape, pressure_load)


@lru_cache(maxsize=4)  # a tuning asks for the frequencies and then the masses of each ring
def _remembered(
    ring: RingParameters, orders: bytes, shape: tuple[int, ...], pressure_load: PressureLoad
) -> Harmonics:
    whole = np.frombuffer(orders, int).reshape(shape)
    return harmonics(ring, whole, pressure_load=pressure_load)


def _frequency_hz(squared: Array, orders: NDArray[np.int_]) -> Array:
    if np.any(squared < 0):
        lowest = int(np.argmin(squared))
        found = f"ω² = {squared.flat[lowest]:.4g} rad²/s² for order {orders.flat[lowest]}"
        rule = "the static stiffness of this order is negative: the ring buckles"
        remedy = "Raise the foundation stiffness or the bending stiffness"
        raise InstabilityError("ring", found, rule, remedy)
    return np.asarray(np.sqrt(squared) / (2.0 * np.pi))


#: Frame of an observer: turning with the wheel, or fixed in space.
Frame = Literal["rotating", "absolute"]
#: Reference systems of waves: on the wheel, in space, and turning so that the pair stands (eq 29).
WaveFrame = Literal["rotating", "absolute", "stationary"]


@dataclass(frozen=True)
class WavePair:
    """The regressive and the progressive wave of one order at one speed.

    Parameters
    ----------
    order : int
        Circumferential order n ≥ 1.
    speed_rad_s : float
        Angular speed Ω of the wheel, rad/s.
    regressive_rad_s, progressive_rad_s : float
        ω_{n,1} and ω_{n,2} (ω_{n,3} and ω_{n,4} for the extensional pair), rotating frame, rad/s.
    regressive_ratio, progressive_ratio : float
        B_{n,1} and B_{n,2}: circumferential over radial amplitude of each wave; negative for the
        extensional pair, whose sign Table 2 writes out.
    """

    order: int
    speed_rad_s: float
    regressive_rad_s: float
    progressive_rad_s: float
    regressive_ratio: float
    progressive_ratio: float

    @property
    def beta_rad_s(self) -> float:
        """Speed β of the stationary frame against the rotating one (eq 32), rad/s."""
        return (self.progressive_rad_s - self.regressive_rad_s) / (2.0 * self.order)

    def frequencies_rad_s(self, frame: WaveFrame) -> tuple[float, float]:
        """Frequencies seen from `frame`: regressive, progressive (eqs 21, 25, 30), rad/s.

        Against the rotating frame, the absolute one turns at −Ω (eq 1c: θ = φ − Ωt) and the
        stationary one at β (eq 29).
        """
        speeds = {"rotating": 0.0, "absolute": -self.speed_rad_s, "stationary": self.beta_rad_s}
        require_one_of("frame", frame, speeds)
        drift = self.order * speeds[frame]
        return self.regressive_rad_s + drift, self.progressive_rad_s - drift

    def propagation_speeds_rad_s(self, frame: WaveFrame) -> tuple[float, float]:
        """Speeds c_{n,1} and c_{n,2} of the two waves (eqs 23, 26 without its modulus, 31), rad/s.

        The regressive wave travels towards negative angles, the progressive one towards positive.
        """
        regressive, progressive = self.frequencies_rad_s(frame)
        return regressive / self.order, progressive / self.order

    def pattern_speed_rad_s(self, frame: WaveFrame) -> float:
        """Speed c_{n,tot} of the superposed pattern (eqs 24, 28), rad/s; 0 in its own frame."""
        regressive, progressive = self.propagation_speeds_rad_s(frame)
        return abs(regressive - progressive) / 2.0

    def radial(
        self, angles_rad: ArrayLike, times_s: ArrayLike, frame: WaveFrame = "rotating"
    ) -> Array:
        """Superposed radial field u_{r,tot} (eqs 19a, 20a, 21a, 22a, 25a, 27a, 30a).

        Parameters
        ----------
        angles_rad : array_like, shape (n_angles,)
            Angles θ, φ or γ in the chosen frame, rad.
        times_s : array_like, shape (n_times,)
            Times, s.
        frame : {"rotating", "absolute", "stationary"}
            Reference system.

        Returns
        -------
        ndarray, shape (n_angles, n_times)
            2cos(nθ + ω_{n,1}t) + 2cos(nθ − ω_{n,2}t), without unit.
        """
        backward, forward = self._phases(angles_rad, times_s, frame)
        return np.asarray(2.0 * np.cos(backward) + 2.0 * np.cos(forward))

    def circumferential(
        self, angles_rad: ArrayLike, times_s: ArrayLike, frame: WaveFrame = "rotating"
    ) -> Array:
        """Superposed field u_{θ,tot} (eqs 19b, 20b, 21b, 22b, 25b, 27b, 30b as corrected).

        The second term of eq 30b is −2B_{n,2} sin(nγ − (ω_{n,2} − nβ)t). Eqs 22b and 27b take
        B_{n,2} = B_{n,1}, which is exact at Ω = 0 only. Arguments and shape as `radial`.
        """
        backward, forward = self._phases(angles_rad, times_s, frame)
        regressive = -2.0 * self.regressive_ratio * np.sin(backward)
        return np.asarray(regressive - 2.0 * self.progressive_ratio * np.sin(forward))

    def _phases(
        self, angles_rad: ArrayLike, times_s: ArrayLike, frame: WaveFrame
    ) -> tuple[Array, Array]:
        around = self.order * np.atleast_1d(finite_array("angles_rad", angles_rad))[:, None]
        times = np.atleast_1d(finite_array("times_s", times_s))
        regressive, progressive = self.frequencies_rad_s(frame)
        return around + regressive * times, around - progressive * times


def wave_pair(
    ring: RingParameters,
    order: int,
    speed_rad_s: float = 0.0,
    *,
    extensional: bool = False,
    pressure_load: PressureLoad = "dead",
) -> WavePair:
    """Both waves of an order: roots and eigenvectors of eqs 12 and 14 by Tables 1 and 2.

    Parameters
    ----------
    ring, order, speed_rad_s, pressure_load
        As `harmonics`, for one order n ≥ 1 and one speed.
    extensional : bool
        Whether to take the extensional pair.

    Raises
    ------
    InstabilityError
        Where a root is complex.
    """
    n = int(wave_orders(order)[0])
    roots = characteristic_roots(ring, n, speed_rad_s, pressure_load=pressure_load)
    ratios = eigenvector_ratios(ring, n, speed_rad_s, pressure_load=pressure_load)
    first = 2 if extensional else 0
    growth = float(np.abs(roots[first : first + 2].imag).max())
    if growth > 0:
        where, found = f"order {n} at {speed_rad_s:g} rad/s", f"a root grows by {growth:.4g} 1/s"
        raise InstabilityError(where, found, "it has no natural frequency", "Lower the speed")
    frequencies = float(roots[first].real), float(-roots[first + 1].real)
    return WavePair(n, float(speed_rad_s), *frequencies, *map(float, ratios[first : first + 2]))


@dataclass(frozen=True, eq=False)
class Bifurcation(ReadonlyArrays):
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
    speed_rad_s: Array
    regressive_hz: Array
    progressive_hz: Array
    growth_rate_1_s: Array
    frame: Frame

    @property
    def standing_hz(self) -> Array:
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
    orders : array_like of int, shape (n_orders,)
        Circumferential orders n ≥ 1.
    speed_rad_s : array_like, shape (n_speeds,)
        Angular speeds Ω, rad/s.
    frame : {"rotating", "absolute"}
        In the absolute frame ω_{n,1} − nΩ and ω_{n,2} + nΩ (eq 25).
    ring, extensional, pressure_load
        As `wave_pair`.

    Returns
    -------
    Bifurcation
        On the grid of orders and speeds.

    Raises
    ------
    ParameterError
        For an order below one, or a speed without equilibrium.
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
    regressive = stable * (pair[..., 0].real - shift)
    progressive = stable * (-pair[..., 1].real + shift)
    return Bifurcation(numbers, speeds, regressive, progressive, growth, frame)


def wave_orders(orders: ArrayLike) -> NDArray[np.int_]:
    """Take orders of waves, n ≥ 1."""
    numbers = np.atleast_1d(whole_orders(orders))
    if np.any(numbers < 1):
        raise ParameterError("orders", f"{numbers.min()}", "waves have n ≥ 1", "Leave it out")
    return numbers


def require_frame(frame: str) -> float:
    """Speed of the observer against the wheel, in Ω: 0 on the wheel, 1 in space; refuse others."""
    require_one_of("frame", frame, get_args(Frame))
    return float(frame == "absolute")
