"""Mode shapes of a universal file along one direction: radial on a wheel, or an axis."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema._arrays import readonly
from ema.errors import InputError
from ema.io.geometry import PLANES, centre_of_circle, is_round
from ema.io.shapes import ShapeSet, read_shapes
from ema.io.uff_geometry import read_nodes
from ema.io.uff_scan import scan
from ema.io.uff_surroundings import read_surroundings

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
        scalars = _table(found, node, 0)
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
    remedy = "Write the nodes (dataset 2411 or 15) to the file too, or choose x, y or z"
    raise InputError(path.name, f"shapes along {held}", rule, remedy)


def _components(found: ShapeSet, node: NDArray[np.int_]) -> NDArray[np.complex128]:
    """Motion along x, y and z, (n_modes, n_nodes, 3); 0 along axes that the file leaves out."""
    return np.stack([_table(found, node, axis) for axis in _TRANSLATIONS], axis=2)


def _table(found: ShapeSet, node: NDArray[np.int_], direction: int) -> NDArray[np.complex128]:
    rows = np.flatnonzero(found.direction == direction)
    table = np.zeros((found.n_modes, node.size), dtype=complex)
    table[:, np.searchsorted(node, found.node[rows])] = found.values[:, rows]
    return table
