"""The command line's ``ringmodal paper``."""

from __future__ import annotations

from pipelines.cli import terminal
from pipelines.cli.interrupt import stating_what_stands
from pipelines.cli.options import Force, Json, Out, Quiet
from pipelines.cli.progress import shown
from pipelines.paper.reproduce import PAGE, reproduce_paper


def paper(out: Out, force: Force = False, as_json: Json = False, quiet: Quiet = False) -> None:
    """Compute the tables and figures of the paper behind the ring model, beside what it prints.

    Example:
      ringmodal paper --out paper
    """
    with stating_what_stands(out), shown(quiet=quiet) as progress:
        chapters = reproduce_paper(out, force=force, progress=progress.stage)
    statements = [one for chapter in chapters for one in chapter.statements]
    if as_json:
        rows = [
            {"place": one.place, "verdict": one.verdict, "found": one.found} for one in statements
        ]
        terminal.print_json({"report": str(out / PAGE), "statements": rows})
        return
    for one in statements:
        terminal.say(f"{one.place}: {one.verdict}. {one.found}")
    terminal.say(f"Report: {out / PAGE}")
