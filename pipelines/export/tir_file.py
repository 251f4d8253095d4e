"""Tyre property files (.tir, TeimOrbit): read with their units, single values changed, written."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from pathlib import Path

from ema.core.errors import InputError, unknown
from ema.core.files import require_regular
from pipelines.storage.atomic import file_written_whole

# Files are in UTF-8, in code pages of Windows, or in both: bytes that are not UTF-8 are kept.
_ENCODING, _UNDECODED = "utf-8", "surrogateescape"
_LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")
_SECTION = re.compile(r"\ufeff?\s*\[(?P<name>[^\]\r\n]*)\]")
_ENTRY = re.compile(
    r"(?P<key>\ufeff?[ \t]*[A-Za-z][\w.]*)(?P<equals>[ \t]*=[ \t]*)"
    r"(?P<value>'[^'\r\n]*'|\"[^\"\r\n]*\"|(?:[^$! \t\r\n]+(?:[ \t]+[^$! \t\r\n]+)*)?)"
    r"(?P<gap>[ \t]*)(?P<comment>(?:[$!][^\r\n]*)?)(?P<end>[\r\n]*)\Z"
)
UNITS = "UNITS"
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_INERTIA = {"MASS": 1, "LENGTH": 2}
_PRESSURE = {"FORCE": 1, "LENGTH": -2}
_STIFFNESS = {"FORCE": 1, "LENGTH": -1}
_NONE: dict[str, int] = {}


@dataclass(frozen=True)
class TirEntry:
    """A line ``KEY = value $comment``: section and key in upper case, the value without quotes.

    The section is empty above the first one; lines count from 1.
    """

    section: str
    key: str
    text: str
    line: int

    def is_in(self, section: str | None) -> bool:
        """Whether it is in a section; None means any but [UNITS]."""
        return self.section != UNITS if section is None else self.section == section.upper()


@dataclass(frozen=True)
class TirFile:
    """A tyre property file: its name in messages, and all lines with their ends."""

    name: str
    lines: tuple[str, ...]

    @property
    def content(self) -> bytes:
        """The file, byte for byte."""
        return "".join(self.lines).encode(_ENCODING, _UNDECODED)

    @cached_property
    def headings(self) -> tuple[tuple[str, int], ...]:
        """Name, in upper case, and line of each section in their order, with repetitions."""
        found = ((_SECTION.match(line), number) for number, line in enumerate(self.lines, 1))
        return tuple((match["name"].strip().upper(), number) for match, number in found if match)

    @cached_property
    def entries(self) -> tuple[TirEntry, ...]:
        """All lines that give a value to a key, without comments and rows of tables."""
        section, found = "", []
        section_at = {number: name for name, number in self.headings}
        for number, line in enumerate(self.lines, 1):
            section = section_at.get(number, section)
            if number not in section_at and (entry := _ENTRY.match(line)):
                key, value = entry["key"].lstrip("\ufeff \t").upper(), entry["value"]
                text = value[1:-1] if _quote(value) else value
                found.append(TirEntry(section, key, text, number))
        return tuple(found)

    def find(self, key: str, section: str | None = None) -> TirEntry | None:
        """The entry of a key, in upper or lower case; None where there is none.

        The default is any section but [UNITS], where MASS is the name of a unit. A key that is
        given more than once is refused.
        """
        found = [each for each in self.entries if each.key == key.upper() and each.is_in(section)]
        if len(found) > 1:
            lines = f"given in lines {' and '.join(str(entry.line) for entry in found)}"
            rule = "programs differ in which of them they use"
            raise InputError(f"{self.name}, {key.upper()}", lines, rule, "Keep one of them")
        return found[0] if found else None

    def number(self, key: str, section: str | None = None) -> float | None:
        """A value in the file's unit; None where the key is missing or empty."""
        entry = self.find(key, section)
        if entry is None or not entry.text:
            return None
        text = entry.text.strip().lower().replace("d", "e")  # Fortran writes 1.0D+05
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or "_" in text:
            where = f"{self.name}, line {entry.line}, {entry.key}"
            raise InputError(where, repr(entry.text), "it must be a number", "Correct the value")
        return value

    def with_value(self, entry: TirEntry, text: str) -> TirFile:
        """The file with another value in one line; quotes, comment and its column are kept."""
        match = _ENTRY.match(self.lines[entry.line - 1])
        if match is None:
            raise ValueError(f"line {entry.line} of {self.name} has no value")
        old, gap, quote = match["value"], match["gap"], _quote(match["value"])
        new = f"{quote}{text}{quote}"
        if match["comment"] and not gap:
            gap = " "
        elif match["comment"] and "\t" not in gap:  # at least one blank
            gap = " " * max(1, len(gap) + len(old) - len(new))
        line = f"{match['key']}{match['equals']}{new}{gap}{match['comment']}{match['end']}"
        before, after = self.lines[: entry.line - 1], self.lines[entry.line :]
        return replace(self, lines=(*before, line, *after))

    def with_entry(self, section: str, key: str, text: str) -> TirFile:
        """The file with a new line at the end of a section, aligned with the line above it.

        A missing section is added at the end of the file.
        """
        last = self._last_line(section)
        ends = [line[len(line.rstrip("\r\n")) :] for line in self.lines]
        end = self._line_end
        if last is None:
            new = f"{end if ends and not ends[-1] else ''}[{section}]{end}"
            return replace(self, lines=(*self.lines, new)).split().with_entry(section, key, text)
        above = _ENTRY.match(self.lines[last - 1])
        column, after = len(key) + 1, "= "
        if above:
            before, _, blanks = above["equals"].partition("=")
            column, after = len(above["key"].lstrip("\ufeff") + before), f"={blanks}"
        line = f"{'' if ends[last - 1] else end}{key:<{column}}{after}{text}{end}"
        lines = (*self.lines[:last], line, *self.lines[last:])
        return replace(self, lines=lines).split()

    def with_comment(self, text: str) -> TirFile:
        """The file with a comment line at its end."""
        open_end = bool(self.lines) and not self.lines[-1].endswith(("\r", "\n"))
        end = self._line_end
        return replace(self, lines=(*self.lines, f"{end if open_end else ''}$ {text}{end}")).split()

    @property
    def _line_end(self) -> str:
        """The most frequent end of a line."""
        ends = [line[len(line.rstrip("\r\n")) :] for line in self.lines]
        found = [each for each in ends if each]
        return max(set(found), key=found.count) if found else "\r\n"

    def split(self) -> TirFile:
        """The same content, one line each."""
        return replace(self, lines=tuple(_LINE.findall("".join(self.lines))))

    def _last_line(self, section: str) -> int | None:
        """Number of the last entry of a section, or of its heading; None where it is missing."""
        lines = [number for name, number in self.headings if name == section]
        lines += [entry.line for entry in self.entries if entry.section == section]
        return max(lines, default=None)


def tir_of(content: bytes, name: str) -> TirFile:
    """A tyre property file from any bytes; all are kept."""
    return TirFile(name, tuple(_LINE.findall(content.decode(_ENCODING, _UNDECODED))))


def read_tir(path: Path) -> TirFile:
    """Read a tyre property file; `InputError` if it cannot be read, or is another file."""
    try:
        content = require_regular(path).read_bytes()
    except OSError as error:
        found, rule = error.strerror or "unreadable", "it must be a tyre property file"
        raise InputError(str(path), found, rule, "Check the path") from error
    if content.startswith(_UTF_16) or b"\0" in content:
        rule = "tyre property files are plain text in UTF-8 or ANSI"
        found = "UTF-16, or not text"
        raise InputError(str(path), found, rule, "Save it as UTF-8, or choose a .tir file")
    tir = tir_of(content, path.name)
    if not tir.headings:
        rule = "a tyre property file must have sections, e.g. [UNITS]"
        raise InputError(str(path), "no section", rule, "Choose a .tir file")
    return tir


def _quote(value: str) -> str:
    """The quotation mark of a value; empty where it has none."""
    is_quoted = len(value) > 1 and value[0] == value[-1] and value[0] in "'\""
    return value[0] if is_quoted else ""


def save_tir(tir: TirFile, path: Path) -> Path | None:
    """Write a tyre property file and return the copy of an existing one."""
    with file_written_whole(path) as partial:
        partial.write_bytes(tir.content)
        backup = _backed_up(path) if path.exists() else None
        if backup is not None:
            shutil.copymode(path, partial)
    return backup


def _backed_up(path: Path) -> Path:
    """Copy a file to FILE.bak, or to FILE.bak2 and so on, whichever is free."""
    for number in count(1):
        backup = path.with_name(f"{path.name}.bak{number if number > 1 else ''}")
        with suppress(FileExistsError):
            backup.touch(exist_ok=False)
            break
    try:
        shutil.copy2(path, backup)
    except BaseException:  # no half copy, not even after an interrupt
        backup.unlink()
        raise
    return backup


_POUND_KG, _FOOT_M, _GRAVITY = 0.45359237, 0.3048, 9.80665

#: Sizes of units in SI by quantity and names; the first name is shown.
_SIZES: dict[str, dict[tuple[str, ...], float]] = {
    "LENGTH": {
        ("m", "meter", "metre", "meters"): 1.0,
        ("mm", "millimeter", "millimetre", "millimeters"): 1e-3,
        ("cm", "centimeter", "centimetre", "centimeters"): 1e-2,
        ("km", "kilometer", "kilometre", "kilometers"): 1e3,
        ("in", "inch", "inches"): _FOOT_M / 12.0,
        ("ft", "foot", "feet"): _FOOT_M,
    },
    "FORCE": {
        ("N", "newton", "newtons"): 1.0,
        ("kN", "kilonewton", "knewton", "kilo_newton"): 1e3,
        ("meganewton", "mega_newton"): 1e6,  # MN and mN would differ in their case only
        ("dyne", "dyn"): 1e-5,
        ("kgf", "kg_force", "kilogram_force"): _GRAVITY,
        ("lbf", "pound_force", "pound"): _POUND_KG * _GRAVITY,
        ("klbf", "kpound_force", "kilo_pound_force", "kip"): 1e3 * _POUND_KG * _GRAVITY,
    },
    "MASS": {
        ("kg", "kilogram", "kilograms"): 1.0,
        ("g", "gram", "grams"): 1e-3,
        ("t", "tonne", "ton", "megagram"): 1e3,
        ("lb", "lbm", "pound_mass", "pound"): _POUND_KG,
        ("slug",): _POUND_KG * _GRAVITY / _FOOT_M,
    },
    "TIME": {
        ("s", "second", "seconds", "sec"): 1.0,
        ("ms", "millisecond", "milliseconds"): 1e-3,
        ("min", "minute", "minutes"): 60.0,
        ("h", "hour", "hours"): 3600.0,
    },
    "ANGLE": {("rad", "radians", "radian"): 1.0, ("deg", "degrees", "degree"): math.pi / 180.0},
    "PRESSURE": {
        ("Pa", "pascal"): 1.0,
        ("kPa", "kilopascal"): 1e3,
        ("MPa", "megapascal"): 1e6,
        ("bar",): 1e5,
        ("psi",): _POUND_KG * _GRAVITY / (_FOOT_M / 12.0) ** 2,
    },
}
# Limits of values in SI, far beyond those of a tyre: products of several do not overflow.
_LARGEST_SI, _SMALLEST_SI = 1e15, 1e-12
_LENGTH, _MASS = {"LENGTH": 1}, {"MASS": 1}

#: Dimension of each key as powers of the file's units. Natural frequencies are in Hz in any file.
QUANTITIES: dict[str, Mapping[str, int]] = {
    **dict.fromkeys(("UNLOADED_RADIUS", "WIDTH", "RIM_RADIUS", "RIM_WIDTH"), _LENGTH),
    **dict.fromkeys(("MASS", "BELT_MASS"), _MASS),
    **dict.fromkeys(("IXX", "IYY", "BELT_IXX", "BELT_IYY"), _INERTIA),
    **dict.fromkeys(("INFLPRES", "NOMPRES", "PRESMIN", "PRESMAX"), _PRESSURE),
    **{key: {"FORCE": 1} for key in ("FNOMIN", "FZMIN", "FZMAX")},
    **{key: {"ANGLE": 1} for key in ("ALPMIN", "ALPMAX", "CAMMIN", "CAMMAX")},
    **dict.fromkeys(
        ("VERTICAL_STIFFNESS", "LONGITUDINAL_STIFFNESS", "LATERAL_STIFFNESS"), _STIFFNESS
    ),
    "VERTICAL_DAMPING": {"FORCE": 1, "TIME": 1, "LENGTH": -1},
    "YAW_STIFFNESS": {"FORCE": 1, "LENGTH": 1, "ANGLE": -1},
    "LONGVL": {"LENGTH": 1, "TIME": -1},
    "GRAVITY": {"LENGTH": 1, "TIME": -2},
    **dict.fromkeys((f"FREQ_{mode}" for mode in ("LONG", "LAT", "YAW", "WINDUP")), _NONE),
    **dict.fromkeys((f"DAMP_{mode}" for mode in ("LONG", "LAT", "YAW", "WINDUP")), _NONE),
}


@dataclass(frozen=True)
class TirUnits:
    """The units of a file."""

    # unit of each quantity in `_SIZES`; PRESSURE only where the file states one
    names: dict[str, str]
    sizes: dict[str, float]  # their sizes in SI
    assumed: tuple[str, ...]  # quantities without a unit in the file; the SI unit is assumed

    def size(self, key: str) -> float:
        """SI value of one unit of a key in `QUANTITIES`."""
        powers = self._powers(key)
        return math.prod(self.sizes[name] ** power for name, power in powers.items())

    def unit(self, key: str) -> str:
        """Unit of a key, e.g. ``kg mm²``; ``1`` for a ratio."""
        if key.startswith("FREQ_"):
            return "Hz"
        powers = self._powers(key)
        units = {
            name: self.names[name] + ("²" if abs(p) == 2 else "") for name, p in powers.items()
        }
        over = " ".join(units[name] for name, power in powers.items() if power > 0)
        under = [units[name] for name, power in powers.items() if power < 0]
        unit = "/".join([over, *under]) or "1"
        return "Pa" if unit == "N/m²" else unit

    def _powers(self, key: str) -> Mapping[str, int]:
        powers = QUANTITIES[key]
        named = powers == _PRESSURE and "PRESSURE" in self.names
        return {"PRESSURE": 1} if named else powers


def units_of(tir: TirFile) -> TirUnits:
    """The units that a file states; SI where it states none. `InputError` for an unknown unit."""
    names, sizes, assumed = {}, {}, []
    for quantity in _SIZES:
        entry = tir.find(quantity, UNITS)
        if entry is None and quantity == "PRESSURE":
            continue
        if entry is None:
            assumed.append(quantity)
        text = entry.text.strip() if entry else next(iter(_SIZES[quantity]))[0]
        sizes_of = _SIZES[quantity].items()
        known = {name.casefold(): (each[0], size) for each, size in sizes_of for name in each}
        if text.casefold() not in known:
            where = f"{tir.name}, line {entry.line}, {quantity}" if entry else quantity
            every = (name for each in _SIZES[quantity] for name in each)
            raise unknown(where, text, f"unknown unit of {quantity.lower()}", every)
        names[quantity], sizes[quantity] = known[text.casefold()]
    return TirUnits(names, sizes, tuple(assumed))


def si_value(tir: TirFile, units: TirUnits, key: str) -> float | None:
    """Value of a key in SI; None where the file does not have it."""
    if key.upper() not in QUANTITIES:
        raise unknown(tir.name, key, "the unit of this key is unknown", QUANTITIES)
    number = tir.number(key)
    if number is None:
        return None
    value = number * units.size(key.upper())
    if abs(value) > _LARGEST_SI:
        rule = f"values in SI must be below {_LARGEST_SI:g}"
        raise InputError(f"{tir.name}, {key}", f"{number:g}", rule, "Correct the value or its unit")
    return value


def clear_si_value(tir: TirFile, units: TirUnits, key: str) -> float | None:
    """Value of a key in SI; None where the key is missing or given more than once."""
    given = sum(entry.key == key and entry.is_in(None) for entry in tir.entries)
    return si_value(tir, units, key) if given == 1 else None


def positive_si_value(tir: TirFile, units: TirUnits, key: str) -> float:
    """Value of a key in SI; `InputError` if it is missing or not greater than zero."""
    value = si_value(tir, units, key)
    if value is None or value < _SMALLEST_SI:
        found = "not given" if value is None else f"{value:g}"
        rule, unit = f"a value of at least {_SMALLEST_SI:g} is needed", units.unit(key)
        raise InputError(f"{tir.name}, {key}", found, rule, f"Give {key} in {unit}")
    return value
