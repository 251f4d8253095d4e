"""Which channel of a recording is the force, which the reference, and where the others sit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ema.errors import InputError, ManifestError, RecordingFormatError
from ema.io.content import remark
from ema.io.manifest import MANIFEST_NAME, RunSection, nearest
from ema.io.positions import Grid, Place
from ema.io.units import SI_UNIT, is_stated
from ema.quality import Finding
from ema.recording import ACCELERATION, FORCE, UNKNOWN, VOLTAGE, Channel, Recording, Response, Run

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
        rule = "a run has at least one acceleration besides the force and the reference"
        raise _fault(recording, wanted, _list(recording), rule, "Check units and types of data")
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
    rule = "FRFs need exactly one excitation, known as a force in N"
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
            raise _fault(recording, wanted, found, rule, "Correct one of the two places")
        seen[key] = name
