"""Channel roles: force, reference and responses, and the sensor positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ema.core.campaign import Response, Run
from ema.core.errors import InputError, ManifestError, RecordingFormatError, nearest
from ema.core.finding import Finding
from ema.core.recording import ACCELERATION, FORCE, UNKNOWN, VOLTAGE, Channel, Recording
from ema.core.units import SI_UNIT, is_stated
from ema.io.campaign.manifest import MANIFEST_NAME, RunSection
from ema.io.content import remark

_INIT = "Write a manifest that names it; `ringmodal init FOLDER` drafts one"


@dataclass(frozen=True)
class Wanted:
    """What the manifest says about a run; all empty where there is none.

    Parameters
    ----------
    manifest : bool
        Whether there is a manifest.
    force : str or None
        Name of the excitation's channel.
    reference : str or None
        Name of the reference sensor's channel.
    positions_deg : dict or None
        Angles by channel name.
    where : str
        Place of the run in the manifest.
    """

    manifest: bool = False
    force: str | None = None
    reference: str | None = None
    positions_deg: dict[str, float] | None = None
    where: str = ""

    def may_be_response(self, channel: Channel) -> bool:
        """Whether a channel looks like a response: one with a position, or else an acceleration."""
        if channel.name in (self.force, self.reference):
            return False
        if self.positions_deg is not None:
            return channel.name in self.positions_deg
        return channel.quantity == ACCELERATION

    @classmethod
    def from_section(cls, section: RunSection, number: int, force: str | None) -> Wanted:
        """Take what `section`, the `number`-th run of a manifest, asks for."""
        where = f"{MANIFEST_NAME}, runs.{number} ({section.file})"
        return cls(True, force, section.reference, section.positions_deg, where)


def assign(
    recording: Recording, wanted: Wanted, grid: Grid, name: str
) -> tuple[Run, list[Finding]]:
    """Give each channel of a recording its role and place; `name` is that of the run.

    Raises
    ------
    ManifestError
        If the manifest names a channel that is not there or measures something else, or puts
        two responses at one place.
    RecordingFormatError
        If names occur twice, or without a manifest it is not clear which channel is the force.
    """
    _check_names(recording)
    findings: list[Finding] = []
    force = _force(recording, wanted, findings)
    reference = _reference(recording, wanted, force, findings)
    if wanted.positions_deg is not None and grid.positions is None:
        detail = "positions_deg without [grid]: there is no circle, angles are not used"
        findings.append(remark(recording.path, "", "grid", detail))
    taken = {force.name} | ({reference.name} if reference is not None else set())
    chosen = _responses(recording, wanted, taken, findings)
    responses = []
    for channel in chosen:
        place = grid.place(recording.path, channel, wanted.positions_deg, findings)
        responses.append(Response(channel, place.node, place.angle_deg))
    if not responses:
        rule = "a run needs at least one acceleration besides the force and the reference"
        raise _fault(recording, wanted, _list(recording), rule, "Check the units and data types")
    _check_places(recording, wanted, responses)
    return Run(name, recording, force, tuple(responses), reference), findings


def reference_place(run: Run, wanted: Wanted, grid: Grid) -> Place:
    """Place of the reference sensor, as far as manifest or file tell."""
    assert run.reference is not None
    return grid.known_place(run.reference, wanted.positions_deg)


def _fault(recording: Recording, wanted: Wanted, found: str, rule: str, remedy: str) -> InputError:
    if wanted.manifest:
        return ManifestError(wanted.where, found, rule, remedy)
    return RecordingFormatError(recording.path.name, found, rule, remedy)


def _list(recording: Recording) -> str:
    return "channels " + ", ".join(f"{each.name} ({each.quantity})" for each in recording.channels)


def _check_names(recording: Recording) -> None:
    seen: dict[str, int] = {}
    for number, name in enumerate(recording.names, 1):
        if name in seen:
            found = f"channels {seen[name]} and {number} are both called {name!r}"
            rule = "a channel is found by its name, so names occur once in a run"
            remedy = "Rename one of them in the export (UFF: first ID line)"
            raise RecordingFormatError(recording.path.name, found, rule, remedy)
        seen[name] = number


def _named(recording: Recording, name: str, wanted: Wanted, key: str) -> Channel:
    for channel in recording.channels:
        if channel.name == name:
            return channel
    names = ", ".join(recording.names)
    rule = f"{recording.path.name} holds no channel of that name, but {names}"
    taken = {wanted.force, wanted.reference, *(wanted.positions_deg or ())}
    free = [each for each in recording.names if each not in taken] or recording.names
    raise ManifestError(f"{wanted.where}, {key}", repr(name), rule, nearest(name, free))


def _as(
    channel: Channel,
    quantity: str,
    recording: Recording,
    wanted: Wanted,
    findings: list[Finding],
) -> Channel:
    """Take a channel in its role; one without a unit is taken as SI, and that is recorded."""
    if channel.quantity == quantity:
        return channel
    if channel.quantity != UNKNOWN or is_stated(channel.unit):
        unit = f" in {channel.unit!r}" if is_stated(channel.unit) else ""
        found = f"{channel.name!r} measures {channel.quantity}{unit}"
        rule = f"its role needs {quantity} in a known unit"
        remedy = f"Convert it to {SI_UNIT[quantity]}, or choose another channel"
        if channel.quantity == VOLTAGE:
            remedy = (
                f'Add [calibration] to {MANIFEST_NAME}: {channel.name} = {{ sensitivity = "…" }}'
            )
        raise _fault(recording, wanted, found, rule, remedy)
    detail = f"no unit stated; taken as {quantity} in {SI_UNIT[quantity]}"
    findings.append(remark(recording.path, channel.name, "unit", detail))
    return replace(channel, quantity=quantity)


def _force(recording: Recording, wanted: Wanted, findings: list[Finding]) -> Channel:
    if wanted.force is not None:
        named = _named(recording, wanted.force, wanted, "excitation.channel")
        return _as(named, FORCE, recording, wanted, findings)
    forces = [channel for channel in recording.channels if channel.quantity == FORCE]
    if len(forces) == 1:
        return forces[0]
    if forces:
        found = f"{len(forces)} forces: {', '.join(each.name for each in forces)}"
    else:
        found = f"no force among {_list(recording)}"
    rule = "FRFs need exactly one excitation, a force in N"
    remedy = "Set excitation.channel in the manifest" if wanted.manifest else _INIT
    raise _fault(recording, wanted, found, rule, remedy)


def _reference(
    recording: Recording, wanted: Wanted, force: Channel, findings: list[Finding]
) -> Channel | None:
    if wanted.reference is None:
        return None
    named = _named(recording, wanted.reference, wanted, "reference")
    if named.name == force.name:
        rule = "one channel cannot be the reference and the force"
        remedy = f"Name the reference sensor, one of {', '.join(recording.names)}"
        raise ManifestError(f"{wanted.where}, reference", repr(force.name), rule, remedy)
    return _as(named, ACCELERATION, recording, wanted, findings)


def _responses(
    recording: Recording, wanted: Wanted, taken: set[str], findings: list[Finding]
) -> list[Channel]:
    """Channels that are responses: those with a position, or else all accelerations."""
    positions = wanted.positions_deg
    if positions is not None:
        for name in positions:
            _named(recording, name, wanted, "positions_deg")
    chosen = []
    for channel in recording.channels:
        if channel.name in taken:
            continue
        if wanted.may_be_response(channel):
            chosen.append(_as(channel, ACCELERATION, recording, wanted, findings))
        else:
            reason = "no acceleration" if positions is None else "not listed in positions_deg"
            findings.append(remark(recording.path, channel.name, "ignored", reason))
    return chosen


def _check_places(recording: Recording, wanted: Wanted, responses: Sequence[Response]) -> None:
    """Refuse two responses at one place of a run: one of them is mislabelled."""
    seen: dict[float | int | None, str] = {}
    for response in responses:
        angle = response.position_deg
        key = response.node if angle is None else round(angle, 6) % 360.0
        name = response.channel.name
        if key in seen:
            place = f"node {key}" if angle is None else f"{key:g} degrees"
            found = f"{seen[key]!r} and {name!r} are both at {place}"
            rule = "each response of a run has a place of its own"
            raise _fault(recording, wanted, found, rule, "Correct one of the two positions")
        seen[key] = name


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
                detail = f"no node numbers in the files; node {place.node} assumed"
                findings.append(remark(path, channel.name, UNNUMBERED, detail))
            return place
        if place.angle_deg is None:
            node = "no node" if place.node is None else f"node {place.node}"
            found = f"no position of {channel.name!r} ({node}) in {path.name}"
            rule = f"each response needs a position or a node from 0 to {self.positions}"
            remedy = "Add positions_deg = { CHANNEL = degrees, … } to its run"
            raise ManifestError(f"{MANIFEST_NAME}, runs", found, rule, remedy)
        if place.node is None:
            detail = f"{place.angle_deg:g} degrees is none of the {self.positions} grid positions"
            findings.append(remark(path, channel.name, "grid", detail))
        return place
