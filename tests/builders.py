"""Build files byte by byte, independently of the package's own writers."""

import struct
from pathlib import Path

import numpy as np

SHARED_DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"
DELIMITER = "    -1"


def row(formats, *values):
    """One line of fixed columns, e.g. ``row("10d 13.5E", 1, 0.5)``."""
    return "".join(format(value, each) for each, value in zip(formats.split(), values, strict=True))


def header58(
    *,
    name="A01",
    function_type=1,
    node=1,
    direction=3,
    reference_node=0,
    reference_direction=0,
    ordinate=2,
    n=8,
    even=1,
    start="  0.00000E+00",
    step="  5.00000E-04",
    abscissa=(17, 0, 0, "Time", "s"),
    axis=(12, 0, 0, "Acceleration", "m/s^2"),
    denominator=(0, 0, 0, "NONE", "NONE"),
    binary=None,
    eol="\n",
):
    """The lines of a dataset 58 up to its payload; `binary` is (byte order, byte count)."""
    number = "    58"
    if binary is not None:
        number += "b" + row("6d 6d 12d 12d 6d 6d 12d 12d", binary[0], 2, 11, binary[1], 0, 0, 0, 0)
    lines = [DELIMITER, number, name, "NONE", "18-Apr-16 13:49:58", "NONE", "NONE"]
    response = f" {'NONE':<10}" + row("10d 4d", node, direction)
    reference = f" {'NONE':<10}" + row("10d 4d", reference_node, reference_direction)
    lines.append(row("5d 10d 5d 10d", function_type, 0, 0, 0) + response + reference)
    lines.append(row("10d 10d 10d >13 >13 >13", ordinate, n, even, start, step, "0.00000E+00"))
    for *codes, label, unit in (abscissa, axis, denominator, (0, 0, 0, "NONE", "NONE")):
        lines.append(row("10d 5d 5d 5d", *codes, 0) + f" {label:<20} {unit:<20}")
    return (eol.join(lines) + eol).encode("latin-1")


def binary58(payload, *, big=False, n_bytes=None, before_end=b"", eol="\n", **header):
    """A dataset 58b around `payload` (bytes); `n_bytes` is what the header claims."""
    count = len(payload) if n_bytes is None else n_bytes
    lines = header58(binary=(2 if big else 1, count), eol=eol, **header)
    return lines + payload + before_end + (DELIMITER + eol).encode()


def ascii58(text, *, eol="\n", **header):
    """A dataset 58 whose payload is `text` as it stands."""
    return header58(eol=eol, **header) + text.encode() + (DELIMITER + eol).encode()


def floats(values, *, big=False, double=False):
    """Bytes of IEEE numbers, packed one by one."""
    return b"".join(struct.pack((">" if big else "<") + "fd"[double], value) for value in values)


def fixed(values, width=13, digits=5, per_line=6, eol="\n"):
    """Numbers in columns of equal width."""
    cells = [f"{value:{width}.{digits}E}" for value in values]
    lines = ["".join(cells[i : i + per_line]) for i in range(0, len(cells), per_line)]
    return "".join(line + eol for line in lines)


def dataset(number, *lines, eol="\n"):
    """Any dataset of text."""
    return (eol.join([DELIMITER, f"{number:6d}", *lines, DELIMITER]) + eol).encode()


def units164(length, force):
    """Dataset 164 with two factors."""
    return dataset(
        164,
        row("10d >20 10d", 9, "user", 2),
        row("25.17E 25.17E 25.17E", length, force, 1.0),
        row("25.17E", 273.15),
    )


def nodes15(coordinates):
    """Dataset 15 from {node: (x, y, z)}."""
    rows = [
        row("10d 10d 10d 10d 13.5E 13.5E 13.5E", node, 0, 0, 0, *point)
        for node, point in coordinates.items()
    ]
    return dataset(15, *rows)


def nodes2411(coordinates):
    """Dataset 2411 from {node: (x, y, z)}, with D exponents."""
    rows = []
    for node, point in coordinates.items():
        rows.append(row("10d 10d 10d 10d", node, 1, 1, 11))
        rows.append(row("25.16E 25.16E 25.16E", *point).replace("E", "D"))
    return dataset(2411, *rows)


def force58(n=8, **header):
    """A 58b force, as a run needs one."""
    values = floats(np.arange(n, dtype=float))
    axis = (13, 0, 0, "Force", "N")
    return binary58(values, **{"name": "force", "node": 0, "n": n, "axis": axis} | header)


def response58(n=8, **header):
    """A 58b acceleration."""
    values = floats(np.arange(n, dtype=float) ** 2)
    return binary58(values, **{"name": "A01", "node": 1, "n": n} | header)


def frf58(values, *, single=False, **header):
    """A 58b accelerance, complex."""
    parts = [part for value in values for part in (value.real, value.imag)]
    defaults = {
        "function_type": 4,
        "ordinate": 5 if single else 6,
        "n": len(values),
        "step": "  1.00000E+00",
        "abscissa": (18, 0, 0, "Frequency", "Hz"),
        "denominator": (13, 0, 0, "Force", "N"),
        "reference_node": 1,
        "reference_direction": 3,
    }
    return binary58(floats(parts, double=not single), **defaults | header)
