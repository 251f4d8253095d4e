"""``ringmodal export``: a result for other modal programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ema.io.uff.reader import SYNTHESISED
from pipelines.cli import options as opt
from pipelines.cli.streams import reporting_outcome
from pipelines.cli.terminal import echo, echo_error, print_json
from pipelines.export.data import MEASURED
from pipelines.export.modal import export as write

EXPORT_FORMATS = ("uff", "xlsx", "csv", "json", "mat")
FRFS = ("both", "measured", "synthesised", "none")
CONTENT = "Content"


def export(
    result: Annotated[Path, opt.argument("RESULT", "Result folder.")],
    file_format: Annotated[
        str,
        opt.one_of(
            EXPORT_FORMATS,
            "uff (universal file), xlsx (Excel), csv (a folder of tables), json or mat (MATLAB). "
            "Default: the ending of --out, or uff.",
            opt.FILES,
            "--format",
        ),
    ] = "",
    out: Annotated[
        Path | None,
        opt.option("File, or folder for csv. Default: named after the result.", opt.FILES, "PATH"),
    ] = None,
    force: Annotated[bool, opt.replacing("an earlier export")] = False,
    accept_changes: opt.AcceptChanges = False,
    real: Annotated[
        bool, opt.flag("--real", "Real shapes (normal modes), not complex ones.", CONTENT)
    ] = False,
    frfs: Annotated[
        str,
        opt.one_of(FRFS, "FRFs: both, measured, synthesised (from the modes) or none.", CONTENT),
    ] = "both",
    text: Annotated[
        bool, opt.flag("--text", "FRFs as text (58), for programs without 58b.", CONTENT)
    ] = False,
    decimal_comma: Annotated[
        bool,
        opt.flag("--decimal-comma", "CSV with semicolons and decimal commas, for Excel.", CONTENT),
    ] = False,
    cylindrical: Annotated[
        bool,
        opt.flag("--cylindrical", "Universal file: shapes along radius, circle, axle.", CONTENT),
    ] = False,
    as_json: opt.Json = False,
) -> None:
    """Write modes, shapes, geometry and FRFs of a result for other modal programs.

    Examples:
      ringmodal export results/tyre_7
      ringmodal export results/tyre_7 --format uff --out tyre_7.unv --real
      ringmodal export results/tyre_7 --format csv --decimal-comma
      ringmodal export results/tyre_7 --format mat --out tyre_7.mat --frfs none
    """  # noqa: D406, D407 - a heading of the help
    with reporting_outcome(out or result):
        content = {"real": real, "text": text, "force": force, "accept_changes": accept_changes}
        content |= {"cylindrical": cylindrical, "decimal_comma": decimal_comma}
        written = write(result, out, file_format, frfs=frfs, **content)
    found, notes = written.export, written.export.geometry.notes
    counts = {"modes": len(found.modes), "nodes": found.geometry.node.size}
    for kind in (MEASURED, SYNTHESISED):
        counts[f"frfs_{kind}"] = sum(f.n_positions for each, _, f in found.frfs if each == kind)
    if as_json:
        about = {"path": str(written.path), "format": written.file_format}
        print_json({**about, **counts, "notes": notes})
        return
    for note in notes:
        echo_error(f"Note: {note}.")
    kind = "real" if found.is_real else "complex"
    echo(
        f"{counts['modes']} {kind} shapes at {len(set(found.geometry.row_node.tolist()))} nodes, "
        f"{counts['frfs_measured']} measured and {counts['frfs_synthesised']} synthesised FRFs"
    )
    echo(f"Written: {written.path}")
