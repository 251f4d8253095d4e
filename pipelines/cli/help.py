"""Help that reads like a page, and usage errors that name what was probably meant."""

from __future__ import annotations

import difflib
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from itertools import pairwise
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

# Typer brings its own copy of click, or uses the installed one: this base is the same in both.
_UsageError: type[Exception] = typer.BadParameter.__mro__[1]

SETTINGS = {"max_content_width": 100, "help_option_names": ["--help", "-h"]}

_EXAMPLES = "Example"
_KEEP_LINES = "\b\n"  # click leaves the lines of such a paragraph as they are
_NAME_WIDTH = 26
_LAST = ("Screen", "General")


class _Page:
    """What groups and commands have in common: help in panels, suggestions for a slip."""

    def format_help_text(self: Any, ctx: Any, formatter: Any) -> None:
        """Write what a command does; examples keep their lines, to be copied."""
        paragraphs = (self.help or "").split("\n\n")
        kept = [_KEEP_LINES + text if text.startswith(_EXAMPLES) else text for text in paragraphs]
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text("\n\n".join(kept))

    def format_options(self: Any, ctx: Any, formatter: Any) -> None:
        """Write commands, arguments and options, each group beneath its heading."""
        groups: dict[str, list[tuple[str, str]]] = {}
        for heading, name, summary in self.listed(ctx):
            groups.setdefault(heading, []).append((name, summary))
        for param in self.get_params(ctx):
            row = param.get_help_record(ctx)
            if row is not None:
                name = param.metavar if _is_argument(param) else row[0]
                text = row[1].replace("\\[", "[")  # some versions of typer escape it for rich
                groups.setdefault(_heading(param), []).append((name, text))
        for heading, rows in sorted(groups.items(), key=lambda group: group[0] in _LAST):
            with formatter.section(_heading_text(ctx, heading)):
                formatter.write_dl(rows, col_max=_NAME_WIDTH)

    def listed(self: Any, ctx: Any) -> list[tuple[str, str, str]]:
        """Heading, name and first paragraph of each command."""
        return []

    def collect_usage_pieces(self: Any, ctx: Any) -> list[str]:
        """What stands behind the command's name in its usage."""
        pieces = [each.metavar for each in self.get_params(ctx) if _is_argument(each)]
        return ["[OPTIONS]", *pieces, *(["COMMAND …"] if isinstance(self, TyperGroup) else [])]

    def parse_args(self: Any, ctx: Any, args: list[str]) -> list[str]:
        """Take the arguments; for what is not known the most similar name is suggested."""
        typed = list(args)
        try:
            taken: list[str] = super().parse_args(ctx, args)  # type: ignore[misc]
        except _UsageError as error:
            _suggest_option(error, [name for each in self.get_params(ctx) for name in each.opts])
            _suggest_value(error)
            _name_value(error, typed)
            _place_value(error, typed)
            raise
        return taken


class Command(_Page, TyperCommand):
    """A command."""


class Group(_Page, TyperGroup):
    """A group of commands."""

    def listed(self, ctx: Any) -> list[tuple[str, str, str]]:
        """Heading, name and first paragraph of each command."""
        found: list[Any] = [self.get_command(ctx, name) for name in self.list_commands(ctx)]
        return [
            (each.rich_help_panel or "Commands", each.name, _first_paragraph(each.help))
            for each in found
        ]


@dataclass(frozen=True)
class Lazy:
    """A command, or a group of them, that is loaded when it is called.

    Parameters
    ----------
    module, name : str
        Where its function, or its `typer.Typer`, stands.
    heading : str
        Heading of the help that it stands under.
    summary : str
        First paragraph of its help.
    """

    module: str
    name: str
    heading: str
    summary: str

    @property
    def command(self) -> str:
        """Name on the command line."""
        return self.name.replace("_", "-")

    def load(self) -> Any:
        """The command, ready to be called."""
        found = getattr(import_module(self.module), self.name)
        if not isinstance(found, typer.Typer):
            alone = typer.Typer(add_completion=False, rich_markup_mode=None)
            alone.command(self.command, cls=Command)(found)
            found = alone
        command: Any = typer.main.get_command(found)
        command.name = self.command
        return command


class LazyGroup(Group):
    """A group whose commands are loaded one by one, each when it is called."""

    lazy: ClassVar[dict[str, Lazy]] = {}

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of all commands."""
        return list(self.lazy)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of a name; None where there is none."""
        if cmd_name not in self.lazy:
            return None
        if cmd_name not in self.commands:
            self.commands[cmd_name] = self.lazy[cmd_name].load()
        return self.commands[cmd_name]

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that is called; for one that is not known suggest the nearest."""
        try:
            return super().resolve_command(ctx, args)
        except _UsageError as error:
            typed: Any = error
            if args and args[0] not in self.lazy and "Did you mean" not in typed.message:
                similar = difflib.get_close_matches(args[0], list(self.lazy), 1)
                typed.message += f" Did you mean {similar[0]!r}?" if similar else ""
            raise

    def listed(self, ctx: Any) -> list[tuple[str, str, str]]:
        """Heading, name and first paragraph of each command, none of them loaded."""
        return [(each.heading, name, each.summary) for name, each in self.lazy.items()]


def _first_paragraph(text: str | None) -> str:
    return " ".join((text or "").partition("\n\n")[0].split())


def _is_argument(param: Any) -> bool:
    return bool(param.param_type_name == "argument")


def _heading(param: Any) -> str:
    if _is_argument(param):
        return "Arguments"
    return getattr(param, "rich_help_panel", None) or "General"


def _heading_text(ctx: Any, heading: str) -> str:
    """A heading in bold where there are colours, otherwise plain."""
    if os.environ.get("NO_COLOR"):
        return heading
    if os.environ.get("FORCE_COLOR"):
        ctx.color = True  # or it would be taken away from what goes into a pipe
    return typer.style(heading, bold=True) if ctx.color or sys.stdout.isatty() else heading


def _suggest_option(error: Any, known: Sequence[str]) -> None:
    name = getattr(error, "option_name", None)
    if name is None or not hasattr(error, "possibilities") or name in known:
        return
    error.possibilities = []
    error.message = f"There is no option {name}." + _did_you_mean(name, known)


def _suggest_value(error: Any) -> None:
    """Complete "'x' is not one of 'a', 'b'" by the value that was probably meant."""
    error.message = error.message.removeprefix("Value error, ")
    if " is not one of " in error.message:
        typed, *known = re.findall(r"'([^']+)'", error.message)
        error.message += _did_you_mean(typed, known)


def _name_value(error: Any, typed: Sequence[str]) -> None:
    """Begin "Input should be …" with the value that was given for the option."""
    param = getattr(error, "param", None)
    given = [value for name, value in pairwise(typed) if name in getattr(param, "opts", ())]
    is_single = getattr(param, "nargs", 0) == 1
    if given and is_single and error.message.startswith("Input should"):
        error.message = f"{given[-1]!r}; i{error.message[1:]}."


def _place_value(error: Any, typed: Sequence[str]) -> None:
    """Say of a value that stands alone where it belongs."""
    if error.message.startswith("Got unexpected extra argument"):
        listed = error.message.rpartition(" (")[2].rstrip(")")
        alone = next((value for value in typed if listed.startswith(value)), listed)
        error.message = (
            f"{alone!r} is one argument too many. Does an option's name belong before it, such as "
            "--tyre, or quotes around a path with blanks? --help lists arguments and options."
        )


def _did_you_mean(typed: str, known: Sequence[str]) -> str:
    similar = difflib.get_close_matches(typed, known, 1)
    return f" Did you mean {similar[0]}?" if similar else ""
