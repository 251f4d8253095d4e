"""The command line: ``ringmodal``, its commands in groups, each loaded when it is called."""

from __future__ import annotations

import sys
from typing import Annotated, ClassVar

import typer

from pipelines.cli import terminal
from pipelines.cli.help import SETTINGS, Lazy, LazyGroup

# Loading all commands with all they need would take a second, for a page of help too.
COMMANDS = (
    Lazy(
        "pipelines.cli.start",
        "demo",
        "First steps",
        "Process the sample campaign and say where the report is.",
    ),
    Lazy(
        "pipelines.cli.start",
        "doctor",
        "First steps",
        "Check the installation: libraries, optional parts, machine, and a small campaign.",
    ),
    Lazy(
        "pipelines.cli.start",
        "inspect",
        "First steps",
        "Show channels, units, rates, lengths and levels of recordings, and what looks wrong.",
    ),
    Lazy(
        "pipelines.cli.start",
        "init",
        "First steps",
        "Draft a campaign.toml from the recordings in a folder, and say what to fill in.",
    ),
    Lazy(
        "pipelines.cli.result",
        "process",
        "From recordings to a result",
        "Recordings → FRFs → poles → modes → ring parameters → validation → report.",
    ),
    Lazy(
        "pipelines.cli.result",
        "tune",
        "From recordings to a result",
        "Determine the ring's parameters again, from the modes of an earlier result.",
    ),
    Lazy(
        "pipelines.cli.result",
        "report",
        "From recordings to a result",
        "Write the report of an earlier result again, as HTML and where wanted as PDF.",
    ),
    Lazy(
        "pipelines.cli.compare",
        "compare",
        "From recordings to a result",
        "Compare two results: frequencies, damping, shapes and ring parameters, with significance.",
    ),
    Lazy(
        "pipelines.cli.export",
        "export",
        "From recordings to a result",
        "Write modes, shapes, geometry and FRFs of a result for other modal programs.",
    ),
    Lazy(
        "pipelines.cli.export",
        "compare_shapes",
        "From recordings to a result",
        "Compare shapes with those of a finite-element model or of another program, by MAC.",
    ),
    Lazy(
        "pipelines.cli.batch",
        "batch",
        "Many campaigns",
        "Process every campaign under a folder, each by itself, and gather modes and parameters.",
    ),
    Lazy(
        "pipelines.cli.simulate",
        "simulate",
        "Ring model",
        "The ring model at work: frequencies, forced vibration, virtual measurements.",
    ),
    Lazy(
        "pipelines.cli.paper",
        "paper",
        "Ring model",
        "Compute the tables and figures of the paper behind the ring model, beside what it prints.",
    ),
    Lazy(
        "pipelines.cli.tyre",
        "tyre",
        "Parameter sets",
        "Parameter sets of tyres: kept in a library, compared, handed to other programs.",
    ),
)


class Program(LazyGroup):
    """``ringmodal``."""

    lazy: ClassVar[dict[str, Lazy]] = {each.command: each for each in COMMANDS}


app = typer.Typer(
    cls=Program,
    name="ringmodal",
    help="""Modal analysis of tyres: from recordings to modes, ring parameters and a report.

    Examples:
      ringmodal demo
      ringmodal inspect measurements/tyre_7
      ringmodal init measurements/tyre_7
      ringmodal process measurements/tyre_7 --out results/tyre_7

    `ringmodal COMMAND --help` lists the options of a command, with units and defaults.
    """,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings=SETTINGS,
)


def _version(wanted: bool) -> None:
    if not wanted:
        return
    from pipelines.results.provenance import library_versions, software_version

    terminal.say(f"ringmodal {software_version()}")
    for name, version in library_versions().items():
        terminal.say(f"  {name} {version}")
    raise typer.Exit


@app.callback()
def common(
    debug: Annotated[
        bool,
        typer.Option(
            "--debug", envvar="RINGMODAL_DEBUG", help="Show where an internal error happened."
        ),
    ] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            is_eager=True,
            callback=_version,
            help="Print the versions of ringmodal, Python and the main libraries.",
        ),
    ] = False,
) -> None:
    """Choose what an internal error shows, before any command runs."""
    sys.excepthook = sys.__excepthook__ if debug else terminal.report_fault


__all__ = ["app"]
