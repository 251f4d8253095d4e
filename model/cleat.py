"""The cleat test: a short blow at the contact of the rolling tyre, in time and frequency."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import finite_array
from model.errors import ParameterError
from model.forced import Direction
from model.ring import belt_width_m
from model.rotation import Frame, require_frame
from model.transfer import Complex, ForcedRing, angular_frequency
from model.transient import HarmonicModes, exponential_convolution, harmonic_modes

#: What is read at the response point: u, its first or its second derivative in time.
Quantity = Literal["displacement", "velocity", "acceleration"]

_DERIVATIVE = {"displacement": 0, "velocity": 1, "acceleration": 2}
_ORDERS_AT_ONCE = 16


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
        if self.duration_s < 0:
            raise ParameterError(
                "duration_s", f"{self.duration_s:g}", "zero or longer", "Correct the duration"
            )

    @property
    def exponents(self) -> tuple[tuple[complex, complex], ...]:
        """Half-sine of unit momentum as exponentials: pairs of factor and exponent, 1/s."""
        rate = math.pi / self.duration_s
        factor = rate / 2.0 / 2.0j
        return (factor, 1j * rate), (-factor, -1j * rate)

    def unit_force(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
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
        The ring on a fixed hub, with belt width. Its frame says where the force stays during the
        blow: on the tread that it hits ("rotating") or in space ("absolute").
    cleat : Cleat
        The blow.
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
    ) -> NDArray[np.float64]:
        """Response in time, exact for the harmonics summed: no time steps.

        Parameters
        ----------
        times_s : array_like, shape (n_times,)
            Times from the start of the blow, s; zero before it.
        response_rad : float
            Angle of the point, rad: θ on the tyre, or φ in space.
        frame : {"rotating", "absolute"}
            Whether the point stays on the tyre or in space; derivatives are taken there.
        direction : {"radial", "circumferential"}
            Component of the displacement.
        quantity : {"displacement", "velocity", "acceleration"}
            m, m/s or m/s². The infinite acceleration during an ideal impulse is left out.

        Returns
        -------
        ndarray, shape (n_times,)
            The response.
        """
        times = np.atleast_1d(finite_array("times_s", times_s))
        row, derivative = _component(direction), _derivative(quantity)
        turning = require_frame(frame) * self.forced.speed_rad_s
        after = np.maximum(times, 0.0)
        total = np.zeros(times.size)
        for block in self._blocks():
            series = self._amplitudes(block, row, derivative, turning, after)
            angle = response_rad - turning * after
            phase = np.exp(1j * self.modes.orders[block, None] * angle)
            total += _both_signs(self.modes.orders[block]) @ (series * phase).real
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
        row, derivative = _component(direction), _derivative(quantity)
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
        for start in range(0, self.modes.orders.size, _ORDERS_AT_ONCE):
            yield slice(start, start + _ORDERS_AT_ONCE)

    def _shift(self, block: slice) -> NDArray[np.float64]:
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

    def _coordinates(self, block: slice, times: NDArray[np.float64]) -> Complex:
        """Coordinate of each pole over time for unit drive, shape (n_orders, 4, n_times)."""
        poles = self.modes.poles[block][:, :, None]
        if self.cleat.duration_s == 0:
            return np.asarray(np.exp(poles * times))
        during = np.minimum(times, self.cleat.duration_s)
        shift = self._shift(block)[:, None, None]
        (rise, up), (fall, down) = self.cleat.exponents
        during_blow = rise * exponential_convolution(up + 1j * shift, poles, during)
        during_blow += fall * exponential_convolution(down + 1j * shift, poles, during)
        return np.asarray(during_blow * np.exp(poles * (times - during)))

    def _amplitudes(
        self,
        block: slice,
        row: int,
        derivative: int,
        turning: float,
        times: NDArray[np.float64],
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

    def _transform(self, block: slice, row: int, omega: NDArray[np.float64]) -> Complex:
        """Fourier transform of a_n or b_n at `omega` on the tyre, shape (n_orders, n_lines)."""
        drive = np.einsum("nkj,nj->nk", self.modes.drive[block], self._load(block))
        weight = (self.modes.shapes[block][:, row] * drive)[:, :, None]
        poles = self.modes.poles[block][:, :, None]
        receptance = (weight / (1j * omega[:, None, :] - poles)).sum(axis=1)
        return np.asarray(receptance * self._blow_spectrum(omega - self._shift(block)[:, None]))

    def _blow_spectrum(self, omega: NDArray[np.float64]) -> Complex:
        """Fourier transform of the blow of unit momentum."""
        if self.cleat.duration_s == 0:
            return np.ones(omega.shape, dtype=complex)
        length = np.asarray(self.cleat.duration_s)
        zero = np.zeros(1, dtype=complex)
        (rise, up), (fall, down) = self.cleat.exponents
        first = exponential_convolution(up - 1j * omega, zero, length)
        second = exponential_convolution(down - 1j * omega, zero, length)
        return np.asarray(rise * first + fall * second)


def _both_signs(orders: NDArray[np.int_]) -> NDArray[np.float64]:
    """Weights of Re a_n e^{inθ}: −n is the conjugate of n, so it counts twice."""
    return np.where(orders == 0, 1.0, 2.0)


def _component(direction: str) -> int:
    known = ("radial", "circumferential")
    if direction not in known:
        raise ParameterError("direction", f"{direction!r}", f"one of {known}", "Choose one")
    return known.index(direction)


def _derivative(quantity: str) -> int:
    if quantity not in _DERIVATIVE:
        raise ParameterError(
            "quantity", f"{quantity!r}", f"one of {', '.join(_DERIVATIVE)}", "Choose one"
        )
    return _DERIVATIVE[quantity]
