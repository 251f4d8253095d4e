"""Read LabVIEW measurement files, ``.lvm``."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check
from ema.io.columns import Column, content_of_columns, not_together, step_and_inverse
from ema.io.content import COPY_AGAIN, EXPORT_AGAIN, FileContent, remark
from ema.io.text.layout import Dialect, Layout
from ema.io.text.source import open_text
from ema.io.text.table import Cells, missing_samples, read_cells

SUFFIXES = (".lvm",)
_NEXT_HEADER = re.compile(
    rb"^(?:Channels|Test_|UUT_|Model_Number|Serial_Number|Notes|\*\*\*)", re.MULTILINE
)


def read(path: Path) -> FileContent:
    """Read the first segment of a LabVIEW measurement file.

    The rate follows from ``Delta_X``, and where the file has a column of time, from that too.
    Comments beside the numbers are left out. A file may have several segments, one for each time
    LabVIEW was started or triggered. They are separate events, not one longer recording: those
    after the first are left out with a finding. `RecordingFormatError` if headers are missing or
    faulty, there are fewer or more rows than they state, a cell is not a number, or time is uneven.
    """
    with open_text(path) as source:
        header = _read_header(path.name, source.head)
        names = header.columns
        units = ("",) * len(names)
        layout = Layout(header.dialect, names, units, header.first_line, header.start)
        has_time = header.x_columns != "no"
        wanted = range(0 if has_time else 1, len(names))
        segment = _Segment(source.sections(header.start))
        sections = (_without_comments(part, layout) for part in segment)
        cells = read_cells(source, layout, wanted, sections)
        detail = "the first segment is read; later ones are separate events and left out"
        findings = [] if segment.is_last else [remark(path, "", Check.SEGMENTS, detail)]
    _check_rows(path, header, cells)
    read_in = [_time(path, header, cells)] if has_time else []
    for place, name, unit in zip(header.places, header.names, header.units, strict=True):
        read_in.append(Column(name, unit, cells[place].samples))
        findings += missing_samples(path, name, cells[place])
    return content_of_columns(path, read_in, rate_hz=header.rate_hz, findings=findings)


class _Segment:
    """Text up to the header of another segment; `is_last` where there is none."""

    def __init__(self, sections: Iterator[bytes]) -> None:
        self._sections = sections
        self.is_last = True

    def __iter__(self) -> Iterator[bytes]:
        for section in self._sections:
            header = _NEXT_HEADER.search(section)
            if header is not None:
                self.is_last = False
                yield _without_blank_end(section[: header.start()])
                return
            yield section


def _without_blank_end(section: bytes) -> bytes:
    """Drop the lines at the end that contain only separators."""
    filled = len(section.rstrip(b"\t,; \r\n"))
    return section[: section.find(b"\n", filled) + 1 or None] if filled else b""


def _without_comments(section: bytes, layout: Layout) -> bytes:
    """Cut the last column, comments, which only some rows have."""
    separator = layout.dialect.separator.encode()
    n_lines = section.count(b"\n")
    if section.count(separator) <= n_lines * (layout.width - 1):
        return section
    cut = bytearray()
    for line in section.splitlines():
        cut += separator.join(line.split(separator, layout.width)[: layout.width]) + b"\n"
    return bytes(cut) if section.endswith(b"\n") else bytes(cut[:-1])


def _check_rows(path: Path, header: _Header, cells: dict[int, Cells]) -> None:
    n_rows = len(cells[header.places[0]].samples)
    stated = max(header.n_samples, default=n_rows)
    if n_rows != stated:
        found = f"{n_rows} rows of numbers, {stated} samples by the header"
        rule = "the file is cut short" if n_rows < stated else "the numbers must be the same"
        raise RecordingFormatError(path.name, found, rule, COPY_AGAIN)


def _time(path: Path, header: _Header, cells: dict[int, Cells]) -> Column:
    """The column of time, which all channels share."""
    stamps: NDArray[np.float64] = cells[0].samples
    for place, name in zip(header.places, header.names, strict=True):
        own = cells[place - 1].samples if header.x_columns == "multi" else stamps
        if not np.array_equal(own, stamps, equal_nan=True):
            raise not_together(path, f"{name!r} and {header.names[0]!r} have different times")
    return Column("X_Value", "s", stamps)


_FIRST_WORDS = "LabVIEW Measurement"
_END = "***End_of_Header***"
_MOST_LINES = 1000
_SPECIAL = ("***Start_Special***", "***End_Special***")
_SEPARATORS = {"tab": "\t", "comma": ","}
_X_COLUMNS = ("no", "one", "multi")


@dataclass(frozen=True)
class _Header:
    """What the headers state about the first segment."""

    dialect: Dialect
    x_columns: str  # "no" column of time, "one", or one for each channel: "multi"
    names: tuple[str, ...]  # of the channels
    units: tuple[str, ...]
    n_samples: tuple[int, ...]  # of the channels; empty where not stated
    rate_hz: float  # by Delta_X; NaN where not stated
    first_line: int  # of the numbers in the file, counted from 1
    start: int  # first character of the numbers

    @property
    def places(self) -> list[int]:
        """Columns of the channels."""
        stride = 2 if self.x_columns == "multi" else 1
        return [1 + stride * number for number in range(len(self.names))]

    @property
    def columns(self) -> tuple[str, ...]:
        """Heading of each column of numbers: ``X_Value`` or that of a channel."""
        if self.x_columns == "multi":
            return tuple(text for name in self.names for text in ("X_Value", name))
        return "X_Value", *self.names


def _read_header(where: str, text: str) -> _Header:
    """Read both headers at the beginning of a file."""
    lines = text.split("\n", _MOST_LINES)
    if not lines[0].startswith(_FIRST_WORDS):
        rule = f"a file ending in .lvm begins with {_FIRST_WORDS!r}"
        raise RecordingFormatError(f"{where}, line 1", repr(lines[0][:20]), rule, EXPORT_AGAIN)
    ends = [number for number, line in enumerate(lines) if line.startswith(_END)][:2]
    if len(ends) < 2 or ends[1] + 2 >= len(lines):
        rule = "the headers of file and segment must end so, and names and numbers must follow"
        raise RecordingFormatError(where, f"{len(ends)} lines {_END}", rule, EXPORT_AGAIN)
    general = _Entries(where, lines[: ends[0]], _separator(where, lines[: ends[0]]))
    segment = _Entries(where, lines[ends[0] + 1 : ends[1]], general.separator)
    first = ends[1] + 2
    start = sum(len(line) + 1 for line in lines[:first])
    heading = lines[first - 1].rstrip("\r").split(general.separator)
    return _header(general, segment, heading, first + 1, start)


class _Entries:
    """Values of a header by their key."""

    def __init__(self, where: str, lines: list[str], separator: str) -> None:
        self.where, self.separator = where, separator
        self._values: dict[str, list[str]] = {}
        is_special = False
        for line in lines:
            is_special = line.startswith(_SPECIAL[0]) or (
                is_special and not line.startswith(_SPECIAL[1])
            )
            key, *values = (cell.strip() for cell in line.split(separator))
            if key and not is_special:
                self._values.setdefault(key, values)

    def of_channels(self, key: str, n: int) -> list[str]:
        """Values for each channel; none where they are not stated."""
        values = self._values.get(key, [])[:n]
        return values if len(values) == n and all(values) else []

    def one(self, key: str, default: str) -> str:
        """A single value in lower case."""
        return (self._values.get(key) or [default])[0].lower() or default

    def fault(self, key: str, found: str, rule: str) -> RecordingFormatError:
        """Build the error about an entry."""
        return RecordingFormatError(f"{self.where}, {key}", found, rule, EXPORT_AGAIN)


def _separator(where: str, lines: list[str]) -> str:
    for line in lines:
        if line.startswith("Separator"):
            name = line[len("Separator") :].strip(" \t,;\r").lower()
            if name in _SEPARATORS:
                return _SEPARATORS[name]
            rule = f"it must be one of {', '.join(_SEPARATORS)}"
            raise RecordingFormatError(f"{where}, Separator", repr(name), rule, EXPORT_AGAIN)
    return "\t"


def _header(
    general: _Entries, segment: _Entries, heading: list[str], first_line: int, start: int
) -> _Header:
    decimal = general.one("Decimal_Separator", ".")
    x_columns = general.one("X_Columns", "one")
    if decimal not in (".", ",") or x_columns not in _X_COLUMNS:
        rule = "they must be a point or comma, and no, one or multi"
        raise general.fault("Decimal_Separator and X_Columns", f"{decimal!r}, {x_columns!r}", rule)
    count = segment.one("Channels", "")
    stride = 2 if x_columns == "multi" else 1
    most = (len(heading) + stride - 2) // stride  # one X_Value precedes them, or each of them
    if not count.isdecimal() or len(count) > 9 or not 0 < int(count) <= most:
        rule = f"it must be the number of channels, and {len(heading)} names are below the header"
        raise segment.fault("Channels", repr(count), rule)
    n = int(count)
    return _Header(
        dialect=Dialect(general.separator, decimal),
        x_columns=x_columns,
        names=tuple(cell.strip() for cell in heading[1 : 1 + stride * n : stride]),
        units=tuple(segment.of_channels("Y_Unit_Label", n) or [""] * n),
        n_samples=_n_samples(segment, n),
        rate_hz=_rate_hz(segment, n, decimal),
        first_line=first_line,
        start=start,
    )


def _n_samples(segment: _Entries, n: int) -> tuple[int, ...]:
    values = segment.of_channels("Samples", n)
    if not all(value.isdecimal() and len(value) < 16 for value in values):
        raise segment.fault("Samples", repr(values[:3]), "there must be one number for each")
    return tuple(map(int, values))


def _rate_hz(segment: _Entries, n: int, decimal: str) -> float:
    dimensions = segment.of_channels("X_Dimension", n)
    if any(each.lower() != "time" for each in dimensions):
        rule = "FRFs are estimated from channels over time"
        raise segment.fault("X_Dimension", ", ".join(dict.fromkeys(dimensions)), rule)
    steps = dict.fromkeys(segment.of_channels("Delta_X", n))
    if not steps:
        return float("nan")
    try:
        rates = {step_and_inverse(step.replace(decimal, "."))[1] for step in steps}
    except ValueError as error:
        raise segment.fault("Delta_X", str(error), "it must be the time step") from error
    if len(rates) > 1:
        raise segment.fault("Delta_X", ", ".join(steps), "a run must have one sampling rate")
    return rates.pop()
