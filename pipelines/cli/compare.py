"""``ringmodal compare`` and ``compare-shapes``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pipelines.cli import options as opt
from pipelines.cli.screen import print_table
from pipelines.cli.streams import reporting_outcome
from pipelines.cli.terminal import echo, echo_error, print_json
from pipelines.compare import shape_comparison as shapes
from pipelines.compare.compare import Comparison, compare_folders
from pipelines.compare.shape_source import Alignment
from pipelines.compare.summary import COMPARISON_HEAD, comparison_record, comparison_rows, findings
from pipelines.report.comparison import write_comparison, write_shape_comparison
from pipelines.report.several import write_comparisons
from pipelines.storage.atomic import file_written_whole, require_free_file

WAYS, DIRECTIONS = ("angle", "node"), ("radial", "x", "y", "z")
PLACES = "Positions and directions"


def compare(
    first: Annotated[Path, opt.argument("FIRST", "Folder of a result, the one to compare with.")],
    second: Annotated[Path, opt.argument("SECOND", "Folder of another result.")],
    others: Annotated[
        list[Path] | None, opt.argument("[MORE…]", "Further results, compared with the first.")
    ] = None,
    out: Annotated[Path, opt.target("Page", (".html",))] = Path("comparison.html"),
    force: Annotated[bool, opt.replacing("an earlier page")] = False,
    accept_changes: opt.AcceptChanges = False,
    as_json: opt.Json = False,
) -> None:
    """Compare results: frequencies, damping, shapes and ring parameters, with significance.

    Every difference is second minus first; further results are compared with the first one too.

    Examples:
      ringmodal compare results/220_kPa results/250_kPa
      ringmodal compare results/monday results/tuesday --out repeatability.html --force
      ringmodal compare results/200_kPa results/220_kPa results/250_kPa
    """  # noqa: D406, D407 - a heading of the help
    with reporting_outcome(out):
        comparisons = [
            compare_folders(first, other, accept_changes=accept_changes)
            for other in (second, *(others or ()))
        ]
        if len(comparisons) == 1:
            page = write_comparison(comparisons[0], out, force=force)
        else:
            page = write_comparisons(comparisons, out, force=force)
    if as_json:
        records = [comparison_record(found) for found in comparisons]
        content = records[0] if len(records) == 1 else {"comparisons": records}
        print_json({"report": str(page), **content})
        return
    for found in comparisons:
        _show(found)
    echo(f"Report: {page}")


def _show(found: Comparison) -> None:
    """Print the changes of the modes, what is doubtful, and what was found."""
    print_table(
        " → ".join(found.names),
        COMPARISON_HEAD,
        comparison_rows(found),
        texts=("mode", "verdict", "verdict on damping"),
        folding=("verdict", "verdict on damping"),
        first_to_go=("MAC", "verdict on damping", "damping change / %", "second / Hz"),
    )
    for doubt in found.doubts:
        echo_error(f"Warning: {doubt}")
    for sentence in findings(found):
        echo(sentence)


def compare_shapes(
    result: Annotated[Path, opt.argument("RESULT", "Result folder.")],
    other: Annotated[
        Path, opt.argument("OTHER", "Universal file (55, 2414), another result, or a CSV table.")
    ],
    out: Annotated[Path | None, opt.target("Table or page", (".csv", ".html"))] = None,
    force: Annotated[bool, opt.replacing("an earlier file")] = False,
    accept_changes: opt.AcceptChanges = False,
    by: Annotated[
        str, opt.one_of(WAYS, "Match by angle or node. Default: angle if possible.", PLACES)
    ] = "",
    tolerance_deg: Annotated[
        float, opt.option("Largest difference of angles in degrees.", PLACES, "DEG")
    ] = 2.0,
    rotate_deg: Annotated[
        float, opt.option("Add this to the angles of OTHER, in degrees.", PLACES, "DEG")
    ] = 0.0,
    mirror: Annotated[
        bool, opt.flag("--mirror", "Reverse the angles of OTHER, before --rotate-deg.", PLACES)
    ] = False,
    direction: Annotated[
        str, opt.one_of(DIRECTIONS, "Motion of OTHER: radial (default), x, y or z.", PLACES)
    ] = "",
    as_json: opt.Json = False,
) -> None:
    """Compare shapes with those of a finite-element model or of another program, by MAC.

    Nodes are matched by angle around the axle, or by number; the radial motion is compared.

    Examples:
      ringmodal compare-shapes results/tyre_7 model.unv
      ringmodal compare-shapes results/tyre_7 model.unv --rotate-deg 90 --out shapes.html
    """  # noqa: D406, D407 - a heading of the help
    alignment = Alignment(by, tolerance_deg, rotate_deg, mirror, direction)
    with reporting_outcome(out or result):
        found = shapes.compare_shapes(result, other, alignment, accept_changes=accept_changes)
        if out is not None:
            is_page = out.suffix.lower() == ".html"
            require_free_file(out, force=force)
            with file_written_whole(out) as partial:
                (write_shape_comparison if is_page else shapes.write_table)(found, partial)
    if as_json:
        print_json(shapes.comparison_record(found))
        return
    title, rows = f"{found.result.name} → {found.other.name}", shapes.match_rows(found)
    go_first = ("difference / Hz", "other / Hz", "frequency / Hz")
    print_table(title, shapes.MATCH_HEAD, rows, texts=shapes.TEXTS, first_to_go=go_first)
    for note in found.notes:
        echo(f"Note: {note}.")
    if out is not None:
        echo(f"Written: {out}")
