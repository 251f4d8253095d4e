"""``ringmodal compare``, ``batch`` and ``export``: results side by side, and for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ema.io.uff.reader import SYNTHESISED
from pipelines.batch.run import Batch, campaign_rows, run_batch
from pipelines.batch.state import Record
from pipelines.cli import options as opt
from pipelines.cli.screen import print_table, shown
from pipelines.cli.streams import Interrupted, reporting_outcome
from pipelines.cli.terminal import echo, echo_error, print_json
from pipelines.compare import shape_comparison as shapes
from pipelines.compare.compare import Comparison, compare_folders
from pipelines.compare.shape_source import Alignment
from pipelines.compare.summary import COMPARISON_HEAD, comparison_record, comparison_rows, findings
from pipelines.export.data import MEASURED
from pipelines.export.modal import export as write
from pipelines.report.comparison import write_comparison, write_comparisons, write_shape_comparison
from pipelines.report.page import read_template
from pipelines.results.options import Options, Units
from pipelines.storage.atomic import file_written_whole, require_free_file

WAYS, DIRECTIONS = ("angle", "node"), ("radial", "x", "y", "z")
PLACES = "Positions and directions"
MACHINES = "Machines"


def compare(
    first: Annotated[Path, opt.argument("FIRST", "Folder of a result, the one to compare with.")],
    second: Annotated[Path, opt.argument("SECOND", "Folder of another result.")],
    others: Annotated[
        list[Path] | None, opt.argument("[MORE…]", "Further results, compared with the first.")
    ] = None,
    out: Annotated[Path, opt.target("Page", (".html",))] = Path("comparison.html"),
    force: Annotated[bool, opt.replacing("an earlier page")] = False,
    accept_changes: opt.AcceptChanges = False,
    units: opt.UnitSystem = None,
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
            compare_folders(first, other, accept_changes=accept_changes, units=units or Units.LAB)
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
        _show(found, " → ".join(found.names) + ": " if len(comparisons) > 1 else "")
    echo(f"Report: {page}")


def _show(found: Comparison, which: str) -> None:
    """Print the changes of the modes, what is doubtful, and what was found.

    Warnings go to another stream than their table, and say `which` comparison they are of.
    """
    print_table(
        " → ".join(found.names),
        COMPARISON_HEAD,
        comparison_rows(found),
        texts=("mode", "verdict", "verdict on damping"),
        folding=("verdict", "verdict on damping"),
        first_to_go=("MAC", "verdict on damping", "damping change / %", "second / Hz"),
    )
    for doubt in found.doubts:
        echo_error(f"Warning: {which}{doubt}")
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


@opt.with_processing_options
def batch(
    root: Annotated[Path, opt.argument("ROOT", "Folder with campaigns, at any depth.")],
    out: Annotated[
        Path, opt.option("Folder for results and tables; a later run continues.", opt.FILES, "DIR")
    ],
    options: Options,
    jobs: Annotated[
        int | None, opt.option("Worker processes. Default: one per core.", MACHINES, "N", min=1)
    ] = None,
    scheduler: Annotated[
        str | None,
        opt.option(
            "Scheduler of a Dask cluster, tls://HOST:PORT, instead of --jobs. Without TLS, anyone "
            "who reaches its port can run code in its workers and in this batch.",
            MACHINES,
            "ADDRESS",
        ),
    ] = None,
    allow_unencrypted: Annotated[
        bool, opt.flag("--allow-unencrypted", "Allow a --scheduler without TLS.", MACHINES)
    ] = False,
    reports: Annotated[
        bool,
        opt.flag("--reports", "Write a report.html for each campaign; takes longer.", opt.FILES),
    ] = False,
    retry_failed: Annotated[
        bool,
        opt.flag("--retry-failed", "Retry campaigns that failed and have not changed.", opt.FILES),
    ] = False,
    template: opt.Template = None,
    units: opt.UnitSystem = None,
    as_json: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Process every campaign under a folder, and collect modes and parameters.

    A campaign that cannot be processed becomes a row with its message. The same command again
    processes only what is new or changed. Ends with code 1 if any campaign failed.

    Examples:
      ringmodal batch measurements/2025 --out results/2025
      ringmodal batch measurements --out results --jobs 4 --reports
      ringmodal batch measurements --out results --scheduler tls://node1:8786
    """  # noqa: D406, D407 - a heading of the help
    n_finished = 0
    with shown(quiet=quiet) as progress:

        def finished(record: Record, done: int, total: int) -> None:
            nonlocal n_finished
            n_finished = done
            progress.step(done, total)
            progress.line(_outcome(record))

        progress.stage("Processing campaigns …")
        try:
            found = run_batch(
                root,
                out,
                options,
                jobs=jobs,
                scheduler=scheduler,
                allow_unencrypted=allow_unencrypted,
                reports=reports,
                template=read_template(template, units),
                retry_failed=retry_failed,
                finished=finished,
                announce=progress.line,
            )
        except Interrupted as interrupted:
            interrupted.outcome = (
                f"{n_finished} campaigns of this run are complete; the same command again "
                "processes the others"
            )
            raise
    if as_json or not quiet:
        _show_batch(found, as_json=as_json)
    if found.failed:
        raise typer.Exit(1)


def _outcome(record: Record) -> str:
    if not record.is_done:
        return f"{record.campaign}: failed. {record.message}"
    warnings = f", {record.n_warnings} warnings" if record.n_warnings else ""
    return f"{record.campaign}: {len(record.modes)} modes{warnings}, {record.seconds:.1f} s"


def _show_batch(found: Batch, *, as_json: bool) -> None:
    counts = {
        "done": found.count(done=True, fresh=True),
        "failed": found.count(done=False, fresh=True),
        "already_done": found.count(done=True, fresh=False),
        "failed_before": found.count(done=False, fresh=False),
    }
    if as_json:
        rows = campaign_rows(found.records)
        print_json({"out": str(found.folder.path), **counts, "campaigns": rows})
        return
    text = f"{counts['done']} done, {counts['failed']} failed (see {found.folder.summary})"
    text += f", {counts['already_done']} already done"
    if counts["failed_before"]:
        text += f", {counts['failed_before']} failed before (use --retry-failed to retry them)"
    echo(text if counts["done"] or counts["failed"] else f"Nothing to do: {text}")


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
