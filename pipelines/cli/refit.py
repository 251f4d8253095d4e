"""``ringmodal refit``: decisions on a result."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from itertools import chain, count
from pathlib import Path
from typing import Annotated, Any

from ema.core.display import number, signed
from ema.core.edits import OF_CHANNELS, OF_POLES, ChannelName, Edit, EditKind, PoleName
from ema.core.errors import InputError
from ema.refit import EditCost
from pipelines.cli import options as opt
from pipelines.cli.result import show
from pipelines.cli.screen import print_table, shown
from pipelines.cli.streams import reporting_outcome
from pipelines.cli.terminal import echo, print_json
from pipelines.library.version import login_name
from pipelines.process.refit import cost, refittable
from pipelines.process.refit import refit as refitted
from pipelines.report.page import read_template
from pipelines.report.write import save
from pipelines.results.edits_file import Record, read_edits
from pipelines.storage.atomic import require_free

DECISIONS = "Decisions"
_EDITED = r"-edited(-\d+)?$"


def _at(text: str) -> Any:
    return opt.option(text, DECISIONS, "HZ,…")


def _of_channels(text: str) -> Any:
    return opt.option(text, DECISIONS, "NAME[@RUN],…")


def refit(
    result_folder: opt.ResultFolder,
    edits: Annotated[
        Path | None,
        opt.option("Decisions in force, instead of those of the result.", DECISIONS, "FILE"),
    ] = None,
    keep: Annotated[
        list[str] | None, _at("List these modes, whatever the checks say of them.")
    ] = None,
    set_aside: Annotated[list[str] | None, _at("Fit these modes, but do not list them.")] = None,
    channel_out: Annotated[list[str] | None, _of_channels("Leave these FRFs out.")] = None,
    channel_in: Annotated[
        list[str] | None, _of_channels("Use these FRFs, whatever the checks say.")
    ] = None,
    flip: Annotated[list[str] | None, _of_channels("Change the sign of these FRFs.")] = None,
    run_out: Annotated[
        list[str] | None, opt.option("Leave all FRFs of these runs out.", DECISIONS, "RUN,…")
    ] = None,
    reference: Annotated[
        int | None,
        opt.option(
            "Force whose FRFs are meant, from 1. Default: all forces.", DECISIONS, "N", min=1
        ),
    ] = None,
    by: Annotated[
        str, opt.option("Who decides. Default: your login name.", DECISIONS, "NAME")
    ] = "",
    reason: Annotated[str, opt.option("Why; stored with each decision.", DECISIONS, "TEXT")] = "",
    only_try: Annotated[
        bool, opt.flag("--try", "Print what the decisions cost; write nothing.", DECISIONS)
    ] = False,
    out: Annotated[
        Path | None,
        opt.option("New folder. Default: beside DIR, named DIR-edited.", opt.FILES, "DIR"),
    ] = None,
    no_report: opt.NoReport = False,
    force: opt.Force = False,
    accept_changes: opt.AcceptChanges = False,
    template: opt.Template = None,
    units: opt.UnitSystem = None,
    as_json: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Identify the modes of a result again with decisions of yours, from its FRFs.

    Recordings are not needed. Decisions add to those that the result has already. The new result
    holds them as edits.toml, which `ringmodal process CAMPAIGN --edits edits.toml` replays.

    Examples:
      ringmodal refit result --set-aside 78.96 --try
      ringmodal refit result --set-aside 78.96 --reason "no partner at 2.0 bar"
      ringmodal refit result --channel-in A05@config_2.uff --flip A07 --out second
      ringmodal refit result --edits edits.toml
    """  # noqa: D406, D407 - a heading of the help
    asked = {
        EditKind.KEEP: opt.numbers("--keep", keep),
        EditKind.SET_ASIDE: opt.numbers("--set-aside", set_aside),
        EditKind.CHANNEL_OUT: _words(channel_out),
        EditKind.CHANNEL_IN: _words(channel_in),
        EditKind.FLIP: _words(flip),
        EditKind.RUN_OUT: _words(run_out),
    }
    if edits is None and not any(asked.values()):
        rule = "a refit needs a decision"
        raise InputError("refit", "none", rule, "Give --edits, --set-aside, --channel-out …")
    target, looks = out or _beside(result_folder), read_template(template, units)
    with reporting_outcome(target):
        if not only_try:
            require_free(target, force=force)
        with shown(quiet=quiet) as progress:
            result = refittable(result_folder, accept_changes=accept_changes)
            record = Record(result.edits) if edits is None else read_edits(edits)
            added = _made(asked, reference, by, reason)
            # Of a record that was added to, the outcome is another one.
            record = (
                replace(record, edits=(*record.edits, *added), selection=()) if added else record
            )
            if only_try:
                progress.stage("Trying …")
                tried = cost(result, record.edits)
            else:
                again = refitted(result, record, progress=progress.stage)
                progress.stage("Writing the result …")
                save(again, target, report=not no_report, force=force, template=looks)
    if only_try:
        _show_cost(tried, as_json=as_json)
        return
    told: dict[str, Any] = {"as_json": as_json, "quiet": quiet, "units": looks.units}
    show(again, target, report=not no_report, **told)


def _words(texts: Sequence[str] | None) -> tuple[str, ...]:
    parts = chain.from_iterable(text.split(",") for text in texts or ())
    return tuple(part.strip() for part in parts if part.strip())


def _made(
    asked: dict[EditKind, tuple[Any, ...]], reference: int | None, by: str, reason: str
) -> tuple[Edit, ...]:
    """Edits of the command line, all of this moment."""
    if reference is not None and not any(asked[kind] for kind in OF_CHANNELS & asked.keys()):
        rule, remedy = "it says of which force channels are meant", "Give --channel-out, --flip …"
        raise InputError("--reference", "no channel", rule, remedy)
    if not any(asked.values()):
        return ()
    at = datetime.now(UTC).isoformat(timespec="seconds")
    who: dict[str, Any] = {"by": by or login_name("--by"), "at": at, "reason": reason}
    return tuple(
        Edit(kind, **_named(kind, name, reference), **who)
        for kind, names in asked.items()
        for name in names
    )


def _named(kind: EditKind, name: Any, reference: int | None) -> dict[str, Any]:
    if kind in OF_POLES:
        return {"pole": PoleName(name)}
    if kind is EditKind.RUN_OUT:
        return {"run": name}
    channel, _, run = name.rpartition("@") if "@" in name else (name, "", "")
    return {"channel": ChannelName(channel, run or None, reference)}


def _beside(folder: Path) -> Path:
    """A free name beside a result."""
    place = folder.resolve()
    base = f"{re.sub(_EDITED, '', place.name)}-edited"
    names = chain([base], (f"{base}-{k}" for k in count(2)))
    return next(folder.parent / name for name in names if not (place.parent / name).exists())


def _show_cost(tried: EditCost, *, as_json: bool) -> None:
    if as_json:
        shifts = [vars(each) for each in tried.shifts]
        names = ("chi_square_before", "chi_square_after", "misfit_before", "misfit_after", "change")
        print_json({**{name: getattr(tried, name) for name in names}, "shifts": shifts})
        return
    rows = [
        (
            "" if each.order is None else f"{each.order}{each.member}",
            f"{each.frequency_hz:.3f}",
            signed(each.frequency_shift_std, 2),
            signed(each.damping_shift_std, 2),
        )
        for each in tried.shifts
    ]
    print_table("Other modes", ("order", "frequency / Hz", "Δ f / σ", "Δ damping / σ"), rows)
    before, after = number(tried.misfit_before, 4), number(tried.misfit_after, 4)
    echo(f"χ²: {signed(tried.change, 0)}; over its degrees of freedom {before} → {after}")
    echo("Nothing was written.")
