"""Columns of a table as channels of a recording: which are axes, where each channel starts."""

from __future__ import annotations

import math
import re
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import UNKNOWN, Channel, Recording
from ema.core.units import (
    FREQUENCY,
    NAMES_KEPT,
    TIME,
    is_stated,
    parse_axis,
    parse_ratio,
    parse_unit,
    unit_in_name,
)
from ema.io.content import (
    EXPORT_AGAIN,
    FileContent,
    left_out,
    not_together,
    note,
    point_of,
    remark,
    stated_windows,
)
from ema.io.rates import (
    FASTEST_HZ,
    SAME_RATE,
    UNSTATED,
    Rate,
    agreed,
    aligned,
    count_of_dates,
    even_step,
    likeliest,
    rate_findings,
    rate_of_stamps,
    uneven,
)

_TIME_NAMES = {
    *("t", "time", "zeit", "timestamp", "time stamp", "x_value", "x value"),
    *("elapsed time", "uhrzeit", "temps", "tid", "tiempo", "tempo"),
}
_TIME_WORD = re.compile(r"(?:^|[^a-z])(?:time|zeit|timestamp|temps|tiempo|tempo)(?:[^a-z]|$)")
_DATE_NAMES = {"date", "datum", "datetime", "date time", "date/time", "datum/zeit"}
_FREQUENCY = re.compile(r"freq|(?<![a-z])(?:f|hz)(?![a-z])")
_SPECTRUM = re.compile(r"(?<![^\W_])(?:fft|psd|spectrum|spektrum)(?![^\W_])", re.IGNORECASE)
# A unit of time or frequency behind a name: time_ms, Zeit in ms, TimeUs, omega_rad_s.
_UNITS_BEHIND = tuple(
    re.compile(rf"(?P<stem>.+){between}(?P<unit>{unit})")
    for between, unit in (
        (r"[\s_.,/:-]", r"[A-Za-z]+[/_][a-z]+"),
        (r"[\s_.,/:-]", r"[A-Za-zµμ]+"),
        (r"(?<=[a-z])(?=[A-Z])", r"[A-Za-z]+"),
    )
)
_LABEL = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?$", re.DOTALL)
_FEWEST_OF_AXIS = 16  # rows below which numbers may rise evenly by chance
_SLOWEST_HZ = 50.0  # of what may be a time beside another source; angles rise more slowly
_FIRST_ROWS = 64  # that tell a signal from an axis without a look at all of it


@dataclass(frozen=True, eq=False)
class Column:
    """A named column of numbers."""

    name: str  # without the unit
    unit: str  # as the file states it; empty where it states none
    samples: NDArray[Any]  # integers or floats, at best a memory map; NaN where missing
    place: str = ""  # in the file, which becomes the name of a channel whose name repeats
    start_s: float = 0.0  # of the first sample, as the file states it
    matrix: str = ""  # that it is a column of


@lru_cache(NAMES_KEPT)
def name_and_unit(label: str) -> tuple[str, str]:
    """Split a heading such as ``"A01 [m/s^2]"``; the unit is empty where there is none."""
    match = _LABEL.match(label.strip())
    return (match["name"], (match["unit"] or "").strip()) if match else (label.strip(), "")


def is_time(name: str, unit: str) -> bool:
    """Whether a column of this name and unit contains time stamps."""
    name, unit = label_of_axis(name, unit)
    return name.lower() in _TIME_NAMES and _seconds(unit) is not None


@lru_cache(NAMES_KEPT)
def label_of_axis(name: str, unit: str = "") -> tuple[str, str]:
    """Name and unit of an axis, whose unit may be the end of its name, as in ``time_ms``."""
    for form in () if is_stated(unit) else _UNITS_BEHIND:
        match = form.fullmatch(name)
        if match is not None and parse_axis(text := match["unit"].replace("_", "/")) is not None:
            return re.sub(r"[\s_]+in$", "", match["stem"]).rstrip(" _.,/:-"), text
    return name, unit


def _seconds(unit: str) -> float | None:
    """Seconds in a unit of time, which is s where none is stated; None for other units."""
    axis = parse_axis(unit)
    if axis is None:
        return None if is_stated(unit) else 1.0
    return axis.factor if axis.kind == TIME else None


def content_of_columns(
    path: Path,
    columns: Sequence[Column],
    *,
    rate: Rate = UNSTATED,
    findings: Sequence[Finding] = (),
    statements: Mapping[str, object] | None = None,
) -> FileContent:
    """Channels and sampling rate of a table, with the findings of its reader.

    `statements` are entries of headers, which may name windows and triggers.

    Columns of time give the rate and the start of the channels that follow them; it has to agree
    with `rate`, what the file states apart from any column. Other columns that rise evenly are
    axes too, and no channels. `RecordingFormatError` if no column is a channel, columns differ in
    length, time is uneven, or channels start at times that do not fit together.
    """
    noticed = list(findings)
    columns = [_with_unit_of_time(each) for each in columns]
    axes = _axes(path, columns, rate, noticed)
    spectral = _behind_frequencies(columns, axes)
    reasons = {columns[at].name: "behind a column of frequencies" for at in spectral}
    noticed += left_out(path, reasons)
    signals = [
        (at, column) for at, column in enumerate(columns) if at not in axes and at not in spectral
    ]
    _check_columns(path, columns, [column for _, column in signals])
    times = {at: axis for at, axis in axes.items() if axis is not None}
    for at, axis in times.items():
        rate = agreed(path, rate, axis.rate) if at == min(times) else _same(path, rate, axis)
    if len(times) > 1:
        _check_all_are_used(path, times, {_place_of_axis(times, at) for at, _ in signals})
    noticed += rate_findings(path, rate)
    repeated = Counter(column.name for _, column in signals)
    channels = [_channel(path, each, repeated[each.name] > 1, noticed) for _, each in signals]
    own = [(column, _axis_of(times, at)) for at, column in signals]
    starts_s = [column.start_s + axis.start_s for column, axis in own]
    lengths = [axis.n_samples or len(column.samples) for column, axis in own]
    together = aligned(path, channels, starts_s, rate.hz, noticed, lengths)
    recording = Recording(path, rate.hz, together, (rate.low_hz, rate.high_hz))
    windows, ignored = stated_windows(path, statements or {})
    return FileContent(path, recording, findings=(*noticed, *ignored), windows=windows)


def _with_unit_of_time(column: Column) -> Column:
    """The unit of a time that ends its name, or is all of it."""
    unit = _unit_of_time(column.name, column.unit)
    return column if unit == column.unit else replace(column, unit=unit)


@lru_cache(NAMES_KEPT)
def _unit_of_time(name: str, stated: str) -> str:
    stem, unit = label_of_axis(name, stated)
    is_named = stem.lower() in _TIME_NAMES or _TIME_WORD.search(stem.lower()) is not None
    return unit if is_named and not is_stated(stated) else stated


@lru_cache(NAMES_KEPT)
def _is_spectrum(name: str) -> bool:
    return _SPECTRUM.search(name) is not None


@dataclass(frozen=True)
class _Axis:
    """A column of time: its rate, first time, and number of times."""

    name: str
    rate: Rate = UNSTATED
    start_s: float = 0.0
    n_samples: int = 0


def _place_of_axis(times: Mapping[int, _Axis], at: int) -> int:
    """The last axis in front of a column, else the first of all."""
    return max((place for place in times if place < at), default=min(times))


_ONLY_AXIS = _Axis("")


def _axis_of(times: Mapping[int, _Axis], at: int) -> _Axis:
    """Axis of a column; starts count from the first axis."""
    if len(times) < 2:
        return _ONLY_AXIS
    axis, first = times[_place_of_axis(times, at)], times[min(times)]
    return replace(axis, start_s=axis.start_s - first.start_s)


def _check_all_are_used(path: Path, times: Mapping[int, _Axis], used: set[int]) -> None:
    """Refuse a time with no channel behind it, if it starts within that of the channels."""
    for at, axis in times.items():
        apart_s = {abs(axis.start_s - times[other].start_s) for other in used - {at}}
        span_s = axis.n_samples / axis.rate.hz
        if at not in used and any(0.0 < each < span_s for each in apart_s):
            found = f"{axis.name!r}: a time of its own, without a channel behind it"
            rule = "of several different times, each must stand in front of its channels"
            raise RecordingFormatError(path.name, found, rule, "Reorder the columns")


def _same(path: Path, rate: Rate, axis: _Axis) -> Rate:
    """The common rate; refuses another axis of time at a different one."""
    if axis.rate.allows(rate.hz):
        return rate
    found = f"{rate.hz:g} Hz by the first column of time, {axis.rate.hz:g} Hz by {axis.name!r}"
    raise not_together(path, found)


def _axes(
    path: Path, columns: Sequence[Column], rate: Rate, findings: list[Finding]
) -> dict[int, _Axis | None]:
    """Columns of time by their place, and None for others that only count."""
    named = [is_time(column.name, column.unit) for column in columns]
    ramps = {
        at: _seconds(column.unit) if named[at] else None
        for at, column in enumerate(columns)
        if named[at]
        or _is_date(column)
        or (not parse_unit(column.unit) and rises_evenly(column.samples))
    }
    for at, factor in ramps.items():
        ramps[at] = factor or _seconds_of_ramp(path, columns[at], rate, any(named), findings)
        named[at] = bool(ramps[at])
    found: dict[int, _Axis | None] = {}
    for at, factor in ramps.items():
        if not factor:
            found[at] = None
            continue
        samples = columns[at].samples
        same = (
            f for other, f in found.items() if f and np.array_equal(columns[other].samples, samples)
        )
        found[at] = next(same, None) or _time_axis(
            path, columns[at], factor, findings, is_only=sum(named) < 2
        )
    return found


def _behind_frequencies(columns: Sequence[Column], axes: Mapping[int, _Axis | None]) -> set[int]:
    """Columns of a spectrum beside a recording: the last axis in front of them is its lines."""
    lines = {at for at, axis in axes.items() if axis is None and _are_lines(columns[at])}
    if not lines or not any(axes.values()):
        return set()
    last = {at: max((each for each in axes if each < at), default=-1) for at in range(len(columns))}
    return {at for at, axis in last.items() if axis in lines and at not in axes}


def _are_lines(column: Column) -> bool:
    """Whether an axis has frequencies from zero or the first line on; a sweep begins higher."""
    name, unit = label_of_axis(column.name.lower(), column.unit)
    axis = parse_axis(unit)
    is_frequency = axis.kind == FREQUENCY if axis else _FREQUENCY.search(name) is not None
    return is_frequency and abs(column.samples[0]) < 1.5 * (column.samples[1] - column.samples[0])


def _time_axis(
    path: Path, column: Column, seconds: float, findings: list[Finding], *, is_only: bool
) -> _Axis:
    """Rate, start and length by a column of time; one of several may be shorter than others."""
    stamps = np.asarray(column.samples, dtype=np.float64)
    stamps = stamps if is_only else _filled(stamps)
    count, factor = ("", 1.0) if is_stated(column.unit) else count_of_dates(stamps)
    if count:
        seconds = factor
        detail = f"{column.name!r} is {stamps[0]:.10g} at its beginning: taken as {count}"
        findings.append(note(path, Check.SAMPLING_RATE, detail))
    stamps = stamps if seconds == 1.0 else stamps * seconds
    rate = rate_of_stamps(stamps, f"column {column.name!r}")
    if rate is None:
        rule = "time is not at equal steps, and spectra need a constant sampling rate"
        remedy = "Look for dropped samples, or resample"
        where = f"{path.name}, column {column.name!r}"
        raise RecordingFormatError(where, uneven(stamps), rule, remedy)
    if rate.hz > FASTEST_HZ and not is_stated(column.unit):
        rule = f"without a unit it is in s, which gives {rate.hz:.6g} Hz"
        where, remedy = f"{path.name}, column {column.name!r}", "Write its unit, as in 'time [ms]'"
        raise RecordingFormatError(where, f"times {stamps[1] - stamps[0]:.6g} apart", rule, remedy)
    return _Axis(column.name, rate, float(stamps[0]), len(stamps))


def rises_evenly(samples: NDArray[Any]) -> bool:
    """Whether a column counts or tells the time, whatever its name: no signal rises evenly."""
    if samples.dtype.kind not in "iuf" or len(samples) < _FEWEST_OF_AXIS:
        return False
    few = samples[:_FEWEST_OF_AXIS].tolist()
    if any(later < earlier for earlier, later in pairwise(few)):  # most signals
        return False
    first = np.array(samples[:_FIRST_ROWS], dtype=np.float64)
    if (first[1:] < first[:-1]).any():
        return False
    first = _filled(first)
    if not (np.all(np.diff(first) >= 0) and first[-1] > first[0] and even_step(first)):
        return False
    return even_step(_filled(np.asarray(samples, dtype=np.float64))) is not None


def _is_date(column: Column) -> bool:
    """Whether a column is a date by its name, whatever counts it."""
    return column.name.lower() in _DATE_NAMES and not is_stated(column.unit)


def _filled(stamps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Times without the empty cells at the end of a column that is shorter than others."""
    return stamps[: int(np.flatnonzero(np.isfinite(stamps)).max(initial=-1)) + 1 or len(stamps)]


def _seconds_of_ramp(
    path: Path, column: Column, stated: Rate, has_time: bool, findings: list[Finding]
) -> float:
    """Seconds in the unit of a column that rises evenly; 0 for what is no time, with a finding."""
    stamps = _filled(np.asarray(column.samples, dtype=np.float64))
    steps = even_step(stamps)
    if _is_date(column):
        if steps is not None and count_of_dates(stamps)[0] and not has_time:
            return 1.0  # of which the count is told from the size
        detail = f"{column.name!r} is a date by its name and no sensor; left out"
        findings.append(note(path, Check.IGNORED, detail))
        return 0.0
    seconds = _seconds(column.unit)
    is_named = _TIME_WORD.search(column.name.lower()) is not None
    if not is_stated(column.unit) and (bare := _seconds(column.name)):
        return bare  # called by its unit alone
    if seconds and (is_stated(column.unit) or is_named):
        return seconds
    if is_named or column.name.lower() in _TIME_NAMES:
        rule = "a column of time must be in s, ms, us, ns, min or h"
        where = f"{path.name}, column {column.name!r}"
        raise RecordingFormatError(where, f"unit {column.unit!r}", rule, EXPORT_AGAIN)
    assert steps is not None
    rises = f"rises evenly by {steps.step:.6g} and is no sensor"
    rate = likeliest(
        steps.inverse * (1 - SAME_RATE), steps.inverse * (1 + SAME_RATE), steps.inverse, ""
    )
    has_other = has_time or not math.isnan(stated.hz)  # with which it is compared
    least_hz = _SLOWEST_HZ if has_other else 1.0
    if not (steps.inverse > least_hz and rate.is_sure) or is_stated(column.unit):
        detail = f"{column.name!r} {rises}; left out"
        findings.append(note(path, Check.IGNORED, detail))
        return 0.0
    if not has_other:
        detail = f"{column.name!r} {rises}; taken as time in s, which gives {rate.hz:.10g} Hz"
        findings.append(note(path, Check.SAMPLING_RATE, detail))
    return 1.0


def _check_columns(path: Path, columns: Sequence[Column], signals: Sequence[Column]) -> None:
    if not signals:
        found = f"columns {', '.join(column.name for column in columns) or 'none'}"
        rule = "at least one column must be a channel"
        raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    frf = next((column for column in signals if parse_ratio(column.unit)), None)
    if frf is not None:
        rule = "samples of FRFs must stand behind their frequencies, as real and imaginary part"
        remedy = "Call the columns Frequency [Hz], 'H1 real', 'H1 imag', or export a universal file"
        raise RecordingFormatError(path.name, f"{frf.name!r} in {frf.unit}", rule, remedy)
    first = columns[0]
    n_samples = len(first.samples)
    for column in columns:
        if (n := len(column.samples)) != n_samples and not column.start_s and not first.start_s:
            found = f"{n_samples} samples of {first.name!r}, {n} of {column.name!r}"
            raise not_together(path, found)
    if not n_samples:
        rule = "a recording must contain samples"
        raise RecordingFormatError(path.name, "no rows of numbers", rule, EXPORT_AGAIN)


def _channel(path: Path, column: Column, is_repeated: bool, findings: list[Finding]) -> Channel:
    name = column.place if column.place and is_repeated else column.name
    name = unicodedata.normalize("NFC", name)  # umlauts as manifests are read
    text = column.unit
    if not is_stated(text) and (text := unit_in_name(name)):
        detail = f"unit {text!r} by the end of the name"
        findings.append(Finding(path.name, name, None, Check.UNIT, Verdict.OK, detail))
    if (unit := parse_unit(text)) is None and is_stated(text):
        findings.append(remark(path, name, Check.UNIT, f"unit {text!r} is not known"))
    if _is_spectrum(name):
        findings.append(
            remark(path, name, Check.CONTENT, "a spectrum by its name, read as samples")
        )
    column.samples.setflags(write=False)
    quantity, factor = (UNKNOWN, 1.0) if unit is None else (unit.quantity, unit.factor)
    node, sense, axis, _ = point_of(name) or (None, 1, 0, "")
    scale = sense * factor
    return Channel(name, quantity, text, column.samples, scale_to_si=scale, node=node, axis=axis)
