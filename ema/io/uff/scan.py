"""Find the datasets of a universal file, seeking over payloads; read lines of text datasets."""

from __future__ import annotations

import mmap
import re
from codecs import BOM_UTF8
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ema.core.errors import RecordingFormatError
from ema.core.files import require_regular
from ema.io.content import LEAVE_OUT, unreadable
from ema.io.rates import parse_number
from ema.io.uff.dataset58_header import (
    DELIMITER,
    HEADER_LINES,
    LITTLE_ENDIAN,
    Header58,
    HeaderError,
    parse_header,
)

_LONGEST_LINE = 256  # header lines have 80 columns; the rest of longer ones is ignored
_WORTH_A_JUMP = 1 << 20  # bytes of text; shorter payloads are searched as fast
_CHUNK_BYTES = 1 << 12
_IGNORED_BETWEEN = b" \t\r\n\x00\x1a"  # blank lines, padding, the end mark of old systems
_WORD = re.compile(rb"[A-Za-z]{2}")
_MOST_TEXT = 200  # lines of text between datasets
_LARGEST_INTEGER = 2**53  # beyond, not every integer is a float


@dataclass(frozen=True)
class Dataset:
    """One dataset of a universal file and where it is."""

    index: int  # in the file, from 1
    number: int  # kind of dataset, e.g. 58 or 2411
    start: int  # first byte of the opening delimiter
    stop: int  # first byte behind the closing delimiter
    header: Header58 | None = None  # of a dataset 58
    payload: tuple[int, int] = (0, 0)  # first and last byte (exclusive) of its values or lines
    layout: np.dtype[np.void] | np.dtype[np.inexact] | None = None  # of a binary record
    remark: str = ""  # what does not fit the definition but could be read
    is_equal_lines: bool = False  # whether the payload is long text of equally long lines

    @property
    def header58(self) -> Header58:
        """Header of a dataset 58."""
        assert self.header is not None
        return self.header


def scan(path: Path) -> tuple[Dataset, ...]:
    """List the datasets of a universal file, seeking over the values of functions.

    Binary payloads end at their byte count; text of equally long lines ends after the number of
    its values. If the closing delimiter is not there, it is searched for.
    """
    rule = "a recording needs at least one dataset"
    try:
        with require_regular(path).open("rb") as file:
            if not path.stat().st_size:
                raise damaged(str(path), "the file is empty", rule)
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                datasets = tuple(_datasets(path, data))
    except OSError as error:
        raise unreadable(path, error) from error
    if not datasets:
        raise damaged(str(path), "only blanks or zeros", rule)
    return datasets


def place(path: Path, index: int, line: int | None = None) -> str:
    """Place in a universal file, as messages name it."""
    return f"{path.name}, dataset {index}" + ("" if line is None else f", line {line}")


def damaged(where: str, found: str, rule: str) -> RecordingFormatError:
    """Build the error about a damaged file."""
    return RecordingFormatError(where, found, rule, LEAVE_OUT)


def _datasets(path: Path, data: mmap.mmap) -> list[Dataset]:
    found: list[Dataset] = []
    has_mark = data[: len(BOM_UTF8)] == BOM_UTF8  # left by an editor of text
    position = _next_content(data, len(BOM_UTF8) if has_mark else 0)
    while position < len(data):
        index = len(found) + 1
        position = _behind_text(data, position)
        opening, after = _line(data, position)
        if opening.rstrip() != DELIMITER and opening.strip() != b"-1":
            rule = 'a dataset of a universal file begins with a line "    -1"'
            raise damaged(place(path, index), repr(opening[:20].decode("latin-1")), rule)
        dataset = _dataset(path, data, index, position, after)
        found.append(dataset)
        position = _next_content(data, dataset.stop)
    return found


def _behind_text(data: mmap.mmap, position: int) -> int:
    """The next dataset behind lines of text, as some programs write; the place itself if none.

    Lines of numbers are the payload of a damaged dataset, and no text.
    """
    start = position
    for _ in range(_MOST_TEXT):
        line, after = _line(data, start)
        if line.strip() == b"-1":
            number = _line(data, after)[0][:6].strip()
            return start if number.isdigit() else position
        if line.strip(_IGNORED_BETWEEN) and not _WORD.search(line):
            return position
        start = after
    return position


def _dataset(path: Path, data: mmap.mmap, index: int, start: int, after: int) -> Dataset:
    """Read the dataset that opens at `start`; its number is at `after`."""
    line, body = _line(data, after)
    text = line[:6].decode("latin-1").strip()
    if not (text.isascii() and text.isdigit()):
        found = repr(line[:20].decode("latin-1")) if line else "the end of the file"
        raise damaged(place(path, index), found, "the number of the dataset must be here")
    number, header, closing = int(text), None, None
    if number == 58:
        header, body = _header(path, data, index, after)
        if header.binary:
            return _binary_function(path, data, Dataset(index, 58, start, start, header), body)
        closing = _predicted_delimiter(data, body, header)
    is_predicted = closing is not None
    if closing is None and (closing := _find_delimiter(data, body - 1)) is None:
        rule = 'each dataset ends with a line "    -1": the file is truncated'
        raise damaged(place(path, index), f"no closing delimiter of dataset type {number}", rule)
    stop, payload = _line(data, closing)[1], (body, closing)
    return Dataset(index, number, start, stop, header, payload, is_equal_lines=is_predicted)


def _header(path: Path, data: mmap.mmap, index: int, position: int) -> tuple[Header58, int]:
    """Header of a dataset 58, and where its values begin."""
    lines: list[str] = []
    while len(lines) <= HEADER_LINES and position < len(data):
        line, position = _line(data, position)
        lines.append(_decoded(line))
    try:
        return parse_header(lines), position
    except HeaderError as fault:
        raise damaged(place(path, index, fault.line), fault.found, fault.rule) from None


def _decoded(line: bytes) -> str:
    """A header line, in UTF-8 or as old programs write it."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", "replace")


def _binary_function(path: Path, data: mmap.mmap, dataset: Dataset, begin: int) -> Dataset:
    """End at the byte count if the delimiter is there, otherwise where the values must end."""
    header = dataset.header58
    layouts = {layout.itemsize * header.n_values: layout for layout in _layouts(header)}
    defined = next(iter(layouts.values()))
    for size in (header.n_bytes, *layouts):
        stop = _closed_at(data, begin + size)
        if stop is None:
            continue
        if size not in layouts:
            break
        layout, remark = layouts[size], ""
        if size != header.n_bytes or layout != defined:
            each = f"{layout.itemsize} for each of {header.n_values} values"
            stated = f"{header.n_bytes} bytes of kind {header.ordinate}"
            remark = f"header: {stated}; found: {size} bytes, {each}; read as such"
        payload = (begin, begin + size)
        return replace(dataset, stop=stop, payload=payload, layout=layout, remark=remark)
    item = defined.itemsize
    end = begin + item * header.n_values
    closing = _find_delimiter(data, begin, min(end + item, len(data)), at_line_start=False)
    held = ((len(data) if closing is None else closing) - begin) // item
    where = place(path, dataset.index)
    if held < header.n_values:
        raise damaged(where, f"{max(held, 0)} of {header.n_values} values", "the file is truncated")
    found = f"no closing delimiter behind {header.n_values} values ({header.n_bytes} bytes stated)"
    rule = 'the payload must end with a line "    -1" at the stated byte count'
    raise damaged(where, found, rule)


def _layouts(header: Header58) -> list[np.dtype[np.void] | np.dtype[np.inexact]]:
    """Ways the values may be stored, the defined one first.

    The others exist in the wild: doubles under a single-precision header, and abscissae of
    uneven spacing in double precision.
    """
    order = "<" if header.byte_order == LITTLE_ENDIAN else ">"
    kind, parts = ("c", 2) if header.is_complex else ("f", 1)
    own = 8 if header.is_double else 4
    if header.even:
        return [np.dtype(f"{order}{kind}{width * parts}") for width in sorted({own, 8})]
    return [
        np.dtype([("abscissa", f"{order}f{x}"), ("value", f"{order}{kind}{y * parts}")])
        for x, y in ((4, own), (8, 8))
    ]


def _line(data: mmap.mmap, position: int) -> tuple[bytes, int]:
    """Line at `position` without its end (cut to a header line), and the place of the next."""
    end = data.find(b"\n", position)
    end = len(data) if end < 0 else end
    line = data[position : min(end, position + _LONGEST_LINE)].rstrip(b"\r")
    return line, min(end + 1, len(data))


def _next_content(data: mmap.mmap, position: int) -> int:
    """Start of the next line that is not blank."""
    begin = position
    while part := data[begin : begin + _CHUNK_BYTES]:
        content = part.lstrip(_IGNORED_BETWEEN)
        begin += len(part) - len(content)
        if content:
            return max(position, data.rfind(b"\n", position, begin) + 1)
    return len(data)


def _is_delimiter(data: mmap.mmap, position: int) -> bool:
    line = data[position : position + _LONGEST_LINE].partition(b"\n")[0]
    return line.startswith(DELIMITER) and line.strip(_IGNORED_BETWEEN) == b"-1"


def _predicted_delimiter(data: mmap.mmap, begin: int, header: Header58) -> int | None:
    """Closing delimiter where long text of equal lines must end; None if it is not there."""
    line = data[begin : begin + _LONGEST_LINE].partition(b"\n")[0]
    per_line, length = line.count(b"."), len(line) + 1
    full, rest = divmod(header.n_values * header.numbers_per_value, max(per_line, 1))
    end = begin + full * length
    if not per_line or end - begin < _WORTH_A_JUMP or end > len(data):
        return None
    if any(data[each - 1 : each] != b"\n" for each in (end, end - length)):
        return None
    closing = _find_delimiter(data, end - 1, min(end + length + len(DELIMITER), len(data)))
    return closing if closing is not None and data[end:closing].count(b".") == rest else None


def _find_delimiter(
    data: mmap.mmap, position: int, stop: int | None = None, *, at_line_start: bool = True
) -> int | None:
    """Next closing delimiter from `position` on; binary payloads do not end with a line."""
    mark = b"\n" + DELIMITER if at_line_start else DELIMITER
    stop = len(data) if stop is None else stop
    while (position := data.find(mark, position, stop)) >= 0:
        delimiter = position + len(mark) - len(DELIMITER)
        if _is_delimiter(data, delimiter):
            return delimiter
        position += 1
    return None


def _closed_at(data: mmap.mmap, position: int) -> int | None:
    """Byte behind the closing delimiter, if one is at `position` or after a line end."""
    if position > len(data):
        return None
    behind = data[position : position + _LONGEST_LINE]
    position += len(behind) - len(behind.lstrip(b"\r\n"))
    return _line(data, position)[1] if _is_delimiter(data, position) else None


class Lines:
    """The lines of a dataset of text, read one after the other."""

    def __init__(self, path: Path, dataset: Dataset) -> None:
        self._path, self._index = path, dataset.index
        with path.open("rb") as file:
            file.seek(dataset.payload[0])
            text = file.read(dataset.payload[1] - dataset.payload[0]).decode("latin-1")
        self._lines = [line.rstrip("\r") for line in text.split("\n")[:-1]]
        self._next = 0

    @property
    def where(self) -> str:
        """The line read last, as messages name it."""
        return place(self._path, self._index, self._next + 2)

    def more(self) -> bool:
        """Whether there are more lines that are not blank."""
        while self._next < len(self._lines) and not self._lines[self._next].strip():
            self._next += 1
        return self._next < len(self._lines)

    def text(self, n: int = 1) -> str:
        """Read `n` lines and return the last one."""
        self._next += n
        if self._next > len(self._lines):
            self._next = len(self._lines) + 1
            raise damaged(self.where, "the end of the dataset", "one more line is required")
        return self._lines[self._next - 1]

    def numbers(self, widths: Sequence[int], least: int) -> list[float]:
        """Numbers on the next line, of which there must be at least `least`; see `line_numbers`."""
        numbers = line_numbers(self.text(), widths, self.where)
        if len(numbers) < least:
            raise damaged(self.where, f"{len(numbers)} numbers", f"the line needs {least} numbers")
        return numbers

    def integers(self, least: int) -> list[int]:
        """Integers on the next line, in columns of ten; see `numbers`."""
        return self.as_integers(self.numbers((10,) * 8, least))

    def as_integers(self, numbers: Sequence[float]) -> list[int]:
        """Numbers of the line read last that must be integers, e.g. labels of nodes."""
        for number in numbers:
            if not number.is_integer() or abs(number) > _LARGEST_INTEGER:
                raise damaged(self.where, f"{number:g}", "labels and codes must be whole numbers")
        return [int(number) for number in numbers]


def line_numbers(line: str, widths: Sequence[int], where: str) -> list[float]:
    """Numbers of a line: separated ones, or touching ones cut by the widths of their columns."""
    try:
        return [parse_number(word) for word in line.split()]
    except ValueError:
        text = line.rstrip()
    numbers, begin = [], 0
    for width in widths:
        if begin >= len(text):
            break
        field = text[begin : begin + width]
        try:
            numbers.append(parse_number(field))
        except ValueError:
            rule = f"columns {begin + 1} to {begin + width} must be a number"
            raise damaged(where, repr(field), rule) from None
        begin += width
    if rest := text[begin:].strip():
        raise damaged(where, repr(rest[:20]), f"nothing may follow column {begin}")
    return numbers
