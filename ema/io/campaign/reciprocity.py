"""Roving force: the sensor stays, the force moves. By reciprocity their places are exchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ema.core.campaign import Response, Run
from ema.core.errors import ManifestError
from ema.core.finding import Check, Finding, Verdict
from ema.io.campaign.manifest import MANIFEST_NAME
from ema.io.content import FileContent

_DETAIL = "one sensor, roving force: by reciprocity, the places of the force are used as positions"
ROVING = Finding("", "", None, Check.RECIPROCITY, Verdict.OK, _DETAIL)


def exchanged(runs: Sequence[Run], forces: Sequence[Response]) -> tuple[list[Run], Response] | None:
    """Runs with the place of the force as that of their sensor, and the place of the sensor.

    `forces` are the forces of the runs and their places. None unless these differ and the sensors
    stay; then there has to be one sensor: H(sensor, force) = H(force, sensor).
    """
    places = [_place(force) for force in forces]
    sensors = {tuple(map(_place, run.responses)) for run in runs}
    if None in places or len(set(places)) < 2 or len(sensors) > 1:
        return None
    fixed = runs[0].responses
    if len(fixed) > 1 or _place(fixed[0]) is None:
        found = f"a force at {len(set(places))} places and {len(fixed)} sensors that stay"
        rule = "where the force roves, one sensor takes its place by reciprocity"
        example = "{ FORCE = degrees, SENSOR = degrees }"
        remedy = f"Name one sensor in every run: positions_deg = {example}"
        raise ManifestError(f"{MANIFEST_NAME}, runs", found, rule, remedy)
    moved = [
        replace(
            run,
            responses=(
                replace(run.responses[0], node=force.node, position_deg=force.position_deg),
            ),
            reference=None,
        )
        for run, force in zip(runs, forces, strict=True)
    ]
    return moved, fixed[0]


def _place(response: Response) -> float | None:
    """Angle or node; None where it is unknown (node 0 means no node)."""
    return response.node or None if response.position_deg is None else response.position_deg


def exchanged_frfs(files: Sequence[FileContent]) -> list[FileContent] | None:
    """Files of FRFs, each of one force, with the nodes of the forces as those of the responses.

    None unless the forces differ and the response stays.
    """
    responses = {int(node) for each in files if each.frf is not None for node in each.frf.node}
    forces = {each.frf_force_node for each in files}
    if len(responses) > 1 or len(forces) < 2 or None in forces:
        return None
    return [
        replace(each, frf=replace(each.frf, node=each.frf.node * 0 + each.frf_force_node))
        for each in files
        if each.frf is not None and each.frf_force_node is not None
    ]
