"""The command line's ``ringmodal export`` and ``ringmodal compare-shapes``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipelines import console
from pipelines.cli_options import FILES, Json
from pipelines.cli_values import completing
from pipelines.interrupt import stating_what_stands

EXPORT_FORMATS = ("uff", "csv", "json", "mat")
FRFS = ("both", "measured", "synthesised", "none")
CONTENT = "Content"


def export(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="Result folder.", show_default=False)
    ],
    file_format: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="NAME",
            rich_help_panel=FILES,
            autocompletion=completing(EXPORT_FORMATS),
            help="uff (universal file), csv (a folder of tables), json or mat (MATLAB). "
            "Default: the ending of --out, or uff.",
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
    force: Annotated[
        bool, typer.Option("--force", rich_help_panel=FILES, help="Replace an earlier export.")
    ] = False,
    real: Annotated[
        bool,
        typer.Option(
            "--real", rich_help_panel=CONTENT, help="Real shapes (normal modes), not complex ones."
        ),
    ] = False,
    frfs: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            rich_help_panel=CONTENT,
            autocompletion=completing(FRFS),
            help="FRFs that go along: both, measured, synthesised (from the modes) or none.",
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
    from pipelines.modal_export import export as write

    with stating_what_stands(out or result):
        written = write(
            result,
            out,
            file_format,
            real=real,
            frfs=frfs,
            text=text,
            force=force,
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
        console.print_json(said)
        return
    for note in notes:
        console.complain(f"Note: {note}.")
    kind = "real" if found.is_real else "complex"
    console.say(
        f"{counts['modes']} {kind} shapes at {found.geometry.n_measured} nodes, "
        f"{counts['frfs_measured']} measured and {counts['frfs_synthesised']} synthesised FRFs"
    )
    console.say(f"Written: {written.path}")
