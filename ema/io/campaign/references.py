"""Forces at several places: where each acts, and which FRFs belong to which of them.

Where the force roves and sensors stay, their places are exchanged by reciprocity:
H(sensor, force) = H(force, sensor).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ema.core.campaign import Direction, Response, Run
from ema.core.display import counted
from ema.core.errors import ManifestError, RecordingFormatError
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import FORCE, Channel
from ema.io.campaign.manifest import MANIFEST_NAME, Manifest, RunSection
from ema.io.campaign.roles import Grid, StatedForce, Wanted
from ema.io.content import FileContent

_ROVING = "roving force: by reciprocity, its places are used as positions, those of {} as the force"
_STATE = "State its place in every run: excitation = { position_deg = … }"


def roving(n_sensors: int) -> Finding:
    """The finding about a force that roves and sensors that stay."""
    detail = _ROVING.format(counted(n_sensors, "sensor"))
    return Finding("", "", None, Check.RECIPROCITY, Verdict.OK, detail)


def stated_forces(
    manifest: Manifest, section: RunSection, where: str, names: Sequence[str]
) -> tuple[StatedForce, ...]:
    """Forces of a run with these channels: those that it states, or else all of the campaign."""
    usual, own = manifest.excitations, section.excitations
    if len(usual) == 1:
        if len(own) > 1 and None in [each.channel for each in own]:
            rule, remedy = "each of several forces needs its channel", "Add channel = …"
            raise ManifestError(f"{where}, excitation", "no channel", rule, remedy)
        return tuple(
            StatedForce(each.channel or usual[0].channel, each.position_deg) for each in own
        )
    here = [each for each in usual if each.channel in names]
    if len(own) > 1 or own[0].channel is not None:
        places = {each.channel: each.position_deg for each in usual}
        return tuple(
            StatedForce(
                each.channel,
                places.get(each.channel) if each.position_deg is None else each.position_deg,
            )
            for each in own
        )
    if names and not here:
        listed = ", ".join(str(each.channel) for each in usual)
        rule = f"a run needs one of the forces of [[excitation]], {listed}"
        raise ManifestError(where, f"channels {', '.join(names)}", rule, "Correct a name")
    if own[0].position_deg is not None:
        if len(here) > 1:
            found, rule = "one position_deg", f"{len(here)} forces were recorded in this run"
            remedy = "Name the channel of the force that acted, or list both"
            raise ManifestError(f"{where}, excitation", found, rule, remedy)
        return (StatedForce(here[0].channel if here else None, own[0].position_deg),)
    return tuple(StatedForce(each.channel, each.position_deg) for each in here) or (StatedForce(),)


def at_usual_place(
    runs: Sequence[Run],
    stated: Sequence[Wanted],
    usual_deg: float | None,
    grid: Grid,
    findings: list[Finding],
) -> list[Run]:
    """Runs whose forces act at the one place of the manifest where they have none of their own.

    Files that state several places come first: then that of the manifest was not meant for all.
    """
    if usual_deg is None:
        return list(runs)
    is_open = [
        all(each.position_deg is None for each in wanted.forces)
        and not set(wanted.positions_deg or ()) & {each.channel.name for each in run.forces}
        for run, wanted in zip(runs, stated, strict=True)
    ]
    told = {
        run.forces[0].place
        for run, wanted, free in zip(runs, stated, is_open, strict=True)
        if free and wanted.force_direction == Direction.RADIAL
    } - {None}
    if len(told) > 1:
        findings.append(_not_used(usual_deg, len(told)))
        return list(runs)
    return [
        replace(
            run,
            forces=tuple(
                grid.known_place(each.channel, {each.channel.name: usual_deg})
                for each in run.forces
            ),
        )
        if free
        else run
        for run, free in zip(runs, is_open, strict=True)
    ]


def _not_used(usual_deg: float, n_places: int) -> Finding:
    detail = (
        f"the files state the force at {n_places} places, which are used; not position_deg = "
        f"{usual_deg:g} of the manifest"
    )
    return Finding("", "", None, Check.EXCITATION, Verdict.WARNING, detail)


def check_references(runs: Sequence[Run]) -> None:
    """Refuse forces of which some have a place and others none, or that act partly together."""
    groups = dict.fromkeys(run.references for run in runs)
    if len(groups) < 2 and all(len(set(each)) == len(each) for each in groups):
        if any(len(each) > 1 and None in each for each in groups):
            raise _unknown_place(next(run for run in runs if None in run.references))
        return
    for run in runs:
        if None in run.references:
            raise _unknown_place(run)
        if len(run.references) > 1:
            found = f"{len(run.references)} forces at once, and other places in other runs"
            if len(set(run.references)) < len(run.references):
                found = f"{len(run.references)} forces at one place"
            rule = "forces act one after the other, or in all runs together and at the same places"
            remedy = "Process runs with one force and those with several by themselves"
            raise ManifestError(f"{MANIFEST_NAME}, runs ({run.name})", found, rule, remedy)


def _unknown_place(run: Run) -> ManifestError:
    rule = "where forces act at several places, each place must be known"
    return ManifestError(f"{MANIFEST_NAME}, runs ({run.name})", "a force anywhere", rule, _STATE)


def exchanged(runs: Sequence[Run]) -> list[Run] | None:
    """Runs with the place of the force as that of their sensor, and the other way round.

    A run for each sensor. None unless the forces differ and fewer sensors stay than places.
    """
    forces = {run.references for run in runs}
    sensors = {tuple(each.place for each in run.responses) for run in runs}
    if len(forces) < 2 or len(sensors) > 1 or any(None in each or len(each) > 1 for each in forces):
        return None
    fixed = sensors.pop()
    if None in fixed or len(fixed) >= len(forces):
        return None
    moved = []
    for sensor in range(len(fixed)):
        for run in runs:
            force, response = run.forces[0], run.responses[sensor]
            at_force = replace(response, node=force.node, position_deg=force.position_deg)
            at_sensor = replace(response, channel=run.force)
            moved.append(replace(run, responses=(at_force,), forces=(at_sensor,), reference=None))
    return moved


def exchanged_frfs(files: Sequence[FileContent]) -> list[FileContent] | None:
    """FRFs with the nodes of forces as those of responses, and the other way round.

    None unless the forces differ, at known nodes, and are more than the responses.
    """
    rows = [_ends(each) for each in files]
    responses = {response for each in rows for response, _ in each}
    forces = {force for each in rows for _, force in each}
    if len(forces) < 2 or len(forces) <= len(responses) or any(node == 0 for node, _ in forces):
        return None
    pairs = [ends for each in rows for ends in each]
    if any(node == 0 for node, _ in responses) and len(set(pairs)) < len(pairs):
        return None  # several responses without a node, not one that stays
    found = []
    for content, ends in zip(files, rows, strict=True):
        assert content.frf is not None
        nodes, axes = (
            np.array(each, dtype=int) for each in zip(*(f for _, f in ends), strict=True)
        )
        angles = [content.circle.angle_deg.get(node, np.nan) for node in nodes.tolist()]
        frf = replace(content.frf, node=nodes, axis=axes, position_deg=np.array(angles))
        found.append(replace(content, frf=frf, frf_forces=tuple(r for r, _ in ends)))
    return found


def _ends(content: FileContent) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Node and axis of response and force of each FRF."""
    frf = content.frf
    assert frf is not None
    responses = zip(frf.node.tolist(), frf.axis.tolist(), strict=True)
    forces = content.frf_forces or ((0, 0),) * frf.n_positions
    return list(zip(responses, forces, strict=True))


def of_one_force(content: FileContent) -> list[FileContent]:
    """The FRFs of each force of a file by themselves."""
    frf, names = content.frf, content.frf_names
    if frf is None or len(set(content.frf_forces)) < 2:
        return [content]
    found = []
    for force in dict.fromkeys(content.frf_forces):
        rows = np.array([row for row, each in enumerate(content.frf_forces) if each == force])
        part = replace(content, frf=frf.rows(rows), frf_forces=(force,) * rows.size)
        found.append(replace(part, frf_names=tuple(names[row] for row in rows)))
    return found


def _forces_of(
    files: Sequence[tuple[FileContent, Wanted]],
    positions: int | None,
    usual_deg: float | None,
    findings: list[Finding],
) -> list[Response]:
    """Where the force of each file of FRFs acts, by the manifest or by its node."""
    grid, forces = Grid(positions, True), []
    for content, wanted in files:
        node, stated = content.frf_force_node, wanted.forces[0].position_deg
        channel = Channel(
            *("force", FORCE, "N", np.zeros(0)),
            node=node,
            angle_deg=content.circle.angle_deg.get(node or 0),
            axis=content.frf_force_axis,
        )
        given = None if stated is None else {"force": stated}
        forces.append(grid.known_place(channel, given))
    is_open = [wanted.forces[0].position_deg is None for _, wanted in files]
    told = {each.place for each, free in zip(forces, is_open, strict=True) if free} - {None}
    if usual_deg is None or len(told) > 1:
        findings += [] if usual_deg is None else [_not_used(usual_deg, len(told))]
        return forces
    return [
        grid.known_place(force.channel, {"force": usual_deg}) if free else force
        for force, free in zip(forces, is_open, strict=True)
    ]


def grouped(
    files: Sequence[tuple[FileContent, Wanted]],
    positions: int | None,
    usual_deg: float | None,
    findings: list[Finding],
) -> list[tuple[Response, list[tuple[FileContent, Wanted]]]]:
    """Files of FRFs by the place of their force, in their order.

    `usual_deg` is that of the manifest for all files. `RecordingFormatError` if some places are not
    known, or nothing relates the forces.
    """
    forces = _forces_of(files, positions, usual_deg, findings)
    if positions is not None and len({force.channel.axis for force in forces} - {0}) > 1:
        found, rule = "forces in several directions", "on a circle, all forces must be radial"
        remedy = "Process the FRFs of radial forces by themselves"
        raise RecordingFormatError(files[0][0].path.name, found, rule, remedy)
    places = dict.fromkeys(force.place for force in forces)
    known = [c for (c, _), f in zip(files, forces, strict=True) if f.place is not None]
    unknown = [c for (c, _), f in zip(files, forces, strict=True) if f.place is None]
    repeated = _responses(known) & _responses(unknown)
    if len(set(places) - {None}) < 2 and not repeated:
        return [(forces[0], list(files))]
    if unknown:
        rule = "where FRFs are of several forces, the node of each force must be known"
        remedy = "Export it with the reference node, or state excitation of its run in the manifest"
        raise RecordingFormatError(unknown[0].path.name, "a force anywhere", rule, remedy)
    groups = [
        (
            next(force for force in forces if force.place == place),
            [each for each, force in zip(files, forces, strict=True) if force.place == place],
        )
        for place in places
    ]
    if positions is None:
        _require_related([_nodes(force, each) for force, each in groups], files[0][0].path.name)
    return groups


def _nodes(force: Response, files: Iterable[tuple[FileContent, Wanted]]) -> set[int]:
    return {node for node, _ in _responses([each for each, _ in files])} | {force.node or 0}


def _responses(files: Sequence[FileContent]) -> set[tuple[int, int]]:
    """Node and axis of all responses."""
    return {response for content in files for response, _ in _ends(content)}


def _require_related(nodes: list[set[int]], where: str) -> None:
    """Refuse FRFs of forces of which some have no point in common with any other."""
    reached, rest = set(nodes[0]), nodes[1:]
    while near := [each for each in rest if each & reached]:
        reached = reached.union(*near)
        rest = [each for each in rest if not each & reached]
    if rest:
        found = f"FRFs of {len(nodes)} forces without a point in common"
        rule = "FRFs of several forces must be of one structure, with responses at the same points"
        remedy = "Process the FRFs of each force by themselves"
        raise RecordingFormatError(where, found, rule, remedy)
