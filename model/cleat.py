"""The cleat test: a short blow at the contact of the rolling tyre, in time and frequency.

Each harmonic is a system in time with four poles; its response to exponentials is exact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, ReadonlyArrays, finite_array, require_number, require_one_of
from model.coefficients import characteristic_roots
from model.errors import InstabilityError, ParameterError
from model.forced import ORDERS_AT_ONCE, Complex, Direction, ForcedRing, angular_frequency
from model.ring import Frame, belt_width_m, require_frame

#: What is read at the response point: u, its first or its second derivative in time.
Quantity = Literal["displacement", "velocity", "acceleration"]


@dataclass(frozen=True)
class Cleat:
    """A blow on the belt: an ideal impulse, or a half-sine of the same momentum.

    Parameters
    ----------
    radial_n_s, circumferential_n_s : float
        Momentum of the radial (outwards) and of the circumferential force, N·s. A cleat presses
        inwards: a negative radial momentum.
    duration_s : float
        Length of the half-sine; 0 for an ideal impulse.
    contact_rad : float
        Angle of the contact at the start of the blow, rad.
    """

    radial_n_s: float = -1.0
    circumferential_n_s: float = 0.0
    duration_s: float = 0.0
    contact_rad: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radial_n_s", "circumferential_n_s", "duration_s", "contact_rad"):
            finite_array(name, getattr(self, name))
        require_number("duration_s", self.duration_s, zero_allowed=True)

    def through(self, shift: Complex, poles: Complex, times_s: Array) -> Complex:
        """Response of `poles` to the half-sine of unit momentum times e^{shift·t}."""
        rate = math.pi / self.duration_s
        rise = exponential_convolution(shift + 1j * rate, poles, times_s)
        fall = exponential_convolution(shift - 1j * rate, poles, times_s)
        return np.asarray(rate / 4.0j * (rise - fall))

    def unit_force(self, times_s: Array) -> Array:
        """Half-sine of unit momentum at `times_s`, 1/s; zero outside the blow."""
        if self.duration_s == 0:
            return np.zeros_like(times_s)
        rate = math.pi / self.duration_s
        inside = (times_s >= 0) & (times_s <= self.duration_s)
        return np.where(inside, rate / 2.0 * np.sin(rate * times_s), 0.0)


@dataclass(frozen=True, eq=False)
class CleatTest:
    """A rolling ring and a blow.

    Parameters
    ----------
    forced : ForcedRing
        The ring on a fixed hub, with belt width. In its frame the force is fixed during the blow:
        to the tread ("rotating") or in space ("absolute").
    cleat : Cleat
    """

    forced: ForcedRing
    cleat: Cleat
    modes: HarmonicModes = field(init=False)

    def __post_init__(self) -> None:
        belt_width_m(self.forced.ring)
        object.__setattr__(self, "modes", harmonic_modes(self.forced))

    def response(
        self,
        times_s: ArrayLike,
        response_rad: float,
        *,
        frame: Frame = "rotating",
        direction: Direction = "radial",
        quantity: Quantity = "acceleration",
    ) -> Array:
        """Response in time, exact for the harmonics summed: no time steps.

        Parameters
        ----------
        times_s : array_like, shape (n_times,)
            Times from the start of the blow, s; zero before it.
        response_rad : float
            Angle of the point, rad: θ on the tyre, or φ in space.
        frame : {"rotating", "absolute"}
            Whether the point is fixed to the tyre or in space; derivatives are taken there.
        direction : {"radial", "circumferential"}
            Component of the displacement.
        quantity : {"displacement", "velocity", "acceleration"}
            m, m/s or m/s². The infinite acceleration during an ideal impulse is left out.

        Returns
        -------
        ndarray, shape (n_times,)
        """
        times = np.atleast_1d(finite_array("times_s", times_s))
        row, derivative = _component_and_derivative(direction, quantity)
        turning = require_frame(frame) * self.forced.speed_rad_s
        after = np.maximum(times, 0.0)
        total = np.zeros(times.size)
        for block in self._blocks():
            series = self._amplitudes(block, row, derivative, turning, after)
            angle = response_rad - turning * after
            phase = np.exp(1j * self.modes.orders[block, None] * angle)
            # −n is the conjugate of n, so Re a_n e^{inθ} counts twice for n > 0.
            twice = np.where(self.modes.orders[block] == 0, 1.0, 2.0)
            total += twice @ (series * phase).real
        return np.where(times >= 0, total, 0.0)

    def spectrum(
        self,
        frequency_hz: ArrayLike,
        response_rad: float,
        *,
        frame: Frame = "rotating",
        direction: Direction = "radial",
        quantity: Quantity = "acceleration",
    ) -> Complex:
        """Fourier transform ∫x(t)e^{−jωt}dt of `response`, in its unit times s.

        The acceleration includes the blow itself, which `response` leaves out of an ideal impulse.
        Arguments as `response`, with frequencies in Hz for times.
        """
        omega = angular_frequency(frequency_hz)
        row, derivative = _component_and_derivative(direction, quantity)
        turning = require_frame(frame) * self.forced.speed_rad_s
        total = np.zeros(omega.size, dtype=complex)
        for block in self._blocks():
            orders = self.modes.orders[block, None]
            phase = np.exp(1j * orders * response_rad)
            ahead = phase * self._transform(block, row, omega + orders * turning)
            behind = phase * self._transform(block, row, -omega + orders * turning)
            total += ahead.sum(axis=0) + behind[orders[:, 0] > 0].conj().sum(axis=0)
        return np.asarray((1j * omega) ** derivative * total)

    def _blocks(self) -> Iterator[slice]:
        for start in range(0, self.modes.orders.size, ORDERS_AT_ONCE):
            yield slice(start, start + ORDERS_AT_ONCE)

    def _shift(self, block: slice) -> Array:
        """Rate nΩ at which a force in space turns on the tyre, per order."""
        held = require_frame(self.forced.frame) * self.forced.speed_rad_s
        return np.asarray(self.modes.orders[block] * held)

    def _load(self, block: slice) -> Complex:
        """Momentum per area on each harmonic, [q_r, q_θ], N·s/m²."""
        ring = self.forced.ring
        area = 2.0 * np.pi * ring.mean_radius_m * belt_width_m(ring)
        start = np.exp(-1j * self.modes.orders[block] * self.cleat.contact_rad) / area
        blow = np.array([self.cleat.radial_n_s, self.cleat.circumferential_n_s])
        return np.asarray(start[:, None] * blow)

    def _coordinates(self, block: slice, times: Array) -> Complex:
        """Coordinate of each pole over time for unit drive, shape (n_orders, 4, n_times)."""
        poles = self.modes.poles[block][:, :, None]
        if self.cleat.duration_s == 0:
            return np.asarray(np.exp(poles * times))
        during = np.minimum(times, self.cleat.duration_s)
        blow = self.cleat.through(1j * self._shift(block)[:, None, None], poles, during)
        return np.asarray(blow * np.exp(poles * (times - during)))

    def _amplitudes(
        self, block: slice, row: int, derivative: int, turning: float, times: Array
    ) -> Complex:
        """a_n or b_n, differentiated for an observer who turns by `turning` against the tyre."""
        load = self._load(block)
        drive = np.einsum("nkj,nj->nk", self.modes.drive[block], load)
        coordinates = drive[:, :, None] * self._coordinates(block, times)
        shapes, poles = self.modes.shapes[block], self.modes.poles[block]
        x = np.einsum("nk,nkt->nt", shapes[:, row], coordinates)
        if derivative == 0:
            return np.asarray(x)
        carried = -1j * self.modes.orders[block, None] * turning
        v = np.einsum("nk,nkt->nt", shapes[:, row + 2], coordinates)
        if derivative == 1:
            return np.asarray(v + carried * x)
        a = np.einsum("nk,nkt->nt", shapes[:, row + 2] * poles, coordinates)
        blow = np.exp(1j * self._shift(block)[:, None] * times) * self.cleat.unit_force(times)
        a = a + load[:, row, None] / self.modes.mass_per_area_kg_m2 * blow
        return np.asarray(a + 2.0 * carried * v + carried**2 * x)

    def _transform(self, block: slice, row: int, omega: Array) -> Complex:
        """Fourier transform of a_n or b_n at `omega` on the tyre, shape (n_orders, n_lines)."""
        drive = np.einsum("nkj,nj->nk", self.modes.drive[block], self._load(block))
        weight = (self.modes.shapes[block][:, row] * drive)[:, :, None]
        poles = self.modes.poles[block][:, :, None]
        receptance = (weight / (1j * omega[:, None, :] - poles)).sum(axis=1)
        length, shift = np.asarray(self.cleat.duration_s), self._shift(block)[:, None] - omega
        blow = self.cleat.through(1j * shift, np.zeros(1, dtype=complex), length) if length else 1.0
        return np.asarray(receptance * blow)


def _component_and_derivative(direction: str, quantity: str) -> tuple[int, int]:
    """Row of the amplitude in the state, and how often it is differentiated."""
    require_one_of("direction", direction, get_args(Direction))
    require_one_of("quantity", quantity, get_args(Quantity))
    return get_args(Direction).index(direction), get_args(Quantity).index(quantity)


@dataclass(frozen=True, eq=False)
class HarmonicModes(ReadonlyArrays):
    """First-order form of the equations of each harmonic n ≥ 0: amplitudes a_n(t), b_n(t).

    ρh·ẍ + (C + G)ẋ + Kx = q(t) for x = [a_n, b_n], with K = [[m11, ic], [−ic, m22]],
    G = 2ρhΩ·[[0, −1], [1, 0]] and damping C. Order −n is the complex conjugate of n.
    """

    orders: NDArray[np.int_]  # 0 … N
    poles: Complex  # rad/s, (n_orders, 4)
    shapes: Complex  # eigenvectors of the state [a, b, ȧ, ḃ] as columns, (n_orders, 4, 4)
    drive: Complex  # share of a load per area [q_r, q_θ] in each pole, (n_orders, 4, 2)
    mass_per_area_kg_m2: float


def harmonic_modes(forced: ForcedRing) -> HarmonicModes:
    """Solve the eigenproblem of every harmonic 0 … N of a stable ring on a fixed hub.

    Hysteretic damping has no causal counterpart in time. The belt's loss is taken as viscous here,
    C = C_bed + η·K''/ω̄_n, equal to the loss factor at the natural frequency ω̄_n of the order.
    """
    if forced.wheel is not None:
        raise ParameterError("wheel", "free", "the hub must be fixed", "Leave the wheel out")
    orders = np.arange(forced.highest_order + 1)
    rho = forced.ring.mass_per_area_kg_m2
    stiffness, damping = _stiffness_and_damping(forced, orders)
    damping[:, 0, 1] -= 2.0 * rho * forced.speed_rad_s
    damping[:, 1, 0] += 2.0 * rho * forced.speed_rad_s
    state = np.zeros((orders.size, 4, 4), dtype=complex)
    state[:, :2, 2:] = np.eye(2)
    state[:, 2:, :2] = -stiffness / rho
    state[:, 2:, 2:] = -damping / rho
    poles, shapes = np.linalg.eig(state)
    growth = poles.real.max(axis=1)
    worst = int(np.argmax(growth))
    if growth[worst] > 1e-6 * np.abs(poles[worst]).max():
        where, found = f"order {orders[worst]}", f"grows by {growth[worst]:.4g} 1/s"
        remedy = "Lower the speed or raise the foundation stiffness"
        raise InstabilityError(where, found, "the response of an unstable ring grows", remedy)
    shapes = shapes.astype(complex)
    drive = np.asarray(np.linalg.inv(shapes)[:, :, 2:] / rho, dtype=complex)
    return HarmonicModes(orders, poles.astype(complex), shapes, drive, rho)


def _stiffness_and_damping(forced: ForcedRing, orders: NDArray[np.int_]) -> tuple[Complex, Complex]:
    """Undamped K, and C with the equivalent viscous loss of the belt, shape (n_orders, 2, 2)."""
    terms = forced.terms(orders)
    ring, speed = forced.ring, forced.speed_rad_s
    natural = np.abs(characteristic_roots(ring, orders, speed, pressure_load=forced.load).real)
    radial = np.where(orders == 0, natural[:, 2], 0.5 * (natural[:, 0] + natural[:, 1]))
    around = np.where(orders == 0, natural[:, 0], radial)
    loss = _matrix(terms.m11.imag, terms.m22.imag, terms.c.imag)
    for row, frequency in ((0, radial), (1, around)):
        moving = frequency > 0
        loss[:, row] *= np.where(moving, 1.0 / np.where(moving, frequency, 1.0), 0.0)[:, None]
    bed = np.diag([forced.damping.radial_n_s_m3, forced.damping.circumferential_n_s_m3])
    return _matrix(terms.m11.real, terms.m22.real, terms.c.real), bed + loss


def _matrix(m11: Array, m22: Array, c: Array) -> Complex:
    matrix = np.empty((m11.size, 2, 2), dtype=complex)
    matrix[:, 0, 0], matrix[:, 1, 1] = m11, m22
    matrix[:, 0, 1], matrix[:, 1, 0] = 1j * c, -1j * c
    return matrix


def exponential_convolution(exponent: Complex, poles: Complex, times_s: Array) -> Complex:
    """∫₀ᵗ e^{s(t−τ)} e^{pτ} dτ = (e^{pt} − e^{st})/(p − s), also where p and s meet.

    Arguments are p and s in 1/s and t ≥ 0 in s, of shapes that broadcast; the result is in s.
    """
    z = (exponent - poles) * times_s
    close, decay = np.abs(z) < 1.0, np.exp(poles * times_s)
    near = np.where(close & (z != 0), z, 1.0)
    together = times_s * decay * np.where(z == 0, 1.0, np.expm1(near) / near)
    apart = np.where(close, 1.0, exponent - poles)
    return np.asarray(np.where(close, together, (np.exp(exponent * times_s) - decay) / apart))
