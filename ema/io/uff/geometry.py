"""Nodes of datasets 15 and 2411, in Cartesian coordinates of the whole structure."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Finding
from ema.io.columns import angles_on_circle
from ema.io.content import remark
from ema.io.uff.scan import COPY_AGAIN, Dataset
from ema.io.uff.text import Lines, as_integers
from ema.io.uff.units import UnitSystem

NODES, NODES_DOUBLE = 15, 2411
COORDINATE_SYSTEMS = (18, 2420)
_WHOLE = (0, 1)  # numbers that programs give the structure's own system, as a rule undefined
_PARALLEL = 1e-6  # sine of the angle between a system's x axis and a point on its x-z plane


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
    """Coordinates of the nodes of a file.

    Dataset 2411 gives them in the structure's own Cartesian system; where there is none, dataset
    15 gives each in a system that dataset 18 or 2420 defines.

    Returns
    -------
    nodes : dict of int to ndarray, shape (3,)
        Cartesian coordinates by node number, in the file's unit.
    doubt : str
        What was assumed; empty where nothing was.

    Raises
    ------
    RecordingFormatError
        If one of these datasets is damaged.
    """
    double = [each for each in datasets if each.number == NODES_DOUBLE]
    if double:
        return {node: xyz for each in double for node, xyz in _nodes_2411(path, each)}, ""
    own = [row for each in datasets if each.number == NODES for row in _nodes_15(path, each)]
    systems: dict[int, _System] = {}
    for each in datasets:
        if each.number in COORDINATE_SYSTEMS and own:
            systems |= _READ_SYSTEMS[each.number](path, each)
    unknown = sorted({system for _, system, _ in own} - systems.keys() - set(_WHOLE))
    doubt = ""
    if unknown:
        listed = ", ".join(map(str, unknown[:5]))
        doubt = (
            f"nodes in coordinate system {listed}, which the file does not define; read as x y z"
        )
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite shows as such
        return {node: _in_whole(systems, system, xyz) for node, system, xyz in own}, doubt


def _nodes_2411(path: Path, dataset: Dataset) -> list[tuple[int, NDArray[np.float64]]]:
    lines = Lines(path, dataset)
    nodes = []
    while lines.more():
        label = lines.integers(1)[0]
        nodes.append((label, np.array(lines.numbers((25,) * 3, 3)[:3])))
    return nodes


def _nodes_15(path: Path, dataset: Dataset) -> list[tuple[int, int, NDArray[np.float64]]]:
    """Label, number of its coordinate system, and coordinates of each node."""
    lines = Lines(path, dataset)
    nodes = []
    while lines.more():
        numbers = lines.numbers((10,) * 4 + (13,) * 3, 7)
        label, system = as_integers(numbers[:2], lines.where)
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
            found, rule = f"coordinate system {number}", "its three points must span a plane"
            raise RecordingFormatError(lines.where, found, rule, COPY_AGAIN)
        systems[number] = _System(kind, reference, points[0], axes, lines.where)
    return systems


def _axes(points: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Unit vectors from origin, point on +x and point on the x-z plane; None if these are none."""
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
    lines.text()
    lines.text()
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


def _in_whole(
    systems: dict[int, _System], number: int, point: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Cartesian coordinates in the whole structure; systems may stand on one another."""
    for _ in range(len(systems) + 1):
        if number not in systems:
            return point
        system = systems[number]
        point = system.origin + _cartesian(system.kind, point) @ system.axes
        if system.reference == number:
            return point
        number = system.reference
    found, rule = f"coordinate system {number}", "no system refers to itself by way of others"
    raise RecordingFormatError(systems[number].where, found, rule, COPY_AGAIN)


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


_UNITS = 164


@dataclass(frozen=True)
class Surroundings:
    """Units, angles of nodes, and doubts about them."""

    units: UnitSystem
    angle_deg: dict[int, float]
    findings: tuple[Finding, ...] = ()


def read_surroundings(path: Path, datasets: Sequence[Dataset], in_use: set[int]) -> Surroundings:
    """Read units and geometry, as far as the nodes in use are concerned.

    Raises
    ------
    RecordingFormatError
        If nodes, coordinate systems or units are damaged.
    """
    units = UnitSystem()
    for each in datasets:
        if each.number == _UNITS:
            units = read_units(path, each)
    nodes, doubt = read_nodes(path, datasets)
    carrying = {node: point for node, point in nodes.items() if node in in_use}
    angles = angles_on_circle(carrying)
    if carrying and not angles:
        doubt = "the nodes of the file's geometry are not on a circle; no angles available"
    return Surroundings(units, angles, (remark(path, "", "geometry", doubt),) if doubt else ())


def read_units(path: Path, dataset: Dataset) -> UnitSystem:
    """Factors of dataset 164.

    Raises
    ------
    RecordingFormatError
        If they are missing or not positive.
    """
    lines = Lines(path, dataset)
    lines.text()
    length, force, *_ = lines.numbers((25,) * 3, 2)
    units = UnitSystem(length, force)
    if not units.is_valid:
        found = f"units {length:g} (length) and {force:g} (force)"
        rule = "factors of dataset 164 must be positive"
        raise RecordingFormatError(lines.where, found, rule, COPY_AGAIN)
    return units
