"""What the other datasets of a universal file say about its functions and shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ema.errors import RecordingFormatError
from ema.io.content import remark
from ema.io.geometry import angles_on_circle
from ema.io.uff_geometry import read_nodes
from ema.io.uff_scan import COPY_AGAIN, Dataset
from ema.io.uff_text import Lines
from ema.io.uff_units import UnitSystem
from ema.quality import Finding

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
        doubt = "the nodes of the file's geometry lie on no circle; it gives no angles"
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
        rule = "factors of dataset 164 are positive numbers"
        raise RecordingFormatError(lines.where, found, rule, COPY_AGAIN)
    return units
