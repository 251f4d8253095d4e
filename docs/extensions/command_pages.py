"""The reference of the command line, from the help of the program itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import typer

from pipelines.cli.app import app as program

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGE = "reference/cli"
_EXAMPLE = re.compile(r"^Examples?:\s*", re.MULTILINE)


def setup(app: Sphinx) -> dict[str, bool]:
    """Append every command to the page of the command line as it is read."""
    app.connect("source-read", _append_commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _append_commands(app: Sphinx, page: str, source: list[str]) -> None:
    if page == PAGE:
        source[0] += "\n".join(_sections())


def _sections() -> Iterator[str]:
    root = typer.main.get_command(program)
    context = root.make_context("ringmodal", [], resilient_parsing=True)
    for name, command, of_command in commands(root, context):
        yield f"\n## {name}\n"
        prose, examples = prose_and_examples(command.help or "")
        yield prose
        yield f"\n```text\n{_usage(command, of_command)}\n```\n"
        yield from _tables(command, of_command)
        shown = "\n".join(f"$ {each}" for each in examples)
        yield f"For example:\n\n```console\n{shown}\n```\n" if examples else ""


def commands(group: Any, context: Any) -> Iterator[tuple[str, Any, Any]]:
    """Every command below a group: its full name, itself and its context."""
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        of_command = command.make_context(name, [], parent=context, resilient_parsing=True)
        if hasattr(command, "list_commands"):
            yield from commands(command, of_command)
        elif not command.hidden:
            yield of_command.command_path, command, of_command


def _usage(command: Any, context: Any) -> str:
    arguments = [_name(each) for each in command.get_params(context) if _is_argument(each)]
    return " ".join([context.command_path, "[OPTIONS]", *arguments])


def prose_and_examples(text: str) -> tuple[str, list[str]]:
    """Help without its examples, and the examples: the commands after "Example:"."""
    prose, *examples = _EXAMPLE.split(text, maxsplit=1)
    lines = "".join(examples).splitlines()
    return prose.strip(), [line.strip() for line in lines if line.strip()]


def _tables(command: Any, context: Any) -> Iterator[str]:
    """Arguments and options, grouped under headings as in the help."""
    groups: dict[str, list[str]] = {}
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is None or parameter.name == "help":
            continue
        name = _name(parameter) if _is_argument(parameter) else record[0]
        name, meaning = (" ".join(text.split()).replace("|", r"\|") for text in (name, record[1]))
        groups.setdefault(_heading(parameter), []).append(f"| `{name}` | {meaning} |")
    for heading, rows in groups.items():
        yield "\n".join([f"\n| {heading} | meaning |", "|---|---|", *rows, ""])


def _is_argument(parameter: Any) -> bool:
    return bool(parameter.param_type_name == "argument")


def _name(argument: Any) -> str:
    return str(argument.metavar or argument.name.upper())


def _heading(parameter: Any) -> str:
    if _is_argument(parameter):
        return "Arguments"
    return getattr(parameter, "rich_help_panel", None) or "Options"
