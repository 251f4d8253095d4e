"""The command line's first steps: ``demo``, ``doctor``, ``inspect``, ``init``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipelines.cli import terminal
from pipelines.cli.doctor import PROBLEM, examine, show_checks
from pipelines.cli.interrupt import stating_what_stands
from pipelines.cli.options import Json, replacing
from pipelines.cli.progress import shown
from pipelines.cli.show_channels import show_inspection
from pipelines.cli.show_result import show
from pipelines.prepare.guesses import Layout
from pipelines.prepare.inspection import inspect_files
from pipelines.prepare.manifest_template import draft_manifest, write_draft
from pipelines.report.save import run_demo

PLACES = "Places of the sensors"


def demo(
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for the demonstration.")
    ] = Path("demo"),
    as_json: Json = False,
) -> None:
    """Process the sample campaign and say where the report is.

    Example:
      ringmodal demo --out demo
    """
    with stating_what_stands(out / "result"):
        result, folder = run_demo(out)
    show(result, folder, as_json=as_json, report=True)


def doctor(as_json: Json = False) -> None:
    """Check the installation: libraries, optional parts, machine, and a small campaign.

    Ends with code 0 if there is no problem, with 1 otherwise; advice is no problem.

    Example:
      ringmodal doctor
    """
    pass

    with shown(quiet=as_json) as progress:
        progress.stage("Checking the installation …")
        checks = examine()
    show_checks(checks, as_json=as_json)
    if any(check.verdict == PROBLEM for check in checks):
        raise typer.Exit(1)


def inspect(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE…", help="Recordings, folders of recordings, or a campaign.toml."
        ),
    ],
    headers: Annotated[bool, typer.Option("--headers", help="Read headers only.")] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 2 if anything looks wrong.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Show channels, units, rates, lengths and levels of recordings, and what looks wrong.

    Examples:
      ringmodal inspect measurements/tyre_7
      ringmodal inspect config_1.uff config_2.uff --headers
    """  # noqa: D406, D407 - a heading of the help
    inspection = inspect_files(files, levels=not headers)
    if inspection.files:
        show_inspection(inspection, as_json=as_json)
    for error in inspection.errors:
        terminal.complain(f"Error: {error}")
    if inspection.errors or (strict and inspection.looks_wrong):
        raise typer.Exit(2)


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Folder with recordings.")],
    spacing_deg: Annotated[
        float | None,
        typer.Option(
            "--spacing-deg",
            metavar="DEG",
            rich_help_panel=PLACES,
            help="Evenly spread sensors: degrees from one to the next, in the order of their "
            "channels. The first one of the first run is at 0.",
        ),
    ] = None,
    step_deg: Annotated[
        float,
        typer.Option(
            "--step-deg",
            metavar="DEG",
            rich_help_panel=PLACES,
            help="Degrees by which they are turned from run to run.",
        ),
    ] = 0.0,
    reference: Annotated[
        str | None,
        typer.Option(
            metavar="CHANNEL",
            rich_help_panel=PLACES,
            help="The sensor that stays in place in all runs. Default: one called REF or alike.",
        ),
    ] = None,
    force: Annotated[bool, replacing("an existing manifest")] = False,
    as_json: Json = False,
) -> None:
    """Draft a campaign.toml from the recordings in a folder, and say what to fill in.

    Examples:
      ringmodal init measurements/tyre_7
      ringmodal init measurements/tyre_7 --spacing-deg 30 --step-deg 5 --reference A13
    """  # noqa: D406, D407 - a heading of the help
    if step_deg and spacing_deg is None:
        raise typer.BadParameter("--step-deg goes with --spacing-deg. Give both.")
    layout = None if spacing_deg is None else Layout(spacing_deg, step_deg)
    draft = draft_manifest(folder, layout=layout, reference=reference)
    for text in draft.left_out:
        terminal.complain(f"Left out: {text}")
    path = write_draft(folder, draft, force=force)
    if as_json:
        content = {"draft": str(path), "to_fill_in": draft.missing, "left_out": draft.left_out}
        terminal.print_json(content)
        return
    terminal.say(f"Draft: {path}")
    for text in draft.missing:
        terminal.say(f"To fill in: {text}")
    terminal.say(f"Next: check {path}, then ringmodal process {folder} --out result")
