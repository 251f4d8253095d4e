"""The command line: ``ringmodal``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines import console
from pipelines.cli_batch import batch
from pipelines.cli_options import (
    Force,
    Given,
    Json,
    NoReport,
    Objective,
    Out,
    Quiet,
    Strict,
    with_processing_options,
)
from pipelines.cli_simulate import simulate
from pipelines.interrupt import stating_what_stands
from pipelines.main import main
from pipelines.progress import shown

if TYPE_CHECKING:
    from pipelines.options import Options

app = typer.Typer(
    name="ringmodal",
    help="Modal analysis of tyres: from recordings to modes, ring parameters and a report.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
app.add_typer(simulate, name="simulate")
app.command()(batch)


@app.callback()
def common(
    debug: Annotated[
        bool,
        typer.Option(
            "--debug", envvar="RINGMODAL_DEBUG", help="Show where a fault of the program happened."
        ),
    ] = False,
) -> None:
    """Choose what a fault of the program shows, before any command runs."""
    sys.excepthook = sys.__excepthook__ if debug else console.report_fault


@app.command()
@with_processing_options
def process(
    campaign: Annotated[
        list[Path], typer.Argument(help="Campaign folder, its campaign.toml, or recordings.")
    ],
    out: Out,
    options: Options,
    no_report: NoReport = False,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Recordings → FRFs → poles → modes → ring parameters → validation → report.

    Example: ringmodal process sample_data/tyre_225_55R17 --out result
    """
    from pipelines.process import process as run
    from pipelines.result_folder import require_free
    from pipelines.store import save

    source = campaign[0] if len(campaign) == 1 else campaign
    with stating_what_stands(out):
        require_free(out, force=force)
        with shown(quiet=quiet) as progress:
            result = run(source, options, progress.stage, progress.step)
            progress.stage("Writing the result …")
            save(result, out, report=not no_report, force=force)
        console.show(result, out, as_json=as_json, report=not no_report)


@app.command()
def tune(
    result_folder: Annotated[Path, typer.Argument(help="Folder of an earlier result.")],
    objective: Objective = "frequency",
    given: Given = None,
    no_report: NoReport = False,
    strict: Strict = False,
    as_json: Json = False,
) -> None:
    """Determine the ring's parameters again, from the modes of an earlier result.

    Example: ringmodal tune result --objective paper
    """
    from pipelines.store import save

    values = console.assignments("--given", given)
    with stating_what_stands(result_folder):
        result = console.tuned_again(result_folder, objective, values, strict=strict)
        save(result, result_folder, report=not no_report, force=True)
        console.show(result, result_folder, as_json=as_json, report=not no_report)


@app.command()
def report(
    result_folder: Annotated[Path, typer.Argument(help="Folder of an earlier result.")],
) -> None:
    """Write the report of an earlier result again.

    Example: ringmodal report result
    """
    from pipelines.store import save

    with stating_what_stands(result_folder):
        save(console.tuned_again(result_folder), result_folder, force=True)
    typer.echo(f"Report: {result_folder / 'report.html'}")


@app.command()
def demo(
    out: Annotated[Path, typer.Option("--out", help="Folder for the demonstration.")] = Path(
        "demo"
    ),
) -> None:
    """Process the sample campaign and say where the report is.

    Example: ringmodal demo --out demo
    """
    from pipelines.demo import run_demo

    with stating_what_stands(out / "result"):
        result, folder = run_demo(out)
    console.show(result, folder, as_json=False, report=True)


@app.command()
def paper(
    out: Out,
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Compute the paper's tables and figures, beside what it prints.

    Example: ringmodal paper --out paper
    """
    from pipelines.paper import PAGE, reproduce_paper

    with stating_what_stands(out), shown(quiet=quiet) as progress:
        chapters = reproduce_paper(out, force=force, progress=progress.stage)
    for statement in (one for chapter in chapters for one in chapter.statements):
        typer.echo(f"{statement.place}: {statement.verdict}. {statement.found}")
    typer.echo(f"Report: {out / PAGE}")


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(help="Folder with recordings.")],
    force: Annotated[bool, typer.Option("--force", help="Replace an existing manifest.")] = False,
) -> None:
    """Draft a campaign.toml from the recordings in a folder.

    Example: ringmodal init measurements/tyre_7
    """
    from pipelines.draft import draft_manifest, write_draft

    draft = draft_manifest(folder)
    for text in draft.left_out:
        console.complain(f"Left out: {text}")
    typer.echo(f"Draft: {write_draft(folder, draft, force=force)}")
    for text in draft.missing:
        typer.echo(f"To fill in: {text}")


@app.command()
def inspect(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings, folders of recordings, or a campaign.toml.")
    ],
    headers: Annotated[
        bool, typer.Option("--headers", help="Only what headers say: signals are not looked at.")
    ] = False,
    strict: Annotated[
        bool, typer.Option("--strict", help="Exit code 2 if anything looks wrong.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Show channels, units, rates, lengths and levels of recordings, and what looks wrong.

    Example: ringmodal inspect config_1.uff
    """
    from pipelines.console_channels import show_inspection
    from pipelines.inspection import inspect_files

    inspection = inspect_files(files, levels=not headers)
    if inspection.files:
        show_inspection(inspection, as_json=as_json)
    for error in inspection.errors:
        console.complain(f"Error: {error}")
    if inspection.errors or (strict and inspection.looks_wrong):
        raise typer.Exit(2)


__all__ = ["app", "main"]

if __name__ == "__main__":
    main()
