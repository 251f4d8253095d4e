"""Sampling rates from printed steps and time stamps, which are rounded."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.io.content import EXPORT_AGAIN
from ema.io.uff.dataset58_header import parse_number

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


_RATES = {
    "fs",
    "fsamp",
    "fsample",
    "rate",
    "samplefrequency",
    "samplerate",
    "samplingfrequency",
    "samplingrate",
}
_STEPS = {"dt", "deltat", "sampleinterval", "samplinginterval", "timestep", "wfincrement"}
_ROUNDING = 1e-12  # relative, of a step kept in double precision
_AGREE = 1e-6


def states_rate(name: str) -> bool:
    """Whether a variable or attribute of this name states a sampling rate or a time step."""
    return _plain(name) in _RATES | _STEPS


def stated_rate(path: Path, statements: Mapping[str, object]) -> float:
    """Sampling rate in Hz that all statements agree on; NaN where there is none.

    Parameters
    ----------
    path : Path
    statements : mapping
        Values (numbers, texts or arrays of one number) by name; what stands before the last slash
        tells where it was found. Names that state no rate are passed over.

    Raises
    ------
    RecordingFormatError
        If a rate or step is not a positive number, or two of them disagree.
    """
    rates = {
        place: _rate(f"{path.name}, {place}", place, value)
        for place, value in statements.items()
        if states_rate(_name(place))
    }
    if not rates:
        return float("nan")
    first, rate = next(iter(rates.items()))
    for place, other in rates.items():
        if abs(other - rate) > _AGREE * rate:
            found = f"{rate:g} Hz by {first!r}, {other:g} Hz by {place!r}"
            rule = "channels of one run are sampled together, at one rate"
            remedy = "Export them together, or in files of their own"
            raise RecordingFormatError(path.name, found, rule, remedy)
    return rate


def _name(place: str) -> str:
    return place.rpartition("/")[2]


def _plain(name: str) -> str:
    return re.sub(r"[_\s-]", "", name.lower()).removesuffix("hz")


def _rate(where: str, place: str, value: object) -> float:
    number = _number(value)
    rate = number if _plain(_name(place)) in _RATES else _inverse(number)
    if 0.0 < rate < math.inf:
        return rate
    shown = str(value)[:40]
    rule = "a sampling rate in Hz or a time step in s must be one positive number"
    raise RecordingFormatError(where, repr(shown), rule, EXPORT_AGAIN)


def _number(value: object) -> float:
    if isinstance(value, bytes):
        value = value.decode("latin-1")
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    try:
        if isinstance(value, str):
            return float(value.strip().removesuffix("Hz"))
        is_real = isinstance(value, int | float | np.integer | np.floating)
        return float(value) if is_real else math.nan  # type: ignore[arg-type]
    except (ValueError, OverflowError, TypeError):
        return math.nan


def _inverse(step: float) -> float:
    if not 0.0 < step < math.inf or math.isinf(1.0 / step):
        return math.nan
    return plainest(1.0 / step, _ROUNDING / step)[0]
