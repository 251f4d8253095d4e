"""What a manifest says of channels: calibration, and axes around the circle."""

from __future__ import annotations

import fnmatch
import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Direction
from ema.core.errors import ManifestError, RecordingFormatError, nearest
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import FORCE, UNKNOWN, VOLTAGE, Channel, Recording
from ema.core.units import SI_UNIT, Unit, is_stated, parse_unit
from ema.io.campaign.manifest import MANIFEST_NAME, CalibrationSection
from ema.io.campaign.roles import Wanted
from ema.io.content import FileContent, note, remark
from ema.io.uff.geometry import frame_at

_SENSITIVITY = re.compile(r"^\s*([+-]?[0-9.,]+(?:[eE][+-]?[0-9]+)?)\s*(.+?)\s*$")
_AMBIGUOUS = re.compile(r"^[+-]?[1-9][0-9]{0,2},[0-9]{3}$")  # decimal comma or thousands?
_MECHANICAL = SI_UNIT.keys() - {VOLTAGE}  # quantities
_WRITE = "Give the number and its unit as on the calibration sheet, e.g. '10.2 mV/g'"
LETTERS = "XYZ"
LOCAL = "local"
# Part of another direction in a sensor that counts as radial: 2 degrees, within which it is placed.
_ASKEW = 0.035
_EXACT = 1e-9  # weights nearer to 0 and 1 than this are these
_SHOWN = 6  # names in a message
_UNITS = dict(zip(Direction, np.eye(3), strict=True))  # radial, tangential, axial
REMEDY = (
    f'Add axes to [grid] of {MANIFEST_NAME}: ["X", "Z"] for the axes that point to 0 and to 90 '
    f'degrees, or "{LOCAL}" where they turn with the circle'
)


@dataclass(frozen=True)
class Sensitivity:
    """Quantity that a sensor measures, and its output."""

    quantity: str
    volts_per_si: float  # volts per m/s², N, m/s or m


def parse_sensitivity(text: str) -> Sensitivity | None:
    """Parse e.g. ``"10.2 mV/g"``, ``"2.25 mV/N"``, ``"98 (m/s^2)/V"``; None for other texts."""
    match = _SENSITIVITY.match(text)
    if match is None or _AMBIGUOUS.match(match[1]):
        return None
    try:
        value = float(match[1].replace(",", "."))
    except ValueError:
        return None
    units = _parts(match[2])
    if units is None or not value or not math.isfinite(value):
        return None
    above, below = units
    if above.quantity == VOLTAGE and below.quantity in _MECHANICAL:
        return Sensitivity(below.quantity, value * above.factor / below.factor)
    if below.quantity == VOLTAGE and above.quantity in _MECHANICAL:
        return Sensitivity(above.quantity, below.factor / (value * above.factor))
    return None


def _parts(text: str) -> tuple[Unit, Unit] | None:
    """Units above and below a slash outside of all brackets; mV/m/s^2 means mV/(m/s^2)."""
    for place, sign in enumerate(text):
        if sign == "/" and text.count("(", 0, place) == text.count(")", 0, place):
            above, below = parse_unit(text[:place]), parse_unit(text[place + 1 :])
            if above is not None and below is not None:
                return above, below
    return None


def check_keys(names: Collection[str], place: str, keys: Iterable[str]) -> None:
    """Refuse a key at a place of the manifest that names no channel."""
    for key in keys:
        if key not in names and not fnmatch.filter(names, key):
            where = f"{MANIFEST_NAME}, {place}.{key}"
            rule = "no recording has a channel of that name"
            raise ManifestError(where, repr(key), rule, nearest(key, sorted(names)))


def calibrated(
    recording: Recording, sections: Mapping[str, CalibrationSection], findings: list[Finding]
) -> Recording:
    """Apply ``[calibration]`` of the manifest to all channels that its keys name.

    Keys are names of channels, or patterns such as ``"A*"``; a name has priority.
    """
    channels = []
    for channel in recording.channels:
        fitting = (key for key in sections if fnmatch.fnmatchcase(channel.name, key))
        entry = channel.name if channel.name in sections else next(fitting, None)
        if entry is not None:
            channel = _calibrate(recording, channel, entry, sections[entry], findings)
        channels.append(channel)
    return replace(recording, channels=tuple(channels))


def _calibrate(
    recording: Recording,
    channel: Channel,
    key: str,
    section: CalibrationSection,
    findings: list[Finding],
) -> Channel:
    where = f"{MANIFEST_NAME}, calibration.{key}"
    sign = math.copysign(1.0, channel.scale_to_si)
    if section.unit is not None:
        unit = parse_unit(section.unit)
        if unit is None or unit.quantity == UNKNOWN:
            remedy = "Write e.g. m/s^2, g, mm/s^2, N, kN, lbf, V or mV"
            raise ManifestError(f"{where}.unit", repr(section.unit), "it is not known", remedy)
        if is_stated(channel.unit) and parse_unit(channel.unit) not in (None, unit):
            detail = f"the file states {channel.unit!r}, the manifest {section.unit!r} and decides"
            findings.append(remark(recording.path, channel.name, Check.UNIT, detail))
        channel = replace(
            channel, quantity=unit.quantity, unit=section.unit, scale_to_si=sign * unit.factor
        )
    if section.sensitivity is not None:
        channel = _with_sensitivity(recording, channel, where, section.sensitivity, findings)
    detail = f"{section.sensitivity or section.unit} by the manifest"
    place = recording.path.name, channel.name, None
    findings.append(Finding(*place, Check.CALIBRATION, Verdict.OK, detail))
    return channel


def _with_sensitivity(
    recording: Recording, channel: Channel, where: str, text: str, findings: list[Finding]
) -> Channel:
    sensitivity = parse_sensitivity(text)
    if sensitivity is None:
        rule = "a sensitivity must be volts over m/s^2, g, N or the like"
        raise ManifestError(f"{where}.sensitivity", repr(text), rule, _WRITE)
    if channel.quantity != VOLTAGE and is_stated(channel.unit):
        unit = f"in {channel.unit!r} in {recording.path.name}"
        found = f"a sensitivity for {channel.name!r}, which is {unit}"
        remedy = 'Leave it out, or add unit = "V" if the file\'s unit is wrong'
        raise ManifestError(where, found, "a sensitivity is for a channel in volts", remedy)
    if channel.quantity != VOLTAGE:
        detail = "no unit stated; taken as V, as a sensitivity is given"
        findings.append(remark(recording.path, channel.name, Check.UNIT, detail))
    scale_to_si = channel.scale_to_si / sensitivity.volts_per_si
    return replace(channel, quantity=sensitivity.quantity, scale_to_si=scale_to_si)


_Frame = NDArray[np.float64]


class _Dof(NamedTuple):
    """A sensor or the force: what a row or a channel is a motion of."""

    name: str
    node: int | None
    axis: int  # 1 to 3, 0 where none is stated
    angle_deg: float | None
    quantity: str = ""  # of a channel: what is summed must be alike


class _Sum(NamedTuple):
    """A motion as a sum of sensors at one place."""

    direction: Direction
    members: list[int]
    weights: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Around:
    """What is known of the axes of one file."""

    content: FileContent
    wanted: Wanted
    positions: int
    force_deg: float | None

    def frames(self, dofs: Sequence[_Dof]) -> Callable[[_Dof], _Frame | None] | None:
        """Axes at each sensor in radial, tangential and axial components; None if they are local.

        `RecordingFormatError` if letters change from node to node and nothing says where they
        point.
        """
        stated = [each for each in dofs if each.axis]
        if not stated or self.wanted.directions or self.wanted.axes == LOCAL:
            return None
        if self.wanted.axes is not None:
            plane = np.array([_vector(letter) for letter in self.wanted.axes])
            return lambda dof: (
                None if (at := self._angle(dof)) is None else frame_at(at, plane, np.eye(3))
            )
        letters: dict[object, set[int]] = {}
        for each in stated:
            letters.setdefault(each.angle_deg if each.node is None else each.node, set()).add(
                each.axis
            )
        differ = len(set().union(*letters.values())) > 1
        if differ and all(len(axes) == 1 for axes in letters.values()):
            if all(each.node in self.content.circle.frames for each in stated):
                return self._by_geometry
            found = f"one axis at each node, but not the same ({self._names(stated)})"
            rule = "such axes are the same for all nodes, and where they point must be known"
            raise RecordingFormatError(self.content.path.name, found, rule, REMEDY)
        by_file = all(each.node in self.content.circle.defined for each in stated)
        return self._by_geometry if by_file else None

    def _by_geometry(self, dof: _Dof) -> _Frame | None:
        return None if dof.node is None else self.content.circle.frames.get(dof.node)

    def _angle(self, dof: _Dof) -> float | None:
        if dof.angle_deg is not None or dof.node is None:
            return dof.angle_deg
        if dof.node in self.content.circle.angle_deg:
            return self.content.circle.angle_deg[dof.node]
        return dof.node * 360.0 / self.positions if 0 <= dof.node <= self.positions else None

    @staticmethod
    def _names(dofs: Sequence[_Dof]) -> str:
        shown = ", ".join(f"{each.name} along {LETTERS[each.axis - 1]}" for each in dofs[:_SHOWN])
        return shown + (" …" if len(dofs) > _SHOWN else "")

    def sums(
        self, dofs: Sequence[_Dof], frame: Callable[[_Dof], _Frame | None], findings: list[Finding]
    ) -> list[_Sum]:
        """Motions along the radius, the circle and the axle that follow from the sensors."""
        groups: dict[object, list[int]] = {}
        for row, each in enumerate(dofs):
            if each.axis and frame(each) is not None:
                place = each.node if each.angle_deg is None else round(each.angle_deg, 6)
                groups.setdefault((place, each.quantity), []).append(row)
        found, askew = [], []
        for members in groups.values():
            axes = np.array([_along(frame(dofs[row]), dofs[row].axis) for row in members])
            parts = [(direction, _weights(axes, unit)) for direction, unit in _UNITS.items()]
            known = [_Sum(each, members, given) for each, given in parts if given is not None]
            found += [_used(each) for each in known]
            askew += [] if known else members
        path = self.content.path
        if askew:
            which = self._names([dofs[row] for row in askew])
            detail = f"{which}: neither radial nor tangential there, and no second axis: left out"
            findings.append(remark(path, "", Check.DIRECTION, detail))
        radial = sum(each.direction == Direction.RADIAL for each in found)
        source = "[grid] axes" if self.wanted.axes else "the geometry of the file"
        detail = f"radial motion at {radial} of {len(groups)} places from X, Y, Z by {source}"
        findings.append(note(path, Check.DIRECTION, detail))
        return found

    def sense(
        self, force: _Dof, dofs: Sequence[_Dof], frame: Callable[[_Dof], _Frame | None]
    ) -> float:
        """1 for a force outwards, −1 inwards; an error for another that is known."""
        beside = (each.angle_deg for each in dofs if each.node == force.node is not None)
        at_deg = next(beside, None) if self.force_deg is None else self.force_deg
        force = force._replace(angle_deg=at_deg)
        at = frame(force) if force.axis else None
        if at is None:
            return 1.0
        radial = float(_along(at, force.axis)[0])
        if abs(radial) < np.sqrt(1 - _ASKEW**2):
            found = f"a force along {LETTERS[force.axis - 1]}, of which {abs(radial):.3f} is radial"
            rule = "the ring is identified from a radial force"
            where = f"{self.content.path.name}, {force.name}"
            remedy = f"Correct its direction, or [excitation] position_deg. {REMEDY}"
            raise RecordingFormatError(where, found, rule, remedy)
        return float(np.sign(radial))


def _vector(letter: str) -> NDArray[np.float64]:
    """Unit vector of an axis such as "X" or "-Z"."""
    sign = -1.0 if letter.startswith("-") else 1.0
    return np.asarray(sign * np.eye(3)[LETTERS.index(letter[-1])])


def _along(frame: _Frame | None, axis: int) -> NDArray[np.float64]:
    assert frame is not None
    return np.asarray(frame[axis - 1])


def _weights(axes: NDArray[np.float64], unit: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Weights of sensors along `axes` (one per row) whose sum moves along `unit`."""
    weights = np.linalg.lstsq(axes.T, unit, rcond=_ASKEW)[0]
    if not np.linalg.norm(weights @ axes - unit) < _ASKEW:
        return None
    near = np.rint(weights)
    return np.asarray(np.where(np.abs(weights - near) < _EXACT, near, weights))


def _used(found: _Sum) -> _Sum:
    used = np.flatnonzero(found.weights)
    return found._replace(members=[found.members[k] for k in used], weights=found.weights[used])


def frfs_along_circle(around: Around, findings: list[Finding]) -> FileContent | None:
    """Content with radial FRFs in the place of others; None where axes are local."""
    content, frf = around.content, around.content.frf
    assert frf is not None
    given = around.wanted.positions_deg or {}
    rows = zip(content.frf_names, frf.node.tolist(), frf.axis.tolist(), strict=True)
    dofs = [
        _Dof(name, node or None, axis, given.get(name, None if np.isnan(angle) else float(angle)))
        for (name, node, axis), angle in zip(rows, frf.position_deg, strict=True)
    ]
    frame = around.frames(dofs)
    if frame is None:
        return None
    force = _Dof("force", content.frf_force_node, content.frf_force_axis, None)
    sense = around.sense(force, dofs, frame)
    found = [each for each in around.sums(dofs, frame, findings) if _is_radial(each)]
    if not found:
        rule = "on a circle, radial responses are used"
        raise RecordingFormatError(content.path.name, "no radial response", rule, REMEDY)
    first = np.array([each.members[0] for each in found])
    mix = np.zeros((len(found), len(dofs)))
    for row, each in enumerate(found):
        mix[row, each.members] = sense * each.weights
    alone = np.count_nonzero(mix, axis=1) == 1
    force_node = content.frf_force_node or 0
    frf = replace(
        frf.rows(first),
        values=mix @ frf.values,
        std=np.sqrt(mix**2 @ frf.std**2),
        coherence=np.where(alone[:, None], frf.coherence[first], np.nan),
        axis=np.zeros(len(found), dtype=int),
    )
    names = tuple(_name(dofs, each) for each in found)
    forces = ((force_node, 0),) * len(found)
    return replace(content, frf=frf, frf_names=names, frf_forces=forces)


def _is_radial(found: _Sum) -> bool:
    return found.direction is Direction.RADIAL


def _name(dofs: Sequence[_Dof], found: _Sum) -> str:
    names = " + ".join(dict.fromkeys(dofs[row].name for row in found.members))
    return names if len(found.members) == 1 else f"{names}, {found.direction}"


def channels_along_circle(
    around: Around, findings: list[Finding]
) -> tuple[FileContent, Wanted] | None:
    """Content with radial, tangential and axial channels, and their directions and places.

    None where axes are local, or a recording states none.
    """
    content, wanted, recording = around.content, around.wanted, around.content.recording
    assert recording is not None
    given = wanted.positions_deg or {}
    channels = [each for each in wanted.possible_responses(recording.channels) if each.axis]
    dofs = [
        _Dof(
            *(each.name, each.node, each.axis, given.get(each.name, each.angle_deg)), each.quantity
        )
        for each in channels
    ]
    frame = around.frames(dofs)
    if frame is None:
        return None
    names = {channel.name for channel in channels}
    others = [
        _turned_force(around, channel, dofs, frame)
        for channel in recording.channels
        if channel.name not in names
    ]
    found = around.sums(dofs, frame, findings)
    made = [_sum(channels, _name(dofs, each), each) for each in found]
    angles = {
        channel.name: given[dofs[each.members[0]].name]
        for channel, each in zip(made, found, strict=True)
        if dofs[each.members[0]].name in given
    }
    places = {name: angle for name, angle in given.items() if name not in names} | angles
    directions = {channel.name: each.direction for channel, each in zip(made, found, strict=True)}
    wanted = replace(
        wanted,
        positions_deg=None if wanted.positions_deg is None else places,
        directions={n: each for n, each in directions.items() if each != Direction.RADIAL},
        sums={
            channel.name: tuple(dofs[row].name for row in each.members)
            for channel, each in zip(made, found, strict=True)
        },
    )
    recording = replace(recording, channels=(*others, *made))
    return replace(content, recording=recording), wanted


def _turned_force(
    around: Around, channel: Channel, dofs: Sequence[_Dof], frame: Callable[[_Dof], _Frame | None]
) -> Channel:
    """The force outwards; any other channel as it is."""
    names = around.wanted.force_names
    if not (channel.name in names if names else _is_force(channel)):
        return channel
    stated = {each.channel: each.position_deg for each in around.wanted.forces}
    if (own_deg := stated.get(channel.name, stated.get(None))) is not None:
        around = replace(around, force_deg=own_deg)
    sense = around.sense(_Dof(channel.name, channel.node, channel.axis, None), dofs, frame)
    return replace(channel, scale_to_si=sense * channel.scale_to_si)


def _is_force(channel: Channel) -> bool:
    return channel.quantity == FORCE


def _sum(channels: Sequence[Channel], name: str, found: _Sum) -> Channel:
    """Motion in one direction; what does not come from one channel alone is computed once."""
    first = channels[found.members[0]]
    if len(found.members) == 1:
        scale = float(found.weights[0]) * first.scale_to_si
        return replace(first, name=name, scale_to_si=scale, axis=0)
    samples = np.zeros(first.n_samples)
    for row, weight in zip(found.members, found.weights, strict=True):
        samples += weight * channels[row].block(0, first.n_samples)
    unit = SI_UNIT.get(first.quantity, first.unit)
    samples.setflags(write=False)
    return replace(first, name=name, unit=unit, samples=samples, scale_to_si=1.0, axis=0)
