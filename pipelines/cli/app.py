"""The command line: ``ringmodal``, its commands in groups, each loaded when it is called."""

from __future__ import annotations

import gc
import logging
import sys
from difflib import get_close_matches
from importlib import import_module
from itertools import pairwise
from typing import Annotated, Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

from ema.core.errors import FitError, InputError, file_trouble, is_drive_trouble, out_of_memory
from model.errors import ParameterError
from pipelines.cli import terminal
from pipelines.cli.streams import Interrupted

SETTINGS = {"max_content_width": 100, "help_option_names": ["--help", "-h"]}

_KEEP_LINES = "\b\n"  # click leaves the lines of such a paragraph as they are
_NAME_WIDTH = 26  # columns
_LAST = ("Screen", "General")
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
        ("review", "review", "Review a result in the browser: see, decide, sign off."),
        ("compare", "compare", "Compare results, with the significance of each difference."),
        ("compare", "export", "Write modes, shapes and FRFs of a result for other modal programs."),
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


class _Grouped:
    """Help in groups without rich, which takes longer to load than everything else in it."""

    def format_help_text(self: Any, ctx: Any, formatter: Any) -> None:
        paragraphs = (self.help or "").split("\n\n")
        kept = [_KEEP_LINES + text if text.startswith("Example") else text for text in paragraphs]
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text("\n\n".join(kept))

    def format_options(self: Any, ctx: Any, formatter: Any) -> None:
        groups: dict[str, list[tuple[str, str]]] = {}
        for heading, name, summary in self.listed(ctx):
            groups.setdefault(heading, []).append((name, summary))
        for param in self.get_params(ctx):
            if (row := param.get_help_record(ctx)) is not None:
                name, heading = row[0], getattr(param, "rich_help_panel", None) or "General"
                if _is_argument(param):
                    name, heading = param.metavar, "Arguments"
                text = row[1].replace("\\[", "[")  # some versions of typer escape it for rich
                groups.setdefault(heading, []).append((name, text))
        for heading, rows in sorted(groups.items(), key=lambda group: group[0] in _LAST):
            with formatter.section(heading):
                formatter.write_dl(rows, col_max=_NAME_WIDTH)

    def listed(self: Any, ctx: Any) -> list[tuple[str, str, str]]:
        """Heading, name and summary of each subcommand."""
        return []

    def collect_usage_pieces(self: Any, ctx: Any) -> list[str]:
        pieces = [each.metavar for each in self.get_params(ctx) if _is_argument(each)]
        return ["[OPTIONS]", *pieces, *(["COMMAND …"] if isinstance(self, TyperGroup) else [])]

    def parse_args(self: Any, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; an error also states the value of the option at fault."""
        typed = list(args)
        try:
            return super().parse_args(ctx, args)  # type: ignore[misc, no-any-return]
        except typer.BadParameter as fault:
            names = getattr(fault.param, "opts", ())
            given = [value for name, value in pairwise(typed) if name in names]
            fault.message = fault.message.removeprefix("Value error, ")
            if given and given[-1] not in fault.message:
                fault.message = f"{given[-1]!r}: {fault.message}"
            raise


class Command(_Grouped, TyperCommand):
    """A command."""


class Group(_Grouped, TyperGroup):
    """A group of commands."""

    def listed(self, ctx: Any) -> list[tuple[str, str, str]]:
        """Heading, name and first paragraph of each subcommand."""
        found: list[Any] = [self.get_command(ctx, name) for name in self.list_commands(ctx)]
        return [
            (each.rich_help_panel or "Commands", each.name, each.help.partition("\n\n")[0])
            for each in found
        ]


def group(text: str) -> typer.Typer:
    """A group of commands and its help."""
    options: Any = {"cls": Group, "no_args_is_help": True, "rich_markup_mode": None}
    return typer.Typer(help=text, add_completion=False, **options)


class LazyGroup(Group):
    """A group whose commands are loaded one by one, each when it is called."""

    #: Module in `pipelines.cli`, heading and summary of each command, by its name.
    lazy: ClassVar[dict[str, tuple[str, str, str]]] = {}

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of all commands."""
        return list(self.lazy)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command with a name; None where there is none."""
        if cmd_name in self.lazy and cmd_name not in self.commands:
            self.commands[cmd_name] = _loaded(self.lazy[cmd_name][0], cmd_name)
        return self.commands.get(cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that is called; for an unknown one suggest the nearest."""
        similar = get_close_matches(args[0], self.lazy, 1)
        if args[0] not in self.lazy and similar and not ctx.resilient_parsing:
            ctx.fail(f"No such command {args[0]!r}. Did you mean {similar[0]!r}?")
        return super().resolve_command(ctx, args)

    def listed(self, ctx: Any) -> list[tuple[str, str, str]]:
        """Heading, name and summary of each command, without loading any."""
        return [(heading, name, text) for name, (_, heading, text) in self.lazy.items()]


def _loaded(module: str, name: str) -> Any:
    found = getattr(import_module(f"pipelines.cli.{module}"), name.replace("-", "_"))
    gc.freeze()  # what is loaded stays
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(name, cls=Command)(found)
        found = alone
    command: Any = typer.main.get_command(found)
    command.name = name
    return command


def _is_argument(param: Any) -> bool:
    return bool(param.param_type_name == "argument")


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
    """Apply the options that come before a command, which is loaded."""
    gc.enable()  # `main` disabled it
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
