"""Dataset 58: the thirteen header lines, their columns, read and written by one table.

Columns follow the Universal File Format definition of the Structural Dynamics Research
Laboratory, University of Cincinnati: dataset 58, function at nodal degree of freedom.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from ema.core.errors import visible_line

DELIMITER = b"    -1"
HEADER_LINES = 11  # after the dataset number
TIME_RESPONSE = 1
FREQUENCY_RESPONSE = 4

GENERAL_TYPES = (0, 1)  # the only ones whose unit exponents mean something
DATA_DISPLACEMENT = 8
DATA_VELOCITY = 11
DATA_ACCELERATION = 12
DATA_FORCE = 13
DATA_TIME = 17
DATA_FREQUENCY = 18

REAL_SINGLE = 2
REAL_DOUBLE = 4
COMPLEX_SINGLE = 5
COMPLEX_DOUBLE = 6
ORDINATES = (REAL_SINGLE, REAL_DOUBLE, COMPLEX_SINGLE, COMPLEX_DOUBLE)

IEEE_FLOATS = 2
LITTLE_ENDIAN = 1
BIG_ENDIAN = 2

# name: (first column, last column), counted from 0, last exclusive
_BINARY_COLUMNS = {"byte_order": (7, 13), "float_format": (13, 19), "n_bytes": (31, 43)}
_IDENTITY_COLUMNS = {
    "function_type": (0, 5),
    "response_node": (41, 51),
    "response_direction": (51, 55),
    "reference_node": (66, 76),
    "reference_direction": (76, 80),
}
_FORM_COLUMNS = {"ordinate": (0, 10), "n_values": (10, 20), "spacing": (20, 30)}
_ABSCISSA_COLUMNS = {"abscissa_min": (30, 43), "abscissa_step": (43, 56)}
_AXIS_COLUMNS = {"data_type": (0, 10), "length": (10, 15), "force": (15, 20)}


class HeaderError(Exception):
    """A header line that cannot be read: what was found and which rule it breaks.

    Carries no file name: whoever reads the file adds the place.
    """

    def __init__(self, line: int, found: str, rule: str) -> None:
        super().__init__(f"line {line}: {found}; {rule}")
        self.line = line
        self.found = found
        self.rule = rule


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
    """The header of one dataset 58.

    Parameters
    ----------
    binary : bool
        58b, with a byte count.
    byte_order : int
        1 little, 2 big endian (58b only).
    n_bytes : int
        Length of the binary payload, as stated.
    id_lines : tuple of str
        The five ID lines; the first one is the channel's name.
    function_type : int
        1 time response, 4 frequency response function.
    response_node, response_direction, reference_node, reference_direction : int
        Degrees of freedom; a negative direction means the opposite sense.
    ordinate : int
        2 real single, 4 real double, 5 complex single, 6 complex double.
    n_values : int
        Number of (real or complex) values.
    even : bool
        Whether the abscissa is given by minimum and step.
    abscissa_min : float
        First abscissa value.
    abscissa_step : str
        Increment as printed: the number of its digits tells how far to trust it.
    abscissa, ordinate_axis, denominator_axis : Axis
        What is measured, and in which unit.
    response_name : str
        Entity name of the response.
    """

    id_lines: tuple[str, ...]
    function_type: int
    ordinate: int
    n_values: int
    abscissa_step: str
    even: bool = True
    abscissa_min: float = 0.0
    binary: bool = False
    byte_order: int = LITTLE_ENDIAN
    n_bytes: int = 0
    response_name: str = "NONE"
    response_node: int = 0
    response_direction: int = 0
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


def parse_number(text: str) -> float:
    """Read a Fortran real: ``1.5D-03`` and ``1.5-103`` are numbers there too.

    Raises
    ------
    ValueError
        If the text is no number.
    """
    plain = text.strip().upper().replace("D", "E")
    if "_" in plain or not plain.isascii():
        raise ValueError(f"{text!r} is not a number")
    sign = max(plain.rfind("+"), plain.rfind("-"))
    if sign > 0 and plain[sign - 1] != "E" and "." in plain[:sign]:
        plain = f"{plain[:sign]}E{plain[sign:]}"
    return float(plain)


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


def _axis(line: str, number: int) -> Axis:
    codes = _columns(line, _AXIS_COLUMNS, number, _integer)
    return Axis(
        data_type=codes["data_type"],
        length_exponent=codes["length"],
        force_exponent=codes["force"],
        label=line[26:46].strip(),
        unit=line[47:67].strip(),
    )


def _form(line: str) -> dict[str, Any]:
    """Line 9: kind and number of values, abscissa; separate words are fine too."""
    words = line.split()
    if len(words) == 6:
        line = "".join(f"{word:>10}" for word in words[:3])
        line += "".join(f"{word[:13]:>13}" for word in words[3:])
    form = _columns(line, _FORM_COLUMNS, 9, _integer)
    text = _columns(line, _ABSCISSA_COLUMNS, 9, lambda text: text.strip() or "0")
    numbers = _columns(line, _ABSCISSA_COLUMNS, 9, lambda text: parse_number(text.strip() or "0"))
    if form["ordinate"] not in ORDINATES:
        rule = "it must be 2, 4, 5 or 6"
        raise HeaderError(9, f"ordinate data type {form['ordinate']}", rule)
    if form["n_values"] < 1:
        raise HeaderError(
            9, f"{form['n_values']} values", "a function must have at least one value"
        )
    for name, value in numbers.items():
        if not isfinite(value):
            raise HeaderError(
                9, repr(text[name]), f"the {name.replace('_', ' ')} is a finite number"
            )
    if form["spacing"] not in (0, 1):
        rule = "it must be 0 (uneven) or 1 (even)"
        raise HeaderError(9, f"abscissa spacing {form['spacing']}", rule)
    return {
        "ordinate": form["ordinate"],
        "n_values": form["n_values"],
        "even": form["spacing"] == 1,
        "abscissa_min": numbers["abscissa_min"],
        "abscissa_step": text["abscissa_step"],
    }


def _binary(line: str) -> dict[str, Any]:
    """Line 2: byte order and byte count where a ``b`` follows the 58."""
    if line[6:7].lower() != "b":
        return {}
    codes = _columns(line, _BINARY_COLUMNS, 2, _integer)
    if codes["byte_order"] not in (LITTLE_ENDIAN, BIG_ENDIAN):
        rule = "it must be 1 (little endian) or 2 (big endian)"
        raise HeaderError(2, f"byte order {codes['byte_order']}", rule)
    if codes["float_format"] != IEEE_FLOATS:
        rule = "only IEEE 754 numbers (format 2) can be read"
        raise HeaderError(2, f"floating-point format {codes['float_format']}", rule)
    return {"binary": True, "byte_order": codes["byte_order"], "n_bytes": codes["n_bytes"]}


def parse_header(lines: list[str]) -> Header58:
    """Read the twelve header lines that follow the delimiter, the dataset number's first.

    Raises
    ------
    HeaderError
        If a line is missing or a column holds no number; lines are counted from the delimiter.
    """
    if len(lines) <= HEADER_LINES:
        rule = f"a dataset 58 has {HEADER_LINES} header lines: the file is truncated"
        raise HeaderError(len(lines) + 1, f"{max(len(lines) - 1, 0)} header lines", rule)
    codes = _columns(lines[6], _IDENTITY_COLUMNS, 8, _integer)
    return Header58(
        id_lines=tuple(line.strip() for line in lines[1:6]),
        response_name=lines[6][31:41].strip(),
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
    name = f" {visible_line(header.response_name)[:10]:<10}"
    response = f"{name}{header.response_node:10d}{header.response_direction:4d}"
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
