"""Rates and starts that variables and attributes of a file state, by their names."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ema.core.errors import RecordingFormatError
from ema.core.units import FREQUENCY, NAMES_KEPT, TIME, AxisUnit, is_stated, parse_axis
from ema.io.content import EXPORT_AGAIN, not_together
from ema.io.rates import (
    FEWEST_DIGITS,
    MOST_DIGITS,
    ROUNDING,
    UNSTATED,
    Rate,
    exact_rate,
    is_possible,
    plainest,
    rate_of_step,
)

_RATES = {
    *("fs", "fsamp", "fsample", "rate", "samplefrequency", "samplerate"),
    *("samplingfrequency", "samplingrate"),
}
# Of a first sample: seconds, or a date and time in ISO 8601.
_STARTS = {"t0", "x0", "starttime", "startvalue", "wfstarttime", "wfstartoffset", "timeoffset"}
_STARTS |= {"start", "starts", "tstart", "begin", "firstsample", "delay", "latency", "lag"}
_DELAYS = {"delay", "latency", "lag"}  # later or earlier: nobody says
_STEPS = {"dt", "deltat", "sampleinterval", "samplinginterval", "timestep", "wfincrement"}

# The unit of a rate beside it: fs_unit, fsUnit; and behind its number: 2.048 kHz.
_UNIT_OF = re.compile(r"[\s_-]*[Uu]nits?$")
_AMOUNT = re.compile(r"\s*([-+0-9.eEdD]+)\s*([A-Za-zµμ][A-Za-z/]*)?\s*")
_SAME_STATEMENT = 1e-6  # relative, of two stated rates


@lru_cache(NAMES_KEPT)
def states_rate(name: str) -> bool:
    """Whether a variable or attribute states a sampling rate, a time step, or the unit of one."""
    return plain_name(_UNIT_OF.sub("", name)) in _RATES | _STEPS


def stated_rate(path: Path, statements: Mapping[str, object]) -> Rate:
    """Sampling rate that all statements agree on; without a value where there is none.

    `statements` are numbers, texts or arrays of one number by name, perhaps with their place
    before a last slash. Names that do not state a rate are skipped.
    """
    stated = {k: v for k, v in statements.items() if states_rate(k.rpartition("/")[2])}
    units = {_UNIT_OF.sub("", k): _text(v) for k, v in stated.items() if _UNIT_OF.search(k)}
    rates = [
        _stated(path, place, value, units.get(place, ""))
        for place, value in stated.items()
        if not _UNIT_OF.search(place)
    ]
    first = min(rates, key=lambda each: each.high_hz - each.low_hz, default=UNSTATED)
    for other in rates:
        is_within = other.is_open and other.allows(first.hz)
        if abs(other.hz - first.hz) > _SAME_STATEMENT * first.hz and not is_within:
            found = f"{first.hz:g} Hz by {first.source}, {other.hz:g} Hz by {other.source}"
            raise not_together(path, found)
    return first


def _text(value: object) -> str:
    stated = value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
    return stated.decode("latin-1") if isinstance(stated, bytes) else str(stated)


def states_start(name: str) -> bool:
    """Whether a variable or attribute of this name states when a channel starts."""
    return plain_name(name) in _STARTS


def stated_start_s(path: Path, statements: Mapping[str, object]) -> float:
    """Start of a channel by what is stated of it, by place; 0 where nothing states it."""
    start_s = 0.0
    for place, value in statements.items():
        if not states_start(place.rpartition("/")[2]):
            continue
        if plain_name(place.rpartition("/")[2]) in _DELAYS:
            rule = "channels differ in it, and a delay may count either way"
            remedy = "State t0, the time of the first sample, or export them aligned"
            raise RecordingFormatError(f"{path.name}, {place}", f"{value}", rule, remedy)
        stated = value.item() if isinstance(value, np.ndarray | np.generic) else value
        text = stated.decode("latin-1") if isinstance(stated, bytes) else str(stated)
        try:
            start_s += _seconds(text)
        except ValueError:
            rule = "a start must be a number of seconds, or date and time as in ISO 8601"
            where = f"{path.name}, {place}"
            raise RecordingFormatError(where, repr(text[:40]), rule, EXPORT_AGAIN) from None
    return start_s


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        return datetime.fromisoformat(text).timestamp()
    if not math.isfinite(seconds):
        raise ValueError(text)
    return seconds


@lru_cache(NAMES_KEPT)
def plain_name(name: str) -> str:
    """A name without case, separators and its unit Hz."""
    return re.sub(r"[_\s-]", "", name.lower()).removesuffix("hz")


def _stated(path: Path, place: str, value: Any, unit: str) -> Rate:
    is_step = plain_name(place.rpartition("/")[2]) not in _RATES
    kind = TIME if is_step else FREQUENCY
    try:
        number = value.item() if isinstance(value, np.ndarray | np.generic) else value
        text = number.decode("latin-1") if isinstance(number, bytes) else number
        if isinstance(text, str) and (match := _AMOUNT.fullmatch(text)):
            text, unit = match[1], match[2] or unit
        axis = parse_axis(unit) if is_stated(unit) else AxisUnit(kind, 1.0)
        factor = axis.factor if axis is not None and axis.kind == kind else math.nan
        if is_step and isinstance(text, str):
            return rate_of_step(text, repr(place), factor)
        hz = float(text)
        if is_step and FEWEST_DIGITS <= plainest(hz, ROUNDING * hz)[1] < MOST_DIGITS:
            return rate_of_step(f"{hz:.{MOST_DIGITS}g}", repr(place), factor)  # as typed
        hz = plainest(1.0 / (hz * factor), ROUNDING / hz)[0] if is_step else hz * factor
    except (ArithmeticError, TypeError, ValueError):
        hz = math.nan
    if is_possible(hz):
        return exact_rate(hz, repr(place))
    rule = "a sampling rate in Hz or a time step in s must be one positive number"
    found = f"{str(value)[:40]!r} {unit}".rstrip()
    raise RecordingFormatError(f"{path.name}, {place}", found, rule, EXPORT_AGAIN)
