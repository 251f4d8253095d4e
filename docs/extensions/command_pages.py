"""The reference of the command line, from the help of the program itself."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import typer
from sphinx.application import Sphinx

from pipelines.cli import app as program

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
        yield _described(command.help or "")
        yield f"```text\n{_usage(command, of_command)}\n```\n"
        yield from _table(command, of_command)


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
    return " ".join([context.command_path, *command.collect_usage_pieces(context)])


def _described(text: str) -> str:
    """Help as Markdown: what follows "Example:" is a command to copy."""
    prose, *example = _EXAMPLE.split(text, maxsplit=1)
    lines = [line.strip() for line in "".join(example).splitlines() if line.strip()]
    shown = "```console\n" + "\n".join(f"$ {line}" for line in lines) + "\n```\n" if lines else ""
    return f"{prose.strip()}\n\n{shown}"


def _table(command: Any, context: Any) -> Iterator[str]:
    yield "| argument or option | meaning |\n|---|---|"
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record and parameter.name != "help":
            name, meaning = (" ".join(str(part).split()).replace("|", r"\|") for part in record)
            yield f"| `{name}` | {meaning} |"
    yield ""
