"""Inertance of the damped ring between any two angles (section 5.3, Figs. 11 and 12)."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import Array, finite_array, require_one_of
from model.errors import ParameterError
from model.ring import belt_width_m
from model.transfer import ORDERS_AT_ONCE, Complex, ForcedRing, angular_frequency

#: Direction of a force or a response on the belt.
Direction = Literal["radial", "circumferential"]


def inertance(
    forced: ForcedRing,
    frequency_hz: ArrayLike,
    response_rad: ArrayLike,
    force_rad: float = 0.0,
    *,
    response_direction: Direction = "radial",
    force_direction: Direction = "radial",
    per_width: bool = False,
) -> Complex:
    """Inertance −ω²u/F of a point force, summed over all harmonics (eqs 6 and 7, exact).

    With Q_n = (F/b)/(2πa) on every harmonic: A_n = Q_n·M22/(M11·M22 + M12²) and
    u_r = Σ A_n e^{inθ}, n from −N to N. The derivative is taken in the frame of the observer;
    centripetal and Coriolis parts that an accelerometer on a rolling tyre would add are not in it.

    Parameters
    ----------
    forced : ForcedRing
        Ring, damping, speed, hub, frame and number of harmonics.
    frequency_hz : array_like, shape (n_frequencies,)
        Frequencies, Hz.
    response_rad : array_like, shape (n_responses,) or scalar
        Angles of the response, rad.
    force_rad : float
        Angle of the force, rad.
    response_direction, force_direction : {"radial", "circumferential"}
        Positive outwards, and counter-clockwise.
    per_width : bool
        Whether the force is per unit of belt width, which needs no belt width: (m/s²)/(N/m).

    Returns
    -------
    ndarray of complex, shape (n_responses, n_frequencies) or (n_frequencies,)
        Inertance in (m/s²)/N.

    Raises
    ------
    ParameterError
        For a ring without belt width, unless `per_width`; for unknown directions.

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> from model import ForcedRing
    >>> from model.reference import TABLE_4_RING
    >>> forced = ForcedRing(TABLE_4_RING, rm.RingDamping(1900.0, 1500.0, 0.025))
    >>> rm.inertance(forced, [80.0, 100.0, 120.0], np.radians([0.0, 100.0])).shape
    (2, 3)
    """
    omega, angles = angular_frequency(frequency_hz), finite_array("response_rad", response_rad)
    around = np.remainder(np.atleast_1d(angles) - force_rad, 2 * np.pi)
    total = np.zeros((around.size, omega.size), dtype=complex)
    for start in range(0, forced.orders.size, ORDERS_AT_ONCE):
        orders = forced.orders[start : start + ORDERS_AT_ONCE]
        amplitude = _compliance(forced, orders, omega, response_direction, force_direction)
        total += np.exp(1j * around[:, None] * orders) @ amplitude
    return _as_inertance(forced, total, omega, per_width, angles.ndim)


def inextensional_inertance(
    forced: ForcedRing,
    frequency_hz: ArrayLike,
    response_rad: ArrayLike,
    force_rad: float = 0.0,
    *,
    per_width: bool = False,
) -> Complex:
    """Radial inertance of an inextensible belt, u_r = −u_θ' (eq 33).

    Eq 33 enters the energies, so that radial and circumferential equations are combined and K
    cancels: Z_n = Kp(n²−1)²/n² + D(n²−1)²/a⁴ + k_r + k_θ/n² − ρh(Ω²+ω²)(1+1/n²) + 4ρhΩω/n +
    iω(c_r + c_θ/n²). Put into eq 6 alone it would lose k_θ. There is no order 0.

    Parameters
    ----------
    forced : ForcedRing
        With a fixed hub; a free wheel needs the exact form.
    frequency_hz, response_rad, force_rad, per_width
        As `inertance`.

    Returns
    -------
    ndarray of complex, shape (n_responses, n_frequencies) or (n_frequencies,)
        Inertance in (m/s²)/N.

    Raises
    ------
    ParameterError
        As `inertance`, and for a free wheel.
    """
    if forced.wheel is not None:
        raise ParameterError("wheel", "free", "the hub must be fixed", "Use `inertance`")
    omega, angles = angular_frequency(frequency_hz), finite_array("response_rad", response_rad)
    around = np.remainder(np.atleast_1d(angles) - force_rad, 2 * np.pi)
    orders = forced.orders[forced.orders != 0]
    n = orders[:, None].astype(float)
    turning = forced.rotating_omega(orders, omega)
    rho, speed = forced.ring.mass_per_area_kg_m2, forced.speed_rad_s
    static = forced.terms(orders).inextensional[:, None]
    static = np.where(turning < 0, static.conj(), static) / n**2
    radial, circumferential = forced.damping.radial_n_s_m3, forced.damping.circumferential_n_s_m3
    stiffness = (
        static
        - rho * turning**2 * (1.0 + 1.0 / n**2)
        + 4.0 * rho * speed * turning / n
        + 1j * turning * (radial + circumferential / n**2)
    )
    total = np.exp(1j * around[:, None] * orders) @ (1.0 / stiffness)
    return _as_inertance(forced, total, omega, per_width, angles.ndim)


def _compliance(
    forced: ForcedRing,
    orders: NDArray[np.int_],
    omega: Array,
    response: Direction,
    force: Direction,
) -> Complex:
    require_one_of("response_direction", response, get_args(Direction))
    require_one_of("force_direction", force, get_args(Direction))
    if response == force == "radial":
        return forced.radial_compliance(orders, omega)
    _, cross, circumferential = forced.compliance(orders, omega)
    if response == force:
        return circumferential
    return cross if response == "circumferential" else -cross


def _as_inertance(
    forced: ForcedRing, total: Complex, omega: Array, per_width: bool, n_dimensions: int
) -> Complex:
    """Scale Σ A_n/Q_n to acceleration over force; drop the axis of a single angle."""
    width = 1.0 if per_width else belt_width_m(forced.ring)
    scaled = -(omega**2) * total / (2.0 * np.pi * forced.ring.mean_radius_m * width)
    return scaled if n_dimensions else scaled[0]
