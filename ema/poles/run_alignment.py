"""Alignment of the FRFs of several runs to a common state before pole estimation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.core.frf import FRF
from ema.poles.estimators import impulse_responses, normal_matrix, poles_of_order, useful_length

# A model order that shows every strong mode of a run and few others.
_ORDER = 30
_NEAR = 0.01
# A shift is undone where it is this many times larger than its own scatter over the modes.
_CLEAR = 3.0


def align_runs(frf: FRF, lines: slice) -> NDArray[np.complex128]:
    """FRFs of some lines, each run's stretched to the natural frequencies of the first run.

    A drift of temperature or pressure moves all frequencies of a run together; seen in one diagram,
    every mode would appear several times. What is undone here only serves the search for poles: the
    curve fit estimates the drift with its uncertainty from the FRFs as measured.
    """
    values = np.array(frf.values[:, lines])
    names = frf.run_names
    if len(names) < 2:
        return values
    frequency_hz = frf.frequency_hz[lines]
    run = np.array([names.index(name) for name in frf.run])
    poles = [_strong_poles(frequency_hz, values[run == number]) for number in range(len(names))]
    middle = 2 * np.pi * float(np.sqrt(max(frequency_hz[0], 1.0) * frequency_hz[-1]))
    for number in range(1, len(names)):
        shift = _shift(poles[0], poles[number], middle)
        if np.any(shift):
            rows = run == number
            lever = (middle / (2 * np.pi * np.maximum(frequency_hz, frequency_hz[0] or 1.0))) ** 2
            values[rows] = stretched(
                frequency_hz, values[rows], 1 + shift[0] + shift[1] * (lever - 1)
            )
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


def _shift(
    first: NDArray[np.complex128], other: NDArray[np.complex128], middle: float
) -> NDArray[np.float64]:
    """Relative shift of the poles that two runs share and its slope over (middle/ω)² − 1.

    The slope is only used where it is clear; zeros where nothing is.
    """
    nothing = np.zeros(2)
    if not (first.size and other.size):
        return nothing
    ratio = np.abs(other)[None, :] / np.abs(first)[:, None] - 1
    distance = np.abs(other[None, :] - first[:, None]) / np.abs(first)[:, None]
    mutual = distance.argmin(axis=0)[distance.argmin(axis=1)] == np.arange(first.size)
    pairs = np.flatnonzero(mutual & (distance.min(axis=1) < _NEAR))
    if pairs.size < 3:
        return nothing
    shifts = ratio[pairs, distance.argmin(axis=1)[pairs]]
    lever = (middle / np.abs(first[pairs])) ** 2 - 1
    for columns in (2, 1):
        basis = np.stack([np.ones(pairs.size), lever], axis=1)[:, :columns]
        if pairs.size < columns + 3:
            continue
        fitted, scatter = _robust_line(basis, shifts)
        if abs(fitted[-1]) > _CLEAR * scatter[-1]:
            return np.asarray(np.append(fitted, np.zeros(2 - columns)))
    return nothing


def _robust_line(
    basis: NDArray[np.float64], shifts: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least absolute deviations by reweighting, with standard deviations from the median one."""
    weight = np.ones(shifts.size)
    for _ in range(20):
        root = np.sqrt(weight)
        fitted = np.linalg.lstsq(root[:, None] * basis, root * shifts, rcond=None)[0]
        left = np.abs(shifts - basis @ fitted)
        weight = 1 / np.maximum(left, 1e-7)
    spread = 1.48 * float(np.median(left))
    inverse = np.linalg.pinv(basis.T @ basis)
    return np.asarray(fitted), spread * np.sqrt(np.diag(inverse))


def stretched(
    frequency_hz: NDArray[np.float64],
    values: NDArray[np.complex128],
    factor: NDArray[np.float64] | float,
) -> NDArray[np.complex128]:
    """FRFs whose natural frequencies are `factor` too high, on the lines of the right ones.

    A factor may be given for each line.
    """
    # Slow to load, and needed only where a tyre drifts.
    from scipy.interpolate import CubicSpline

    within = np.clip(frequency_hz * factor, frequency_hz[0], frequency_hz[-1])
    return np.asarray(CubicSpline(frequency_hz, values, axis=1)(within))
