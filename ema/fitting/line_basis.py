"""Functions of the lines around a resonance: what holds every pole near, beside the background."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ema.core.numerics import readonly
from ema.fitting.variable_projection import Complex, Real

_DIMENSIONS = 20  # hold every pole near the resonance to 3e-4
_KEPT = 64  # of the last lines and poles


@lru_cache(maxsize=_KEPT)
def near_pole(lines_hz: bytes, start: complex) -> tuple[Real, Complex]:
    """Background of lines around a pole, ω² and 1, and what holds every pole near beside that.

    Orthonormal columns and rows. The same lines are fitted again and again: with what is known of
    the other orders, and against each force.
    """
    omega, size, ratio = 2 * np.pi * np.frombuffer(lines_hz), abs(start), -start.real / abs(start)
    ground = np.linalg.qr(np.vander(omega / size, 3)[:, ::2])[0]
    frequencies = size * (1 + ratio * np.linspace(-2.5, 2.5, 9))
    widths = np.array([0.4, 0.7, 1.0, 1.5, 2.2])
    poles = np.array([f * (-ratio * w + 1j) for f in frequencies for w in widths])
    functions = above_ground(ground, alone(omega, poles))
    functions /= np.linalg.norm(functions, axis=1, keepdims=True)
    above = min(_DIMENSIONS, omega.size - 2)  # the rest is background
    span = np.linalg.svd(functions, full_matrices=False)[2][:above]
    return readonly(ground), readonly(span, complex)


def above_ground(ground: Real, values: Complex) -> Complex:
    """Rows of values without the background."""
    return np.asarray(values - (values @ ground) @ ground.T)


def alone(omega: Real, poles: Complex) -> Complex:
    """FRFs of single poles, (n_poles, n_lines)."""
    away = 1j * omega - poles[:, None], 1j * omega - poles.conj()[:, None]
    return np.asarray(omega**2 / (away[0] * away[1]))
