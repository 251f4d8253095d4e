"""Roles and directions of channels: forces, reference and responses, and the sensor positions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np

from ema.core.campaign import Campaign, Direction, Response, Run
from ema.core.errors import InputError, ManifestError, RecordingFormatError, nearest
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import (
    ACCELERATION,
    DERIVATIVES,
    FORCE,
    UNKNOWN,
    VOLTAGE,
    Channel,
    Recording,
    motions,
)
from ema.core.units import SI_UNIT, is_stated, unit_in_name
from ema.io.campaign.manifest import MANIFEST_NAME
from ema.io.content import remark

_INIT = "Write a manifest that names it; `ringmodal init FOLDER` writes a template"
_ON_GRID = 1e-3  # of a grid step
_SHOWN = 6  # angles in a message


@dataclass(frozen=True)
class StatedForce:
    """A force of a run as the manifest states it."""

    channel: str | None = None  # None: the only force of the recording
    position_deg: float | None = None  # None: that of the campaign, or of the file


@dataclass(frozen=True)
class Wanted:
    """What the manifest states about a run; all empty without a manifest."""

    where: str = ""  # place of the run in the manifest; empty without one
    forces: tuple[StatedForce, ...] = (StatedForce(),)  # several that act at the same time
    reference: str | None = None  # name of the channel of the reference sensor
    positions_deg: dict[str, float] | None = None  # angles by name of the channel
    directions: dict[str, Direction] = field(default_factory=dict)  # of channels not radial
    force_direction: Direction = Direction.RADIAL
    axes: tuple[str, str] | Literal["local"] | None = None  # global ones at 0 and 90 degrees
    sums: dict[str, tuple[str, ...]] = field(default_factory=dict)  # channels in those added up

    @property
    def force_names(self) -> set[str]:
        """Channels of the forces, as far as they are stated."""
        return {each.channel for each in self.forces if each.channel is not None}

    def possible_responses(self, channels: Sequence[Channel]) -> list[Channel]:
        """Channels that may be responses: those with a position, or else all of one quantity."""
        free = [each for each in channels if each.name not in {*self.force_names, self.reference}]
        if self.positions_deg is not None:
            return [each for each in free if each.name in self.positions_deg]
        return motions(free)


def assign(
    recording: Recording, wanted: Wanted, grid: Grid, name: str, findings: list[Finding]
) -> Run:
    """Give each channel of a recording its role and place; `name` is that of the run."""
    roles = _Roles(recording, wanted, findings)
    roles.check_names()
    forces = roles.forces()
    reference = roles.reference({each.name for each in forces})
    if wanted.positions_deg is not None and grid.positions is None:
        roles.note("", Check.GRID, "positions_deg without [grid]: no circle, angles not used")
    taken = {each.name for each in (*forces, *([reference] if reference is not None else []))}
    responses = [
        replace(
            grid.place(recording.path, channel, wanted.positions_deg, findings),
            direction=wanted.directions.get(channel.name, Direction.RADIAL),
        )
        for channel in roles.responses(taken, on_circle=grid.positions is not None)
    ]
    roles.check_places(responses)
    roles.check_directions(reference)
    radial = tuple(each for each in responses if each.direction == Direction.RADIAL)
    others = tuple(each for each in responses if each.direction != Direction.RADIAL)
    given = {
        force.name: stated.position_deg for force, stated in zip(forces, wanted.forces, strict=True)
    }
    angles = {each: angle for each, angle in given.items() if angle is not None}
    angles |= wanted.positions_deg or {}
    places = tuple(grid.known_place(force, angles) for force in forces)
    return Run(name, recording, forces[0], radial, reference, others, places)


def ring_runs(runs: Sequence[Run], stated: Sequence[Wanted], findings: list[Finding]) -> list[Run]:
    """Runs of radial responses to a radial force; what is left out is added to `findings`."""
    kept = []
    for run, wanted in zip(runs, stated, strict=True):
        findings += _left_out(run, wanted.force_direction)
        if wanted.force_direction == Direction.RADIAL and run.responses:
            kept.append(run)
    if not kept:
        found, rule = "no radial response to a radial force", "the ring is identified from these"
        remedy = "Add runs with radial sensors and force, or correct directions"
        raise ManifestError(f"{MANIFEST_NAME}, runs", found, rule, remedy)
    return kept


def _left_out(run: Run, force: Direction) -> Iterator[Finding]:
    """Responses that are evaluated nowhere, and those that are not of the ring."""
    for each in run.responses if force != Direction.RADIAL else ():
        where = run.name, each.channel.name, each.position_deg
        detail = f"radial response to a {force} force: not evaluated"
        yield Finding(*where, Check.IGNORED, Verdict.OK, detail)
    for each in run.others:
        where = run.name, each.channel.name, each.position_deg
        detail = f"{each.direction} response: kept out of the ring"
        yield Finding(*where, Check.DIRECTION, Verdict.OK, detail)


def by_direction(
    campaign: Campaign, runs: Sequence[Run], stated: Sequence[Wanted]
) -> tuple[Campaign, ...]:
    """What was measured in each other direction, if possible with a force in that direction.

    A radial force hardly excites torsion and axial modes.
    """
    found = []
    for direction in (Direction.TANGENTIAL, Direction.AXIAL):
        parts = [
            (wanted, _evaluated(run, direction))
            for run, wanted in zip(runs, stated, strict=True)
            if any(each.direction == direction for each in run.others)
        ]
        for force in (direction, Direction.RADIAL):
            chosen = [(wanted, run) for wanted, run in parts if wanted.force_direction == force]
            if chosen:
                found.append(_campaign(campaign, chosen, direction, force))
                break
    return tuple(found)


def _campaign(
    campaign: Campaign, parts: Sequence[tuple[Wanted, Run]], direction: Direction, force: Direction
) -> Campaign:
    """A campaign of the responses of one direction to a force at one place.

    Of radial forces at several places, the first one is enough for what it hardly excites.
    """
    places = [run.references for _, run in parts]
    kept = [run for (_, run), place in zip(parts, places, strict=True) if place == places[0]]
    if len(kept) < len(parts) and force != Direction.RADIAL:
        wanted, run = next(
            each for each, place in zip(parts, places, strict=True) if place != places[0]
        )
        found = f"{run.forces[0].position_deg} degrees"
        rule = f"a {force} force must act at one place in all runs"
        remedy = "Leave out runs with another place"
        raise ManifestError(f"{wanted.where}, excitation.position_deg", found, rule, remedy)
    return replace(
        campaign,
        runs=tuple(kept),
        excitation_deg=kept[0].forces[0].position_deg,
        direction=direction,
        force_direction=force,
    )


def _evaluated(run: Run, direction: Direction) -> Run:
    """A run with the responses of one direction; all others only have a mass."""
    fixed = [] if run.reference is None else [Response(run.reference, None, None)]
    sensors = (*run.responses, *run.others, *fixed)
    return replace(
        run,
        responses=tuple(each for each in sensors if each.direction == direction),
        others=tuple(each for each in sensors if each.direction != direction),
        reference=None,
    )


@dataclass(frozen=True)
class _Roles:
    """The channels of a recording, and what was assumed to give them their roles."""

    recording: Recording
    wanted: Wanted
    findings: list[Finding]

    def note(self, channel: str, check: Check, detail: str) -> None:
        self.findings.append(remark(self.recording.path, channel, check, detail))

    def fault(self, found: str, rule: str, remedy: str) -> InputError:
        if self.wanted.where:
            return ManifestError(self.wanted.where, found, rule, remedy)
        return RecordingFormatError(self.recording.path.name, found, rule, remedy)

    @property
    def _listed(self) -> str:
        names = (f"{each.name} ({each.quantity})" for each in self.recording.channels)
        return f"channels {', '.join(names)}"

    def check_names(self) -> None:
        seen: dict[str, int] = {}
        for number, name in enumerate(self.recording.names, 1):
            if (first := seen.setdefault(name, number)) < number:
                found = f"channels {first} and {number} are both called {name!r}"
                rule = "a channel is found by its name, which must be unique in a run"
                remedy = "Rename one of them in the export (UFF: first ID line)"
                raise RecordingFormatError(self.recording.path.name, found, rule, remedy)

    def _named(self, name: str, key: str) -> Channel:
        for channel in self.recording.channels:
            if channel.name == name:
                return channel
        names, wanted = self.recording.names, self.wanted
        rule = f"{self.recording.path.name} has no such channel, but {', '.join(names)}"
        taken = {*wanted.force_names, wanted.reference, *(wanted.positions_deg or ())}
        free = [each for each in names if each not in taken] or names
        raise ManifestError(f"{wanted.where}, {key}", repr(name), rule, nearest(name, free))

    def _as(self, channel: Channel, quantity: str) -> Channel:
        """A channel in its role; one without a unit is taken as SI with a finding."""
        if channel.quantity == quantity:
            return channel
        if quantity == ACCELERATION and channel.quantity in DERIVATIVES:
            detail = f"{channel.quantity}, converted to acceleration in the spectra"
            place = self.recording.path.name, channel.name, channel.angle_deg
            self.findings.append(Finding(*place, Check.QUANTITY, Verdict.OK, detail))
            return channel
        if channel.quantity != UNKNOWN or is_stated(channel.unit):
            unit = f" in {channel.unit!r}" if is_stated(channel.unit) else ""
            remedy = f"Convert it to {SI_UNIT[quantity]}, or choose another channel"
            if channel.quantity == VOLTAGE:
                entry = f'{channel.name} = {{ sensitivity = "…" }}'
                remedy = f"Add [calibration] to {MANIFEST_NAME}: {entry}"
            found = f"{channel.name!r} measures {channel.quantity}{unit}"
            raise self.fault(found, f"its role needs {quantity} in a known unit", remedy)
        detail = f"no unit stated; taken as {quantity} in {SI_UNIT[quantity]}"
        if text := unit_in_name(channel.name, guess=True):
            detail += f", though its name ends in {text!r}"
        self.note(channel.name, Check.UNIT, detail)
        return replace(channel, quantity=quantity)

    def forces(self) -> list[Channel]:
        stated = [each.channel for each in self.wanted.forces if each.channel is not None]
        if stated:
            return [self._as(self._named(each, "excitation.channel"), FORCE) for each in stated]
        forces = [channel for channel in self.recording.channels if channel.quantity == FORCE]
        if len(forces) == 1:
            return forces
        found = f"no force among {self._listed}"
        if forces:
            found = f"{len(forces)} forces: {', '.join(each.name for each in forces)}"
        remedy = "Set excitation.channel in the manifest, or [[excitation]] for each force"
        rule = "which force in N acts must be known"
        raise self.fault(found, rule, remedy if self.wanted.where else _INIT)

    def reference(self, forces: set[str]) -> Channel | None:
        if self.wanted.reference is None:
            return None
        named = self._named(self.wanted.reference, "reference")
        if named.name in forces:
            where, rule = self.wanted.where, "one channel cannot be the reference and the force"
            remedy = f"Name the reference sensor, one of {', '.join(self.recording.names)}"
            raise ManifestError(f"{where}, reference", repr(named.name), rule, remedy)
        return self._as(named, ACCELERATION)

    def _along_force(self, responses: list[Channel]) -> list[Channel]:
        """Those in the direction of the force, where a node was measured in several directions."""
        places = {(channel.node, channel.axis) for channel in responses}
        if len({node for node, _ in places}) == len(places) or self.wanted.directions:
            return responses
        axis = self.forces()[0].axis
        kept = [channel for channel in responses if channel.axis == axis]
        names = ", ".join(channel.name for channel in responses if channel.axis != axis)
        if not kept:
            rule = "where nodes have several sensors, those in the direction of the force are used"
            remedy = "State the directions of channels in the manifest, or that of the force in UFF"
            raise self.fault(
                f"no response in the direction of the force, but {names}", rule, remedy
            )
        place = self.recording.path.name, "", None
        detail = f"{names}: not in the direction of the force, left out"
        self.findings.append(Finding(*place, Check.DIRECTION, Verdict.OK, detail))
        return kept

    def responses(self, taken: set[str], *, on_circle: bool) -> list[Channel]:
        """Channels that are responses, and a finding for each of the others."""
        positions = self.wanted.positions_deg
        for name in positions or ():
            self._named(name, "positions_deg")
        possible = self.wanted.possible_responses(self.recording.channels)
        chosen = []
        for channel in self.recording.channels:
            if channel.name in taken:
                continue
            if channel in possible:
                chosen.append(self._as(channel, ACCELERATION))
            else:
                motion = possible[0].quantity if possible else ACCELERATION
                reason = f"not {motion}" if positions is None else "not in positions_deg"
                self.note(channel.name, Check.IGNORED, reason)
        if positions is None and on_circle:
            chosen = self._along_force(chosen)
        if not chosen:
            rule = "a run needs at least one response (a motion) besides force and reference"
            raise self.fault(self._listed, rule, "Check the units and data types")
        return chosen

    def check_places(self, responses: Sequence[Response]) -> None:
        """Refuse two responses at one place of a run: one of them is mislabelled."""
        seen: dict[tuple[Direction, float | int | None], str] = {}
        for response in responses:
            angle = response.position_deg
            place = response.node if angle is None else round(angle, 6) % 360.0
            key = response.direction, place
            name = response.channel.name
            if key in seen:
                where = f"node {place}" if angle is None else f"{place:g} degrees"
                found = f"{seen[key]!r} and {name!r} are both at {where}"
                rule = "each response of a run must have a different place"
                remedy = "Correct one of the two positions, or state directions"
                raise self.fault(found, rule, remedy)
            seen[key] = name

    def check_directions(self, reference: Channel | None) -> None:
        """Refuse directions of channels that are not there, and a reference that is not radial."""
        for name, direction in self.wanted.directions.items():
            self._named(name, "directions")
            if reference is not None and reference.name == name and direction != Direction.RADIAL:
                rule = "the fixed reference sensor must be radial"
                remedy = "Name a radial sensor as the reference"
                raise self.fault(f"{name!r} is {direction}", rule, remedy)


@dataclass(frozen=True)
class Grid:
    """Positions of the nodes."""

    positions: int | None  # on the circle; None for any structure
    nodes_are_set: bool  # whether files number their nodes; node 0 everywhere means no
    numbers: dict[str, int] = field(default_factory=dict)  # given by name where files have none

    @classmethod
    def over(cls, positions: int | None, channels: Sequence[Channel]) -> Grid:
        """Grid for all responses, whose names are numbered in order where files have no nodes."""
        if any(channel.node for channel in channels):
            return cls(positions, True)
        names = dict.fromkeys(channel.name for channel in channels)
        return cls(positions, False, {name: number for number, name in enumerate(names, 1)})

    def known_place(self, channel: Channel, positions_deg: dict[str, float] | None) -> Response:
        """Place of a channel by the manifest, the geometry in the file, or its node on the grid.

        Nodes may be counted from 0 or from 1: the last one then meets node 0.
        """
        node = channel.node if self.nodes_are_set else None
        if self.positions is None:
            node = self.numbers.get(channel.name) if node is None else node
            return Response(channel, node, None)
        angle = (positions_deg or {}).get(channel.name, channel.angle_deg)
        if angle is None:
            if node is None or not 0 <= node <= self.positions:
                return Response(channel, node, None)
            angle = node * 360.0 / self.positions
        angle = angle % 360.0
        steps = angle * self.positions / 360.0
        if abs(steps - round(steps)) > _ON_GRID:
            return Response(channel, None, angle)
        return Response(channel, round(steps) % self.positions, angle)

    def place(
        self,
        path: Path,
        channel: Channel,
        positions_deg: dict[str, float] | None,
        findings: list[Finding],
    ) -> Response:
        """Place of a response, which must be known; assumptions are added to `findings`."""
        place = self.known_place(channel, positions_deg)
        if self.positions is None:
            if not self.nodes_are_set:
                detail = f"no node numbers in the files; node {place.node} assumed"
                findings.append(remark(path, channel.name, Check.NODE, detail))
            return place
        if place.position_deg is None:
            node = "no node" if place.node is None else f"node {place.node}"
            found = f"no position of {channel.name!r} ({node}) in {path.name}"
            rule = f"each response needs a position or a node from 0 to {self.positions}"
            remedy = "Add positions_deg = { CHANNEL = degrees, … } to its run"
            raise ManifestError(f"{MANIFEST_NAME}, runs", found, rule, remedy)
        return place

    def off_grid(self, places: Sequence[Response]) -> list[Finding]:
        """One finding about all angles that are none of the grid positions."""
        angles = {round(each.position_deg, 6) for each in places if each.position_deg is not None}
        off = angles - {
            round(each.position_deg or 0.0, 6) for each in places if each.node is not None
        }
        if self.positions is None or not off:
            return []
        shown = ", ".join(f"{angle:g}" for angle in sorted(off)[:_SHOWN])
        more = " …" if len(off) > _SHOWN else ""
        detail = f"{shown}{more} degrees: none of the {self.positions} grid positions"
        turns = np.array(sorted(angles)) / 360.0
        for positions in range(3, 2 * self.positions):
            steps = turns * positions
            if np.all(np.abs(steps - np.rint(steps)) < _ON_GRID):
                detail += f"; all angles are on {positions}: positions = {positions}?"
                break
        return [Finding("", "", None, Check.GRID, Verdict.WARNING, detail)]
