"""Columns of a table, whatever the format it was stored in, as channels of a recording."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.errors import RecordingFormatError
from ema.io.content import FileContent, remark
from ema.io.sampling import even_step, jump
from ema.io.units import is_stated, parse_unit
from ema.quality import Finding
from ema.recording import UNKNOWN, Channel, Recording

EXPORT_AGAIN = "Correct the file or export it again"
_TIME_NAMES = {
    *("t", "time", "zeit", "timestamp", "time stamp", "x_value", "x value"),
    *("elapsed time", "uhrzeit", "temps", "tid", "tiempo", "tempo"),
}
_SECONDS = {"": 1.0, "s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6}
_LABEL = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<unit>[^\[\]]*)\])?$", re.DOTALL)


@dataclass(frozen=True, eq=False)
class Column:
    """A named column of numbers.

    Parameters
    ----------
    name : str
        Without the unit.
    unit : str
        As the file states it; empty where it states none.
    samples : ndarray, shape (n_samples,)
        Integers or floats, at best a memory map; NaN where a sample is missing.
    """

    name: str
    unit: str
    samples: NDArray[Any]


def name_and_unit(label: str) -> tuple[str, str]:
    """Split a heading such as ``"A01 [m/s^2]"``; the unit is empty where there is none."""
    match = _LABEL.match(label.strip())
    return (match["name"], (match["unit"] or "").strip()) if match else (label.strip(), "")


def is_time(name: str, unit: str) -> bool:
    """Whether a column of this name and unit holds time stamps."""
    return name.lower() in _TIME_NAMES and unit in _SECONDS


def content_of_columns(
    path: Path, columns: Sequence[Column], *, rate_hz: float = float("nan")
) -> FileContent:
    """Channels and sampling rate of a table.

    A column called ``time`` or ``t`` gives the rate; it has to agree with `rate_hz` where the file
    states that too.

    Parameters
    ----------
    path : Path
    columns : sequence of Column
        In the order of the file.
    rate_hz : float
        Sampling rate that the file states apart from any column; NaN where it states none.

    Raises
    ------
    RecordingFormatError
        If no column holds a channel, columns differ in length, or time is uneven.
    """
    times = [column for column in columns if is_time(column.name, column.unit)]
    signals = [column for column in columns if column not in times[:1]]
    _check_columns(path, columns, signals)
    if times:
        rate_hz = _agreed_rate(path, _rate(path, times[0]), rate_hz)
    findings: list[Finding] = []
    channels = tuple(_channel(path, column, findings) for column in signals)
    return FileContent(path, Recording(path, rate_hz, channels), findings=tuple(findings))


def _check_columns(path: Path, columns: Sequence[Column], signals: Sequence[Column]) -> None:
    if not signals:
        found = f"columns {', '.join(column.name for column in columns) or 'none'}"
        rule = "at least one column holds a channel"
        raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    first = columns[0]
    for column in columns:
        if len(column.samples) != len(first.samples):
            found = (
                f"{len(first.samples)} samples of {first.name!r}, "
                f"{len(column.samples)} of {column.name!r}"
            )
            rule = "channels of one run are sampled together and equally long"
            remedy = "Export them together, or in files of their own"
            raise RecordingFormatError(path.name, found, rule, remedy)
    if not len(first.samples):
        rule = "a recording holds samples"
        raise RecordingFormatError(path.name, "no rows of numbers", rule, EXPORT_AGAIN)


def _channel(path: Path, column: Column, findings: list[Finding]) -> Channel:
    unit = parse_unit(column.unit)
    if unit is None and is_stated(column.unit):
        findings.append(remark(path, column.name, "unit", f"unit {column.unit!r} is not known"))
    column.samples.setflags(write=False)
    return Channel(
        name=column.name,
        quantity=UNKNOWN if unit is None else unit.quantity,
        unit=column.unit,
        samples=column.samples,
        scale_to_si=1.0 if unit is None else unit.factor,
    )


def _rate(path: Path, time: Column) -> float:
    stamps = np.asarray(time.samples, dtype=np.float64) * _SECONDS[time.unit]
    steps = even_step(stamps)
    if steps is not None:
        return steps[1]
    where = f"{path.name}, column {time.name!r}"
    rule = "time is not at equal steps, and spectra need a constant sampling rate"
    remedy = "Look for dropped samples, or resample"
    raise RecordingFormatError(where, jump(stamps), rule, remedy)


def _agreed_rate(path: Path, of_time: float, stated: float) -> float:
    if np.isnan(stated) or abs(of_time - stated) <= 1e-4 * stated:
        return of_time
    found = f"{stated:g} Hz stated, {of_time:g} Hz by the time column"
    rule = "a recording has one sampling rate"
    raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
