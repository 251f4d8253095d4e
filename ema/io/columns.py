"""Columns of a table as channels of a recording, and sampling rates from printed time steps."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding
from ema.core.recording import UNKNOWN, Channel, Recording
from ema.core.units import is_stated, parse_unit
from ema.io.content import EXPORT_AGAIN, FileContent, remark

_TIME_NAMES = {
    *("t", "time", "zeit", "timestamp", "time stamp", "x_value", "x value"),
    *("elapsed time", "uhrzeit", "temps", "tid", "tiempo", "tempo"),
}
_SECONDS = dict.fromkeys(("", "s", "sec", "secs", "second", "seconds", "sekunden"), 1.0)
_SECONDS |= {"ms": 1e-3, "msec": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6}
_LABEL = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?$", re.DOTALL)
_RATES = {
    *("fs", "fsamp", "fsample", "rate", "samplefrequency", "samplerate"),
    *("samplingfrequency", "samplingrate"),
}
_STEPS = {"dt", "deltat", "sampleinterval", "samplinginterval", "timestep", "wfincrement"}

_MOST_DIGITS = 7  # a plain number has no more
_SENSELESS = 1e100  # beyond any time or frequency; NaN and infinity are too
_PIECE = 1 << 16  # values of a long column that are looked at together
_UNEVEN = 0.2  # of a step: a single dropped sample deviates by at least half a step
SAME_RATE = 1e-4  # relative, of a stated rate and that of a rounded time column
_SAME_STATEMENT = 1e-6  # relative, of two stated rates
_EXACT = 1e-9  # relative, of the step of a long column in double precision
_ROUNDING = 1e-12  # relative, of a step kept in double precision


@dataclass(frozen=True, eq=False)
class Column:
    """A named column of numbers."""

    name: str  # without the unit
    unit: str  # as the file states it; empty where it states none
    samples: NDArray[Any]  # integers or floats, at best a memory map; NaN where missing
    place: str = ""  # in the file, which becomes the name of a channel whose name repeats


def name_and_unit(label: str) -> tuple[str, str]:
    """Split a heading such as ``"A01 [m/s^2]"``; the unit is empty where there is none."""
    match = _LABEL.match(label.strip())
    return (match["name"], (match["unit"] or "").strip()) if match else (label.strip(), "")


def is_time(name: str, unit: str) -> bool:
    """Whether a column of this name and unit contains time stamps."""
    return name.lower() in _TIME_NAMES and unit.lower() in _SECONDS


def content_of_columns(
    path: Path,
    columns: Sequence[Column],
    *,
    rate_hz: float = math.nan,
    findings: Sequence[Finding] = (),
) -> FileContent:
    """Channels and sampling rate of a table, with the findings of its reader.

    A column ``time`` or ``t`` gives the rate; it has to agree with `rate_hz`, the rate that the
    file states apart from any column (NaN where it states none). `RecordingFormatError` if no
    column is a channel, columns differ in length, or time is uneven.
    """
    times = [column for column in columns if is_time(column.name, column.unit)][:1]
    signals = [column for column in columns if column not in times]
    _check_columns(path, columns, signals)
    if times:
        rate_hz = _rate_of_column(path, times[0], rate_hz)
    noticed = list(findings)
    repeated = Counter(column.name for column in signals)
    channels = tuple(_channel(path, each, repeated[each.name] > 1, noticed) for each in signals)
    return FileContent(path, Recording(path, rate_hz, channels), findings=tuple(noticed))


def _check_columns(path: Path, columns: Sequence[Column], signals: Sequence[Column]) -> None:
    if not signals:
        found = f"columns {', '.join(column.name for column in columns) or 'none'}"
        rule = "at least one column must be a channel"
        raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    first = columns[0]
    n_samples = len(first.samples)
    for column in columns:
        if (n := len(column.samples)) != n_samples:
            found = f"{n_samples} samples of {first.name!r}, {n} of {column.name!r}"
            raise not_together(path, found)
    if not n_samples:
        rule = "a recording must contain samples"
        raise RecordingFormatError(path.name, "no rows of numbers", rule, EXPORT_AGAIN)


def not_together(path: Path, found: str) -> RecordingFormatError:
    """The error about channels of one file that differ in length, rate or time."""
    rule = "channels of one run must be sampled together, at one rate and equally long"
    remedy = "Export them together, or in separate files"
    return RecordingFormatError(path.name, found, rule, remedy)


def _channel(path: Path, column: Column, is_repeated: bool, findings: list[Finding]) -> Channel:
    name = column.place if column.place and is_repeated else column.name
    unit = parse_unit(column.unit)
    if unit is None and is_stated(column.unit):
        findings.append(remark(path, name, Check.UNIT, f"unit {column.unit!r} is not known"))
    column.samples.setflags(write=False)
    quantity, factor = (UNKNOWN, 1.0) if unit is None else (unit.quantity, unit.factor)
    return Channel(name, quantity, column.unit, column.samples, scale_to_si=factor)


def _rate_of_column(path: Path, time: Column, stated: float) -> float:
    """Rate by the time column; a rate that the file states beside it must be the same."""
    stamps = np.asarray(time.samples, dtype=np.float64) * _SECONDS[time.unit.lower()]
    steps = even_step(stamps)
    where = f"{path.name}, column {time.name!r}"
    if steps is None:
        rule = "time is not at equal steps, and spectra need a constant sampling rate"
        remedy = "Look for dropped samples, or resample"
        raise RecordingFormatError(where, uneven(stamps), rule, remedy)
    if abs(steps[1] - stated) > SAME_RATE * stated:
        found = f"{stated:g} Hz stated, {steps[1]:g} Hz by the time column"
        raise RecordingFormatError(where, found, "a recording has one sampling rate", EXPORT_AGAIN)
    return steps[1]


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
        columns.append(Column(name, unit or own, samples))
    return columns


def unit_of_each(where: str, n_channels: int, units: Sequence[str]) -> list[str]:
    """Unit of each channel, from a list of as many, of one for all, or of none."""
    if len(units) not in (0, 1, n_channels):
        found = f"{len(units)} units for {n_channels} channels"
        rule = "there must be one unit for each channel, or one for all"
        raise RecordingFormatError(where, found, rule, "Correct the list of units")
    stated = [unit.strip() for unit in units] or [""]
    return stated if len(stated) == n_channels else stated * n_channels


def parse_number(text: str) -> float:
    """Read a Fortran real, such as ``1.5D-03`` or ``1.5-103``; ValueError for other texts."""
    plain = text.strip().upper().replace("D", "E")
    if "_" in plain or not plain.isascii():
        raise ValueError(f"{text!r} is not a number")
    sign = max(plain.rfind("+"), plain.rfind("-"))
    if sign > 0 and plain[sign - 1] != "E" and "." in plain[:sign]:
        plain = f"{plain[:sign]}E{plain[sign:]}"
    return float(plain)


def plainest(value: float, tolerance: float) -> tuple[float, int]:
    """Number with the fewest significant digits within `tolerance` of `value`, and their number."""
    for digits in range(1, _MOST_DIGITS + 1):
        candidate = float(f"{value:.{digits - 1}e}")
        if abs(candidate - value) <= tolerance:
            return candidate, digits
    return value, _MOST_DIGITS + 1


def step_and_inverse(printed: str) -> tuple[float, float]:
    """Step and its inverse, from a step printed with few digits, e.g. ``"1.52588E-05"``.

    Six digits of 1/65536 s give 65535.95 Hz. Usually either the step or its inverse is a plain
    number; the one with fewer digits within the last printed place is taken as exact. ValueError
    for other texts than positive numbers.
    """
    step = parse_number(printed)
    if not 0.0 < step < math.inf or not 0.0 < 1.0 / step < math.inf:
        raise ValueError(f"{printed!r} is not a positive step")
    mantissa = printed.strip().upper().replace("D", "E").partition("E")[0]
    digits = len(mantissa.replace(".", "").strip("+-0"))
    last_place = 10.0 ** -len(mantissa.partition(".")[2]) / parse_number(mantissa)
    inverse, inverse_digits = plainest(1.0 / step, last_place / step)
    return (1.0 / inverse, inverse) if inverse_digits <= digits else (step, 1.0 / step)


def even_step(abscissa: NDArray[np.float64]) -> tuple[float, float] | None:
    """Step and its inverse of rounded times or frequencies; None where they are not equidistant."""
    if len(abscissa) < 2 or not -_SENSELESS < np.min(abscissa) <= np.max(abscissa) < _SENSELESS:
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
    tolerance = max(2.0 * deviation / span, _EXACT)
    plain_step, step_digits = plainest(step, tolerance * step)
    inverse, inverse_digits = plainest(1.0 / step, tolerance / step)
    if inverse_digits <= step_digits:
        return 1.0 / inverse, inverse
    return plain_step, 1.0 / plain_step


def uneven(stamps: NDArray[np.float64]) -> str:
    """Where time stamps that `even_step` refused leave their even steps."""
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


def states_rate(name: str) -> bool:
    """Whether a variable or attribute of this name states a sampling rate or a time step."""
    return plain_name(name) in _RATES | _STEPS


def stated_rate(path: Path, statements: Mapping[str, object]) -> float:
    """Sampling rate in Hz that all statements agree on; NaN where there is none.

    `statements` are numbers, texts or arrays of one number by name, perhaps with their place
    before a last slash. Names that do not state a rate are skipped.
    """
    rates = {
        place: _stated(f"{path.name}, {place}", name, value)
        for place, value in statements.items()
        if states_rate(name := place.rpartition("/")[2])
    }
    first, rate = next(iter(rates.items()), ("", math.nan))
    for place, other in rates.items():
        if abs(other - rate) > _SAME_STATEMENT * rate:
            raise not_together(path, f"{rate:g} Hz by {first!r}, {other:g} Hz by {place!r}")
    return rate


def plain_name(name: str) -> str:
    """A name without case, separators and its unit Hz."""
    return re.sub(r"[_\s-]", "", name.lower()).removesuffix("hz")


def _stated(where: str, name: str, value: Any) -> float:
    try:
        number = value.item() if isinstance(value, np.ndarray | np.generic) else value
        text = number.decode("latin-1") if isinstance(number, bytes) else number
        rate = float(text.strip().removesuffix("Hz") if isinstance(text, str) else text)
        if plain_name(name) not in _RATES:
            rate = plainest(1.0 / rate, _ROUNDING / rate)[0]
    except (ArithmeticError, TypeError, ValueError):
        rate = math.nan
    if 0.0 < rate < math.inf:
        return rate
    rule = "a sampling rate in Hz or a time step in s must be one positive number"
    raise RecordingFormatError(where, repr(str(value)[:40]), rule, EXPORT_AGAIN)
