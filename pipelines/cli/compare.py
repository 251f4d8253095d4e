"""The command line's ``ringmodal compare``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines.cli import terminal
from pipelines.cli.interrupt import stating_what_stands
from pipelines.cli.options import FILES, AcceptChanges, Json, replacing
from pipelines.cli.terminal import columns_of, print_table
from pipelines.cli.values import choice
from pipelines.compare.compare import compare_folders
from pipelines.compare.summary_text import findings
from pipelines.compare.table import COMPARISON_HEAD, comparison_record, comparison_rows
from pipelines.report.comparison import write_comparison

if TYPE_CHECKING:
    from pipelines.compare.compare import Comparison

_FIRST_TO_GO = ("MAC", "verdict on damping", "damping change / %", "second / Hz")
_TEXTS = ("mode", "verdict", "verdict on damping")


def compare(
    first: Annotated[
        Path, typer.Argument(metavar="FIRST", help="Folder of a result, the one to compare with.")
    ],
    second: Annotated[Path, typer.Argument(metavar="SECOND", help="Folder of another result.")],
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="FILE", rich_help_panel=FILES, help="Page with all comparisons."
        ),
    ] = Path("comparison.html"),
    force: Annotated[bool, replacing("an earlier page")] = False,
    accept_changes: AcceptChanges = False,
    as_json: Json = False,
) -> None:
    """Compare two results: frequencies, damping, shapes and ring parameters, with significance.

    Every difference is second minus first.

    Examples:
      ringmodal compare results/220_kPa results/250_kPa
      ringmodal compare results/monday results/tuesday --out repeatability.html --force
    """  # noqa: D406, D407 - a heading of the help
    choice("--out", out.suffix or "(no ending)", (".html",))
    with stating_what_stands(out):
        found = compare_folders(first, second, accept_changes=accept_changes)
        page = write_comparison(found, out, force=force)
    if as_json:
        terminal.print_json({"report": str(page), **comparison_record(found)})
        return
    _show(found)
    terminal.say(f"Report: {page}")


def _show(found: Comparison) -> None:

    columns = columns_of(COMPARISON_HEAD, comparison_rows(found), _TEXTS, _TEXTS[1:])
    output = terminal.screen()
    print_table(output, " → ".join(found.names), columns, _FIRST_TO_GO)
    for doubt in found.doubts:
        terminal.complain(f"Warning: {doubt}")
    for sentence in findings(found):
        output.print(terminal.printable(sentence), markup=False)
