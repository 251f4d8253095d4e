"""Directions: what the ring is identified from, and what was measured across it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ema.core.campaign import Campaign, Direction, Response, Run
from ema.core.errors import ManifestError
from ema.core.finding import Check, Finding, Verdict
from ema.io.campaign.manifest import MANIFEST_NAME
from ema.io.campaign.roles import Wanted


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
    """A campaign of the responses of one direction, whose force acts at one place."""
    usual_deg, grid = campaign.excitation_deg, campaign.has_circle
    places = [usual_deg if each.force_deg is None else each.force_deg % 360 for each, _ in parts]
    if len(set(places)) > 1:
        where, where_deg = parts[-1][0].where, places[-1]
        rule = f"a {force} force must act at one place in all runs, here {places[0]} degrees"
        remedy = "Leave out runs with another place"
        raise ManifestError(f"{where}, excitation.position_deg", str(where_deg), rule, remedy)
    return replace(
        campaign,
        runs=tuple(run for _, run in parts),
        excitation_deg=places[0] if grid else None,
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
