"""Mode shapes from datasets 55 and 2414, mode by mode."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.io.uff.scan import COPY_AGAIN, Dataset
from ema.io.uff.text import Lines

DATA_AT_NODES, ANALYSIS_DATA = 55, 2414

_ANALYSES = {
    0: "unknown",
    1: "static",
    2: "normal mode",
    3: "complex eigenvalue",
    4: "transient",
    5: "frequency response",
    6: "buckling",
    7: "complex eigenvalue",
    9: "static, non-linear",
}
_NORMAL_MODE = 2
_COMPLEX_MODE = (3, 7)
_AT_NODES = 1
_TENSOR = 4  # data characteristics from here on are no vectors
_MOTIONS = (0, 1, 8, 11, 12, 93, 94, 95, 96)  # displacement, velocity, acceleration, or unstated
_REAL, _COMPLEX = (2, 4), (5, 6)
_DIRECTIONS = {1: (0,), 3: (1, 2, 3), 6: (1, 2, 3, 4, 5, 6)}  # by values per node; 4 to 6 rotate
_VALUE_WIDTHS = (13,) * 6


@dataclass(frozen=True, eq=False)
class ModeRecord:
    """One mode as a dataset holds it.

    Parameters
    ----------
    frequency_hz, damping_ratio : float
        Undamped frequency; damping ratio, NaN where the dataset states none.
    node : ndarray of int, shape (n_nodes,)
        Node numbers.
    directions : tuple of int
        1 to 3 translations along X, Y, Z; 4 to 6 rotations about them; 0 a scalar.
    values : ndarray of complex, shape (n_nodes, n_directions)
        Shape as stored.
    absent : float
        What a node that is not listed has: 0 in dataset 55, NaN (nothing known) in 2414.
    """

    frequency_hz: float
    damping_ratio: float
    node: NDArray[np.int_]
    directions: tuple[int, ...]
    values: NDArray[np.complex128]
    absent: float


@dataclass(frozen=True)
class _Form:
    """What the head of a dataset says about its values, and about the mode."""

    location: int
    analysis: int
    characteristic: int
    result: int
    kind: int
    n_values: int
    normal: tuple[float, ...]  # frequency, modal mass, viscous ζ, hysteretic η
    eigenvalue: complex


def read_mode(path: Path, dataset: Dataset) -> ModeRecord | str:
    """Read a dataset 55 or 2414, or say what it holds where that is no mode shape.

    Raises
    ------
    RecordingFormatError
        If it is damaged.
    """
    lines = Lines(path, dataset)
    form = _head_55(lines) if dataset.number == DATA_AT_NODES else _head_2414(lines)
    other = _what_else(form)
    if other:
        return other
    if form.analysis == _NORMAL_MODE:
        frequency_hz, damping_ratio = form.normal[0], _ratio(form.normal[2], form.normal[3])
    else:
        frequency_hz, damping_ratio = _of_eigenvalue(form.eigenvalue)
    if not 0.0 <= frequency_hz < math.inf:
        found, rule = f"a mode at {frequency_hz:g} Hz", "frequencies must be positive and finite"
        raise RecordingFormatError(lines.where, found, rule, COPY_AGAIN)
    node, values = _read_values(lines, form)
    return ModeRecord(
        frequency_hz,
        damping_ratio,
        node,
        _DIRECTIONS[form.n_values],
        values,
        0.0 if dataset.number == DATA_AT_NODES else math.nan,
    )


def _head_55(lines: Lines) -> _Form:
    """Records 1 to 8; the real parameters depend on the type of analysis."""
    for _ in range(5):
        lines.text()
    form = _definition(lines)
    n_integers, n_reals, *_ = lines.integers(2)
    if n_integers > 6:  # eight on a line, the two counts among them
        lines.text()
    reals = lines.numbers(_VALUE_WIDTHS, min(max(n_reals, 1), 6))
    if n_reals > 6:
        lines.text()
    reals += [0.0] * 6
    return _Form(_AT_NODES, *form, normal=tuple(reals[:4]), eigenvalue=complex(*reals[:2]))


def _head_2414(lines: Lines) -> _Form:
    """Records 1 to 13; the twelve real parameters have fixed places."""
    lines.text()
    lines.text()
    location = lines.integers(1)[0]
    for _ in range(5):
        lines.text()
    form = _definition(lines)
    lines.text()
    lines.text()
    reals = lines.numbers(_VALUE_WIDTHS, 6)[:6] + lines.numbers(_VALUE_WIDTHS, 6)[:6]
    normal = (reals[1], reals[3], reals[4], reals[5])
    return _Form(location, *form, normal=normal, eigenvalue=complex(*reals[6:8]))


def _definition(lines: Lines) -> tuple[int, int, int, int, int]:
    """Analysis, characteristic, result, kind and number of values: the same in both datasets."""
    _, analysis, characteristic, result, kind, n_values = lines.integers(6)[:6]
    return analysis, characteristic, result, kind, n_values


def _what_else(form: _Form) -> str:
    """What a dataset holds that is no mode shape; empty for a mode shape."""
    if form.analysis not in (_NORMAL_MODE, *_COMPLEX_MODE):
        return f"results of a {_ANALYSES.get(form.analysis, form.analysis)} analysis"
    if form.location != _AT_NODES:
        return "values of elements"
    if form.characteristic >= _TENSOR or form.n_values not in _DIRECTIONS:
        return f"{form.n_values} values per node that are no motion"
    if form.result not in _MOTIONS:
        return f"results of type {form.result}, no motion"
    if form.kind not in (*_REAL, *_COMPLEX):
        return f"values of kind {form.kind}"
    return ""


def _ratio(viscous: float, hysteretic: float) -> float:
    """Damping ratio of a normal mode; half the loss factor where no viscous one is stated.

    Zero is what stands in these fields where nothing is known.
    """
    return viscous or hysteretic / 2.0 or math.nan


def _of_eigenvalue(eigenvalue: complex) -> tuple[float, float]:
    """Undamped frequency and damping ratio of an eigenvalue in rad/s."""
    size = math.hypot(eigenvalue.real, eigenvalue.imag)
    if size == 0.0:
        return 0.0, math.nan
    return size / (2.0 * math.pi), -eigenvalue.real / size


def _read_values(lines: Lines, form: _Form) -> tuple[NDArray[np.int_], NDArray[np.complex128]]:
    """Node by node: its number on a line, its values on as many lines as they need."""
    n_numbers = form.n_values * (2 if form.kind in _COMPLEX else 1)
    rows: dict[int, list[float]] = {}
    while lines.more():
        node = lines.integers(1)[0]
        if node in rows:
            found, rule = f"node {node} twice", "each node direction must have one value per mode"
            raise RecordingFormatError(lines.where, found, rule, COPY_AGAIN)
        row = rows[node] = []
        while len(row) < n_numbers:
            row += lines.numbers(_VALUE_WIDTHS, 1)
        if len(row) > n_numbers:
            found, rule = f"{len(row)} numbers", f"node {node} has {n_numbers}"
            raise RecordingFormatError(lines.where, found, rule, COPY_AGAIN)
    table = np.array(list(rows.values()), dtype=np.float64).reshape(-1, n_numbers)
    values = table.view(np.complex128) if form.kind in _COMPLEX else table.astype(np.complex128)
    return np.array(list(rows), dtype=np.int_), values
