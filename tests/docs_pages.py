"""The pages of the documentation, and the blocks in them that promise to work."""

from __future__ import annotations

import re
import textwrap
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
COMMANDS = ("", "console", "bash", "sh")

_BLOCK = re.compile(
    r"(?:<!-- not run: (?P<reason>[^>]*?) -->\s*)?"
    r"^(?P<indent> *)```(?P<language>\w*)[^\n`]*\n(?P<text>.*?)^(?P=indent)```[ ]*$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    Parameters
    ----------
    page : Path
    line : int
        Where its text begins.
    language : str
    text : str
    reason : str
        Why it is not run: ``<!-- not run: … -->`` above it; empty for those that are.
    """

    page: Path
    line: int
    language: str
    text: str
    reason: str


@dataclass(frozen=True)
class Command:
    """A command of a block and what the page shows of its answer."""

    text: str
    shown: str


def pages() -> list[Path]:
    """Every page that somebody wrote."""
    written = [p for p in (ROOT / "docs").rglob("*.md") if "generated" not in p.parts]
    return [ROOT / "README.md", *sorted(written)]


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [
        Block(
            page=page,
            line=text.count("\n", 0, found.start("text")) + 1,
            language=found["language"],
            text=textwrap.dedent(found["text"]),
            reason=" ".join((found["reason"] or "").split()),
        )
        for found in _BLOCK.finditer(text)
    ]


def commands_of(block: Block) -> list[Command]:
    """Commands of a block: lines after a prompt, or all lines where there is no prompt."""
    lines = block.text.replace("\\\n", " ").splitlines()
    if not any(line.startswith("$ ") for line in lines):
        shell = block.language in ("bash", "sh") or all(
            line.startswith(("ringmodal", "#")) for line in lines if line.strip()
        )
        return [Command(line.strip(), "") for line in lines if shell and line.strip()]
    commands: list[Command] = []
    for line in lines:
        if line.startswith("$ "):
            commands.append(Command(line[2:].strip(), ""))
        elif commands:
            last = commands.pop()
            commands.append(Command(last.text, f"{last.shown}\n{line}"))
    return commands
