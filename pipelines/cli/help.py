"""Commands loaded when they are called, and help that lists options and commands in groups."""

from __future__ import annotations

from difflib import get_close_matches
from importlib import import_module
from itertools import pairwise
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup

SETTINGS = {"max_content_width": 100, "help_option_names": ["--help", "-h"]}

_KEEP_LINES = "\b\n"  # click leaves the lines of such a paragraph as they are
_NAME_WIDTH = 26  # columns
_LAST = ("Screen", "General")


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
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(name, cls=Command)(found)
        found = alone
    command: Any = typer.main.get_command(found)
    command.name = name
    return command


def _is_argument(param: Any) -> bool:
    return bool(param.param_type_name == "argument")
