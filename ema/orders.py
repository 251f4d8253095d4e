"""One circumferential order at a time: nearly single-mode FRFs, and what they say by themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.circumference import circle_basis, highest_order
from ema.errors import FitError
from ema.frf import FRF
from ema.pole_fit import Lines, PoleFit, fit_poles
from ema.variable_projection import Complex, Real

# Half-widths of a resonance that its own fit looks at, and the fewest lines for it.
_REACH = 6.0
_FEWEST_LINES = 12


@dataclass(frozen=True, eq=False)
class OrderFrf:
    """The part of the FRFs that goes with cos nθ and sin nθ.

    Parameters
    ----------
    order : int
    frequency_hz : ndarray, shape (n_frequencies,)
    values : ndarray of complex, shape (2, n_frequencies)
        Amplitudes of cos nθ and sin nθ; one row for n = 0.
    std : ndarray, shape (2, n_frequencies)
        Standard deviation per quadrature.
    """

    order: int
    frequency_hz: Real
    values: Complex
    std: Real


class OrderDecomposition:
    """FRFs of a circle of positions, resolved into circumferential orders.

    The spatial Fourier transform where the positions are complete and equidistant, least squares
    where some are missing.

    Parameters
    ----------
    frf : FRF
        With angles.
    """

    def __init__(self, frf: FRF) -> None:
        self._frf = frf
        self.highest = highest_order(frf.position_deg)
        self._inverse = np.linalg.pinv(circle_basis(frf.position_deg, self.highest))

    def order(
        self, order: int, lines: slice | NDArray[np.int_], values: Complex | None = None
    ) -> OrderFrf:
        """Resolve one order from the FRFs, or from other `values` on the same lines."""
        rows = self._inverse[[0]] if order == 0 else self._inverse[2 * order - 1 : 2 * order + 1]
        measured = self._frf.values[:, lines] if values is None else values
        variance = np.square(rows) @ np.square(self._frf.std[:, lines])
        return OrderFrf(order, self._frf.frequency_hz[lines], rows @ measured, np.sqrt(variance))


def fit_order(
    order: OrderFrf, start: Complex, *, damping_reach: float = 4.0, tries: int = 30
) -> PoleFit:
    """Fit the poles of one order to its own FRFs, around their resonance.

    Parameters
    ----------
    order : OrderFrf
    start : ndarray of complex, shape (n_modes,)
        One pole, or the two of a pair.
    damping_reach : float
        Factor within which the damping stays around the start.
    tries : int
        Most steps of the search.

    Raises
    ------
    FitError
        If too few lines lie around the resonance.
    """
    centre_hz = float(np.mean(np.abs(start))) / (2 * np.pi)
    half_width_hz = float(np.max(-start.real)) / (2 * np.pi)
    spread_hz = float(np.ptp(np.abs(start))) / (2 * np.pi)
    near = np.abs(order.frequency_hz - centre_hz) < _REACH * half_width_hz + spread_hz
    if np.count_nonzero(near) < _FEWEST_LINES:
        raise FitError(f"only {np.count_nonzero(near)} lines around order {order.order}.")
    level = np.sqrt(np.mean(order.std[:, near] ** 2, axis=1))
    known = bool(np.all(np.isfinite(level)) and np.all(level > 0))
    lines = Lines(
        frequency_hz=order.frequency_hz[near],
        values=order.values[:, near],
        weight=np.ones(np.count_nonzero(near)),
        scale=1 / level if known else np.ones(level.size),
        run=np.zeros(level.size, dtype=int),
        importance=np.ones(np.count_nonzero(near)),
    )
    decay, frequency = -start.real, start.imag
    lower = np.column_stack([decay / damping_reach, frequency - 2 * decay]).ravel()
    upper = np.column_stack([decay * damping_reach, frequency + 2 * decay]).ravel()
    return fit_poles(lines, start, lower, upper, tries=tries)
