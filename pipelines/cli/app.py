"""The command line: ``ringmodal``, its commands in groups, each loaded when it is called."""

from __future__ import annotations

import logging
import sys
from typing import Annotated, Any, ClassVar

import typer

from ema.core.errors import FitError, InputError, file_trouble, is_drive_trouble, out_of_memory
from model.errors import ParameterError
from pipelines.cli import terminal
from pipelines.cli.help import SETTINGS, LazyGroup
from pipelines.cli.streams import Interrupted

# Module in pipelines.cli, command, summary. Loading all of them costs a second.
_COMMANDS = {
    "First steps": (
        ("start", "demo", "Process the sample campaign and write its report."),
        ("doctor", "doctor", "Check the installation: libraries, machine, and a small campaign."),
        ("start", "inspect", "Show channels, units, rates and levels, and what looks wrong."),
        ("start", "init", "Write a campaign.toml template from the recordings in a folder."),
    ),
    "From recordings to a result": (
        ("result", "process", "Recordings → FRFs → poles → modes → ring parameters → report."),
        ("refit", "refit", "Identify the modes of a result again, with decisions of yours."),
        ("result", "tune", "Determine the ring parameters again, from the modes of a result."),
        ("result", "report", "Write the report of a result again, as HTML and optionally PDF."),
        ("refit", "review", "Review a result in the browser: see, decide, sign off."),
        ("compare", "compare", "Compare results, with the significance of each difference."),
        ("result", "export", "Write modes, shapes and FRFs of a result for other modal programs."),
        ("compare", "compare-shapes", "Compare shapes with those of a model or program, by MAC."),
    ),
    "Many campaigns": (
        ("compare", "batch", "Process every campaign under a folder and collect the results."),
    ),
    "Ring model": (
        ("simulate", "simulate", "Ring model: frequencies, responses, virtual measurements."),
        ("simulate", "paper", "Compute the tables and figures of the paper on the ring model."),
    ),
    "Parameter sets": (("tyre", "tyre", "Parameter sets of tyres: versions, comparison, export."),),
}


class Program(LazyGroup):
    """``ringmodal``."""

    lazy: ClassVar[dict[str, tuple[str, str, str]]] = {
        name: (module, heading, summary)
        for heading, commands in _COMMANDS.items()
        for module, name, summary in commands
    }


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
    # Loads numpy, which the help does without.
    from pipelines.results.provenance import library_versions, software_version

    terminal.echo(f"ringmodal {software_version()}")
    for name, version in library_versions().items():
        terminal.echo(f"  {name} {version}")
    raise typer.Exit


@app.callback()
def common(
    debug: Annotated[
        bool,
        typer.Option(
            "--debug", envvar="RINGMODAL_DEBUG", help="Show where an internal error happened."
        ),
    ] = False,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="Show what the packages log, with details.")
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
    """Apply the options that come before a command."""
    sys.excepthook = sys.__excepthook__ if debug else terminal.report_fault
    if verbose:
        terminal.show_logs(logging.INFO)


def run() -> Any:
    """Run the command line and return its exit code; an internal error is raised."""
    terminal.show_logs()
    sys.excepthook = terminal.report_fault  # until `--debug` is read
    try:
        app()
    except SystemExit as ended:
        return ended.code
    except Interrupted as interrupted:
        terminal.echo_error(f"Interrupted: {interrupted.outcome}.")
        return interrupted.exit_code
    except (InputError, FitError, ParameterError) as error:
        terminal.echo_error(f"Error: {error}")
        return 2
    except OSError as error:
        if not is_drive_trouble(error):
            raise
        terminal.echo_error(file_trouble(error))
        return 2
    except MemoryError as error:
        terminal.echo_error(out_of_memory(error))
        return 1
    return 0
