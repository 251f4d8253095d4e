"""The ring at rest: natural frequencies, mode shapes and modal masses at Ω = 0."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, require_type, whole_orders
from model.coefficients import Harmonics, PressureLoad, harmonics, inextensional_roots
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
