"""``ringmodal paper``."""

from __future__ import annotations

from pipelines.cli.options import Force, Json, Out, Quiet
from pipelines.cli.screen import shown
from pipelines.cli.streams import reporting_outcome
from pipelines.cli.terminal import echo, print_json
from pipelines.paper.reproduce import PAGE, reproduce_paper


def paper(out: Out, force: Force = False, as_json: Json = False, quiet: Quiet = False) -> None:
    """Compute the tables and figures of the paper on the ring model, next to the printed values.

    Example:
      ringmodal paper --out paper
    """
    with reporting_outcome(out), shown(quiet=quiet) as progress:
        chapters = reproduce_paper(out, force=force, progress=progress.stage)
    statements = [one for chapter in chapters for one in chapter.statements]
    if as_json:
        rows = [
            {"place": one.place, "verdict": one.verdict, "found": one.found} for one in statements
        ]
        print_json({"report": str(out / PAGE), "statements": rows})
        return
    for one in statements:
        echo(f"{one.place}: {one.verdict}. {one.found}")
    echo(f"Report: {out / PAGE}")
