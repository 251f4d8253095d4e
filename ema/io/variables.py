"""Variables of MATLAB and HDF5 files: arrays as columns, rates and starts by their names."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Finding
from ema.core.recording import ACCELERATION, FORCE
from ema.core.units import FREQUENCY, NAMES_KEPT, TIME, AxisUnit, is_stated, parse_axis, parse_unit
from ema.io.columns import Column, name_and_unit
from ema.io.content import EXPORT_AGAIN, left_out, not_together
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

_SLOW_SHARE = 0.25  # of the longest channel, which slower ones beside it have at most


def are_slow(lengths: Sequence[int], units: Sequence[str]) -> list[bool]:
    """Which series are slow channels beside a recording; a force or an acceleration is none.

    Those of the longest one's length are the recording, if there are at least two.
    """
    longest = max(lengths, default=0)
    known = [parse_unit(unit) for unit in units]
    wanted = [unit is not None and unit.quantity in (FORCE, ACCELERATION) for unit in known]
    is_recording = list(lengths).count(longest) > 1
    return [
        is_recording and n <= _SLOW_SHARE * longest and not is_wanted
        for n, is_wanted in zip(lengths, wanted, strict=True)
    ]


def without_complex(
    path: Path, columns: Sequence[Column]
) -> tuple[list[Column], tuple[Finding, ...]]:
    """Columns of real numbers, and findings about others: complex ones need frequencies."""
    complex_ones = [each.name for each in columns if each.samples.dtype.kind == "c"]
    reason = "complex numbers without a vector of frequencies"
    real = [each for each in columns if each.samples.dtype.kind != "c"]
    if not real and complex_ones:
        rule = "FRFs need their frequencies, in a vector such as frequency"
        found = f"{', '.join(complex_ones)} (complex numbers)"
        raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    return real, left_out(path, dict.fromkeys(complex_ones, reason))


def matrix_columns(
    where: str, matrix: NDArray[Any], names: Sequence[str], units: Sequence[str]
) -> list[Column]:
    """Split a matrix, (n_samples, n_channels) or the other way round, into its channels.

    Names may have the unit in square brackets. Their number shows which side counts the channels;
    without names, the shorter one does. `units` are one for each channel, one for all, or none.
    """
    rows, columns = matrix.shape
    n_channels = len(names) or min(rows, columns)
    if rows == columns or n_channels not in (rows, columns):
        found = f"a matrix of {rows} × {columns} and {len(names)} names"
        rule = "one side must be the samples, the other the channels, with a name for each channel"
        raise RecordingFormatError(where, found, rule, "Give as many names as channels")
    signals = matrix.T if columns == n_channels else matrix
    labels = names or [f"channel {number}" for number in range(1, n_channels + 1)]
    columns = []
    for label, unit, samples in zip(
        labels, unit_of_each(where, n_channels, units), signals, strict=True
    ):
        name, own = name_and_unit(label)
        matrix_name = where.rpartition(", ")[2].rpartition("/")[2]
        columns.append(Column(name, unit or own, samples, matrix=matrix_name))
    return columns


def unit_of_each(where: str, n_channels: int, units: Sequence[str]) -> list[str]:
    """Unit of each channel, from a list of as many, of one for all, or of none."""
    if len(units) not in (0, 1, n_channels):
        found = f"{len(units)} units for {n_channels} channels"
        rule = "there must be one unit for each channel, or one for all"
        raise RecordingFormatError(where, found, rule, "Correct the list of units")
    stated = [unit.strip() for unit in units] or [""]
    return stated if len(stated) == n_channels else stated * n_channels


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
