"""The command line's ``ringmodal export`` and ``ringmodal compare-shapes``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipelines.cli import terminal
from pipelines.cli.interrupt import stating_what_stands
from pipelines.cli.options import FILES, AcceptChanges, Json, one_of, replacing
from pipelines.cli.terminal import columns_of, print_table
from pipelines.cli.values import choice
from pipelines.compare.shape_comparison import MATCH_HEAD, TEXTS, match_rows, write_table
from pipelines.export.modal import export as write
from pipelines.export.modal import require_free_file
from pipelines.report.shape_comparison import write_page
from pipelines.storage.atomic import file_written_whole

if TYPE_CHECKING:
    from pipelines.compare.shape_comparison import ShapeComparison

EXPORT_FORMATS = ("uff", "csv", "json", "mat")
WAYS, DIRECTIONS = ("angle", "node"), ("radial", "x", "y", "z")
FRFS = ("both", "measured", "synthesised", "none")
Result = Annotated[
    Path, typer.Argument(metavar="RESULT", help="Result folder.", show_default=False)
]
CONTENT, PLACES = "Content", "Places and directions"


def export(
    result: Result,
    file_format: Annotated[
        str,
        one_of(
            EXPORT_FORMATS,
            FILES,
            "uff (universal file), csv (a folder of tables), json or mat (MATLAB). "
            "Default: the ending of --out, or uff.",
            "--format",
        ),
    ] = "",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="PATH",
            rich_help_panel=FILES,
            help="File, or folder for csv. Default: named after the result, in the current folder.",
        ),
    ] = None,
    force: Annotated[bool, replacing("an earlier export")] = False,
    accept_changes: AcceptChanges = False,
    real: Annotated[
        bool,
        typer.Option(
            "--real", rich_help_panel=CONTENT, help="Real shapes (normal modes), not complex ones."
        ),
    ] = False,
    frfs: Annotated[
        str,
        one_of(
            FRFS,
            CONTENT,
            "FRFs that go along: both, measured, synthesised (from the modes) or none.",
        ),
    ] = "both",
    text: Annotated[
        bool,
        typer.Option(
            "--text",
            rich_help_panel=CONTENT,
            help="FRFs of a universal file as text (58), for programs without 58b.",
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """Write modes, shapes, geometry and FRFs of a result for other modal programs.

    Examples:
      ringmodal export results/tyre_7
      ringmodal export results/tyre_7 --format uff --out tyre_7.unv --real
      ringmodal export results/tyre_7 --format mat --out tyre_7.mat --frfs none
    """  # noqa: D406, D407 - a heading of the help
    with stating_what_stands(out or result):
        written = write(
            result,
            out,
            file_format,
            real=real,
            frfs=frfs,
            text=text,
            force=force,
            accept_changes=accept_changes,
        )
    found = written.export
    counts = {
        "modes": len(found.modes),
        "nodes": found.geometry.node.size,
        "frfs_measured": 0 if found.measured is None else found.measured.n_positions,
        "frfs_synthesised": 0 if found.synthesised is None else found.synthesised.n_positions,
    }
    notes = list(found.geometry.notes)
    if as_json:
        said = {"path": str(written.path), "format": written.file_format, **counts, "notes": notes}
        terminal.print_json(said)
        return
    for note in notes:
        terminal.complain(f"Note: {note}.")
    kind = "real" if found.is_real else "complex"
    terminal.say(
        f"{counts['modes']} {kind} shapes at {found.geometry.n_measured} nodes, "
        f"{counts['frfs_measured']} measured and {counts['frfs_synthesised']} synthesised FRFs"
    )
    terminal.say(f"Written: {written.path}")


def compare_shapes(
    result: Result,
    other: Annotated[
        Path,
        typer.Argument(
            metavar="OTHER",
            help="Universal file with shapes (55, 2414), another result, or a CSV table.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            rich_help_panel=FILES,
            help="Write a table (.csv) or a page (.html) too.",
        ),
    ] = None,
    force: Annotated[bool, replacing("an earlier file")] = False,
    accept_changes: AcceptChanges = False,
    by: Annotated[
        str,
        one_of(
            WAYS, PLACES, "Match places by angle or by node. Default: angle where both have angles."
        ),
    ] = "",
    tolerance_deg: Annotated[
        float,
        typer.Option(
            metavar="DEG", rich_help_panel=PLACES, help="Largest difference of angles in degrees."
        ),
    ] = 2.0,
    rotate_deg: Annotated[
        float,
        typer.Option(
            metavar="DEG",
            rich_help_panel=PLACES,
            help="Add this to the angles of OTHER, in degrees.",
        ),
    ] = 0.0,
    mirror: Annotated[
        bool,
        typer.Option(
            "--mirror",
            rich_help_panel=PLACES,
            help="Count the angles of OTHER the other way round, before --rotate-deg.",
        ),
    ] = False,
    direction: Annotated[
        str,
        one_of(
            DIRECTIONS,
            PLACES,
            "Motion of OTHER to compare: radial, x, y or z. Default: radial on a wheel.",
        ),
    ] = "",
    as_json: Json = False,
) -> None:
    """Compare shapes with those of a finite-element model or of another program, by MAC.

    Nodes are matched by angle around the axle, or by number; motion is taken radially.

    Examples:
      ringmodal compare-shapes results/tyre_7 model.unv
      ringmodal compare-shapes results/tyre_7 model.unv --rotate-deg 90 --out shapes.html
    """  # noqa: D406, D407 - a heading of the help
    from pipelines.compare.shape_comparison import compare_shapes, comparison_record
    from pipelines.compare.shape_source import Alignment

    alignment = Alignment(by, tolerance_deg, rotate_deg, mirror, direction)
    with stating_what_stands(out or result):
        found = compare_shapes(result, other, alignment, accept_changes=accept_changes)
        if out is not None:
            _write_comparison(found, out, force)
    if as_json:
        terminal.print_json(comparison_record(found))
        return
    _show(found)
    if out is not None:
        terminal.say(f"Written: {out}")


def _write_comparison(found: ShapeComparison, out: Path, force: bool) -> None:

    writers = {".csv": write_table, ".html": write_page}
    ending = choice("--out", out.suffix or "(no ending)", tuple(writers))
    require_free_file(out, force=force)
    with file_written_whole(out) as partial:
        writers[ending](found, partial)


def _show(found: ShapeComparison) -> None:

    output = terminal.screen()
    columns = columns_of(MATCH_HEAD, match_rows(found), TEXTS)
    go_first = ("difference / Hz", "other / Hz", "frequency / Hz")
    print_table(output, f"{found.result.name} → {found.other.name}", columns, go_first)
    for note in found.notes:
        output.print(terminal.printable(f"Note: {note}."), markup=False)
