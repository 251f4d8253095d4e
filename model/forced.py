"""Damped ring under harmonic loads: its harmonics (eq 12), inertance between any two angles.

Section 5.3, Figs. 11 and 12.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, finite_array, readonly, require_one_of, require_order_limit
from model.coefficients import Harmonics, PressureLoad, harmonics
from model.errors import ParameterError
from model.parameters import RingDamping, RingParameters, Wheel
from model.ring import Frame, belt_width_m, require_frame

#: Direction of a force or a response on the belt.
Direction = Literal["radial", "circumferential"]
Complex = NDArray[np.complexfloating[Any, Any]]
ORDERS_AT_ONCE = 16  # keeps the matrices of a block in the cache


@dataclass(frozen=True)
class ForcedRing:
    """A damped ring at one speed, under harmonic loads (section 5.3).

    Parameters
    ----------
    ring : RingParameters
    damping : RingDamping
        Its loss factor follows the sign of the frequency.
    speed_rad_s : float
        Angular speed Ω, rad/s.
    wheel : Wheel or None
        A wheel that is free to move (see `model.hub`); None for a fixed hub.
    pressure_load : {"dead", "follower"} or None
        See `equilibrium`. None means the paper's dead load on a fixed hub and a follower load with
        a free wheel, where a dead load would hold the wheel against rotation.
    highest_order : int
        N: harmonics from −N to N are summed. At the force itself the sum converges slowly
        (0.2 % at N = 100), elsewhere fast.
    frame : {"rotating", "absolute"}
        Whether force and response are fixed to the tyre or in space. In space a harmonic n of
        frequency ω acts on the tyre at ω + nΩ.
    """

    ring: RingParameters
    damping: RingDamping
    speed_rad_s: float = 0.0
    wheel: Wheel | None = None
    pressure_load: PressureLoad | None = None
    highest_order: int = 200
    frame: Frame = "rotating"

    def __post_init__(self) -> None:
        finite_array("speed_rad_s", self.speed_rad_s)
        require_order_limit(self.highest_order)
        require_frame(self.frame)

    @property
    def load(self) -> PressureLoad:
        """The pressure load in force."""
        if self.pressure_load is not None:
            return self.pressure_load
        return "dead" if self.wheel is None else "follower"

    @property
    def orders(self) -> NDArray[np.int_]:
        """Orders −N … N."""
        return np.arange(-self.highest_order, self.highest_order + 1)

    def terms(self, orders: ArrayLike) -> Harmonics:
        """Coefficients of eq 12 with the loss factor for positive frequencies."""
        return harmonics(
            self.ring, orders, self.speed_rad_s, pressure_load=self.load, damping=self.damping
        )

    def rotating_omega(self, orders: NDArray[np.int_], omega_rad_s: Array) -> Array:
        """Frequencies at which harmonics are excited on the tyre.

        Shape (n_orders, n_frequencies), or (1, n_frequencies) where they are the same for all.
        """
        shift = require_frame(self.frame) * self.speed_rad_s
        if shift == 0:
            return omega_rad_s[None, :]
        return omega_rad_s[None, :] + shift * orders[:, None]

    def compliance(
        self, orders: NDArray[np.int_], omega_rad_s: Array
    ) -> tuple[Complex, Complex, Complex]:
        """Inverse of the damped matrix of eq 12, coupled to the wheel where that is free.

        `omega_rad_s` is in the frame of the observer. Returns radial, cross and circumferential
        compliance, shape (n_orders, n_frequencies), m³/N, for surface loads Q per area:
        [A, B] = [[radial, −cross], [cross, circumferential]]·[Q_r, Q_θ].
        """
        m11, m12, m22 = self.matrix(orders, omega_rad_s)
        inverse = 1.0 / (m11 * m22 + m12**2)
        return m22 * inverse, m12 * inverse, m11 * inverse

    def radial_compliance(self, orders: NDArray[np.int_], omega_rad_s: Array) -> Complex:
        """First part of `compliance` alone: A_n/Q_n = M22/(M11·M22 + M12²)."""
        m11, m12, m22 = self.matrix(orders, omega_rad_s)
        return m22 / (m11 * m22 + m12**2)

    def matrix(
        self, orders: NDArray[np.int_], omega_rad_s: Array
    ) -> tuple[Complex, Complex, Complex]:
        """M11, M12 = −M21 and M22 of eq 12 with damping; a free wheel is condensed into them."""
        omega = self.rotating_omega(orders, omega_rad_s)
        terms = self.terms(orders)
        rho, damping = self.ring.mass_per_area_kg_m2, self.damping
        inertia = rho * omega**2
        m11 = _signed(terms.m11, omega) + (1j * damping.radial_n_s_m3 * omega - inertia)
        m22 = _signed(terms.m22, omega) + (1j * damping.circumferential_n_s_m3 * omega - inertia)
        m12 = 1j * _signed(terms.c, omega) - 2j * rho * self.speed_rad_s * omega
        if self.wheel is not None:
            lines = np.broadcast_to(omega, m11.shape)
            for row in np.flatnonzero(np.abs(orders) <= 1):
                self._condense_wheel(int(orders[row]), lines[row], m11[row], m12[row], m22[row])
        return m11, m12, m22

    def bed(self, omega: Array) -> tuple[Complex, Complex]:
        """Dynamic stiffness k + iωc of the foundation, radial and circumferential, N/m³."""
        ring, damping = self.ring, self.damping
        return (
            ring.radial_stiffness_n_m3 + 1j * omega * damping.radial_n_s_m3,
            ring.circumferential_stiffness_n_m3 + 1j * omega * damping.circumferential_n_s_m3,
        )

    def turning_terms(self, omega: Array) -> tuple[Complex, Complex]:
        """Coupling M23 = M32 of belt and wheel rotation and the bed's part of M33 (order 0)."""
        arm, support = self.moment_arms()
        _, around = self.bed(omega)
        return support - arm * around, arm**2 * around - arm * support

    def wheel_inertia(self, order: int, omega: Array) -> Array:
        """Inertia term of the wheel over 2πa and width; `omega` is on the tyre.

        I_rω²/(2πa) for order 0, (m/πa)(ω − nΩ)² for n = ±1 with the unknown (x_w ∓ iz_w)/2.
        """
        if self.wheel is None:
            return np.full(omega.shape, np.inf)
        line = np.pi * self.ring.mean_radius_m * belt_width_m(self.ring)
        if order == 0:
            return np.asarray(self.wheel.inertia_kg_m2 * omega**2 / (2.0 * line))
        shifted = omega - order * self.speed_rad_s
        return np.asarray(self.wheel.mass_kg * shifted**2 / line)

    def moment_arms(self) -> tuple[float, float]:
        """Arm of circumferential bed forces about the axis, m, and k_r·u_r°, N/m².

        The objective foundation turns its radial prestress with the wheel; the paper's (eq 45b) has
        the arm a and no prestress, and goes with the dead load.
        """
        if self.load == "dead":
            return self.ring.mean_radius_m, 0.0
        rest = self.terms(0).rest
        growth = float(rest.radial_displacement_m)
        return float(rest.radius_m), self.ring.radial_stiffness_n_m3 * growth

    def _condense_wheel(
        self, order: int, omega: Array, m11: Complex, m12: Complex, m22: Complex
    ) -> None:
        """Eliminate the wheel's motion from the rows of one order, in place."""
        inertia = self.wheel_inertia(order, omega)
        if order == 0:
            coupling, own = self.turning_terms(omega)
            m22 -= coupling**2 / (own - inertia)
            return
        radial, around = self.bed(omega)
        own = radial + around - inertia
        m11 -= radial**2 / own
        m12 += 1j * order * radial * around / own
        m22 -= around**2 / own


def _signed(values: NDArray[Any], omega: Array) -> NDArray[Any]:
    """Coefficients of each order along ω; the loss factor has the sign of the frequency."""
    column = values[:, None]
    if np.iscomplexobj(values) and np.any(omega < 0):
        return np.where(omega < 0, column.conj(), column)
    return column


def angular_frequency(frequency_hz: ArrayLike) -> Array:
    """Take frequencies in Hz as angular frequencies, shape (n_frequencies,)."""
    return readonly(2.0 * np.pi * np.atleast_1d(finite_array("frequency_hz", frequency_hz)))


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
    >>> from model.parameters import TABLE_4_RING
    >>> forced = ForcedRing(TABLE_4_RING, rm.RingDamping(1900.0, 1500.0, 0.025))
    >>> rm.inertance(forced, [80.0, 100.0, 120.0], np.radians([0.0, 100.0])).shape
    (2, 3)
    """
    require_one_of("response_direction", response_direction, get_args(Direction))
    require_one_of("force_direction", force_direction, get_args(Direction))
    omega, angles = angular_frequency(frequency_hz), finite_array("response_rad", response_rad)
    around = np.remainder(np.atleast_1d(angles) - force_rad, 2 * np.pi)
    total = np.zeros((around.size, omega.size), dtype=complex)
    for start in range(0, forced.orders.size, ORDERS_AT_ONCE):
        orders = forced.orders[start : start + ORDERS_AT_ONCE]
        if response_direction == force_direction == "radial":
            amplitude = forced.radial_compliance(orders, omega)
        else:
            _, cross, circumferential = forced.compliance(orders, omega)
            mixed = cross if response_direction == "circumferential" else -cross
            amplitude = circumferential if response_direction == force_direction else mixed
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


def _as_inertance(
    forced: ForcedRing, total: Complex, omega: Array, per_width: bool, n_dimensions: int
) -> Complex:
    """Scale Σ A_n/Q_n to acceleration over force; drop the axis of a single angle."""
    width = 1.0 if per_width else belt_width_m(forced.ring)
    scaled = -(omega**2) * total / (2.0 * np.pi * forced.ring.mean_radius_m * width)
    return scaled if n_dimensions else scaled[0]
