"""Sampling rates that files state beside their samples, under the names that labs use."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ema.errors import RecordingFormatError
from ema.io.columns import EXPORT_AGAIN
from ema.io.sampling import plainest

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
    rule = "a sampling rate in Hz or a time step in s is one positive number"
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
