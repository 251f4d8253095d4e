"""Harmonics of the ring as systems in time: poles, shapes and their answer to exponentials."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.arrays import readonly
from model.coefficients import characteristic_roots
from model.errors import InstabilityError, ParameterError
from model.transfer import Complex, ForcedRing


@dataclass(frozen=True, eq=False)
class HarmonicModes:
    """First-order form of the equations of each harmonic n ≥ 0: amplitudes a_n(t), b_n(t).

    ρh·ẍ + (C + G)ẋ + Kx = q(t) for x = [a_n, b_n], with K = [[m11, ic], [−ic, m22]],
    G = 2ρhΩ·[[0, −1], [1, 0]] and damping C.

    Parameters
    ----------
    orders : ndarray of int, shape (n_orders,)
        Orders 0 … N; −n is the complex conjugate.
    poles : ndarray of complex, shape (n_orders, 4)
        s, rad/s.
    shapes : ndarray of complex, shape (n_orders, 4, 4)
        Columns are eigenvectors of the state [a, b, ȧ, ḃ].
    drive : ndarray of complex, shape (n_orders, 4, 2)
        Share of a load per area, [q_r, q_θ], in each pole's coordinate.
    mass_per_area_kg_m2 : float
        ρh.
    """

    orders: NDArray[np.int_]
    poles: Complex
    shapes: Complex
    drive: Complex
    mass_per_area_kg_m2: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "orders", readonly(self.orders, int))
        for name in ("poles", "shapes", "drive"):
            object.__setattr__(self, name, readonly(getattr(self, name), complex))


def harmonic_modes(forced: ForcedRing) -> HarmonicModes:
    """Solve the eigenproblem of every harmonic of a ring on a fixed hub.

    Hysteretic damping has no causal counterpart in time. The belt's loss is taken as viscous here,
    C = C_bed + η·K''/ω̄_n, equal to the loss factor at the natural frequency ω̄_n of the order.

    Parameters
    ----------
    forced : ForcedRing
        Ring, damping, speed and highest order.

    Returns
    -------
    HarmonicModes
        For orders 0 … N.

    Raises
    ------
    ParameterError
        For a free wheel.
    InstabilityError
        Where a harmonic grows in time.
    """
    if forced.wheel is not None:
        raise ParameterError(
            "wheel", "free", "the response in time is for a fixed hub", "Leave the wheel out"
        )
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
    _require_stable(orders, poles)
    shapes = shapes.astype(complex)
    drive = np.asarray(np.linalg.inv(shapes)[:, :, 2:] / rho, dtype=complex)
    return HarmonicModes(orders, poles.astype(complex), shapes, drive, rho)


def _stiffness_and_damping(forced: ForcedRing, orders: NDArray[np.int_]) -> tuple[Complex, Complex]:
    """Undamped K, and C with the equivalent viscous loss of the belt, shape (n_orders, 2, 2)."""
    terms = forced.terms(orders)
    natural = np.abs(
        characteristic_roots(
            forced.ring, orders, forced.speed_rad_s, pressure_load=forced.load
        ).real
    )
    radial = np.where(orders == 0, natural[:, 2], 0.5 * (natural[:, 0] + natural[:, 1]))
    around = np.where(orders == 0, natural[:, 0], radial)
    loss = _matrix(terms.m11.imag, terms.m22.imag, terms.c.imag)
    for row, frequency in ((0, radial), (1, around)):
        moving = frequency > 0
        loss[:, row] *= np.where(moving, 1.0 / np.where(moving, frequency, 1.0), 0.0)[:, None]
    bed = np.diag([forced.damping.radial_n_s_m3, forced.damping.circumferential_n_s_m3])
    return _matrix(terms.m11.real, terms.m22.real, terms.c.real), bed + loss


def _matrix(m11: NDArray[np.float64], m22: NDArray[np.float64], c: NDArray[np.float64]) -> Complex:
    matrix = np.empty((m11.size, 2, 2), dtype=complex)
    matrix[:, 0, 0], matrix[:, 1, 1] = m11, m22
    matrix[:, 0, 1], matrix[:, 1, 0] = 1j * c, -1j * c
    return matrix


def _require_stable(orders: NDArray[np.int_], poles: Complex) -> None:
    growth = poles.real.max(axis=1)
    worst = int(np.argmax(growth))
    if growth[worst] > 1e-6 * np.abs(poles[worst]).max():
        raise InstabilityError(
            f"order {orders[worst]}",
            f"grows by {growth[worst]:.4g} 1/s",
            "an unstable ring has no response that decays",
            "Lower the speed or raise the foundation stiffness",
        )


def exponential_convolution(
    exponent: Complex, poles: Complex, times_s: NDArray[np.float64]
) -> Complex:
    """∫₀ᵗ e^{s(t−τ)} e^{pτ} dτ = (e^{pt} − e^{st})/(p − s), also where p and s meet.

    Parameters
    ----------
    exponent, poles : ndarray of complex
        p and s, 1/s, of shapes that broadcast with `times_s`.
    times_s : ndarray
        t ≥ 0, s.

    Returns
    -------
    ndarray of complex
        In the broadcast shape, s.
    """
    argument = (exponent - poles) * times_s
    close = np.abs(argument) < 1e-2
    z = np.where(close, argument, 0.0)
    series = 1.0 + z * (0.5 + z * (1 / 6 + z * (1 / 24 + z * (1 / 120 + z * (1 / 720 + z / 5040)))))
    decay = np.exp(poles * times_s)
    apart = np.where(close, 1.0, exponent - poles)
    return np.asarray(
        np.where(close, times_s * decay * series, (np.exp(exponent * times_s) - decay) / apart)
    )
