"""``ringmodal tyre update-tir``, ``from-tir`` and ``modal-targets``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from ema.core.display import DASH, signed
from ema.core.errors import InputError
from pipelines.cli import options as opt
from pipelines.cli.screen import print_table
from pipelines.cli.show_tyre import require_accepted, show_parameters, show_verdict
from pipelines.cli.terminal import echo, echo_error, print_json
from pipelines.export.belt import measured_modes, write_modal_targets
from pipelines.export.tir_file import read_tir, save_tir
from pipelines.export.tir_update import TirChange, TirUpdate, plan_update, ring_from_tir
from pipelines.library.export import export
from pipelines.library.library import resolve
from pipelines.storage.atomic import file_written_whole

VALUES = "Values"
TirArgument = Annotated[Path, opt.argument("FILE", "Tyre property file (.tir).")]
BeltWidth = Annotated[
    float | None,
    opt.option(
        "Width of the belt in m, not of the section. Default: that of the set.", VALUES, "B"
    ),
]


def update_tir(
    file: TirArgument,
    source: Annotated[
        str, opt.option("NAME@VERSION, a result folder or a tyre.toml.", "", "SET", "--from")
    ],
    belt_width_m: BeltWidth = None,
    out: Annotated[
        Path | None, opt.option("File to write. Default: replace FILE.", opt.FILES, "FILE")
    ] = None,
    add: Annotated[bool, opt.flag("--add", "Add keys that are not in the file.", VALUES)] = False,
    yes: Annotated[bool, opt.flag("--yes", "Do not ask before writing.", opt.FILES)] = False,
    dry_run: Annotated[bool, opt.flag("--dry-run", "Show only, write nothing.", opt.FILES)] = False,
    comment: Annotated[
        bool,
        opt.flag("--comment", "Add a comment line: keys, set, version, verdict, date.", VALUES),
    ] = False,
    library: opt.Library = None,
    accept_changes: opt.AcceptChanges = False,
    accept_warnings: opt.AcceptWarnings = False,
    as_json: opt.Json = False,
) -> None:
    """Update a tyre property file (.tir) with a parameter set.

    Changes the values that the ring determines, in the units of the file: BELT_MASS, BELT_IYY,
    FREQ_LONG, FREQ_WINDUP, DAMP_LONG, DAMP_WINDUP and INFLPRES. All other bytes stay. The earlier
    file is kept as FILE.bak, FILE.bak2, … A set whose verdict is not good needs --accept-warnings,
    or a yes where you are asked.

    Examples:
      ringmodal tyre update-tir tyre.tir --from result --dry-run
      ringmodal tyre update-tir tyre.tir --from 225-55R17@3 --library parameters --yes
      ringmodal tyre update-tir tyre.tir --from tyre.toml --belt-width-m 0.19 --out new.tir --yes
    """  # noqa: D406, D407 - a heading of the help
    target = out or file
    tir = read_tir(file)
    found = resolve(source, library, accept_changes=accept_changes)
    named = found.name if comment else ""
    update = plan_update(
        tir,
        found.parameters,
        belt_width_m,
        add=add,
        comment=named,
        accept_warnings=True,  # asked for before anything is written
    )
    if not as_json:
        _show_update(update, found.name)
    show_verdict(found.parameters, doubts_only=as_json)
    written, backup = False, None
    if not dry_run and (update.changes or out is not None):
        require_accepted(found, given=accept_warnings, asks=not as_json)
        if not yes:
            _require_consent(target, asks=not as_json)
        written, backup = True, save_tir(update.after, target)
    if as_json:
        about = {"file": str(target), "written": written, "backup": backup and str(backup)}
        state = found.parameters.basis.state
        print_json({**about, **_update_content(update, found.name, state)})
        return
    if backup is not None:
        echo(f"Kept: {backup}")
    echo(f"Written: {target}" if written else "Nothing was written.")


def from_tir(
    file: TirArgument,
    belt_width_m: BeltWidth = None,
    like: Annotated[
        str | None,
        opt.option(
            "Set with K, D and the belt width, which the file lacks: NAME@VERSION, a result "
            "folder or a tyre.toml.",
            VALUES,
            "SET",
        ),
    ] = None,
    out: Annotated[
        Path | None, opt.option("Write the set to this file, e.g. as TOML.", opt.FILES, "FILE")
    ] = None,
    library: opt.Library = None,
    accept_changes: opt.AcceptChanges = False,
    accept_warnings: opt.AcceptWarnings = False,
    as_json: opt.Json = False,
) -> None:
    """Derive ring parameters from a tyre property file (.tir): mass per area, k_r and k_θ.

    From BELT_MASS, BELT_IYY, FREQ_LONG, FREQ_WINDUP and INFLPRES. K and D are not in the file: they
    are assumed, or taken from --like, whose verdict must be good or accepted where --out is given.

    Examples:
      ringmodal tyre from-tir tyre.tir --belt-width-m 0.19
      ringmodal tyre from-tir tyre.tir --like result --out from_tir.toml
    """  # noqa: D406, D407 - a heading of the help
    known = resolve(like, library, accept_changes=accept_changes) if like else None
    made = ring_from_tir(read_tir(file), belt_width_m, known.parameters if known else None)
    parameters = made.parameters
    if known is not None:
        show_verdict(known.parameters, doubts_only=True)
    if out is not None:
        if known is not None:
            require_accepted(known, given=accept_warnings, asks=not as_json)
        export(parameters, out)
    if as_json:
        ring = {name: {"value": p.value, "how": p.how} for name, p in parameters.ring.items()}
        about = {"file": out and str(out), "designation": parameters.designation}
        content = {"conditions": parameters.conditions, "ring": ring, "notes": made.notes}
        print_json({**about, **content})
        return
    show_parameters(parameters)
    for note in made.notes:
        echo_error(f"Note: {note}")
    if out is not None:
        echo(f"Written: {out}")


def modal_targets(
    source: Annotated[str, opt.AnySet],
    out: Annotated[Path, opt.option("Text file to write.", opt.FILES, "FILE")],
    library: opt.Library = None,
    accept_changes: opt.AcceptChanges = False,
    accept_warnings: opt.AcceptWarnings = False,
    as_json: opt.Json = False,
) -> None:
    """Write modal targets for an FTire-style parameter fit.

    In-plane rotation, translation and the first two bendings of the belt, with frequencies and
    damping ratios of the ring; if SET is a result folder, with the measured ones as well. A set
    whose verdict is not good needs --accept-warnings, or a yes where you are asked.

    Examples:
      ringmodal tyre modal-targets result --out targets.txt
      ringmodal tyre modal-targets 225-55R17@3 --library parameters --out targets.txt
    """  # noqa: D406, D407 - a heading of the help
    found = resolve(source, library, accept_changes=accept_changes)
    show_verdict(found.parameters, doubts_only=True)
    require_accepted(found, given=accept_warnings, asks=not as_json)
    measured = measured_modes(Path(source))
    with file_written_whole(out) as partial:
        targets = write_modal_targets(found.parameters, partial, measured)
    if as_json:
        print_json({"file": str(out), "targets": [vars(target) for target in targets]})
    else:
        echo(f"Written: {out}")


def _require_consent(target: Path, *, asks: bool) -> None:
    """Ask before an existing file is replaced; a no ends the command."""
    if not target.exists():
        return
    if not (asks and sys.stdin.isatty()):
        remedy = "Use --yes in scripts, or --dry-run to write nothing"
        raise InputError(str(target), "no --yes", "confirmation required", remedy)
    if not typer.confirm(f"Write {target}?"):
        echo("Nothing was written.")
        raise typer.Exit


def _show_update(update: TirUpdate, source: str) -> None:
    """Print old and new values in the file's units, what stays, and why."""
    echo(f"{update.before.name} from {source}:")
    if update.changes:
        head = ("key", "line", "old", "new", "±", "in %", "unit", "from")
        rows = map(_cells, update.changes)
        print_table("", head, rows, texts=("key", "unit", "from"), folding=("from",))
    if update.unchanged:
        echo(f"Up to date: {', '.join(update.unchanged)}")
    if update.missing:
        echo(f"Not in the file: {', '.join(update.missing)}; use --add to add them")
    for key, reason in update.open_ones.items():
        echo(f"Not determined: {key}: {reason}")
    for reason, keys in update.left_alone.items():
        echo(f"Left alone: {', '.join(keys)}: {reason}")
    for note in update.notes:
        echo_error(f"Note: {note}")


def _cells(change: TirChange) -> tuple[str, ...]:
    def shown(value: float | None, digits: int = 6) -> str:
        return DASH if value is None else f"{value:.{digits}g}"

    percent = DASH if change.percent is None else signed(change.percent, 1)
    numbers = (shown(change.old), change.text, shown(change.std, 2), percent)
    return (change.key, str(change.line or "new"), *numbers, change.unit, change.basis)


def _update_content(update: TirUpdate, source: str, state: str | None) -> dict[str, Any]:
    """Content of ``--json``."""
    return {
        "source": source,
        "verdict": state,
        "changes": [_change_content(change) for change in update.changes],
        "unchanged": update.unchanged,
        "missing": update.missing,
        "not_determined": dict(update.open_ones),
        "left_alone": {key: why for why, keys in update.left_alone.items() for key in keys},
        "notes": update.notes,
    }


def _change_content(change: TirChange) -> dict[str, Any]:
    names = ("key", "section", "line", "old", "new", "text", "std", "percent", "unit")
    content = {name: getattr(change, name) for name in names}
    return {**content, "from": change.basis, "not_identified": change.doubts}
