"""Nodes of datasets 15 and 2411 in Cartesian coordinates of the structure, and units of 164."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.finding import Check, Finding
from ema.io.content import remark
from ema.io.uff.dataset58_header import UnitSystem
from ema.io.uff.scan import Dataset, Lines, damaged

_NODES, _NODES_DOUBLE, _UNITS = 15, 2411, 164  # kinds of datasets
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
    double = [each for each in datasets if each.number == _NODES_DOUBLE]
    if double:
        return {node: xyz for each in double for node, xyz in _nodes_2411(path, each)}, ""
    own = [row for each in datasets if each.number == _NODES for row in _nodes_15(path, each)]
    systems: dict[int, _System] = {}
    for each in datasets:
        if each.number in _READ_SYSTEMS and own:
            systems |= _READ_SYSTEMS[each.number](path, each)
    unknown = sorted({system for _, system, _ in own} - systems.keys() - set(_GLOBAL))
    listed = ", ".join(map(str, unknown[:5]))
    doubt = f"nodes in coordinate system {listed}, which the file does not define; read as x y z"
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite stays so
        nodes = {node: _in_global(systems, system, xyz) for node, system, xyz in own}
    return nodes, doubt if unknown else ""


def _nodes_2411(path: Path, dataset: Dataset) -> list[tuple[int, NDArray[np.float64]]]:
    lines = Lines(path, dataset)
    nodes = []
    while lines.more():
        label = lines.integers(1)[0]
        nodes.append((label, np.array(lines.numbers((25,) * 3, 3)[:3])))
    return nodes


def _nodes_15(path: Path, dataset: Dataset) -> list[tuple[int, int, NDArray[np.float64]]]:
    """Label, coordinate system, and coordinates of each node."""
    lines = Lines(path, dataset)
    nodes = []
    while lines.more():
        numbers = lines.numbers((10,) * 4 + (13,) * 3, 7)
        label, system = lines.as_integers(numbers[:2])
        nodes.append((label, system, np.array(numbers[4:7])))
    return nodes


def _systems_18(path: Path, dataset: Dataset) -> dict[int, _System]:
    """Systems given by their origin, a point on +x and one on the x-z plane."""
    lines = Lines(path, dataset)
    systems = {}
    while lines.more():
        number, kind, reference, *_ = lines.integers(3)
        lines.text()
        first = lines.numbers((13,) * 6, 6)
        points = np.reshape(first[:6] + lines.numbers((13,) * 3, 3)[:3], (3, 3))
        axes = _axes(points)
        if axes is None:
            rule = "its three points must span a plane"
            raise damaged(lines.where, f"coordinate system {number}", rule)
        systems[number] = _System(kind, reference, points[0], axes, lines.where)
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


def _systems_2420(path: Path, dataset: Dataset) -> dict[int, _System]:
    """Systems given by the rows of a matrix: three axes, and the origin last."""
    lines = Lines(path, dataset)
    lines.text(2)
    systems = {}
    while lines.more():
        number, kind, *_ = lines.integers(2)
        lines.text()
        rows = np.array([lines.numbers((25,) * 3, 3)[:3] for _ in range(4)])
        systems[number] = _System(kind, 0, rows[3], rows[:3], lines.where)
    return systems


_READ_SYSTEMS: dict[int, Callable[[Path, Dataset], dict[int, _System]]] = {
    18: _systems_18,
    2420: _systems_2420,
}


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
    if kind == 1:
        angle = np.radians(point[1])
        return np.array([point[0] * np.cos(angle), point[0] * np.sin(angle), point[2]])
    if kind == 2:
        polar, azimuth = np.radians(point[1:])
        across = point[0] * np.sin(polar)
        x, y = across * np.cos(azimuth), across * np.sin(azimuth)
        return np.array([x, y, point[0] * np.cos(polar)])
    return point


@dataclass(frozen=True)
class Surroundings:
    """Units, angles of nodes, and findings about them."""

    units: UnitSystem
    angle_deg: dict[int, float]
    findings: tuple[Finding, ...] = ()


def read_surroundings(path: Path, datasets: Sequence[Dataset], in_use: set[int]) -> Surroundings:
    """Read units and the geometry of the nodes in use."""
    units = UnitSystem()
    for each in datasets:
        if each.number == _UNITS:
            units = read_units(path, each)
    nodes, doubt = read_nodes(path, datasets)
    carrying = {node: point for node, point in nodes.items() if node in in_use}
    angles = angles_on_circle(carrying)
    if carrying and not angles:
        doubt = "the nodes of the file's geometry are not on a circle; no angles available"
    return Surroundings(units, angles, (remark(path, "", Check.GEOMETRY, doubt),) if doubt else ())


def read_units(path: Path, dataset: Dataset) -> UnitSystem:
    """Factors of dataset 164."""
    lines = Lines(path, dataset)
    lines.text()
    length, force, *_ = lines.numbers((25,) * 3, 2)
    units = UnitSystem(length, force)
    if not units.is_valid:
        found = f"units {length:g} (length) and {force:g} (force)"
        raise damaged(lines.where, found, "factors of dataset 164 must be positive")
    return units


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
    if len(points) == 1 and not points[0, [first, second]].any():
        return {}
    plane = points[:, [first, second]]
    if not is_round(plane):
        if len(points) < 4:  # any three points are on a circle
            return {}
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
