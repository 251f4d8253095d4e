"""Sampling rates from printed steps and time stamps, which are rounded."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ema.io.uff58_header import parse_number

_MOST_DIGITS = 7
_SENSELESS = 1e100  # beyond any time or frequency; NaN and infinity are too
_PIECE = 1 << 16
_UNEVEN = 0.2  # of a step: a single dropped sample deviates by at least half a step


def plainest(value: float, tolerance: float) -> tuple[float, int]:
    """Find the number with the fewest significant digits within `tolerance` of `value`.

    Returns
    -------
    tuple of float and int
        The number and how many digits it takes; `value` itself where none is plain.
    """
    for digits in range(1, _MOST_DIGITS + 1):
        candidate = float(f"{value:.{digits - 1}e}")
        if abs(candidate - value) <= tolerance:
            return candidate, digits
    return value, _MOST_DIGITS + 1


def step_and_inverse(printed: str) -> tuple[float, float]:
    """Step and its inverse, from a step printed with few digits.

    Six digits of 1/65536 s give 65535.95 Hz. Either the step or its inverse is a plain number
    as a rule; the one with fewer digits within the last printed place is taken as exact.

    Parameters
    ----------
    printed : str
        E.g. ``"1.52588E-05"``.

    Raises
    ------
    ValueError
        If it is no positive number whose inverse is one too.
    """
    step = parse_number(printed)
    if not 0.0 < step < math.inf or not 0.0 < 1.0 / step < math.inf:
        raise ValueError(f"{printed!r} is not a positive step")
    mantissa = printed.strip().upper().replace("D", "E").partition("E")[0]
    decimals = len(mantissa.partition(".")[2])
    digits = len(mantissa.replace(".", "").strip("+-0")) or 1
    last_place = 10.0**-decimals / max(abs(parse_number(mantissa)), 10.0**-decimals)
    inverse, inverse_digits = plainest(1.0 / step, last_place / step)
    if inverse_digits <= digits:
        return 1.0 / inverse, inverse
    return step, 1.0 / step


def even_step(abscissa: NDArray[np.float64]) -> tuple[float, float] | None:
    """Step and its inverse of values that should be equidistant; None where they are not.

    Parameters
    ----------
    abscissa : ndarray, shape (n,)
        Times or frequencies, as rounded by whoever printed them.
    """
    extremes = (
        (float(np.min(abscissa)), float(np.max(abscissa))) if len(abscissa) > 1 else (np.nan,)
    )
    if not max(abs(extreme) for extreme in extremes) < _SENSELESS:
        return None
    span = float(abscissa[-1] - abscissa[0])
    if not span > 0.0:
        return None
    step = span / (len(abscissa) - 1)
    deviation = 0.0
    for begin in range(0, len(abscissa), _PIECE):  # long columns are not doubled in memory
        piece = abscissa[begin : begin + _PIECE]
        ideal = abscissa[0] + step * np.arange(begin, begin + len(piece))
        deviation = max(deviation, float(np.max(np.abs(piece - ideal))))
    if not deviation <= _UNEVEN * step or not 1.0 / step < math.inf:
        return None
    tolerance = max(2.0 * deviation / span, 1e-9)
    plain_step, step_digits = plainest(step, tolerance * step)
    inverse, inverse_digits = plainest(1.0 / step, tolerance / step)
    if inverse_digits <= step_digits:
        return 1.0 / inverse, inverse
    return plain_step, 1.0 / plain_step


def jump(stamps: NDArray[np.float64]) -> str:
    """Say where time stamps leave their even steps, for a message.

    Parameters
    ----------
    stamps : ndarray, shape (n,)
        Time in s that `even_step` refused.
    """
    if len(stamps) < 2:
        return f"{len(stamps)} time stamp"
    missing = np.flatnonzero(~np.isfinite(stamps))
    if missing.size:
        return f"no time in row {missing[0] + 1} of {len(stamps)}"
    steps = np.diff(stamps)
    usual = float(np.median(steps))
    row = int(np.argmax(np.abs(steps - usual)))
    return (
        f"time goes from {stamps[row]:g} s to {stamps[row + 1]:g} s at row {row + 2} "
        f"of {len(stamps)}, elsewhere in steps of {usual:g} s"
    )
