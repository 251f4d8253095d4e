"""Text of a file piece by piece: unpacked, decoded, with one kind of line ends."""

from __future__ import annotations

import codecs
import csv
import gzip
import os
import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from ema.core.errors import RecordingFormatError, original
from ema.core.units import parse_axis, parse_ratio, parse_unit
from ema.io.columns import name_and_unit
from ema.io.content import COPY_AGAIN, unreadable
from ema.io.rates import parse_number

_HEAD_BYTES = 1 << 20
_SMALLEST_SECTION = 1 << 18
_LARGEST_SECTION = 1 << 23
_LONGEST_LINE = 1 << 26
_PIECE_BYTES = 1 << 17  # they stay near the processor
_MOST_PACKED = 50  # digits pack 3 to 10 times; far more is not a measurement
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


class TextSource:
    """A text file that is open for reading, once from its beginning to its end.

    `sections` are text in `encoding`, a superset of ASCII, with lines that end in LF or CR LF;
    UTF-16 becomes UTF-8, and a byte-order mark is left out. `head` is the beginning of the text,
    up to a megabyte, and all of it if `is_whole`.
    """

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self.path = path
        self._size = file.seek(0, os.SEEK_END)
        file.seek(0)
        self._packed = path.name.lower().endswith(".gz")
        self._stream = cast(BinaryIO, gzip.GzipFile(fileobj=file)) if self._packed else file
        self._unpacked = 0
        self._decoder: codecs.IncrementalDecoder | None = None
        self._has_cr_alone = False
        self._bytes = self._beginning()
        self.is_whole = self._unpacked < _HEAD_BYTES
        self.head, self.encoding = _decoded(self._bytes)

    def sections(self, start: int) -> Iterator[bytes]:
        """Whole lines from character `start` of `head` on, some of them at a time.

        A last line without a line end comes separately. `head` is released, to save memory.
        """
        rest = self._bytes[len(self.head[:start].encode(self.encoding)) :]
        self._bytes, self.head = b"", ""
        size = min(max(self._size // 4, _SMALLEST_SECTION), _LARGEST_SECTION)
        carried = b""
        pieces = (rest[begin : begin + size] for begin in range(0, len(rest), size))
        for piece in chain(pieces, iter(lambda: self._plain(self._raw(size)), b"")):
            end = piece.rfind(b"\n") + 1
            if end:
                yield b"".join((carried, memoryview(piece)[:end]))
                carried = b""
            carried += piece[end:]
            if len(carried) > _LONGEST_LINE:
                found = f"a line of over {_LONGEST_LINE >> 20} MB"
                rule = "rows of a table must not be longer"
                raise RecordingFormatError(self.path.name, found, rule, COPY_AGAIN)
        if carried:
            yield carried

    def _beginning(self) -> bytes:
        raw = self._raw(_HEAD_BYTES)
        if raw.startswith(_UTF_16):
            self._decoder = codecs.getincrementaldecoder("utf-16")()
        raw = self._plain(raw).removeprefix(codecs.BOM_UTF8)
        self._has_cr_alone = b"\r" in raw and b"\n" not in raw
        return raw.replace(b"\r", b"\n") if self._has_cr_alone else raw

    def _plain(self, raw: bytes) -> bytes:
        """What was read, with UTF-16 as UTF-8 and a carriage return alone as a line end."""
        if self._decoder is not None:
            try:
                raw = self._decoder.decode(raw, final=not raw).encode()
            except UnicodeDecodeError as error:
                rule = "the file begins as UTF-16 and must be UTF-16 to its end"
                raise RecordingFormatError(self.path.name, str(error), rule, COPY_AGAIN) from error
        return raw.replace(b"\r", b"\n") if self._has_cr_alone else raw

    def _raw(self, size: int) -> bytes:
        try:
            raw = self._stream.read(size)
        except (gzip.BadGzipFile, EOFError, zlib.error) as error:
            rule = "a file ending in .gz must be packed by gzip and complete"
            raise RecordingFormatError(self.path.name, str(error), rule, COPY_AGAIN) from error
        except OSError as error:
            raise unreadable(self.path, error) from error
        self._unpacked += len(raw)
        if self._packed and self._unpacked > _MOST_PACKED * self._size + _HEAD_BYTES:
            found = f"over {self._unpacked} bytes of text in {self._size}"
            rule = f"measured numbers do not pack more than {_MOST_PACKED} times"
            raise RecordingFormatError(self.path.name, found, rule, "Unpack it if you trust it")
        return raw


@contextmanager
def open_text(path: Path) -> Iterator[TextSource]:
    """Open a text file, packed by gzip where its name ends in ``.gz``."""
    try:
        file = path.open("rb")
    except OSError as error:
        raise unreadable(path, error) from error
    with file:
        yield TextSource(path, file)


def _decoded(raw: bytes) -> tuple[str, str]:
    """Text and encoding of a file's beginning, which may end within a character."""
    for encoding in ("utf-8", "cp1252"):
        try:
            return codecs.getincrementaldecoder(encoding)().decode(raw), encoding
        except UnicodeDecodeError:
            continue
    return raw.decode("latin-1"), "latin-1"


def count_of(sign: bytes, text: bytes) -> int:
    """How often a character is in a long text; `bytes.count` is slow where it often is."""
    characters = np.frombuffer(text, np.uint8)
    pieces = range(0, len(text), _PIECE_BYTES)
    return sum(
        int(np.count_nonzero(characters[at : at + _PIECE_BYTES] == sign[0])) for at in pieces
    )


def begins_some_line(signs: bytes, text: bytes) -> bool:
    """Whether a line of a text begins with one of some characters."""
    characters = np.frombuffer(text, np.uint8)
    ends = np.flatnonzero(characters[:-1] == ord("\n"))
    return text[:1] in signs or bool(np.isin(characters[ends + 1], list(signs)).any())


_MOST_LINES = 2000  # blank ones too
_MOST_JOINED = 10  # lines of one row, in whose quoted names lines break
_OPEN_QUOTE = re.compile(r"(?:^|[\t;,|])[ ]*\"[^\"]*$")
_RULE = " \t\r\x1a,;|+-=_*#"  # characters of a rule between header and numbers


@dataclass(frozen=True)
class Line:
    """A line, or several that a quoted cell joins."""

    text: str  # without its end
    number: int  # in the file, counted from 1
    start: int  # its first character in the beginning of the file


def lines_of(source: TextSource) -> Iterator[Line]:
    """Lines that are not blank; lines joined by a quoted cell count as one."""
    text, start, number = source.head, 0, 1
    has_quotes = '"' in text
    while start < len(text) and number <= _MOST_LINES:
        end = _line_end(text, start)
        joined = end
        for _ in range(_MOST_JOINED if has_quotes else 0):
            if joined >= len(text) or not _OPEN_QUOTE.search(_last_line(text, start, joined)):
                break
            joined = _line_end(text, joined)
            if text.count('"', start, joined) % 2 == 0:
                end = joined
                break
        if end == len(text) and not source.is_whole and text[-1] != "\n":
            return  # the head ends within this line
        line = text[start:end].rstrip("\r\n").translate(_TYPESET)
        if line.strip(_RULE):
            yield Line(line, number, start)
        number += text.count("\n", start, end)
        start = end


def _line_end(text: str, start: int) -> int:
    return text.find("\n", start) + 1 or len(text)


def _last_line(text: str, start: int, end: int) -> str:
    """The line in which a quotation mark may be open; empty where none is."""
    line = text[start:end].rstrip("\r\n")
    return line if line.count('"') % 2 else ""


@dataclass(frozen=True)
class Dialect:
    """How a table is written: a blank as separator means any run of blanks and tabs."""

    separator: str
    decimal: str  # point or comma


BLANKS = " "  # as a separator: any run of blanks and tabs

# A point or comma that separates thousands counts only before a decimal sign: 1.234,56 or
# 1,234.56; an apostrophe or a blank always: 1'234.5 (Switzerland), 1 234,5 (ISO 80000).
_NUMBER = {
    decimal: re.compile(
        rf"[+-]?(?:[0-9]+(?:{sign}[0-9]*)?|{sign}[0-9]+)(?:[eEdD][+-]?[0-9]+)?"
        rf"|[+-]?[1-9][0-9]{{0,2}}(?:{thousands}[0-9]{{3}})+{sign}[0-9]+"
        rf"|[+-]?[1-9][0-9]{{0,2}}(?:(?:['\u2019][0-9]{{3}})+|(?: [0-9]{{3}})+)(?:{sign}[0-9]*)?"
    )
    for decimal, sign, thousands in ((".", r"\.", ","), (",", ",", r"\."))
}
# A minus sign and blanks as word processors set them.
TYPESET = {"\u2212": "-", "\u00a0": " ", "\u202f": " ", "\u2009": " "}
_TYPESET = {ord(sign): plain for sign, plain in TYPESET.items()}
# Cells, in lower case, that cannot be mistaken for a name, and all that mark a missing sample.
NOT_A_NUMBER = frozenset(("nan", "-nan", "+nan", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind"))
MISSING = NOT_A_NUMBER | {"", "-", "--", "null", "none", "n/a", "na"}
MISSING |= {"inf", "-inf", "+inf", "infinity", "-infinity", "1.#inf", "-1.#inf"}
MISSING |= {"#n/a", "#nv", "#num!", "#wert!", "#value!", "#div/0!", "#ref!"}  # of spreadsheets
_DATE = r"[0-9]{4}[-/.][0-9]{2}[-/.][0-9]{2}|[0-9]{1,2}[-/.][0-9]{1,2}[-/.](?:[0-9]{4}|[0-9]{2})"
DATE = re.compile(_DATE)
_LONGEST_DATE = 10  # characters
_MONTH = r"[A-Za-zÀ-ÿ]{3,9}\.?"
_LONG_DATE = (
    rf"{_DATE}|[0-9]{{8}}|[0-9]{{1,5}} days?|[0-9]{{1,2}}\.?[- ]{_MONTH}[- ][0-9]{{2,4}}"
    rf"|{_MONTH} [0-9]{{1,2}},? [0-9]{{4}}"
)
_WEEKDAY = r"[DFMSTW][a-zàéíéäö]{1,9}\.?,?[ ]+"
# A time of day or since a start, perhaps with a date: ISO 8601, 31.12.2026, 12/31/2026,
# Sat 31-Dec-2026; behind it perhaps a zone (Z, +01:00, CET, Europe/Berlin). Where there are no
# hours, minutes with a fraction.
CLOCK = re.compile(
    rf"(?:(?:{_WEEKDAY})?(?P<date>{_LONG_DATE})(?:T|[ ]*[-_ ][ ]*))?(?P<hours>[0-9]{{1,2}}:)?"
    r"(?P<rest>[0-9]{2}:[0-9]{2}(?:[.,][0-9]{1,9}|:[0-9]{3}(?:[0-9]{3}){0,2})?)"
    r"(?:[ ]*(?P<half>[AaPp])\.?[Mm]\.?)?"
    r"(?:[ ]?(?:Z|[A-Z]{3,4}(?:[+-][0-9]{1,2})?|[+-][0-9]{2}(?::?[0-9]{2})?))?"
    r"(?:[ ]?\[?[A-Z][A-Za-z_]+(?:/[A-Za-z_]+)+\]?)?"
)
# A complex number in one cell, as numpy and MATLAB write it.
COMPLEX = re.compile(r"[0-9.]\s?[+-]\s?(?:[ij]\*?[0-9.]|[0-9.]+(?:[eE][+-]?[0-9]+)?\s?\*?[ij]\b)")
COMPLEX_RULE = "a complex number must have a cell for its real and one for its imaginary part"
COMPLEX_REMEDY = "Write two columns, such as H1 real and H1 imag"
# Numbers whose points or commas may as well separate thousands: 1,234.
THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:[.,][0-9]{3})+")
# Units behind a name without square brackets: "Force (N)", and "Kraft / N" as in DIN 461.
_OTHER_LABELS = (
    re.compile(r"(?P<name>.*\S)\s*\((?P<unit>[^()]*(?:\([^()]*\))?[^()]*)\)"),
    re.compile(r"(?P<name>.*\S)\s+/\s+(?P<unit>\S+)"),
    re.compile(r"(?P<name>.*\S)\s+(?P<unit>\([^()]*\)/\w+)"),  # real (m/s²)/N
)
_PHASES = {"deg", "°", "degree", "degrees", "rad", "radian"}
_COMMENT_MARK = re.compile(r"^ *(?:[#!']+|//|%+(?= )) *")
_LONGEST_NAME = 400


_DAY_S = 86_400.0
_ABSOLUTE_S = 1e8  # starts of this size contain the date: LabVIEW counts from 1904


def starts_of(values: Sequence[str], decimal: str, clocks: Sequence[str] = ()) -> list[float]:
    """Starts of channels in s, from numbers or times of day, behind `clocks` if there are some.

    ValueError for other texts. Times of day may pass midnight.
    """
    times = [_seconds_of_day(each) for each in clocks] or [0.0] * len(values)
    if any(":" in each for each in values):
        times, values = [_seconds_of_day(each) for each in values], ["0"] * len(values)
    if max(times) - min(times) > _DAY_S / 2:
        times = [each + _DAY_S * (each < _DAY_S / 2) for each in times]
    starts = [parse_number((each or "0").replace(decimal, ".")) for each in values]
    if max(starts) >= _ABSOLUTE_S:
        return starts
    return [time + start for time, start in zip(times, starts, strict=True)]


def _seconds_of_day(text: str) -> float:
    match = re.fullmatch(r"(?:\S+[ T])?(\d\d?):(\d\d):(\d\d(?:[.,]\d+)?)", text.strip())
    if match is None:
        raise ValueError(f"{text!r} is no time of day")
    return 3600.0 * int(match[1]) + 60.0 * int(match[2]) + float(match[3].replace(",", "."))


def is_number(cell: str, decimal: str, *, is_only: bool = False) -> bool:
    """Whether a cell is a number with this decimal sign.

    If it `is_only` one in its row, a blank may separate columns, and no thousands.
    """
    return _NUMBER[decimal].fullmatch(cell) is not None and not (is_only and " " in cell)


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day or since a start, perhaps with a date."""
    return ":" in cell and CLOCK.fullmatch(cell) is not None  # far faster on numbers


def is_date(cell: str) -> bool:
    """Whether a cell is a date alone."""
    return len(cell) <= _LONGEST_DATE and DATE.fullmatch(cell) is not None


def holds_numbers_alone(line: str) -> bool:
    """Whether a line contains only numbers, whatever separates them."""
    texts = re.split(r"[;,\t |\"]+", line.strip())
    return all(not text or is_number(text, ".") for text in texts)


def cells_of(line: str, separator: str) -> list[str]:
    """Cells of a line, without quotation marks and the blanks around them."""
    if separator == BLANKS:
        line = " ".join(line.split())
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    try:
        (cells,) = csv.reader([line], delimiter=separator, skipinitialspace=True)
    except csv.Error:  # a line break outside of quotation marks, or a cell too long to be one
        return [line]
    return [cell.strip() for cell in cells]


def heading_cells(line: str, separator: str, width: int) -> list[str]:
    """Cells of a line of names or units, without a comment mark in front.

    Where blanks separate, names may contain blanks too: `width` is the number of cells expected.
    """
    line = _COMMENT_MARK.sub("", line)
    cells = cells_of(line, separator)
    if separator != BLANKS or len(cells) == width:
        return cells
    line = line.strip()
    for pattern in (r"\s{2,}|\t", r"\s+(?![\[(])"):
        cells = re.split(pattern, line)
        if len(cells) == width:
            return cells
    return cells_of(line, separator)


def is_known_unit(text: str) -> bool:
    """Whether a text is a unit of a channel, an axis or an FRF."""
    text = text.strip().removeprefix("[").removesuffix("]")
    if not text:
        return False
    if text.lower() in _PHASES or text.startswith("dB"):
        return True
    return any(parse(text) is not None for parse in (parse_unit, parse_axis, parse_ratio))


def label(cell: str) -> tuple[str, str]:
    """Name and unit of a heading such as ``A01 [g]``, ``A01 (g)`` or ``A01 / g``, on one line."""
    name, unit = name_and_unit(original(" ".join(cell.split()))[:_LONGEST_NAME])
    if unit:
        return name, unit
    for pattern in _OTHER_LABELS:
        match = pattern.fullmatch(name)
        if match and is_known_unit(match["unit"]):
            return match["name"], match["unit"].strip()
    return name, ""
