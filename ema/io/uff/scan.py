"""Find the datasets of a universal file without reading what they hold."""

from __future__ import annotations

import mmap
from codecs import BOM_UTF8
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ema.core.errors import RecordingFormatError
from ema.core.files import require_regular
from ema.io.uff.dataset58_header import (
    DELIMITER,
    HEADER_LINES,
    LITTLE_ENDIAN,
    Header58,
    HeaderError,
    parse_header,
)

_LONGEST_LINE = 256  # header lines have 80 columns; nothing longer is looked at
_WORTH_A_JUMP = 1 << 20  # bytes of text that are searched faster than a jump is worth
_CHUNK_BYTES = 1 << 12
_IGNORED_BETWEEN = b" \t\r\n\x00\x1a"  # blank lines, padding, the end mark of old systems
COPY_AGAIN = "Copy or export the file again, or leave out the run"


@dataclass(frozen=True)
class Dataset:
    """One dataset of a universal file and where it lies.

    Parameters
    ----------
    index : int
        Place in the file, from 1.
    number : int
        Kind of dataset, e.g. 58 or 2411.
    start, stop : int
        Bytes from the opening delimiter to behind the closing one.
    header : Header58 or None
        Of a dataset 58.
    payload : tuple of int
        First and last byte (exclusive) of a dataset 58's values.
    layout : numpy dtype or None
        One record of a binary payload: a value, or abscissa and value where spacing is uneven.
    remark : str
        What does not fit the definition but could be read all the same.
    is_equal_lines : bool
        Whether the payload is long text that ends where lines like its first one have to end.
    """

    index: int
    number: int
    start: int
    stop: int
    header: Header58 | None = None
    payload: tuple[int, int] = (0, 0)
    layout: np.dtype[np.void] | np.dtype[np.inexact] | None = None
    remark: str = ""
    is_equal_lines: bool = False


def scan(path: Path) -> tuple[Dataset, ...]:
    """List the datasets of a universal file, seeking over the values of functions.

    Binary payloads end where their byte count says; text of equally long lines ends where their
    number says. The delimiter has to stand there; else it is searched for.

    Raises
    ------
    RecordingFormatError
        If the file is missing, empty, no universal file, truncated or damaged.
    """
    try:
        with require_regular(path).open("rb") as file:
            if not path.stat().st_size:
                rule = "a recording needs at least one dataset"
                raise RecordingFormatError(str(path), "the file is empty", rule, COPY_AGAIN)
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                return tuple(_datasets(path, data))
    except OSError as error:
        reason = error.strerror or str(error)
        rule = "it must be a file that can be read"
        raise RecordingFormatError(
            str(path), reason, rule, "Check the name and the access rights"
        ) from error


def place(path: Path, index: int, line: int | None = None) -> str:
    """Say where in a universal file something was found."""
    return f"{path.name}, dataset {index}" + ("" if line is None else f", line {line}")


def _datasets(path: Path, data: mmap.mmap) -> list[Dataset]:
    found: list[Dataset] = []
    has_mark = data[: len(BOM_UTF8)] == BOM_UTF8  # left by an editor of text
    position = _next_content(data, len(BOM_UTF8) if has_mark else 0)
    while position < len(data):
        index = len(found) + 1
        opening, after = _line(data, position)
        if opening.rstrip() != DELIMITER and opening.strip() != b"-1":
            what = repr(opening[:20].decode("latin-1"))
            rule = 'a dataset of a universal file begins with a line "    -1"'
            raise RecordingFormatError(place(path, index), what, rule, COPY_AGAIN)
        dataset = _dataset(path, data, index, position, after)
        found.append(dataset)
        position = _next_content(data, dataset.stop)
    if not found:
        rule = "a recording needs at least one dataset"
        raise RecordingFormatError(str(path), "nothing but blanks or zeros", rule, COPY_AGAIN)
    return found


def _dataset(path: Path, data: mmap.mmap, index: int, start: int, after: int) -> Dataset:
    """Read the dataset that opens at `start`; its number stands at `after`."""
    line, body = _line(data, after)
    text = line[:6].decode("latin-1").strip()
    if not (text.isascii() and text.isdigit()):
        found = repr(line[:20].decode("latin-1")) if line else "the end of the file"
        rule = "the number of the dataset follows its opening delimiter"
        raise RecordingFormatError(place(path, index), found, rule, COPY_AGAIN)
    number = int(text)
    if number == 58:
        return _function(path, data, index, start, after)
    closing = _find_delimiter(data, body - 1)
    if closing is None:
        raise _unclosed(path, index, number)
    return Dataset(index, number, start, _line(data, closing)[1])


def _function(path: Path, data: mmap.mmap, index: int, start: int, after: int) -> Dataset:
    lines: list[str] = []
    position = after
    while len(lines) <= HEADER_LINES and position < len(data):
        line, position = _line(data, position)
        lines.append(line.decode("latin-1"))
    try:
        header = parse_header(lines)
    except HeaderError as fault:
        where = place(path, index, fault.line)
        raise RecordingFormatError(where, fault.found, fault.rule, COPY_AGAIN) from None
    if header.binary:
        return _binary_function(path, data, Dataset(index, 58, start, start, header), position)
    predicted = _predicted_delimiter(data, position, header)
    closing = _find_delimiter(data, position - 1) if predicted is None else predicted
    if closing is None:
        raise _unclosed(path, index, 58)
    stop = _line(data, closing)[1]
    equal = predicted is not None
    return Dataset(index, 58, start, stop, header, (position, closing), is_equal_lines=equal)


def _binary_function(path: Path, data: mmap.mmap, draft: Dataset, begin: int) -> Dataset:
    """Trust the byte count, verify it by the delimiter, and else try what the values need."""
    header = draft.header
    assert header is not None
    layouts = _layouts(header)
    sizes = [header.n_bytes, *(layout.itemsize * header.n_values for layout in layouts)]
    for size in sizes:
        stop = _closed_at(data, begin + size)
        if stop is None:
            continue
        fitting = [each for each in layouts if each.itemsize * header.n_values == size]
        if not fitting:
            break
        remark = ""
        if size != header.n_bytes or fitting[0] != layouts[0]:
            remark = (
                f"header: {header.n_bytes} bytes of kind {header.ordinate}; found: {size} "
                f"bytes, {fitting[0].itemsize} for each of {header.n_values} values; read as "
                "such"
            )
        payload = (begin, begin + size)
        return Dataset(draft.index, 58, draft.start, stop, header, payload, fitting[0], remark)
    raise _wrong_size(path, data, draft, begin, layouts[0].itemsize)


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
    pairs = [(4, own), (8, own)] if header.is_double else [(4, 4), (8, 8)]
    return [
        np.dtype([("abscissa", f"{order}f{x}"), ("value", f"{order}{kind}{y * parts}")])
        for x, y in pairs
    ]


def _wrong_size(
    path: Path, data: mmap.mmap, draft: Dataset, begin: int, item: int
) -> RecordingFormatError:
    header = draft.header
    assert header is not None
    end = begin + item * header.n_values
    closing = _find_delimiter(data, begin, min(end + item, len(data)), at_line_start=False)
    held = ((len(data) if closing is None else closing) - begin) // item
    where = place(path, draft.index)
    if held < header.n_values:
        found = f"{max(held, 0)} of {header.n_values} values"
        return RecordingFormatError(where, found, "the file is truncated", COPY_AGAIN)
    found = f"no closing delimiter behind {header.n_values} values ({header.n_bytes} bytes stated)"
    rule = 'the payload must end with a line "    -1" at the stated byte count'
    return RecordingFormatError(where, found, rule, COPY_AGAIN)


def _unclosed(path: Path, index: int, number: int) -> RecordingFormatError:
    found = f"no closing delimiter of dataset type {number}"
    rule = 'each dataset ends with a line "    -1": the file is truncated'
    return RecordingFormatError(place(path, index), found, rule, COPY_AGAIN)


def _line(data: mmap.mmap, position: int) -> tuple[bytes, int]:
    """Line at `position` without its end (cut to what a header line may hold), and the next."""
    end = data.find(b"\n", position)
    end = len(data) if end < 0 else end
    return data[position : min(end, position + _LONGEST_LINE)].rstrip(b"\r"), min(
        end + 1, len(data)
    )


def _next_content(data: mmap.mmap, position: int) -> int:
    """Skip blank lines; back to the start of the line that holds something."""
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
    """Closing delimiter where long text of equal lines has to end; None if it is not there."""
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
    """Byte behind the closing delimiter, if one stands at `position` or after a line end."""
    if position > len(data):
        return None
    behind = data[position : position + _LONGEST_LINE]
    position += len(behind) - len(behind.lstrip(b"\r\n"))
    return _line(data, position)[1] if _is_delimiter(data, position) else None
