"""Nodes of datasets 15 and 2411 in Cartesian coordinates of the structure, and units of 164."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.finding import Check, Finding
from ema.io.content import remark
from ema.io.uff.dataset58_header import UnitSystem
from ema.io.uff.scan import Dataset, Lines, damaged

_NODES, _NODES_DOUBLE, _UNITS = 15, 2411, 164  # kinds of datasets
_SYSTEMS, _SYSTEMS_DOUBLE = 18, 2420
_GLOBAL = (0, 1)  # numbers of the global system, which files usually do not define
_PARALLEL = 1e-6  # sine of the angle between the x axis of a system and a point on its x-z plane
_ROUND = 0.05  # radii may differ by this share of the radius
_SENSELESS = 1e100  # larger than any structure in any unit
PLANES = {0: (1, 2), 1: (0, 2), 2: (0, 1)}  # normal axis: the axes between which angles count


@dataclass(frozen=True, eq=False)
class _System:
    """A coordinate system in terms of another one, whose number is `reference`."""

    kind: int
    reference: int
    origin: NDArray[np.float64]
    axes: NDArray[np.float64]  # one unit vector per row
    where: str


def read_nodes(
    path: Path, datasets: Sequence[Dataset]
) -> tuple[dict[int, NDArray[np.float64]], str]:
    """Coordinates of the nodes of a file, and what was assumed (empty where nothing was).

    Dataset 2411 gives them in the global Cartesian system; without it, dataset 15 gives each in a
    system that dataset 18 or 2420 defines. They stay in the unit of the file.
    """
    is_global = any(each.number == _NODES_DOUBLE for each in datasets)
    kind = _NODES_DOUBLE if is_global else _NODES
    own = [row for each in datasets if each.number == kind for row in _nodes(path, each)]
    systems: dict[int, _System] = {}
    for each in datasets:
        if each.number in (_SYSTEMS, _SYSTEMS_DOUBLE) and own and not is_global:
            systems |= _systems(path, each)
    unknown = sorted({system for _, system, _ in own} - systems.keys() - set(_GLOBAL))
    listed = ", ".join(map(str, unknown[:5]))
    doubt = f"nodes in coordinate system {listed}, which the file does not define; read as x y z"
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite stays so
        nodes = {node: _in_global(systems, system, xyz) for node, system, xyz in own}
    return nodes, doubt if unknown else ""


def _nodes(path: Path, dataset: Dataset) -> Iterator[tuple[int, int, NDArray[np.float64]]]:
    """Label, coordinate system (0 in dataset 2411) and coordinates of each node."""
    lines = Lines(path, dataset)
    while lines.more():
        if dataset.number == _NODES_DOUBLE:
            label, system = lines.integers(1)[0], 0
            xyz = lines.numbers((25,) * 3, 3)[:3]
        else:
            numbers = lines.numbers((10,) * 4 + (13,) * 3, 7)
            label, system = lines.as_integers(numbers[:2])
            xyz = numbers[4:7]
        yield label, system, np.array(xyz)


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


@dataclass(frozen=True)
class Surroundings:
    """Units, angles of nodes, and findings about them."""

    units: dict[int, UnitSystem]  # by the index of the dataset 164; each holds for what follows
    angle_deg: dict[int, float]
    findings: tuple[Finding, ...] = ()

    def units_at(self, dataset: Dataset) -> UnitSystem:
        """Units of a dataset: of the last 164 in front of it, else of the first one."""
        before = [index for index in self.units if index < dataset.index]
        place = max(before, default=min(self.units, default=0))
        return self.units.get(place, UnitSystem())


def read_surroundings(path: Path, datasets: Sequence[Dataset], in_use: set[int]) -> Surroundings:
    """Read units and the geometry of the nodes in use."""
    units = {each.index: read_units(path, each) for each in datasets if each.number == _UNITS}
    nodes, doubt = read_nodes(path, datasets)
    carrying = {node: point for node, point in nodes.items() if node in in_use}
    angles = angles_on_circle(carrying)
    if carrying and not angles:
        doubt = "the nodes of the file's geometry are not on a circle; no angles available"
    findings = (remark(path, "", Check.GEOMETRY, doubt),) if doubt else ()
    return Surroundings(units, angles, findings)


def read_units(path: Path, dataset: Dataset) -> UnitSystem:
    """Factors of dataset 164."""
    lines = Lines(path, dataset)
    lines.text()
    length, force, *_ = lines.numbers((25,) * 3, 2)
    if not (0.0 < length < np.inf and 0.0 < force < np.inf):
        found = f"units {length:g} (length) and {force:g} (force)"
        raise damaged(lines.where, found, "factors of dataset 164 must be positive")
    return UnitSystem(length, force)


def angles_on_circle(nodes: Mapping[int, NDArray[np.float64]]) -> dict[int, float]:
    """Angle of each node on a circle in degrees, 0…360; empty where nodes are not on a circle.

    Angles count from the first axis of the plane (x, or y in the y-z plane) to its second, about
    the origin, or about the centre of the circle where that is elsewhere.
    """
    if not nodes:
        return {}
    points = np.array(list(nodes.values()), dtype=np.float64)
    if not (np.abs(points) < _SENSELESS).all():  # NaN is not smaller
        return {}
    first, second = PLANES[int(np.argmin(np.ptp(points, axis=0)))]
    plane = points[:, [first, second]]
    if len(points) > 3 and not is_round(plane):  # any three points are on a circle
        plane = plane - centre_of_circle(plane)
    if not is_round(plane):
        return {}
    angles = np.degrees(np.arctan2(plane[:, 1], plane[:, 0])) % 360.0
    return dict(zip(nodes, angles.tolist(), strict=True))


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
