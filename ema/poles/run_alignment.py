"""Alignment of the FRFs of several runs to a common state before pole estimation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.core.frf import FRF
from ema.poles.lsce import impulse_responses, normal_matrix, poles_of_order, useful_length

# A model order that shows every strong mode of a run and few others.
_ORDER = 30
_NEAR = 0.01
# A shift is undone where it is this many times larger than its own scatter over the modes.
_CLEAR = 3.0


def align_runs(frf: FRF, lines: slice) -> NDArray[np.complex128]:
    """FRFs of some lines, each run's stretched to the natural frequencies of the first run.

    A drift of temperature or pressure moves all frequencies of a run together; seen in one
    diagram, every mode would appear several times. What is undone here only serves the search for
    poles: the curve fit estimates the drift with its uncertainty from the FRFs as measured.

    Parameters
    ----------
    frf : FRF
    lines : slice
        Lines to use.

    Returns
    -------
    ndarray of complex, shape (n_positions, n_lines)
    """
    values = np.array(frf.values[:, lines])
    names = frf.run_names
    if len(names) < 2:
        return values
    frequency_hz = frf.frequency_hz[lines]
    run = np.array([names.index(name) for name in frf.run])
    poles = [_strong_poles(frequency_hz, values[run == number]) for number in range(len(names))]
    for number in range(1, len(names)):
        shift, scatter = _shift(poles[0], poles[number])
        if abs(shift) > _CLEAR * scatter:
            rows = run == number
            values[rows] = stretched(frequency_hz, values[rows], 1 + shift)
    return values


def _strong_poles(
    frequency_hz: NDArray[np.float64], values: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    responses, step_s = impulse_responses(frequency_hz, values)
    order = min(_ORDER, responses.shape[1] // 4)
    length = useful_length(responses, shortest=3 * order)
    matrix = normal_matrix(responses[:, 1:length], order)
    poles = poles_of_order(matrix, order, step_s, frequency_hz[0])
    damping = -poles.real / np.abs(poles)
    return np.asarray(poles[(damping > 0) & (damping < 0.2)])


def _shift(first: NDArray[np.complex128], other: NDArray[np.complex128]) -> tuple[float, float]:
    """Median relative shift of the poles that two runs share, and its standard deviation."""
    if not (first.size and other.size):
        return 0.0, np.inf
    ratio = np.abs(other)[None, :] / np.abs(first)[:, None] - 1
    distance = np.abs(other[None, :] - first[:, None]) / np.abs(first)[:, None]
    mutual = distance.argmin(axis=0)[distance.argmin(axis=1)] == np.arange(first.size)
    pairs = np.flatnonzero(mutual & (distance.min(axis=1) < _NEAR))
    if pairs.size < 3:
        return 0.0, np.inf
    shifts = ratio[pairs, distance.argmin(axis=1)[pairs]]
    median = float(np.median(shifts))
    spread = 1.48 * float(np.median(np.abs(shifts - median)))
    return median, spread / np.sqrt(pairs.size)


def stretched(
    frequency_hz: NDArray[np.float64], values: NDArray[np.complex128], factor: float
) -> NDArray[np.complex128]:
    """FRFs whose natural frequencies are `factor` too high, on the lines of the right ones."""
    # Slow to load, and needed only where a tyre drifts.
    from scipy.interpolate import CubicSpline

    within = np.clip(frequency_hz * factor, frequency_hz[0], frequency_hz[-1])
    return np.asarray(CubicSpline(frequency_hz, values, axis=1)(within))
