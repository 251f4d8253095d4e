"""Mode shapes of datasets 55 and 2414 from other programs, for comparison."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import InputError, RecordingFormatError, require_type
from ema.core.finding import Check, Finding
from ema.core.numerics import ReadonlyArrays
from ema.io.content import remark
from ema.io.uff import geometry
from ema.io.uff.scan import Dataset, Lines, damaged, scan

RADIAL = "radial"
AXES = ("x", "y", "z")
DIRECTIONS = (RADIAL, *AXES)

_MOST_GAPS = 8  # cells of the table per value given: files of one structure have about 1
_FEWEST_NODES = 3
_AT_ORIGIN = 0.02  # an axle this near to the origin, over the radius, goes through it
_ON_A_LINE = 0.01  # extent of nodes across, over that along

_DATA_AT_NODES, _ANALYSIS_DATA = 55, 2414  # kinds of datasets
_ANALYSES = (
    *("unknown", "static", "normal mode", "complex eigenvalue", "transient", "frequency response"),
    *("buckling", "complex eigenvalue", "8", "static, non-linear"),
)
_NORMAL_MODE, _COMPLEX_MODE = 2, (3, 7)
_AT_NODES = 1
_TENSOR = 4  # data characteristics from here on are not vectors
_MOTIONS = (0, 1, 8, 11, 12, 93, 94, 95, 96)  # displacement, velocity, acceleration, or unstated
_REAL, _COMPLEX = (2, 4), (5, 6)
_TRANSLATIONS = (1, 2, 3)
_DIRECTIONS = {1: (0,), 3: _TRANSLATIONS, 6: (*_TRANSLATIONS, 4, 5, 6)}  # by values per node
_VALUE_WIDTHS = (13,) * 6


@dataclass(frozen=True, eq=False)
class ShapeSet(ReadonlyArrays):
    """Mode shapes of a universal file, as stored, without a common scale.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_modes,)
        Undamped natural frequencies.
    damping_ratio : ndarray, shape (n_modes,)
        NaN where the file states none.
    node : ndarray of int, shape (n_rows,)
        Node of each row.
    direction : ndarray of int, shape (n_rows,)
        1 to 3 translation along X, Y, Z, 4 to 6 rotation about them, 0 where there is none.
    angle_deg : ndarray, shape (n_rows,)
        Angle of the node; NaN where the file has no geometry, or nodes are not on a circle.
    values : ndarray of complex, shape (n_modes, n_rows)
        NaN where a mode has no value for a row.
    findings : tuple of Finding
        What was left out or assumed.
    """

    frequency_hz: NDArray[np.float64]
    damping_ratio: NDArray[np.float64]
    node: NDArray[np.int_]
    direction: NDArray[np.int_]
    angle_deg: NDArray[np.float64]
    values: NDArray[np.complex128]
    findings: tuple[Finding, ...] = ()

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return int(self.values.shape[0])


def read_shapes(path: Path | str) -> ShapeSet:
    """Read the mode shapes of a universal file from its datasets 55 and 2414.

    Normal modes and complex eigenvalues, real or complex, are modes; results of other analyses
    are left out with a finding.

    Parameters
    ----------
    path : Path or str
        A universal file.

    Raises
    ------
    RecordingFormatError
        If the file is missing or damaged, or has no mode shapes.

    Examples
    --------
    >>> import ringmodal as rm
    >>> from pipelines.export.modal import export
    >>> written = export("result", "modes.uff")
    >>> shapes = rm.read_shapes("modes.uff")
    >>> shapes.n_modes, shapes.values.shape[1] >= 72
    (9, True)
    """
    path = Path(require_type("shapes", path, (str, Path), "Name a universal file"))
    datasets = scan(path)
    kinds = (_DATA_AT_NODES, _ANALYSIS_DATA)
    read_in = [(each, _read_mode(path, each)) for each in datasets if each.number in kinds]
    modes = [found for _, found in read_in if isinstance(found, _Mode)]
    left_out = [
        f"dataset {each.index} ({each.number}): {found}"
        for each, found in read_in
        if isinstance(found, str)
    ]
    if not any(len(mode.node) for mode in modes):
        held = "; ".join(left_out[:3]) or f"{len(datasets)} datasets, none of them 55 or 2414"
        rule = "mode shapes are normal or complex modes in datasets 55 or 2414"
        raise RecordingFormatError(path.name, held, rule, "Export the modes of the modal analysis")
    findings = tuple(remark(path, "", Check.CONTENT, f"{each}, left out") for each in left_out)
    node, direction, values = _table(path, modes)
    around = geometry.read_surroundings(path, datasets, set(node.tolist()))
    frequency_hz = np.array([mode.frequency_hz for mode in modes])
    damping_ratio = np.array([mode.damping_ratio for mode in modes])
    angle_deg = np.array([around.angle_deg.get(each, np.nan) for each in node.tolist()])
    findings += around.findings
    values = _along_global_axes(node, direction, values, around.axes)
    return ShapeSet(frequency_hz, damping_ratio, node, direction, angle_deg, values, findings)


def _table(
    path: Path, modes: Sequence[_Mode]
) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.complex128]]:
    """Nodes and directions of all modes, in order of appearance, and (n_modes, n_rows) values."""
    nodes = list(dict.fromkeys(int(node) for mode in modes for node in mode.node))
    directions = sorted({each for mode in modes for each in mode.directions})
    n_cells = len(modes) * len(nodes) * len(directions)
    if n_cells > _MOST_GAPS * sum(mode.values.size for mode in modes):
        found = f"{len(modes)} modes over {len(nodes)} nodes, most of them missing"
        raise damaged(path.name, found, "modes of one structure must share their nodes")
    table = np.empty((len(modes), len(nodes), len(directions)), dtype=np.complex128)
    row_of = {node: row for row, node in enumerate(nodes)}
    for number, mode in enumerate(modes):
        rows = [row_of[int(node)] for node in mode.node]
        columns = [directions.index(each) for each in mode.directions]
        table[number] = np.nan
        table[number][:, columns] = mode.absent
        table[number][np.ix_(rows, columns)] = mode.values
    node = np.repeat(np.array(nodes), len(directions))
    direction = np.tile(np.array(directions), len(nodes))
    return node, direction, table.reshape(len(modes), -1)


def _along_global_axes(
    node: NDArray[np.int_],
    direction: NDArray[np.int_],
    values: NDArray[np.complex128],
    axes: Mapping[int, NDArray[np.float64]],
) -> NDArray[np.complex128]:
    """Values along the global axes; those of a node count along its displacement system."""
    found = values.copy()
    for first in (1, 4):  # translations, rotations
        for each in axes.keys() & set(node.tolist()):
            rows = np.flatnonzero((node == each) & (direction >= first) & (direction < first + 3))
            if rows.size:
                found[:, rows] = values[:, rows] @ axes[each]
    return found


@dataclass(frozen=True, eq=False)
class _Mode:
    """One mode of a dataset."""

    frequency_hz: float
    damping_ratio: float  # NaN where the dataset states none
    node: NDArray[np.int_]
    directions: tuple[int, ...]
    values: NDArray[np.complex128]  # (n_nodes, n_directions), as stored
    absent: float  # of a node that is not listed: 0 in dataset 55, NaN (unknown) in 2414


@dataclass(frozen=True)
class _Form:
    """Head of a dataset: what its values are, and parameters of the mode."""

    normal: tuple[float, ...]  # frequency, modal mass, viscous ζ, hysteretic η
    eigenvalue: complex
    location: int
    analysis: int
    characteristic: int
    result: int
    kind: int
    n_values: int


def _read_mode(path: Path, dataset: Dataset) -> _Mode | str:
    """Read a dataset 55 or 2414, or return what it is instead of a mode shape."""
    is_55 = dataset.number == _DATA_AT_NODES
    lines = Lines(path, dataset)
    form = _head_55(lines) if is_55 else _head_2414(lines)
    if other := _what_else(form):
        return other
    size = math.hypot(form.eigenvalue.real, form.eigenvalue.imag)
    frequency_hz = size / (2.0 * math.pi)
    damping_ratio = -form.eigenvalue.real / size if size else math.nan
    if form.analysis == _NORMAL_MODE:
        frequency_hz, _, viscous, hysteretic = form.normal
        # Zero means unknown. The viscous ratio is half the loss factor.
        damping_ratio = viscous or hysteretic / 2.0 or math.nan
    if not 0.0 <= frequency_hz < math.inf:
        found, rule = f"a mode at {frequency_hz:g} Hz", "frequencies must be positive and finite"
        raise damaged(lines.where, found, rule)
    node, values = _read_values(lines, form)
    absent = 0.0 if is_55 else math.nan
    return _Mode(frequency_hz, damping_ratio, node, _DIRECTIONS[form.n_values], values, absent)


def _head_55(lines: Lines) -> _Form:
    """Records 1 to 8; the real parameters depend on the type of analysis."""
    lines.text(5)
    form = lines.integers(6)[1:6]
    n_integers, n_reals, *_ = lines.integers(2)
    if n_integers > 6:  # eight on a line, the two counts among them
        lines.text()
    reals = lines.numbers(_VALUE_WIDTHS, min(max(n_reals, 1), 6))
    if n_reals > 6:
        lines.text()
    reals += [0.0] * 6
    return _Form(tuple(reals[:4]), complex(*reals[:2]), _AT_NODES, *form)


def _head_2414(lines: Lines) -> _Form:
    """Records 1 to 13, with twelve real parameters."""
    lines.text(2)
    location = lines.integers(1)[0]
    lines.text(5)
    form = lines.integers(6)[1:6]
    lines.text(2)
    reals = lines.numbers(_VALUE_WIDTHS, 6)[:6] + lines.numbers(_VALUE_WIDTHS, 6)[:6]
    normal = (reals[1], reals[3], reals[4], reals[5])
    return _Form(normal, complex(*reals[6:8]), location, *form)


def _what_else(form: _Form) -> str:
    """What a dataset contains instead of a mode shape; empty for a mode shape."""
    if form.analysis not in (_NORMAL_MODE, *_COMPLEX_MODE):
        known = 0 <= form.analysis < len(_ANALYSES)
        return f"results of a {_ANALYSES[form.analysis] if known else form.analysis} analysis"
    if form.location != _AT_NODES:
        return "values of elements"
    if form.characteristic >= _TENSOR or form.n_values not in _DIRECTIONS:
        return f"{form.n_values} values per node, no motion"
    if form.result not in _MOTIONS:
        return f"results of type {form.result}, no motion"
    if form.kind not in (*_REAL, *_COMPLEX):
        return f"values of kind {form.kind}"
    return ""


def _read_values(lines: Lines, form: _Form) -> tuple[NDArray[np.int_], NDArray[np.complex128]]:
    """Nodes, each with its number on a line and its values on as many lines as they need."""
    n_numbers = form.n_values * (2 if form.kind in _COMPLEX else 1)
    rows: dict[int, list[float]] = {}
    while lines.more():
        node = lines.integers(1)[0]
        if node in rows:
            raise damaged(lines.where, f"node {node} twice", "a node must be listed once")
        row = rows[node] = []
        while len(row) < n_numbers:
            row += lines.numbers(_VALUE_WIDTHS, 1)
        if len(row) > n_numbers:
            raise damaged(lines.where, f"{len(row)} numbers", f"node {node} has {n_numbers}")
    table = np.array(list(rows.values()), dtype=np.float64).reshape(-1, n_numbers)
    values = table.view(np.complex128) if form.kind in _COMPLEX else table.astype(np.complex128)
    return np.array(list(rows), dtype=np.int_), values


@dataclass(frozen=True, eq=False)
class RadialShapes(ReadonlyArrays):
    """Shapes as one value per node; NaN means not stated, or no wheel."""

    frequency_hz: NDArray[np.float64]
    damping_ratio: NDArray[np.float64]
    node: NDArray[np.int_]
    angle_deg: NDArray[np.float64]  # around the axle, 0…360
    radius_m: NDArray[np.float64]  # from the axle
    across_m: NDArray[np.float64]  # along the axle, from the middle of the wheel
    values: NDArray[np.complex128]  # (n_modes, n_nodes)
    notes: tuple[str, ...] = ()  # what was assumed


class _Wheel(NamedTuple):
    """Nodes around an axle."""

    coordinates: NDArray[np.float64]  # (3, n_nodes): angle, radius, place along the axle
    axes: tuple[int, int]  # of the plane in which angles count
    note: str


def read_radial_shapes(
    path: Path | str, direction: str = "", *, on_wheel: bool = True
) -> RadialShapes:
    """Read the shapes of a universal file and reduce them to one direction.

    The axle of a wheel is the axis along which its nodes extend least; angles count from the first
    axis of the plane (x, or y in the y-z plane) to the second. The file has datasets 55 or 2414,
    and for a wheel 15 or 2411. `direction` is radial, x, y or z; by default radial where the nodes
    surround an axle, otherwise the only axis that moves. With `on_wheel` False they do not surround
    one.

    `RecordingFormatError` if the file is damaged or has no shapes; `InputError` if the direction
    does not follow from it.
    """
    path = Path(path)
    found = read_shapes(path)
    node = np.unique(found.node)
    wheel = _wheel(path, node) if on_wheel else None
    values, note = _along(path, found, node, wheel, direction)
    coordinates = np.full((3, node.size), np.nan) if wheel is None else wheel.coordinates
    notes = (note,) if wheel is None else (wheel.note, note)
    modes, (angle_deg, radius_m, across_m) = (found.frequency_hz, found.damping_ratio), coordinates
    return RadialShapes(*modes, node, angle_deg, radius_m, across_m, values, notes)


def _wheel(path: Path, node: NDArray[np.int_]) -> _Wheel | None:
    datasets = scan(path)
    place = geometry.read_nodes(path, datasets).xyz
    to_m = 1.0 / geometry.read_surroundings(path, datasets, set()).units_at(datasets[-1]).length
    blank = np.full(3, np.nan)
    points = to_m * np.array([place.get(each, blank) for each in node.tolist()])
    known = points[np.isfinite(points).all(axis=1)]
    if len(known) < _FEWEST_NODES:
        return None
    extent = np.ptp(known, axis=0)
    if np.sort(extent)[1] <= _ON_A_LINE * extent.max():
        return None
    axle = int(np.argmin(extent))
    first, second = geometry.PLANES[axle]
    plane = known[:, [first, second]]
    centre = np.zeros(2) if geometry.is_round(plane) else geometry.centre_of_circle(plane)
    if np.hypot(*centre) <= _AT_ORIGIN * extent.max() / 2:
        centre = np.zeros(2)
    along = points[:, [first, second]] - centre
    middle = (known[:, axle].max() + known[:, axle].min()) / 2
    angle_deg = np.degrees(np.arctan2(along[:, 1], along[:, 0])) % 360.0
    coordinates = np.stack([angle_deg, np.hypot(*along.T), points[:, axle] - middle])
    note = f"axle along {AXES[axle]}, angles from {AXES[first]} towards {AXES[second]}"
    return _Wheel(coordinates, (first, second), note)


def _along(
    path: Path, found: ShapeSet, node: NDArray[np.int_], wheel: _Wheel | None, direction: str
) -> tuple[NDArray[np.complex128], str]:
    """Values (n_modes, n_nodes) along the direction, and what it is."""
    # By direction, 0 to 3; 0 along axes that the file leaves out.
    tables = np.zeros((1 + len(_TRANSLATIONS), found.n_modes, node.size), dtype=complex)
    rows = np.flatnonzero(found.direction <= _TRANSLATIONS[-1])
    place = np.searchsorted(node, found.node[rows])
    tables[found.direction[rows], :, place] = found.values[:, rows].T
    components = tables[1:]
    if direction in AXES:
        return components[AXES.index(direction)], f"motion along {direction}"
    if not np.isin(found.direction, _TRANSLATIONS).any():
        return tables[0], "one value per node without direction, taken as it is"
    if wheel is not None:
        turn = np.deg2rad(wheel.coordinates[0])
        first, second = components[list(wheel.axes)]
        return first * np.cos(turn) + second * np.sin(turn), "radial motion, outward"
    moving = [axis for axis in range(3) if np.nan_to_num(components[axis]).any()]
    if len(moving) == 1 and direction != RADIAL:
        return components[moving[0]], f"motion along {AXES[moving[0]]}, the only one"
    held = ", ".join(AXES[axis] for axis in moving)
    rule = "without nodes around an axle there is no radial direction"
    remedy = "Add the nodes (dataset 2411 or 15) to the file, or choose x, y or z"
    raise InputError(path.name, f"shapes along {held}", rule, remedy)
