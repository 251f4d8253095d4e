"""The command line's ``ringmodal compare``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines import console
from pipelines.cli_options import FILES, AcceptChanges, Json, replacing
from pipelines.cli_values import choice
from pipelines.interrupt import stating_what_stands

if TYPE_CHECKING:
    from pipelines.comparison import Comparison

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
    from pipelines.comparison import compare_folders
    from pipelines.comparison_table import comparison_record
    from pipelines.report.comparison import write_comparison

    choice("--out", out.suffix or "(no ending)", (".html",))
    with stating_what_stands(out):
        found = compare_folders(first, second, accept_changes=accept_changes)
        page = write_comparison(found, out, force=force)
    if as_json:
        console.print_json({"report": str(page), **comparison_record(found)})
        return
    _show(found)
    console.say(f"Report: {page}")


def _show(found: Comparison) -> None:
    from pipelines.comparison_table import COMPARISON_HEAD, comparison_rows
    from pipelines.comparison_words import findings
    from pipelines.console_tables import columns_of, print_table

    columns = columns_of(COMPARISON_HEAD, comparison_rows(found), _TEXTS, _TEXTS[1:])
    output = console.screen()
    print_table(output, " → ".join(found.names), columns, _FIRST_TO_GO)
    for doubt in found.doubts:
        console.complain(f"Warning: {doubt}")
    for sentence in findings(found):
        output.print(console.printable(sentence), markup=False)
