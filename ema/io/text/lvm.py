"""Read LabVIEW measurement files, ``.lvm``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding
from ema.core.recording import ACCELERATION, FORCE
from ema.core.units import parse_unit
from ema.io.columns import Column, content_of_columns
from ema.io.content import COPY_AGAIN, EXPORT_AGAIN, FileContent, entries, note, remark
from ema.io.rates import UNSTATED, Rate, rate_of_step
from ema.io.text.layout import Layout
from ema.io.text.source import Dialect, begins_some_line, count_of, open_text, starts_of
from ema.io.text.table import missing_samples, read_cells

_NEXT_HEADER = re.compile(
    rb"^(?:Channels|Test_|UUT_|Model_Number|Serial_Number|Notes|\*\*\*)", re.MULTILINE
)
_FIRST_OF_HEADERS = b"CTUMSN*"
_FIRST_WORDS = "LabVIEW Measurement"
_END = "***End_of_Header***"
_MOST_LINES = 1000
_SPECIAL = re.compile(r"(?ms)^\*{3}Start_Special\*{3}.*?(?:^\*{3}End_Special\*{3}|\Z)")
_SEPARATORS = {"tab": "\t", "comma": ","}
_X_COLUMNS = ("no", "one", "multi")


@dataclass(frozen=True)
class _ChannelHeader:
    """What the header states about a channel, and why it is not read."""

    place: int  # of its column
    unit: str
    start_s: float  # by X0 and Time
    why_not: str = ""


@dataclass(frozen=True)
class _Header:
    """What the headers state about the first segment."""

    layout: Layout
    x_columns: str  # "no" column of time, "one", or one for each channel: "multi"
    channels: Sequence[_ChannelHeader]
    n_rows: int | None  # None where not stated
    rate: Rate  # by Delta_X
    statements: dict[str, str]  # first value of all other entries


def read(path: Path) -> FileContent:
    """Read the first segment of a LabVIEW measurement file; comments are left out.

    Later segments are separate events, not one longer recording: they are left out with a finding.
    `RecordingFormatError` if headers are missing or faulty, there are fewer or more rows than they
    state, a cell is not a number, or time is uneven.
    """
    findings: list[Finding] = []
    with open_text(path) as source:
        header = _read_header(path.name, source.head)
        layout, has_time = header.layout, header.x_columns != "no"
        wanted = range(0 if has_time else 1, layout.width)
        segment = _first_segment(path, source.sections(layout.start), findings)
        sections = (_without_comments(part, layout) for part in segment)
        cells = read_cells(source, layout, wanted, sections, findings)
    time = cells[0].samples if has_time else None
    n_rows = _rows(path, len(cells[1].samples), header.n_rows, time, findings)
    columns = (
        [Column("X_Value", "s", cells[0].samples[:n_rows])] if header.x_columns == "one" else []
    )
    is_multi = header.x_columns == "multi"
    for channel in header.channels:
        name, own = layout.names[channel.place], cells[channel.place]
        if channel.why_not or own.n_missing == len(own.samples):
            why = channel.why_not or "no number in any row"
            findings.append(note(path, Check.CONTENT, f"{name!r}: {why}, left out"))
            continue
        if is_multi:
            columns.append(Column("X_Value", "s", cells[channel.place - 1].samples[:n_rows]))
        columns.append(Column(name, channel.unit, own.samples[:n_rows], "", channel.start_s))
        findings += missing_samples(path, name, own)
    return content_of_columns(
        path, columns, rate=header.rate, findings=findings, statements=header.statements
    )


def _rows(
    path: Path, n_rows: int, stated: int | None, time: NDArray[Any] | None, findings: list[Finding]
) -> int:
    """Rows of the recording, where one header may stand above the blocks of several writes.

    Time that goes on joins the blocks; where it starts again, they are events of their own.
    """
    if stated is None or n_rows == stated:
        return n_rows
    counts = f"{n_rows} rows of numbers, {stated} samples by the header"
    if n_rows < stated:
        raise RecordingFormatError(path.name, counts, "the file is cut short", COPY_AGAIN)
    if time is None:
        detail = f"{counts}: taken as one recording, as no column of time shows other events"
        findings.append(remark(path, "", Check.SEGMENTS, detail))
        return n_rows
    again = np.flatnonzero(np.diff(time) <= 0) + 1
    if not again.size:
        detail = f"{counts}, which counts one write: time goes on, one recording"
        findings.append(note(path, Check.SEGMENTS, detail))
        return n_rows
    detail = (
        f"time starts again in row {again[0] + 1}: the first of {len(again) + 1} events is read"
    )
    findings.append(remark(path, "", Check.SEGMENTS, detail))
    return int(again[0])


def _first_segment(
    path: Path, sections: Iterator[bytes], findings: list[Finding]
) -> Iterator[bytes]:
    """Text up to the header of another segment, without lines of separators alone before it."""
    for section in sections:
        may_be = begins_some_line(_FIRST_OF_HEADERS, section)  # far faster on numbers
        header = _NEXT_HEADER.search(section) if may_be else None
        if header is None:
            yield section
            continue
        detail = "the first segment is read; later ones are separate events and left out"
        findings.append(remark(path, "", Check.SEGMENTS, detail))
        filled = len(section[: header.start()].rstrip(b"\t,; \r\n"))
        yield section[: section.find(b"\n", filled) + 1] if filled else b""
        return


def _without_comments(section: bytes, layout: Layout) -> bytes:
    """Cut the last column, comments, which only some rows have."""
    separator = layout.dialect.separator.encode()
    n_lines = count_of(b"\n", section)
    if count_of(separator, section) <= n_lines * (layout.width - 1):
        return section
    cut = bytearray()
    for line in section.splitlines():
        cut += separator.join(line.split(separator, layout.width)[: layout.width]) + b"\n"
    return bytes(cut) if section.endswith(b"\n") else bytes(cut[:-1])


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
        self.stride = 1  # from a channel's values to those of the next one
        self.first: dict[str, str] = {}  # of special blocks too
        for line in _SPECIAL.sub("", "\n".join(lines)).split("\n"):
            key, *values = (cell.strip() for cell in line.split(separator))
            self._values.setdefault(key, values)
        for line in lines:
            key, *values = (cell.strip() for cell in line.split(separator))
            self.first |= {key: values[0]} if values else entries([key])

    def of_channels(self, key: str, n: int) -> list[str]:
        """Values for each channel, empty where they are not stated."""
        return [*self._values.get(key, [])[:: self.stride], *[""] * n][:n]

    @property
    def is_spread(self) -> bool:
        """Whether rows leave a place empty above each further column of time."""
        rows = (self._values.get(key, []) for key in ("Samples", "X_Dimension", "X0", "Delta_X"))
        return any(row[1:2] == [""] and any(row[2:3]) for row in rows)

    def one(self, key: str, default: str) -> str:
        """A single value in lower case."""
        return (self._values.get(key) or [default])[0].lower() or default

    def fault(self, key: str, found: str, rule: str) -> RecordingFormatError:
        """Build the error about an entry."""
        return RecordingFormatError(f"{self.where}, {key}", found, rule, EXPORT_AGAIN)


def _separator(where: str, lines: list[str]) -> str:
    stated = [line.removeprefix("Separator") for line in lines if line.startswith("Separator")]
    name = [*stated, "tab"][0].strip(" \t,;\r").lower()
    if name not in _SEPARATORS:
        rule = f"it must be one of {', '.join(_SEPARATORS)}"
        raise RecordingFormatError(f"{where}, Separator", repr(name), rule, EXPORT_AGAIN)
    return _SEPARATORS[name]


def _header(
    general: _Entries, segment: _Entries, heading: list[str], first_line: int, start: int
) -> _Header:
    """What both headers state, with the row of names below them."""
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
    segment.stride = stride if segment.is_spread else 1
    counts = _counts(segment, n)
    steps = segment.of_channels("Delta_X", n)
    units = segment.of_channels("Y_Unit_Label", n)
    starts_s = _starts_s(segment, n, decimal, has_times=x_columns == "multi")
    most_rows = max((each for each in counts if each is not None), default=None)
    fast = next((step for step, each in zip(steps, counts, strict=True) if each == most_rows), "")
    reasons = [_why_not(*each, most_rows, fast) for each in zip(counts, steps, units, strict=True)]
    names = tuple(cell.strip() for cell in heading[: 2 + stride * (n - 1)])
    dialect = Dialect(general.separator, decimal)
    used = [not why for why in reasons]
    return _Header(
        layout=Layout(dialect, names, ("",) * len(names), first_line, start),
        x_columns=x_columns,
        channels=tuple(map(_ChannelHeader, range(1, len(names), stride), units, starts_s, reasons)),
        n_rows=most_rows,
        rate=_rate(segment, list(compress(steps, used)), decimal),
        statements=general.first | segment.first,
    )


def _counts(segment: _Entries, n: int) -> list[int | None]:
    """Samples of each channel, None where they are not stated."""
    samples = segment.of_channels("Samples", n)
    if not all(not value or (value.isdecimal() and len(value) < 16) for value in samples):
        raise segment.fault("Samples", repr(samples[:3]), "there must be one number for each")
    return [int(value) if value else None for value in samples]


def _why_not(count: int | None, step: str, unit: str, most_rows: int | None, fast: str) -> str:
    """Why a channel beside the recording is not read; a slow force or sensor is an error."""
    if count is None or count == most_rows:
        return "not wired" if count is None and most_rows is not None and not step else ""
    known = parse_unit(unit)
    is_wanted = known is not None and known.quantity in (FORCE, ACCELERATION)
    if count and (step == fast or is_wanted):
        return ""
    return f"{count} samples beside {most_rows}"


def _rate(segment: _Entries, stated: Sequence[str], decimal: str) -> Rate:
    dimensions = [each for each in segment.of_channels("X_Dimension", len(stated)) if each]
    if any(each.lower() != "time" for each in dimensions):
        rule = "FRFs are estimated from channels over time"
        raise segment.fault("X_Dimension", ", ".join(dict.fromkeys(dimensions)), rule)
    steps = [step for step in dict.fromkeys(stated) if step]
    try:
        rates = [rate_of_step(step.replace(decimal, "."), "Delta_X") for step in steps]
    except ValueError as error:
        raise segment.fault("Delta_X", str(error), "it must be the time step") from error
    if len(steps) > 1:
        raise segment.fault("Delta_X", ", ".join(steps), "a run must have one sampling rate")
    return rates[0] if rates else UNSTATED


def _starts_s(segment: _Entries, n: int, decimal: str, *, has_times: bool) -> list[float]:
    """Starts of channels; X0 is in the column of time where each channel has one."""
    starts = [each or "0" for each in segment.of_channels("X0", n)]
    clocks = [each for each in segment.of_channels("Time", n) if each]
    clocks = clocks if len(clocks) == n and len(set(clocks)) > 1 else []
    try:
        return starts_of(["0"] * n if has_times else starts, decimal, clocks)
    except ValueError as error:
        rule = "they must be the time of the first sample"
        raise segment.fault("X0 and Time", str(error), rule) from error
