"""Nodes of datasets 15 and 2411, the axes of motion at each of them, and units of 164."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.finding import Check, Finding
from ema.io.content import CircleNodes, Nodes, remark
from ema.io.uff.dataset58_header import UnitSystem
from ema.io.uff.scan import Dataset, Lines, damaged

_NODES, _NODES_DOUBLE, _UNITS = 15, 2411, 164  # kinds of datasets
_SYSTEMS, _SYSTEMS_DOUBLE = 18, 2420
_GLOBAL = (0, 1)  # numbers of the global system, which files usually do not define
_PARALLEL = 1e-6  # sine of the angle between the x axis of a system and a point on its x-z plane
_ROUND = 0.05  # radii may differ by this share of the radius
_SENSELESS = 1e100  # larger than any structure in any unit
PLANES = {0: (1, 2), 1: (0, 2), 2: (0, 1)}  # normal axis: the axes between which angles count
_SAME_AXES = 1e-3  # radians
# Points at the ends of the Cartesian unit vectors of a system, in its own coordinates, by kind.
_CARTESIAN_ENDS = np.eye(3)
_UNIT_ENDS = {
    1: np.array([(1.0, 0.0, 0.0), (1.0, 90.0, 0.0), (0.0, 0.0, 1.0)]),
    2: np.array([(1.0, 90.0, 0.0), (1.0, 90.0, 90.0), (1.0, 0.0, 0.0)]),
}


@dataclass(frozen=True, eq=False)
class _System:
    """A coordinate system in terms of another one, whose number is `reference`."""

    kind: int
    reference: int
    origin: NDArray[np.float64]
    axes: NDArray[np.float64]  # one unit vector per row
    where: str


def read_nodes(path: Path, datasets: Sequence[Dataset]) -> Nodes:
    """Coordinates of the nodes of a file, and the axes of motion at each of them.

    Dataset 2411 gives the former in the global Cartesian system; without it, dataset 15 gives each
    in a system that dataset 18 or 2420 defines, as either does for the latter.
    """
    is_global = any(each.number == _NODES_DOUBLE for each in datasets)
    kind = _NODES_DOUBLE if is_global else _NODES
    own = [row for each in datasets if each.number == kind for row in _nodes(path, each)]
    systems: dict[int, _System] = {}
    for each in datasets:
        if each.number in (_SYSTEMS, _SYSTEMS_DOUBLE) and any(any(row.systems) for row in own):
            systems |= _systems(path, each)
    named = {row.systems[0] for row in own} | {row.systems[1] for row in own}
    listed = ", ".join(map(str, sorted(named - systems.keys() - set(_GLOBAL))[:5]))
    doubt = f"nodes in coordinate system {listed}, which the file does not define; read as x y z"
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite stays so
        xyz = {row.node: _in_global(systems, row.systems[0], row.point) for row in own}
        axes = {
            row.node: turned
            for row in own
            if row.systems[1] in systems
            and (turned := _axes_at(systems, row.systems[1], xyz[row.node])) is not None
        }
    return Nodes(xyz, axes, doubt if listed else "")


@dataclass(frozen=True, eq=False)
class _Row:
    """A node as stored; coordinates of dataset 2411 are global whatever system it names."""

    node: int
    systems: tuple[int, int]  # of its coordinates and of its motion
    point: NDArray[np.float64]


def _nodes(path: Path, dataset: Dataset) -> Iterator[_Row]:
    lines = Lines(path, dataset)
    while lines.more():
        if dataset.number == _NODES_DOUBLE:
            label, _, *moving = lines.integers(1) + [0] * 2
            systems, xyz = (0, moving[0]), lines.numbers((25,) * 3, 3)[:3]
        else:
            numbers = lines.numbers((10,) * 4 + (13,) * 3, 7)
            label, *codes = lines.as_integers(numbers[:3])
            systems, xyz = (codes[0], codes[1]), numbers[4:7]
        yield _Row(label, systems, np.array(xyz))


def _axes_at(
    systems: dict[int, _System], number: int, xyz: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Unit vectors of a system at a point, one per row; None where they are the global ones.

    Those of a cylindrical system are radial, tangential and axial, of a spherical one radial,
    along the polar angle and along the azimuth.
    """
    kind = systems[number].kind
    origin = _in_global(systems, number, np.zeros(3))
    ends = _UNIT_ENDS.get(kind, _CARTESIAN_ENDS)
    axes = np.array([_in_global(systems, number, end) for end in ends]) - origin
    x, y, z = axes @ (xyz - origin)
    cos, sin = np.array([x, y]) / (np.hypot(x, y) or 1.0)
    turned = np.eye(3)
    if kind == 1:
        turned = np.array([(cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)])
    elif kind == 2:
        up, out = np.array([z, np.hypot(x, y)]) / (np.linalg.norm((x, y, z)) or 1.0)
        turned = np.array(
            [(out * cos, out * sin, up), (up * cos, up * sin, -out), (-sin, cos, 0.0)]
        )
    found = turned @ axes
    return None if np.allclose(found, np.eye(3), atol=_SAME_AXES) else found


def _systems(path: Path, dataset: Dataset) -> dict[int, _System]:
    """Systems given by three points (dataset 18), or by their axes and origin (2420)."""
    lines = Lines(path, dataset)
    has_points = dataset.number == _SYSTEMS
    if not has_points:
        lines.text(2)
    systems = {}
    while lines.more():
        number, kind, *others = lines.integers(3 if has_points else 2)
        lines.text()
        if has_points:
            numbers = lines.numbers((13,) * 6, 6)[:6] + lines.numbers((13,) * 3, 3)[:3]
            axes, origin = _axes(np.reshape(numbers, (3, 3))), np.array(numbers[:3])
            if axes is None:
                rule = "its three points must span a plane"
                raise damaged(lines.where, f"coordinate system {number}", rule)
        else:
            rows = np.array([lines.numbers((25,) * 3, 3)[:3] for _ in range(4)])
            axes, origin = rows[:3], rows[3]
        reference = others[0] if has_points else 0
        systems[number] = _System(kind, reference, origin, axes, lines.where)
    return systems


def _axes(points: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Unit vectors from origin, point on +x and point on the x-z plane; None if on one line."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        directions = points[1:] - points[0]
        along_x, on_plane = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        along_y = np.cross(on_plane, along_x)
        sine = float(np.linalg.norm(along_y))
    if not sine > _PARALLEL:  # points that coincide make it NaN
        return None
    along_y /= sine
    return np.array([along_x, along_y, np.cross(along_x, along_y)])


def _in_global(
    systems: dict[int, _System], number: int, point: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Coordinates in the global Cartesian system; systems may be defined in others."""
    for _ in range(len(systems) + 1):
        if number not in systems:
            return point
        system = systems[number]
        point = system.origin + _cartesian(system.kind, point) @ system.axes
        if system.reference == number:
            return point
        number = system.reference
    rule = "no system may refer to itself, not even through others"
    raise damaged(systems[number].where, f"coordinate system {number}", rule)


def _cartesian(kind: int, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cartesian from cylindrical (r, θ°, z) or spherical (r, θ° from +z, φ°) coordinates."""
    if kind not in (1, 2):
        return point
    across, angle, along = point[0], np.radians(point[1]), point[2]
    if kind == 2:
        polar, angle = np.radians(point[1:])
        across, along = point[0] * np.sin(polar), point[0] * np.cos(polar)
    return np.array([across * np.cos(angle), across * np.sin(angle), along])


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Units, places of nodes, and findings about them."""

    units: dict[int, UnitSystem]  # by the index of the dataset 164; each holds for what follows
    angle_deg: dict[int, float]
    findings: tuple[Finding, ...] = ()
    circle: CircleNodes = field(default_factory=CircleNodes)
    axes: dict[int, NDArray[np.float64]] = field(default_factory=dict)  # as `Nodes.axes`

    def units_at(self, dataset: Dataset) -> UnitSystem:
        """Units of a dataset: of the last 164 in front of it, else of the first one."""
        before = [index for index in self.units if index < dataset.index]
        place = max(before, default=min(self.units, default=0))
        return self.units.get(place, UnitSystem())


def read_surroundings(path: Path, datasets: Sequence[Dataset], in_use: set[int]) -> Surroundings:
    """Read units and the geometry; the nodes in use show whether there is a circle."""
    units = {each.index: read_units(path, each) for each in datasets if each.number == _UNITS}
    return replace(placed(path, read_nodes(path, datasets), in_use), units=units)


def placed(path: Path, nodes: Nodes, in_use: set[int]) -> Surroundings:
    """Angles of the nodes in use, where these are on a circle."""
    carrying = {node: point for node, point in nodes.xyz.items() if node in in_use}
    circle, doubt = circle_of(carrying), nodes.doubt
    if carrying and circle is None:
        doubt = "the nodes of the file's geometry are not on a circle; no angles available"
    findings = (remark(path, "", Check.GEOMETRY, doubt),) if doubt else ()
    if circle is None:
        return Surroundings({}, {}, findings, axes=nodes.axes)
    angles = {node: circle.angle_deg(point) for node, point in nodes.xyz.items()}
    plane = np.eye(3)[list(circle.plane)]
    frames = {
        node: frame_at(angle, plane, nodes.axes.get(node, np.eye(3)))
        for node, angle in angles.items()
    }
    in_place = {node: angles[node] for node in carrying}
    around = CircleNodes(angles, frames, frozenset(nodes.axes))
    return Surroundings({}, in_place, findings, around, nodes.axes)


def frame_at(
    angle_deg: float, plane: NDArray[np.float64], axes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Axes (one per row) in radial, tangential and axial components at an angle.

    Both rows of `plane` are unit vectors, towards 0° and towards 90°.
    """
    turn = np.deg2rad(angle_deg)
    radial = np.cos(turn) * plane[0] + np.sin(turn) * plane[1]
    tangential = np.cos(turn) * plane[1] - np.sin(turn) * plane[0]
    return np.asarray(axes @ np.column_stack([radial, tangential, np.cross(*plane)]))


def read_units(path: Path, dataset: Dataset) -> UnitSystem:
    """Factors of dataset 164."""
    lines = Lines(path, dataset)
    lines.text()
    length, force, *_ = lines.numbers((25,) * 3, 2)
    if not (0.0 < length < np.inf and 0.0 < force < np.inf):
        found = f"units {length:g} (length) and {force:g} (force)"
        raise damaged(lines.where, found, "factors of dataset 164 must be positive")
    return UnitSystem(length, force)


@dataclass(frozen=True, eq=False)
class Circle:
    """A circle in a plane of the global axes.

    Angles count from the first axis of the plane (x, or y in the y-z plane) to its second, about
    the origin, or about the centre of the circle where that is elsewhere.
    """

    plane: tuple[int, int]
    centre: NDArray[np.float64]

    def angle_deg(self, point: NDArray[np.float64]) -> float:
        """Angle of a point, 0…360."""
        first, second = point[list(self.plane)] - self.centre
        return float(np.degrees(np.arctan2(second, first)) % 360.0)


def circle_of(nodes: Mapping[int, NDArray[np.float64]]) -> Circle | None:
    """The circle that nodes are on; None where they are not on one."""
    points = np.array(list(nodes.values()), dtype=np.float64)
    if not points.size or not (np.abs(points) < _SENSELESS).all():  # NaN is not smaller
        return None
    axes = PLANES[int(np.argmin(np.ptp(points, axis=0)))]
    plane, centre = points[:, list(axes)], np.zeros(2)
    if len(points) > 3 and not is_round(plane):  # any three points are on a circle
        centre = centre_of_circle(plane)
    return Circle(axes, centre) if is_round(plane - centre) else None


def angles_on_circle(nodes: Mapping[int, NDArray[np.float64]]) -> dict[int, float]:
    """Angle of each node on a circle in degrees; empty where nodes are not on one."""
    circle = circle_of(nodes)
    return {} if circle is None else {n: circle.angle_deg(point) for n, point in nodes.items()}


def is_round(plane: NDArray[np.float64]) -> bool:
    """Whether points (n, 2) have about the same distance from the origin."""
    radii = np.hypot(plane[:, 0], plane[:, 1])
    mean = float(radii.mean())
    return mean > 0.0 and float(np.ptp(radii)) <= _ROUND * mean


def centre_of_circle(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre of the least-squares circle of points (n, 2).

    x² + y² = 2 x₀ x + 2 y₀ y + c (Kåsa 1976).
    """
    system = np.column_stack([2.0 * plane, np.ones(len(plane))])
    solution: NDArray[np.float64] = np.linalg.lstsq(system, (plane**2).sum(axis=1), rcond=None)[0]
    return solution[:2]
