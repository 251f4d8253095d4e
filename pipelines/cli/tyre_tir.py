"""The command line's ``ringmodal tyre update-tir``, ``from-tir`` and ``modal-targets``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ema.core.errors import InputError
from pipelines.cli import show_tyre, terminal
from pipelines.cli.options import FILES, AcceptChanges, AnySet, Json, Library
from pipelines.export.belt import measured_modes, write_modal_targets
from pipelines.export.tir_file import read_tir, save_tir
from pipelines.export.tir_update import plan_update, ring_from_tir
from pipelines.library.export import export
from pipelines.library.library import resolve
from pipelines.storage.atomic import file_written_whole

if TYPE_CHECKING:
    from pipelines.export.tir_update import TirUpdate

VALUES = "Values"

TirArgument = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="Tyre property file (.tir).", show_default=False),
]
BeltWidth = Annotated[
    float | None,
    typer.Option(
        "--belt-width-m",
        metavar="B",
        rich_help_panel=VALUES,
        help="Width of the belt in m, not that of the section. Default: that of the set.",
    ),
]


def update_tir(
    file: TirArgument,
    source: Annotated[
        str,
        typer.Option("--from", metavar="SET", help="NAME@VERSION, a result folder or a tyre.toml."),
    ],
    belt_width_m: BeltWidth = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE", rich_help_panel=FILES, help="Write there. Default: in place."
        ),
    ] = None,
    add: Annotated[
        bool,
        typer.Option("--add", rich_help_panel=VALUES, help="Add keys that are not in the file."),
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", rich_help_panel=FILES, help="Do not ask before writing.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", rich_help_panel=FILES, help="Show only, write nothing.")
    ] = False,
    library: Library = None,
    accept_changes: AcceptChanges = False,
    as_json: Json = False,
) -> None:
    """Bring a tyre property file (.tir) up to date with a parameter set.

    Changes the values that the ring determines, in the units of the file: BELT_MASS, BELT_IYY,
    FREQ_LONG, FREQ_WINDUP, DAMP_LONG, DAMP_WINDUP and INFLPRES. Every other byte stays. What stood
    there is kept as FILE.bak, FILE.bak2, …

    Examples:
      ringmodal tyre update-tir tyre.tir --from result --dry-run
      ringmodal tyre update-tir tyre.tir --from 225-55R17@3 --library parameters --yes
      ringmodal tyre update-tir tyre.tir --from tyre.toml --belt-width-m 0.19 --out new.tir --yes
    """  # noqa: D406, D407 - a heading of the help
    target = out or file
    tir = read_tir(file)
    found = resolve(source, library, accept_changes=accept_changes)
    update = plan_update(tir, found.parameters, belt_width_m, add=add)
    if not as_json:
        show_tyre.show_update(update, found.name)
    written, backup = False, None
    if not dry_run and (update.changes or out is not None):
        if not yes:
            _require_consent(target, asks=not as_json)
        written, backup = True, _save(update, target)
    if as_json:
        told = {"file": str(target), "written": written, "backup": backup and str(backup)}
        terminal.print_json({**told, **show_tyre.update_content(update, found.name)})
        return
    if backup is not None:
        terminal.say(f"Kept: {backup}")
    terminal.say(f"Written: {target}" if written else "Nothing was written.")


def from_tir(
    file: TirArgument,
    belt_width_m: BeltWidth = None,
    like: Annotated[
        str | None,
        typer.Option(
            metavar="SET",
            rich_help_panel=VALUES,
            help="Set that gives K, D and the belt width, which such a file does not hold: "
            "NAME@VERSION, a result folder or a tyre.toml.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            rich_help_panel=FILES,
            help="Write the set there, e.g. as TOML.",
        ),
    ] = None,
    library: Library = None,
    accept_changes: AcceptChanges = False,
    as_json: Json = False,
) -> None:
    """Find the ring in a tyre property file (.tir): mass per area, k_r and k_θ.

    From BELT_MASS, BELT_IYY, FREQ_LONG, FREQ_WINDUP and INFLPRES. K and D are not in such a file:
    they are assumed, or taken from --like.

    Examples:
      ringmodal tyre from-tir tyre.tir --belt-width-m 0.19
      ringmodal tyre from-tir tyre.tir --like result --out from_tir.toml
    """  # noqa: D406, D407 - a heading of the help
    known = None
    if like:
        known = resolve(like, library, accept_changes=accept_changes).parameters
    made = ring_from_tir(read_tir(file), belt_width_m, known)
    if out is not None:
        export(made.parameters, out)
    show_tyre.show_ring(made, str(out) if out else None, as_json=as_json)


def modal_targets(
    source: Annotated[str, AnySet],
    out: Annotated[
        Path,
        typer.Option("--out", metavar="FILE", rich_help_panel=FILES, help="Text file to write."),
    ],
    library: Library = None,
    accept_changes: AcceptChanges = False,
    as_json: Json = False,
) -> None:
    """Write modal targets for an FTire-style parameter fit.

    In-plane rotation, translation and the first two bendings of the belt, with frequencies and
    damping ratios of the ring; where SET is a result folder, measured ones beside them.

    Examples:
      ringmodal tyre modal-targets result --out targets.txt
      ringmodal tyre modal-targets 225-55R17@3 --library parameters --out targets.txt
    """  # noqa: D406, D407 - a heading of the help
    found = resolve(source, library, accept_changes=accept_changes)
    measured = measured_modes(Path(source))
    with file_written_whole(out) as partial:
        targets = write_modal_targets(found.parameters, partial, measured)
    if as_json:
        terminal.print_json({"file": str(out), "targets": [vars(target) for target in targets]})
    else:
        terminal.say(f"Written: {out}")


def _require_consent(target: Path, *, asks: bool) -> None:
    """Ask before an existing file is replaced; nobody there to ask is bad usage.

    Raises
    ------
    InputError
        Where nobody can be asked.
    Exit
        On a no, with nothing written.
    """
    if not target.exists():
        return
    if not (asks and sys.stdin.isatty()):
        rule = "confirmation required"
        raise InputError(str(target), "no --yes", rule, "Give --yes, or --dry-run to only look")
    if not typer.confirm(f"Write {target}?"):
        terminal.say("Nothing was written.")
        raise typer.Exit


def _save(update: TirUpdate, target: Path) -> Path | None:

    return save_tir(update.after, target)
