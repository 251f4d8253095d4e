"""What surrounds the functions of a universal file: header, units, geometry and mode shapes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from ema.io.uff58_header import DELIMITER
from ema.visible import visible_line

CARTESIAN = 1  # number of the only coordinate system: the structure's own

_KELVIN_AT_0_C = 273.15
_NODE_COLOUR, _LINE_COLOUR = 11, 8
_LONGEST_LINE = 125  # nodes of a trace line that every program takes
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_STRUCTURAL, _TRANSLATION, _DISPLACEMENT = 1, 2, 8
_NORMAL_MODE, _COMPLEX_EIGENVALUE = 2, 3
_REAL, _COMPLEX = 2, 5


@dataclass(frozen=True, eq=False)
class ShapeDataset:
    """One mode as dataset 55 holds it.

    Parameters
    ----------
    number : int
        Number of the mode, from 1.
    id_lines : tuple of str
        Up to five lines of text.
    pole : complex
        rad/s, upper half plane.
    node : ndarray of int, shape (n_nodes,)
    values : ndarray, shape (n_nodes, 3)
        Motion along x, y and z; real for a normal mode, complex for a complex one.
    modal_a : complex
        Modal A of a complex mode in N s/m, 0 where unknown.
    modal_mass_kg : float
        Modal mass of a normal mode, 0 where unknown.
    """

    number: int
    id_lines: tuple[str, ...]
    pole: complex
    node: NDArray[np.int_]
    values: NDArray[np.inexact]
    modal_a: complex = 0.0
    modal_mass_kg: float = 0.0


def header_151(name: str, description: str, program: str, written: datetime) -> bytes:
    """Dataset 151: what the file is, and who wrote it when."""
    moment = f"{written.day:02d}-{_MONTHS[written.month - 1]}-{written:%y} {written:%H:%M:%S}"
    stamp = f"{moment[:9]:<10}{moment[10:]:<10}"
    lines = [
        _text(name),
        _text(description),
        _text(program),
        f"{stamp}{0:10d}{0:10d}{0:10d}",
        stamp,
        _text(program),
        stamp,
    ]
    return _dataset(151, lines)


def units_164() -> bytes:
    """Dataset 164: everything in SI."""
    lines = [
        f"{1:10d}{'SI: Meter (newton)':<20}{2:10d}",
        _reals((1.0, 1.0, 1.0), 25, 16),
        _reals((_KELVIN_AT_0_C,), 25, 16),
    ]
    return _dataset(164, lines)


def coordinate_system_2420() -> bytes:
    """Dataset 2420: the structure's own Cartesian system, for programs that ask for one."""
    axes = np.vstack([np.eye(3), np.zeros(3)])
    lines = [
        f"{1:10d}",
        _text("ringmodal"),
        f"{CARTESIAN:10d}{0:10d}{_LINE_COLOUR:10d}",
        _text("global"),
        *(_reals(row, 25, 16) for row in axes),
    ]
    return _dataset(2420, lines)


def nodes_2411(node: NDArray[np.int_], xyz_m: NDArray[np.float64]) -> bytes:
    """Dataset 2411: nodes in Cartesian coordinates, m."""
    lines = []
    for label, point in zip(node.tolist(), xyz_m.tolist(), strict=True):
        lines.append(f"{label:10d}{CARTESIAN:10d}{CARTESIAN:10d}{_NODE_COLOUR:10d}")
        lines.append(_reals(point, 25, 16))
    return _dataset(2411, lines)


def trace_lines_82(name: str, path: Sequence[int]) -> bytes:
    """Dataset 82: a line through the nodes, in as many pieces as programs can take."""
    step = _LONGEST_LINE - 1  # each piece begins where the one before it ended
    pieces = [path[start : start + step + 1] for start in range(0, max(len(path) - 1, 1), step)]
    datasets = []
    for number, piece in enumerate(pieces, start=1):
        head = f"{number:10d}{len(piece):10d}{_LINE_COLOUR:10d}"
        rows = (piece[start : start + 8] for start in range(0, len(piece), 8))
        lines = ["".join(f"{label:10d}" for label in row) for row in rows]
        datasets.append(_dataset(82, [head, _text(name), *lines]))
    return b"".join(datasets)


def shape_55(mode: ShapeDataset) -> bytes:
    """Dataset 55: a mode shape, as a complex eigenvalue or, where it is real, a normal mode."""
    is_complex = np.iscomplexobj(mode.values)
    analysis = _COMPLEX_EIGENVALUE if is_complex else _NORMAL_MODE
    kind = _COMPLEX if is_complex else _REAL
    numbers = (_STRUCTURAL, analysis, _TRANSLATION, _DISPLACEMENT, kind, 3)
    reals = _of_complex(mode) if is_complex else _of_normal(mode)
    lines = [
        *map(_text, (*mode.id_lines, *("NONE",) * 5)[:5]),
        "".join(f"{number:10d}" for number in numbers),
        f"{2:10d}{len(reals):10d}{1:10d}{mode.number:10d}",
        _reals(reals, 13, 5),
    ]
    values = np.ascontiguousarray(mode.values)
    parts = values.view(np.float64) if is_complex else values
    for label, row in zip(mode.node.tolist(), parts.tolist(), strict=True):
        lines += [f"{label:10d}", _reals(row, 13, 5)]
    return _dataset(55, lines)


def _of_complex(mode: ShapeDataset) -> tuple[float, ...]:
    """Eigenvalue, modal A and modal B = −s A."""
    modal_b = -mode.pole * mode.modal_a
    return tuple(
        part for value in (mode.pole, mode.modal_a, modal_b) for part in (value.real, value.imag)
    )


def _of_normal(mode: ShapeDataset) -> tuple[float, ...]:
    """Frequency, modal mass, viscous and hysteretic damping."""
    size = abs(mode.pole)
    return size / (2 * np.pi), mode.modal_mass_kg, -mode.pole.real / size, 0.0


def _dataset(number: int, lines: Iterable[str]) -> bytes:
    end = DELIMITER.decode()
    return "\n".join([end, f"{number:6d}", *lines, end, ""]).encode("ascii")


def _text(line: str) -> str:
    """80 columns of plain ASCII; a line may not be blank."""
    plain = " ".join(visible_line(line).encode("ascii", "replace").decode().split())
    return f"{plain[:80] or 'NONE':<80}"


def _reals(values: Iterable[float], width: int, digits: int) -> str:
    return "".join(f"{value + 0.0:{width}.{digits}E}" for value in values)
