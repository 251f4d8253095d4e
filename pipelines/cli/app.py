"""The command line: ``ringmodal``, its commands in groups."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Annotated

import typer

from pipelines.cli import terminal
from pipelines.cli.batch import batch
from pipelines.cli.compare import compare
from pipelines.cli.export import compare_shapes, export
from pipelines.cli.help import SETTINGS, Command, Group
from pipelines.cli.paper import paper
from pipelines.cli.result import process, report, tune
from pipelines.cli.simulate import simulate
from pipelines.cli.start import demo, doctor, init, inspect
from pipelines.cli.tyre import tyre

app = typer.Typer(
    cls=Group,
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

_GROUPS: dict[str, tuple[Callable[..., None], ...]] = {
    "First steps": (demo, doctor, inspect, init),
    "From recordings to a result": (process, tune, report, compare, export, compare_shapes),
    "Many campaigns": (batch,),
}
for _heading, _commands in _GROUPS.items():
    for _command in _commands:
        app.command(cls=Command, rich_help_panel=_heading)(_command)
app.add_typer(simulate, name="simulate", cls=Group, rich_help_panel="Ring model")
app.command(cls=Command, rich_help_panel="Ring model")(paper)
app.add_typer(tyre, name="tyre", cls=Group, rich_help_panel="Parameter sets")


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
