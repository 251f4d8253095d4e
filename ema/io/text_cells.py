"""Cells of a line of text: numbers, missing samples, times of day, names with units."""

from __future__ import annotations

import csv
import re

from ema.io.columns import is_time, name_and_unit
from ema.io.units import parse_unit
from ema.visible import original

BLANKS = " "  # as a separator: any run of blanks and tabs

_NUMBER = {
    decimal: re.compile(rf"[+-]?(?:[0-9]+(?:{sign}[0-9]*)?|{sign}[0-9]+)(?:[eEdD][+-]?[0-9]+)?")
    for decimal, sign in ((".", r"\."), (",", ","))
}
_SPREADSHEET_FAULTS = ("#n/a", "#nv", "#num!", "#wert!", "#value!", "#div/0!", "#ref!")
_NO_NUMBERS = ("nan", "-nan", "+nan", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind")
_INFINITIES = ("inf", "-inf", "+inf", "infinity", "-infinity", "1.#inf", "-1.#inf")
_NOTHING = ("", "-", "--", "null", "none", "n/a", "na")
_MISSING = frozenset((*_NOTHING, *_NO_NUMBERS, *_INFINITIES, *_SPREADSHEET_FAULTS))
_CLOCK = re.compile(
    r"(?:[0-9]{4}([-/])[0-9]{2}\1[0-9]{2}[T ])?[0-9]{2}:[0-9]{2}:[0-9]{2}(?:[.,][0-9]{1,9})?Z?"
)
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:[.,][0-9]{3})+")
# Units behind a name without square brackets: "Force (N)", and "Kraft / N" as in DIN 461.
_OTHER_LABELS = (
    re.compile(r"(?P<name>.*\S)\s*\((?P<unit>[^()]*(?:\([^()]*\))?[^()]*)\)"),
    re.compile(r"(?P<name>.*\S)\s+/\s+(?P<unit>\S+)"),
)
_COMMENT_MARK = re.compile(r"^ *(?:[#!']+|//|%+(?= )) *")
_LONGEST_NAME = 400
_SECONDS = {"seconds": "s", "second": "s", "secs": "s", "sekunden": "s", "msec": "ms"}


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell is a number with this decimal sign."""
    return _NUMBER[decimal].fullmatch(cell) is not None


def may_hold_thousands(cell: str) -> bool:
    """Whether points or commas in a number may as well separate thousands: ``1,234``."""
    return _THOUSANDS.fullmatch(cell) is not None


def is_missing(cell: str) -> bool:
    """Whether a cell stands for a sample that was not taken, such as ``NaN`` or ``-``."""
    return cell.lower() in _MISSING


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day, ``hh:mm:ss.s``, or a date and time as in ISO 8601."""
    return _CLOCK.fullmatch(cell) is not None


def is_not_a_number(cell: str) -> bool:
    """Whether a cell is a missing sample where a number stood, so that no name reads like it."""
    return cell.lower() in _NO_NUMBERS


def holds_numbers_alone(line: str) -> bool:
    """Whether a line holds nothing but numbers, whatever separates them."""
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

    Where blanks separate, names may hold blanks too: `width` tells how many cells to look for.
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
    """Whether a text is a unit of a channel or of time."""
    text = text.strip().removeprefix("[").removesuffix("]")
    return bool(text) and (parse_unit(text) is not None or is_time("t", _plain_time(text)))


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


def is_time_label(cell: str) -> bool:
    """Whether a heading is that of a time column."""
    name, unit = label(cell)
    return is_time(name, _plain_time(unit))


def time_unit(name: str, unit: str) -> str:
    """Unit of a column, that of a time column in the spelling that `is_time` knows."""
    return _plain_time(unit) if is_time(name, "") else unit


def _plain_time(unit: str) -> str:
    return _SECONDS.get(unit.lower(), unit)
