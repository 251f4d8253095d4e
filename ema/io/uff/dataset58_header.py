"""Header lines of dataset 58, read and written by one table of columns, and units of its axes.

Columns follow the Universal File Format definition of the Structural Dynamics Research
Laboratory, University of Cincinnati: dataset 58, function at nodal degree of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ema.core.errors import visible_line
from ema.core.recording import ACCELERATION, DISPLACEMENT, FORCE, UNKNOWN, VELOCITY
from ema.core.units import is_stated, parse_unit
from ema.io.rates import parse_number

#: Key of the fourth ID line, as "force_deg = 13": where the force acts on a circle.
FORCE_DEG = "force_deg"
DELIMITER = b"    -1"
HEADER_LINES = 11  # after the dataset number
TIME_RESPONSE, FREQUENCY_RESPONSE, COHERENCE = 1, 4, 6
DATA_DISPLACEMENT, DATA_VELOCITY, DATA_ACCELERATION, DATA_FORCE = 8, 11, 12, 13
DATA_TIME, DATA_FREQUENCY = 17, 18
QUANTITY = {
    DATA_DISPLACEMENT: DISPLACEMENT,
    DATA_VELOCITY: VELOCITY,
    DATA_ACCELERATION: ACCELERATION,
    DATA_FORCE: FORCE,
}
_GENERAL_TYPES = (0, 1)  # the only ones whose unit exponents have a meaning
REAL_SINGLE, REAL_DOUBLE, COMPLEX_SINGLE, COMPLEX_DOUBLE = _ORDINATES = 2, 4, 5, 6
LITTLE_ENDIAN, BIG_ENDIAN = 1, 2
IEEE_FLOATS = 2

# name: (first column, last column), counted from 0, last exclusive
_BINARY_COLUMNS = {"byte_order": (7, 13), "float_format": (13, 19), "n_bytes": (31, 43)}
_IDENTITY_COLUMNS = {
    "function_type": (0, 5),
    "response_node": (41, 51),
    "response_direction": (51, 55),
    "reference_node": (66, 76),
    "reference_direction": (76, 80),
}
_FORM_COLUMNS = {"ordinate": (0, 10), "n_values": (10, 20), "even": (20, 30)}
_ABSCISSA_COLUMNS = {"abscissa_min": (30, 43), "abscissa_step": (43, 56)}
_AXIS_COLUMNS = {"data_type": (0, 10), "length_exponent": (10, 15), "force_exponent": (15, 20)}


class HeaderError(Exception):
    """A header line that cannot be read; the name of the file is added by its reader."""

    def __init__(self, line: int, found: str, rule: str) -> None:
        super().__init__(f"line {line}: {found}; {rule}")
        self.line, self.found, self.rule = line, found, rule


@dataclass(frozen=True)
class Axis:
    """One axis record (lines 8 to 11): type of data, unit exponents, label and unit label."""

    data_type: int = 0
    length_exponent: int = 0
    force_exponent: int = 0
    label: str = "NONE"
    unit: str = "NONE"


@dataclass(frozen=True)
class Header58:
    """The header of one dataset 58."""

    id_lines: tuple[str, ...]  # five; the first one is the name of the channel
    function_type: int  # 1 time response, 4 frequency response function
    ordinate: int  # 2 real single, 4 real double, 5 complex single, 6 complex double
    n_values: int  # real or complex
    abscissa_step: str  # as printed: the number of its digits shows how exact it is
    even: bool = True  # whether the abscissa is given by minimum and step
    abscissa_min: float = 0.0
    binary: bool = False  # 58b, with a byte count
    byte_order: int = LITTLE_ENDIAN  # of 58b
    n_bytes: int = 0  # of the binary payload, as stated
    response_node: int = 0
    response_direction: int = 0  # negative: the opposite sense
    reference_node: int = 0
    reference_direction: int = 0
    abscissa: Axis = field(default_factory=Axis)
    ordinate_axis: Axis = field(default_factory=Axis)
    denominator_axis: Axis = field(default_factory=Axis)

    @property
    def is_complex(self) -> bool:
        """Whether each value is a pair of real and imaginary part."""
        return self.ordinate in (COMPLEX_SINGLE, COMPLEX_DOUBLE)

    @property
    def is_double(self) -> bool:
        """Whether the ordinate is stored in double precision."""
        return self.ordinate in (REAL_DOUBLE, COMPLEX_DOUBLE)

    @property
    def numbers_per_value(self) -> int:
        """Numbers that make a value: one or two parts, and its abscissa where spacing is uneven."""
        return (2 if self.is_complex else 1) + (0 if self.even else 1)


def _integer(text: str) -> int:
    if not text.strip():
        return 0
    if not text.isascii() or "_" in text:
        raise ValueError(f"{text!r} is not an integer")
    return int(text)


def _columns(
    line: str, columns: dict[str, tuple[int, int]], number: int, convert: Callable[[str], Any]
) -> dict[str, Any]:
    values = {}
    for name, (first, last) in columns.items():
        text = line[first:last]
        try:
            values[name] = convert(text)
        except ValueError:
            rule = f"columns {first + 1} to {last} must be a number, the {name.replace('_', ' ')}"
            raise HeaderError(number, repr(text), rule) from None
    return values


def _require(is_right: bool, line: int, found: str, rule: str) -> None:
    if not is_right:
        raise HeaderError(line, found, rule)


def _axis(line: str, number: int) -> Axis:
    codes = _columns(line, _AXIS_COLUMNS, number, _integer)
    return Axis(**codes, label=line[26:46].strip(), unit=line[47:67].strip())


def _form(line: str) -> dict[str, Any]:
    """Line 9: kind and number of values, abscissa; in columns or as separate words."""
    words = line.split()
    if len(words) == 6:
        line = "".join(f"{word:>10}" for word in words[:3])
        line += "".join(f"{word[:13]:>13}" for word in words[3:])
    form = _columns(line, _FORM_COLUMNS, 9, _integer)
    form |= _columns(line, _ABSCISSA_COLUMNS, 9, lambda text: parse_number(text.strip() or "0"))
    for name, (first, last) in _ABSCISSA_COLUMNS.items():
        rule = f"the {name.replace('_', ' ')} must be finite"
        _require(math.isfinite(form[name]), 9, repr(line[first:last]), rule)
    kind, n_values, even = form["ordinate"], form["n_values"], form["even"]
    _require(kind in _ORDINATES, 9, f"ordinate data type {kind}", "it must be 2, 4, 5 or 6")
    _require(n_values > 0, 9, f"{n_values} values", "there must be at least one value")
    _require(even in (0, 1), 9, f"abscissa spacing {even}", "it must be 0 (uneven) or 1 (even)")
    return form | {"even": even == 1, "abscissa_step": line[43:56].strip() or "0"}


def _binary(line: str) -> dict[str, Any]:
    """Line 2: byte order and byte count where a ``b`` follows the 58."""
    if line[6:7].lower() != "b":
        return {}
    codes = _columns(line, _BINARY_COLUMNS, 2, _integer)
    order, kind = codes["byte_order"], codes.pop("float_format")
    rule = "it must be 1 (little endian) or 2 (big endian)"
    _require(order in (LITTLE_ENDIAN, BIG_ENDIAN), 2, f"byte order {order}", rule)
    rule = "only IEEE 754 numbers (format 2) can be read"
    _require(kind == IEEE_FLOATS, 2, f"floating-point format {kind}", rule)
    return {"binary": True, **codes}


def _identity(line: str) -> str:
    """Line 8 in its columns: names of entities that are too long push the rest to the right."""
    head, words = line[:30], line[30:].split()
    if len(words) != 6:
        for first in (40, 65):
            found = line[first - 9 : first + 11]
            rule = f"the name before column {first + 2} must not reach into the node behind it"
            _require(len(line[first : first + 2].split(" ", 1)[0]) < 2, 8, repr(found), rule)
        return line
    try:
        numbers = [_integer(word) for word in (*words[1:3], *words[4:6])]
    except ValueError:
        return line
    ends = [f" {'':<10}{numbers[at]:10d}{numbers[at + 1]:4d}" for at in (0, 2)]
    return f"{head:<30}{''.join(ends)}"


def parse_header(lines: list[str]) -> Header58:
    """Read the twelve header lines that follow the delimiter, that of the dataset number first.

    A `HeaderError` counts lines from the delimiter.
    """
    if len(lines) <= HEADER_LINES:
        rule = f"dataset 58 must have {HEADER_LINES} header lines: the file is truncated"
        raise HeaderError(len(lines) + 1, f"{max(len(lines) - 1, 0)} header lines", rule)
    codes = _columns(_identity(lines[6]), _IDENTITY_COLUMNS, 8, _integer)
    return Header58(
        id_lines=tuple(line.strip() for line in lines[1:6]),
        abscissa=_axis(lines[8], 10),
        ordinate_axis=_axis(lines[9], 11),
        denominator_axis=_axis(lines[10], 12),
        **codes,
        **_form(lines[7]),
        **_binary(lines[0]),
    )


def _format_axis(axis: Axis) -> str:
    exponents = f"{axis.length_exponent:5d}{axis.force_exponent:5d}{0:5d}"
    label, unit = visible_line(axis.label), visible_line(axis.unit)
    return f"{axis.data_type:10d}{exponents} {label[:20]:<20} {unit[:20]:<20}"


def format_header(header: Header58) -> bytes:
    """Write the delimiter and the header lines, each ending in a line feed."""
    kind = "    58"
    if header.binary:
        sizes = f"{HEADER_LINES:12d}{header.n_bytes:12d}{0:6d}{0:6d}{0:12d}{0:12d}"
        kind += f"b{header.byte_order:6d}{IEEE_FLOATS:6d}{sizes}"
    response = f" {'NONE':<10}{header.response_node:10d}{header.response_direction:4d}"
    reference = f" {'NONE':<10}{header.reference_node:10d}{header.reference_direction:4d}"
    form = f"{header.ordinate:10d}{header.n_values:10d}{int(header.even):10d}"
    abscissa = f"{header.abscissa_min:13.5E}{header.abscissa_step:>13}{0.0:13.5E}"
    lines = [
        kind,
        *(f"{visible_line(line)[:80]:<80}" for line in header.id_lines),
        f"{header.function_type:5d}{0:10d}{0:5d}{0:10d}{response}{reference}",
        form + abscissa,
        *map(_format_axis, (header.abscissa, header.ordinate_axis, header.denominator_axis)),
        _format_axis(Axis()),
    ]
    return DELIMITER + b"\n" + "\n".join(lines).encode("latin-1", "replace") + b"\n"


@dataclass(frozen=True)
class UnitSystem:
    """Factors of dataset 164: values in units of the file divided by them are SI."""

    length: float = 1.0
    force: float = 1.0


@dataclass(frozen=True)
class OrdinateUnit:
    """Quantity of an axis, unit as stated, factor to SI, and what was assumed."""

    quantity: str
    text: str
    factor: float
    remark: str = ""


def ordinate_unit(axis: Axis, system: UnitSystem) -> OrdinateUnit:
    """Find quantity and SI factor of an axis.

    A known unit label decides; without one, the type of data in the units of dataset 164. Unit
    exponents count for general types only.
    """
    typed = QUANTITY.get(axis.data_type)
    text = axis.unit if is_stated(axis.unit) else ""
    label = parse_unit(text)
    if label is not None and label.quantity != UNKNOWN:
        doubt = f"type {axis.data_type} means {typed}, but the unit is {text!r}; the unit is used"
        agrees = typed in (None, label.quantity)
        return OrdinateUnit(label.quantity, text, label.factor, "" if agrees else doubt)
    if label is None and typed is not None:
        factor = 1.0 / (system.force if typed == FORCE else system.length)
        doubt = f"unit {text!r} is not known; taken as SI (dataset 164)" if text else ""
        return OrdinateUnit(typed, text, factor, doubt)
    if label is None and axis.data_type in _GENERAL_TYPES:
        return _general_unit(axis, text, system)
    return OrdinateUnit(UNKNOWN, text, 1.0)


def _general_unit(axis: Axis, text: str, system: UnitSystem) -> OrdinateUnit:
    exponents = (axis.length_exponent, axis.force_exponent)
    quantity = FORCE if exponents == (0, 1) else UNKNOWN
    try:
        factor = system.length ** -exponents[0] * system.force ** -exponents[1]
    except OverflowError:
        factor = math.inf
    if not 0.0 < factor < math.inf:
        return OrdinateUnit(
            quantity, text, 1.0, f"unit exponents {exponents} make no sense, not used"
        )
    return OrdinateUnit(quantity, text, factor)
