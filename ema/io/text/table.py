"""Numbers of a text table, read section by section to limit memory."""

from __future__ import annotations

import contextlib
import io
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import date
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray
from pyarrow import compute

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding
from ema.io.columns import is_time
from ema.io.content import COPY_AGAIN, EXPORT_AGAIN, arrow_reader, note, remark
from ema.io.text.layout import Layout
from ema.io.text.source import (
    BLANKS,
    CLOCK,
    COMPLEX,
    COMPLEX_REMEDY,
    COMPLEX_RULE,
    MISSING,
    TYPESET,
    Dialect,
    TextSource,
    cells_of,
    count_of,
    is_clock,
    is_number,
)

_BLOCK_BYTES = 1 << 20
_NARROW_BYTES = 4  # cells of fewer bytes are kept in single precision where that is exact
_CUT_SHORT = "the file is cut short"
_USUAL_MISSING = ["", "NaN", "nan", "-", "#N/A"]  # for each column Arrow builds a tree of these
_HOUR_NS = 3_600_000_000_000
_MONTHS = {
    name: n
    for n, name in enumerate(
        ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"], 1
    )
}
_MONTHS |= {"mär": 3, "mrz": 3, "mai": 5, "okt": 10, "dez": 12}
_STAMP_RULE = (
    "a time stamp must be hh:mm:ss.s, or a date and that (ISO 8601, 31.12.2026, 12/31/2026)"
)
_TAIL_ROWS = 8  # with which the last one is compared
# What lines of text below the numbers begin with.
_TEXT_BELOW = re.compile(r"[^\W\d_]|[#*%/!=<\[]|[-+_]{3}")
_DECIMAL = {".": "point", ",": "comma"}
_THOUSANDS = {".": re.compile(r"[,'\u2019 ]"), ",": re.compile(r"[.'\u2019 ]")}


def read_cells(
    source: TextSource,
    layout: Layout,
    wanted: Sequence[int],
    sections: Iterable[bytes],
    findings: list[Finding],
) -> dict[int, Cells]:
    """Read columns of a table by number; cells of other columns may be anything.

    Lines of text below the last row of numbers are left out with a finding.

    `sections` are complete lines from the first row of numbers on; one without a line end is the
    last.
    """
    reader = _Reader(source.path.name, layout, wanted, source.encoding)
    for section in sections:
        reader.take(section)
    if reader.below is not None:
        place = reader.below.where.removeprefix(f"{source.path.name}, ")
        detail = f"below the numbers: {reader.below.found} in {place}: not read"
        findings.append(note(source.path, Check.IGNORED, detail))
    if not reader.n_rows:
        rule = "a table needs at least one row of numbers"
        raise RecordingFormatError(source.path.name, "blank rows only", rule, EXPORT_AGAIN)
    return reader.columns


def missing_samples(path: Path, name: str, cells: Cells) -> list[Finding]:
    """Note how many samples of a channel are missing, where any are."""
    counts = f"{cells.n_missing} of {len(cells.samples)} samples are missing"
    detail = f"{counts}, the first in row {cells.first_missing}"
    return [remark(path, name, Check.MISSING_SAMPLES, detail)] if cells.n_missing else []


class Cells:
    """Samples of one column of text, read section by section."""

    def __init__(self) -> None:
        self._pieces: list[NDArray[Any]] = []
        self._n = self.n_missing = 0
        self.first_missing = 0  # row of the first missing sample, counted from 1

    def append(self, values: NDArray[Any], *, narrow: bool) -> None:
        """Add samples; the caller ignores overflow."""
        if not math.isfinite(values.sum()):  # far faster than a look at each sample
            absent = ~np.isfinite(values)
            values = np.where(absent, np.nan, values)
            if not self.n_missing and absent.any():
                self.first_missing = self._n + int(np.argmax(absent)) + 1
            self.n_missing += int(np.count_nonzero(absent))
        if narrow and values.dtype == np.float64:
            single = values.astype(np.float32)
            values = single if np.array_equal(values, single, equal_nan=True) else values
        self._pieces.append(values)
        self._n += len(values)

    @cached_property
    def samples(self) -> NDArray[Any]:
        """All samples, NaN where missing; time stamps in s since the first."""
        samples = np.concatenate(self._pieces)
        self._pieces.clear()
        if samples.dtype != np.int64:
            return samples
        # Times of day without a date begin again at midnight, minutes without an hour after one.
        steps = np.diff(samples, prepend=samples[:1])
        hours = np.cumsum(np.abs(steps + _HOUR_NS) < _HOUR_NS // 3600)
        hours += 24 * np.cumsum(steps < -12 * _HOUR_NS)
        return np.asarray((samples - samples[:1] + hours * _HOUR_NS) * 1e-9)


class _Reader:
    """State of reading: lines and rows read, decimal sign, columns so far."""

    def __init__(self, where: str, layout: Layout, wanted: Sequence[int], encoding: str) -> None:
        self._where, self._layout, self._encoding = where, layout, encoding
        self.columns = {index: Cells() for index in wanted}
        self._decimal_is_open = layout.either_decimal
        self._line, self.n_rows = layout.first_line, 0
        self._tail = self._held = b""
        self.below: RecordingFormatError | None = None  # what text would be among numbers
        self._typeset = [
            (sign.encode(encoding, "ignore"), plain.encode()) for sign, plain in TYPESET.items()
        ]
        self._days: dict[int, list[str]] = {}  # of columns of time stamps

    def take(self, section: bytes) -> None:
        """Read the next section into the columns."""
        section = section.rstrip(b"\x1a")  # DOS programs end a text with it
        for sign, plain in () if section.isascii() else self._typeset:
            section = section.replace(sign, plain) if sign else section
        if self.below is not None and section.strip():
            raise self.below
        if not section or section.isspace():
            if self._layout.width == 1:
                self._held += section
            else:
                self._line += count_of(b"\n", section)
            return
        if self._layout.width == 1:
            section = self._without_blank_end(section)
        self._settle_decimal(section)
        if not section.endswith(b"\n"):
            self._check_end(section)
        table = self._parsed(section)
        if table is None:
            return
        self.n_rows += table.num_rows
        narrow = len(section) < _NARROW_BYTES * table.num_rows * self._layout.width
        with np.errstate(over="ignore", invalid="ignore"):
            for (index, column), values in zip(self.columns.items(), table.columns, strict=True):
                if index in self._layout.clocks:
                    values = self._nanoseconds(section, index, values)
                for chunk in values.chunks:
                    column.append(chunk.to_numpy(zero_copy_only=False), narrow=narrow)
        self._line += count_of(b"\n", section)
        self._tail = section[-(1 << 16) :]

    def _without_blank_end(self, section: bytes) -> bytes:
        """Keep blank lines until more numbers follow: at the end of a file they are not samples."""
        section = self._held + section
        end = section.find(b"\n", len(section.rstrip())) + 1 or len(section)
        self._held = section[end:]
        return section[:end]

    def _settle_decimal(self, section: bytes) -> None:
        """Take the decimal comma once it occurs, where the first rows were integers."""
        if not self._decimal_is_open or not (b"." in section or b"," in section):
            return
        separator = self._layout.dialect.separator
        if separator == "," and b"." not in section and b'"' not in section:
            return
        self._decimal_is_open = False
        decimal = "." if b"." in section else ","
        self._layout = replace(self._layout, dialect=Dialect(separator, decimal))

    def _parsed(self, section: bytes) -> pa.Table | None:
        if self._layout.dialect.separator == BLANKS:
            section = _single_blanks(section)
        try:
            return self._by_arrow(section)
        except (pa.ArrowInvalid, pa.ArrowKeyError):
            plain = self._checked(section)
        try:
            return self._by_arrow(plain) if plain else None
        except (pa.ArrowInvalid, pa.ArrowKeyError) as error:
            rule = f"each of the {self._layout.width} columns must have a number in every row"
            raise self._fault(self._line, str(error), rule) from error

    def _by_arrow(self, section: bytes) -> pa.Table:
        layout = self._layout
        labels = [str(index) for index in range(layout.width)]
        types = {
            str(index): pa.string() if index in layout.clocks else pa.float64()
            for index in self.columns
        }
        block = max(_BLOCK_BYTES, 2 * section.find(b"\n"))
        is_table = layout.width > 1  # in a single column, an empty line is a missing sample
        return pa.csv.read_csv(
            arrow_reader(section),
            pa.csv.ReadOptions(column_names=labels, block_size=block),
            pa.csv.ParseOptions(delimiter=layout.dialect.separator, ignore_empty_lines=is_table),
            pa.csv.ConvertOptions(
                column_types=types,
                include_columns=list(types),
                null_values=_USUAL_MISSING,
                strings_can_be_null=True,
                decimal_point=layout.dialect.decimal,
                check_utf8=False,
            ),
            memory_pool=pa.system_memory_pool(),  # the default one keeps megabytes in reserve
        )

    def _checked(self, section: bytes) -> bytes:
        """Rewrite a section in plain cells, or raise the error about the faulty cell."""
        separator = self._layout.dialect.separator
        plain = bytearray()
        for number, raw in enumerate(io.BytesIO(section), self._line):
            line = raw.decode(self._encoding, errors="replace").rstrip("\r\n")
            if not line.strip() and self._layout.width > 1:
                continue
            cells = cells_of(line, separator)
            try:
                if len(cells) != self._layout.width:
                    raise self._ragged(number, line, cells, is_cut=not raw.endswith(b"\n"))
                plain += separator.join(self._checked_cells(number, cells)).encode() + b"\n"
            except RecordingFormatError as fault:
                is_below = _TEXT_BELOW.match(cells[0]) and (plain or self.n_rows)
                if self.below is None and not is_below:
                    raise
                self.below = self.below or fault
            else:
                if self.below is not None:  # numbers go on below the text
                    raise self.below
        return bytes(plain)

    def _checked_cells(self, number: int, cells: Sequence[str]) -> list[str]:
        decimal = self._layout.dialect.decimal
        checked = [""] * len(cells)
        for index in self.columns:
            cell = cells[index]
            if index in self._layout.clocks:
                if not is_clock(cell):
                    found = repr(cell[:40]) if cell else "no time"
                    raise self._fault(number, found, _STAMP_RULE, index)
                checked[index] = f'"{cell}"'
            elif is_number(cell, decimal, is_only=len(cells) == 1):
                number_text = _THOUSANDS[decimal].sub("", cell.upper().replace("D", "E"))
                checked[index] = f'"{number_text}"' if decimal in number_text else number_text
            elif cell.lower() not in MISSING:
                rule = f"a cell must be empty or a number with a decimal {_DECIMAL[decimal]}"
                if is_time(self._layout.names[index], ""):
                    rule += f"; {_STAMP_RULE}"
                remedy = EXPORT_AGAIN
                if COMPLEX.search(cell):
                    rule, remedy = COMPLEX_RULE, COMPLEX_REMEDY
                raise self._fault(number, repr(cell[:40]), rule, index, remedy)
        return checked

    def _ragged(
        self, number: int, line: str, cells: Sequence[str], *, is_cut: bool
    ) -> RecordingFormatError:
        width = self._layout.width
        found = f"{len(cells)} cells, {width} columns: {line[:40]!r}"
        rule, remedy = f"each row must have {width} cells", EXPORT_AGAIN
        if not any(is_number(cell, self._layout.dialect.decimal) for cell in cells):
            found = f"text where numbers go on: {line[:40]!r}"
            rule = "below the header there must be only rows of numbers"
        elif is_cut and len(cells) < width:
            rule, remedy = _CUT_SHORT, COPY_AGAIN
        return self._fault(number, found, rule, remedy=remedy)

    def _fault(
        self, line: int, found: str, rule: str, index: int = -1, remedy: str = EXPORT_AGAIN
    ) -> RecordingFormatError:
        column = "" if index < 0 else f", column {self._layout.names[index]!r}"
        where = f"{self._where}, line {line}{column}"
        return RecordingFormatError(where, found, rule, remedy)

    def _check_end(self, section: bytes) -> None:
        """Refuse a last line, without a line end, that stops within its last number.

        It does if the rows before have the same number of decimals in that column, and this one
        has fewer, or an empty cell.
        """
        decimal, separator = self._layout.dialect.decimal, self._layout.dialect.separator
        rows = (self._tail + section).decode("utf-8", errors="replace").splitlines()
        last = [cells_of(row, separator)[-1] for row in rows[-_TAIL_ROWS - 1 :] if row.strip()]
        *others, end = (len(cell.partition(decimal)[2]) for cell in last)
        is_empty = len(last) > 1 and all(last[:-1]) and not last[-1]
        if is_empty or (len(last) > _TAIL_ROWS // 2 and min(others) == max(others) > end):
            found = f"the last row ends in {last[-1]!r}, those before in {last[-2]!r} and the like"
            raise self._fault(self._line, found, _CUT_SHORT, remedy=COPY_AGAIN)

    def _nanoseconds(self, section: bytes, index: int, stamps: pa.ChunkedArray) -> pa.ChunkedArray:
        """Time stamps as integer nanoseconds since some midnight."""
        text = compute.utf8_trim_whitespace(stamps)
        found = "a row without a time"
        try:
            parts = compute.extract_regex(text, rf"\A(?:{CLOCK.pattern})\z")
            if not parts.null_count:
                return self._since_midnight(
                    index, *map(partial(compute.struct_field, parts), range(4))
                )
        except (pa.ArrowInvalid, ValueError) as error:
            found = str(error)
        self._checked(section)  # names the line, unless a stamp only looks like one
        raise self._fault(self._line, found, _STAMP_RULE, index)

    def _since_midnight(
        self,
        index: int,
        dates: pa.ChunkedArray,
        hours: pa.ChunkedArray,
        rest: pa.ChunkedArray,
        half: pa.ChunkedArray,
    ) -> pa.ChunkedArray:
        """Nanoseconds since midnight of the first day; ValueError where a day is left out."""
        rest = compute.replace_substring_regex(rest, r"^(\d\d:\d\d)[,:]", r"\1.")
        rest = compute.binary_join_element_wise("1970-01-01 00", rest, ":")
        rest = rest.cast(pa.timestamp("ns")).cast(pa.int64())
        hours = compute.if_else(compute.equal(hours, ""), "0", compute.utf8_rtrim(hours, ":"))
        hours = hours.cast(pa.int64())
        if half[0].as_py():
            is_late = compute.equal(compute.utf8_upper(half), "P")
            hours = compute.if_else(compute.equal(hours, 12), 0, hours)
            hours = compute.add(hours, compute.multiply(is_late.cast(pa.int64()), 12))
        days = self._days.setdefault(index, [])
        days += [day for day in dates.unique().to_pylist() if day not in days]
        check_days(days)
        numbers = compute.index_in(dates, pa.array(days)).cast(pa.int64())
        hours = compute.add(hours, compute.multiply(numbers, 24))
        return compute.add(compute.multiply(hours, _HOUR_NS), rest)


def check_days(dates: Sequence[str]) -> None:
    """Refuse (ValueError) days that do not follow one another, day or month first."""
    numbers = [_numbers_of_date(each) for each in dates if each]
    for order in ((0, 1, 2), (2, 1, 0), (2, 0, 1)):
        with contextlib.suppress(ValueError, IndexError):
            days = [each[0] if len(each) == 1 else _ordinal(each, order) for each in numbers]
            if days == list(range(days[0], days[0] + len(days)) if days else ()):
                return
    raise ValueError(f"{', '.join(dates[:3])}: no dates, or not one day after another")


def _numbers_of_date(text: str) -> list[int]:
    """Year, month and day as they stand in a date; one number of a count of days."""
    for month in re.findall(r"[^\W\d_]{3,}", text):
        text = text.replace(month, f" {_MONTHS.get(month[:3].lower(), '')} ")
    compact = re.fullmatch(r"([0-9]{4})([0-9]{2})([0-9]{2})", text)
    return [int(each) for each in (compact.groups() if compact else re.findall("[0-9]+", text))]


def _ordinal(numbers: Sequence[int], order: tuple[int, int, int]) -> int:
    year, month, day = (numbers[place] for place in order)
    return date(year + 2000 * (year < 100), month, day).toordinal()


def _single_blanks(section: bytes) -> bytes:
    """Runs of blanks and tabs as one blank, none at a line's ends."""
    section = section.replace(b"\t", b" ").replace(b"\r", b"")
    while b"  " in section:
        section = section.replace(b"  ", b" ")
    return section.replace(b"\n ", b"\n").replace(b" \n", b"\n").strip(b" ")
