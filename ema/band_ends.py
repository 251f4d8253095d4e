"""How much the modes depend on where the band ends: what error bars do not hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.pole_fit import N_STAND_INS, Lines, PoleFit

# Share of the lines that is left out at one end.
_TRIM = 0.06


def band_shift(
    fit: PoleFit, refit: Callable[[Lines, NDArray[np.complex128]], PoleFit]
) -> NDArray[np.float64]:
    """Largest change of each pole when the fit loses lines at either end of the band.

    Parameters
    ----------
    fit : PoleFit
        Its last pole is the stand-in for modes above the band.
    refit : callable
        Fits lines from start poles.

    Returns
    -------
    ndarray, shape (n_modes, 2)
        Changes of frequency in Hz and of damping ratio; NaN for poles next to the ends.
    """
    n_lines = fit.lines.frequency_hz.size
    cut = int(_TRIM * n_lines)
    shifts = [_shift(fit, refit, kept) for kept in (slice(cut, n_lines), slice(0, n_lines - cut))]
    stacked = np.abs(np.stack(shifts))
    known = np.isfinite(stacked)
    largest = np.max(np.where(known, stacked, 0.0), axis=0)
    return np.asarray(np.where(known.any(axis=0), largest, np.nan))


def _shift(
    fit: PoleFit, refit: Callable[[Lines, NDArray[np.complex128]], PoleFit], kept: slice
) -> NDArray[np.float64]:
    lines = replace(
        fit.lines,
        frequency_hz=fit.lines.frequency_hz[kept],
        values=fit.lines.values[:, kept],
        weight=fit.lines.weight[kept],
        importance=fit.lines.importance[kept],
    )
    poles = fit.poles[:-N_STAND_INS]
    frequency_hz, half_width_hz = np.abs(poles) / (2 * np.pi), -poles.real / (2 * np.pi)
    low, high = lines.frequency_hz[[0, -1]]
    inside = (frequency_hz - low > half_width_hz) & (high - frequency_hz > half_width_hz)
    shift = np.full((fit.poles.size, 2), np.nan)
    if not np.any(inside):
        return shift
    again = refit(lines, poles[inside]).poles[:-N_STAND_INS]
    rows = np.flatnonzero(inside)
    shift[rows, 0] = np.abs(again) / (2 * np.pi) - frequency_hz[inside]
    shift[rows, 1] = again.real / -np.abs(again) - poles[inside].real / -np.abs(poles[inside])
    return shift
