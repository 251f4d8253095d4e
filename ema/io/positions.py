"""Places of sensors: angles on the grid, or nodes of any structure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ema.errors import ManifestError
from ema.io.content import remark
from ema.io.manifest import MANIFEST_NAME
from ema.quality import Finding
from ema.recording import Channel

_ON_GRID = 1e-3  # of a grid step


#: Check under which it is remarked that neither file nor manifest says where a sensor sat.
UNNUMBERED = "node"


@dataclass(frozen=True)
class Place:
    """Node and angle of a sensor, each as far as it is known."""

    node: int | None = None
    angle_deg: float | None = None


@dataclass(frozen=True)
class Grid:
    """Where nodes lie.

    Parameters
    ----------
    positions : int or None
        Number of positions on the circle; None for any structure.
    nodes_are_set : bool
        Whether the files number their nodes; node 0 everywhere means that they do not.
    numbers : dict
        Node numbers given by name in order of appearance, where files have none.
    """

    positions: int | None
    nodes_are_set: bool
    numbers: dict[str, int] = field(default_factory=dict)

    @classmethod
    def over(cls, positions: int | None, channels: Sequence[Channel]) -> Grid:
        """Look at the nodes of all responses, and number their names where there are none."""
        if any(channel.node for channel in channels):
            return cls(positions, True)
        names = dict.fromkeys(channel.name for channel in channels)
        numbers = {name: number for number, name in enumerate(names, 1)}
        return cls(positions, False, numbers)

    def angle_of(self, node: int | None) -> float | None:
        """Angle of node k, k·360/positions, in degrees; None for a node that is not on the grid.

        Nodes may be counted from 0 or from 1: the last one then meets node 0.
        """
        if node is None or self.positions is None or not 0 <= node <= self.positions:
            return None
        return (node % self.positions) * 360.0 / self.positions

    def known_place(self, channel: Channel, positions_deg: dict[str, float] | None) -> Place:
        """Place of a channel: the manifest's angle, the file's geometry, its node on the grid."""
        node = channel.node if self.nodes_are_set else None
        if self.positions is None:
            return Place(self.numbers.get(channel.name) if node is None else node)
        angle = (positions_deg or {}).get(channel.name, channel.angle_deg)
        if angle is None and (angle := self.angle_of(node)) is None:
            return Place(node)
        angle = angle % 360.0
        steps = angle * self.positions / 360.0
        if abs(steps - round(steps)) > _ON_GRID:
            return Place(None, angle)
        return Place(round(steps) % self.positions, angle)

    def place(
        self,
        path: Path,
        channel: Channel,
        positions_deg: dict[str, float] | None,
        findings: list[Finding],
    ) -> Place:
        """Place of a response, which has to be known; what was assumed goes to `findings`.

        Raises
        ------
        ManifestError
            If there is a grid and neither manifest nor file say where on it.
        """
        place = self.known_place(channel, positions_deg)
        if self.positions is None:
            if not self.nodes_are_set:
                detail = f"no node numbers in the files; taken as node {place.node}"
                findings.append(remark(path, channel.name, UNNUMBERED, detail))
            return place
        if place.angle_deg is None:
            node = "no node" if place.node is None else f"node {place.node}"
            found = f"no position of {channel.name!r} ({node}) in {path.name}"
            rule = f"each response has a position or a node from 0 to {self.positions}"
            remedy = "Add positions_deg = { CHANNEL = degrees, … } to its run"
            raise ManifestError(f"{MANIFEST_NAME}, runs", found, rule, remedy)
        if place.node is None:
            detail = f"{place.angle_deg:g} degrees is none of the {self.positions} grid positions"
            findings.append(remark(path, channel.name, "grid", detail))
        return place
