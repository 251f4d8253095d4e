"""Columns of a table, whatever the format it was stored in, as channels of a recording."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Finding
from ema.core.recording import UNKNOWN, Channel, Recording
from ema.core.units import is_stated, parse_unit
from ema.io.content import EXPORT_AGAIN, FileContent, remark
from ema.io.sampling import even_step, jump

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
        rule = "at least one column must be a channel"
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
        rule = "a recording must contain samples"
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


_ROUND = 0.05  # radii may differ by this part of the radius
_SENSELESS = 1e100  # larger than any structure in any unit
PLANES = {0: (1, 2), 1: (0, 2), 2: (0, 1)}  # normal axis: the axes angles are counted between


def angles_on_circle(nodes: Mapping[int, NDArray[np.float64]]) -> dict[int, float]:
    """Angle of each node in the plane where the circle lies; empty where they lie on none.

    Parameters
    ----------
    nodes : mapping of int to ndarray, shape (3,)
        Coordinates of the nodes that carry sensors.

    Returns
    -------
    dict of int to float
        Degrees in 0…360, counter-clockwise from the plane's first axis (x, or y in the y-z plane)
        to its second, about the origin, or about the circle's own centre where it lies elsewhere.
    """
    if not nodes:
        return {}
    points = np.array(list(nodes.values()), dtype=np.float64)
    if not (np.abs(points) < _SENSELESS).all():  # NaN is not smaller than anything
        return {}
    first, second = PLANES[int(np.argmin(np.ptp(points, axis=0)))]
    if len(points) == 1 and not points[0, [first, second]].any():
        return {}
    plane = points[:, [first, second]]
    if not is_round(plane):
        if len(points) < 4:  # three points lie on a circle whatever they are
            return {}
        plane = plane - centre_of_circle(plane)
        if not is_round(plane):
            return {}
    angles = np.degrees(np.arctan2(plane[:, 1], plane[:, 0])) % 360.0
    return dict(zip(nodes, angles.tolist(), strict=True))


def is_round(plane: NDArray[np.float64]) -> bool:
    """Whether points (n, 2) lie about equally far from the origin."""
    radii = np.hypot(plane[:, 0], plane[:, 1])
    mean = float(radii.mean())
    return mean > 0.0 and float(np.ptp(radii)) <= _ROUND * mean


def centre_of_circle(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre of the least-squares circle of points (n, 2).

    x² + y² = 2 x₀ x + 2 y₀ y + c (Kåsa 1976).
    """
    system = np.column_stack([2.0 * plane, np.ones(len(plane))])
    solution: NDArray[np.float64] = np.linalg.lstsq(system, (plane**2).sum(axis=1), rcond=None)[0]
    return solution[:2]


def matrix_columns(
    where: str, matrix: NDArray[Any], names: Sequence[str], units: Sequence[str]
) -> list[Column]:
    """Split a matrix into its channels.

    The names tell which of its sides counts the channels; without them, it is the shorter one.

    Parameters
    ----------
    where : str
        File and place in it, for messages.
    matrix : ndarray, shape (n_samples, n_channels) or (n_channels, n_samples)
    names : sequence of str
        Names of the channels, perhaps with the unit in square brackets; empty where unknown.
    units : sequence of str
        One for each channel, one for all, or none.

    Raises
    ------
    RecordingFormatError
        If names or units do not fit, or a square matrix leaves open what its rows are.
    """
    rows, columns = matrix.shape
    n_channels = len(names) or min(rows, columns)
    if rows == columns or n_channels not in (rows, columns):
        found = f"a matrix of {rows} × {columns} and {len(names)} names"
        rule = (
            "one dimension must be the samples, the other the channels, with a name for each "
            "channel"
        )
        remedy = "Give as many names as there are channels"
        raise RecordingFormatError(where, found, rule, remedy)
    signals = matrix.T if columns == n_channels else matrix
    labels = names or [f"channel {number}" for number in range(1, n_channels + 1)]
    stated = unit_of_each(where, n_channels, units)
    pairs = [name_and_unit(label) for label in labels]
    return [
        Column(name, unit or own, samples)
        for (name, own), unit, samples in zip(pairs, stated, signals, strict=True)
    ]


def unit_of_each(where: str, n_channels: int, units: Sequence[str]) -> list[str]:
    """Unit of each channel, from a list of as many, of one for all, or of none.

    Raises
    ------
    RecordingFormatError
        If the list has another length.
    """
    if len(units) not in (0, 1, n_channels):
        found = f"{len(units)} units for {n_channels} channels"
        rule = "there is one unit for each channel, or one for all"
        raise RecordingFormatError(where, found, rule, "Correct the list of units")
    stated = units if len(units) == n_channels else list(units or ("",)) * n_channels
    return [unit.strip() for unit in stated]
