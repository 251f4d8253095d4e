"""Mode shapes from other programs, for comparison."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.arrays import readonly
from ema.core.errors import InputError, RecordingFormatError
from ema.core.finding import Finding
from ema.io.columns import PLANES, centre_of_circle, is_round
from ema.io.content import remark
from ema.io.uff.geometry import read_nodes, read_surroundings
from ema.io.uff.scan import COPY_AGAIN, scan
from ema.io.uff.shapes import ModeRecord, read_mode
from ema.io.uff.units import SHAPES

_MOST_GAPS = 8  # cells of the whole table for each value given: files of one structure have about 1


@dataclass(frozen=True, eq=False)
class ShapeSet:
    """Mode shapes of a universal file, as stored: each has a scale of its own.

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
        Angle of the row's node; NaN where the file has no geometry, or it is no circle.
    values : ndarray of complex, shape (n_modes, n_rows)
        NaN where a mode says nothing about a row.
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

    def __post_init__(self) -> None:
        for name, dtype in (
            ("frequency_hz", float),
            ("damping_ratio", float),
            ("node", int),
            ("direction", int),
            ("angle_deg", float),
            ("values", complex),
        ):
            object.__setattr__(self, name, readonly(getattr(self, name), dtype))

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return int(self.values.shape[0])


def read_shapes(path: Path | str) -> ShapeSet:
    """Read the mode shapes of a universal file from its datasets 55 and 2414.

    Normal modes and complex eigenvalues, real or complex, are modes; results of other analyses
    are named in a finding and left out.

    Parameters
    ----------
    path : Path or str
        A universal file.

    Raises
    ------
    RecordingFormatError
        If the file is missing or damaged, or holds no mode shapes.

    Examples
    --------
    >>> import ringmodal as rm
    >>> from pipelines.export.modal import export
    >>> written = export("result", "modes.uff")
    >>> shapes = rm.read_shapes("modes.uff")
    >>> shapes.n_modes, shapes.values.shape[1] >= 72
    (8, True)
    """
    path = Path(path)
    datasets = scan(path)
    modes: list[ModeRecord] = []
    left_out: list[str] = []
    for dataset in datasets:
        if dataset.number not in SHAPES:
            continue
        found = read_mode(path, dataset)
        if isinstance(found, ModeRecord):
            modes.append(found)
        else:
            left_out.append(f"dataset {dataset.index} ({dataset.number}): {found}")
    if not any(len(mode.node) for mode in modes):
        held = "; ".join(left_out[:3]) or f"{len(datasets)} datasets, none of them 55 or 2414"
        rule = "mode shapes are normal or complex modes in datasets 55 or 2414"
        raise RecordingFormatError(path.name, held, rule, "Export the modes of the modal analysis")
    findings = tuple(remark(path, "", "content", f"{each}, left out") for each in left_out)
    node, direction, values = _table(path, modes)
    around = read_surroundings(path, datasets, set(node.tolist()))
    return ShapeSet(
        frequency_hz=np.array([mode.frequency_hz for mode in modes]),
        damping_ratio=np.array([mode.damping_ratio for mode in modes]),
        node=node,
        direction=direction,
        angle_deg=np.array([around.angle_deg.get(each, np.nan) for each in node.tolist()]),
        values=values,
        findings=findings + around.findings,
    )


def _table(
    path: Path, modes: Sequence[ModeRecord]
) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.complex128]]:
    """Nodes and directions of all modes, in order of appearance, and (n_modes, n_rows) values."""
    nodes = list(dict.fromkeys(int(node) for mode in modes for node in mode.node))
    directions = sorted({each for mode in modes for each in mode.directions})
    n_cells = len(modes) * len(nodes) * len(directions)
    if n_cells > _MOST_GAPS * sum(mode.values.size for mode in modes):
        found = f"{len(modes)} modes over {len(nodes)} nodes, most of them missing"
        rule = "modes of one structure share their nodes"
        raise RecordingFormatError(path.name, found, rule, COPY_AGAIN)
    table = np.empty((len(modes), len(nodes), len(directions)), dtype=np.complex128)
    row_of = {node: row for row, node in enumerate(nodes)}
    for number, mode in enumerate(modes):
        rows = [row_of[int(node)] for node in mode.node]
        columns = [directions.index(each) for each in mode.directions]
        table[number] = np.nan
        table[number][:, columns] = mode.absent
        table[number][np.ix_(rows, columns)] = mode.values
    return (
        np.repeat(np.array(nodes), len(directions)),
        np.tile(np.array(directions), len(nodes)),
        table.reshape(len(modes), -1),
    )


RADIAL = "radial"
AXES = ("x", "y", "z")
DIRECTIONS = (RADIAL, *AXES)

_TRANSLATIONS = (1, 2, 3)
_FEWEST_NODES = 3
_AT_ORIGIN = 0.02  # an axle this near to the origin, over the radius, goes through it
_ON_A_LINE = 0.01  # extent of nodes across, over that along


@dataclass(frozen=True, eq=False)
class RadialShapes:
    """Shapes as one value per node.

    Parameters
    ----------
    frequency_hz, damping_ratio : ndarray, shape (n_modes,)
        Undamped frequency; damping ratio, NaN where not stated.
    node : ndarray of int, shape (n_nodes,)
    angle_deg : ndarray, shape (n_nodes,)
        Around the axle, 0…360; NaN where there is no wheel.
    radius_m, across_m : ndarray, shape (n_nodes,)
        Distance from the axle, and along it from the wheel's middle; NaN where there is no wheel.
    values : ndarray of complex, shape (n_modes, n_nodes)
        NaN where a mode says nothing of a node.
    notes : tuple of str
        What was assumed, in words.
    """

    frequency_hz: NDArray[np.float64]
    damping_ratio: NDArray[np.float64]
    node: NDArray[np.int_]
    angle_deg: NDArray[np.float64]
    radius_m: NDArray[np.float64]
    across_m: NDArray[np.float64]
    values: NDArray[np.complex128]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("frequency_hz", "damping_ratio", "angle_deg", "radius_m", "across_m"):
            object.__setattr__(self, name, readonly(getattr(self, name), float))
        object.__setattr__(self, "node", readonly(self.node, int))
        object.__setattr__(self, "values", readonly(self.values, complex))


@dataclass(frozen=True, eq=False)
class _Wheel:
    """Cylindrical coordinates of nodes, and what they are counted from."""

    angle_deg: NDArray[np.float64]
    radius_m: NDArray[np.float64]
    across_m: NDArray[np.float64]
    note: str
    axes: tuple[int, int]


def read_radial_shapes(
    path: Path | str, direction: str = "", *, on_wheel: bool = True
) -> RadialShapes:
    """Read the shapes of a universal file and reduce them to one direction.

    The axle of a wheel is the axis along which its nodes extend least; angles count from the
    plane's first axis (x, or y in the y-z plane) to its second.

    Parameters
    ----------
    path : path
        Datasets 55 or 2414, and for a wheel 15 or 2411.
    direction : {"radial", "x", "y", "z"}, optional
        Default: radial where the nodes surround an axle, otherwise the only axis that moves.
    on_wheel : bool
        Whether nodes may surround an axle; False for any other structure.

    Raises
    ------
    RecordingFormatError
        If the file is damaged or holds no shapes.
    InputError
        If the direction does not follow from the file.
    """
    path = Path(path)
    found = read_shapes(path)
    node = np.unique(found.node)
    wheel = _wheel(path, node) if on_wheel else None
    values, note = _along(path, found, node, wheel, direction)
    unknown = np.full(node.size, np.nan)
    return RadialShapes(
        frequency_hz=found.frequency_hz,
        damping_ratio=found.damping_ratio,
        node=node,
        angle_deg=unknown if wheel is None else wheel.angle_deg,
        radius_m=unknown if wheel is None else wheel.radius_m,
        across_m=unknown if wheel is None else wheel.across_m,
        values=values,
        notes=(note,) if wheel is None else (wheel.note, note),
    )


def _wheel(path: Path, node: NDArray[np.int_]) -> _Wheel | None:
    datasets = scan(path)
    place, _ = read_nodes(path, datasets)
    to_m = 1.0 / read_surroundings(path, datasets, set()).units.length
    blank = np.full(3, np.nan)
    points = to_m * np.array([place.get(each, blank) for each in node.tolist()])
    known = points[np.isfinite(points).all(axis=1)]
    if len(known) < _FEWEST_NODES:
        return None
    extent = np.ptp(known, axis=0)
    if np.sort(extent)[1] <= _ON_A_LINE * extent.max():
        return None
    axle = int(np.argmin(extent))
    first, second = PLANES[axle]
    plane = known[:, [first, second]]
    centre = np.zeros(2) if is_round(plane) else centre_of_circle(plane)
    if np.hypot(*centre) <= _AT_ORIGIN * extent.max() / 2:
        centre = np.zeros(2)
    along = points[:, [first, second]] - centre
    middle = (known[:, axle].max() + known[:, axle].min()) / 2
    return _Wheel(
        angle_deg=np.degrees(np.arctan2(along[:, 1], along[:, 0])) % 360.0,
        radius_m=np.hypot(along[:, 0], along[:, 1]),
        across_m=points[:, axle] - middle,
        note=f"axle along {AXES[axle]}, angles from {AXES[first]} towards {AXES[second]}",
        axes=(first, second),
    )


def _along(
    path: Path, found: ShapeSet, node: NDArray[np.int_], wheel: _Wheel | None, direction: str
) -> tuple[NDArray[np.complex128], str]:
    """Values (n_modes, n_nodes) along the direction, and what it is."""
    components = _components(found, node)
    if direction in AXES:
        return components[:, :, AXES.index(direction)], f"motion along {direction}"
    if not np.isin(found.direction, _TRANSLATIONS).any():
        scalars = _shapes_table(found, node, 0)
        return scalars, "one value per node without direction, taken as it is"
    if wheel is not None:
        turn = np.deg2rad(wheel.angle_deg)
        first, second = (components[:, :, axis] for axis in wheel.axes)
        return first * np.cos(turn) + second * np.sin(turn), "radial motion, outward"
    moving = [axis for axis in range(3) if np.nan_to_num(components[:, :, axis]).any()]
    if len(moving) == 1 and direction != RADIAL:
        return components[:, :, moving[0]], f"motion along {AXES[moving[0]]}, the only one"
    held = ", ".join(AXES[axis] for axis in moving)
    rule = "without nodes around an axle there is no radial direction"
    remedy = "Add the nodes (dataset 2411 or 15) to the file, or choose x, y or z"
    raise InputError(path.name, f"shapes along {held}", rule, remedy)


def _components(found: ShapeSet, node: NDArray[np.int_]) -> NDArray[np.complex128]:
    """Motion along x, y and z, (n_modes, n_nodes, 3); 0 along axes that the file leaves out."""
    return np.stack([_shapes_table(found, node, axis) for axis in _TRANSLATIONS], axis=2)


def _shapes_table(
    found: ShapeSet, node: NDArray[np.int_], direction: int
) -> NDArray[np.complex128]:
    rows = np.flatnonzero(found.direction == direction)
    table = np.zeros((found.n_modes, node.size), dtype=complex)
    table[:, np.searchsorted(node, found.node[rows])] = found.values[:, rows]
    return table
