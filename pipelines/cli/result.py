"""A result, made and shown: ``process``, ``tune``, ``report``, and their output."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated, Any

from ema.core.display import band_text, counted, value_with_std
from ema.core.errors import InputError
from ema.core.modes import Chosen
from model import TuningResult
from model.parameters import DAMPING_NAMES, RING_NAMES
from model.verdict import State
from pipelines.cli import options as opt
from pipelines.cli.screen import print_table, say, shown, warn
from pipelines.cli.streams import reporting_outcome
from pipelines.cli.terminal import echo, print_json
from pipelines.export.data import require_excel
from pipelines.process.ring import retune
from pipelines.process.run import process as run
from pipelines.report.page import read_template
from pipelines.report.write import (
    MOVING,
    PDF,
    STILL,
    WORKBOOK,
    has,
    printing_library,
    save,
    write_figures,
)
from pipelines.results.edits_file import read_edits
from pipelines.results.options import Options, Units, parameter_rows
from pipelines.results.result import Result, edit_records
from pipelines.results.verdict import judge, orders_in_doubt, ring_is_usable
from pipelines.storage.atomic import require_free
from pipelines.storage.tables import plain_rows

REPORT = "report.html"
_LOG = logging.getLogger(__name__)


@opt.with_processing_options
def process(
    campaign: Annotated[
        list[Path], opt.argument("CAMPAIGN…", "Campaign folder, its campaign.toml, or recordings.")
    ],
    out: opt.Out,
    options: Options,
    edits: Annotated[
        Path | None,
        opt.option("Decisions to replay: edits.toml of a result, or your own.", opt.FILES, "FILE"),
    ] = None,
    no_report: opt.NoReport = False,
    figures: opt.Figures = None,
    gif: opt.Gif = False,
    pdf: opt.Pdf = False,
    xlsx: opt.Xlsx = False,
    force: opt.Force = False,
    template: opt.Template = None,
    units: opt.UnitSystem = None,
    as_json: opt.Json = False,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Recordings → FRFs → poles → modes → ring parameters → validation → report.

    Examples:
      ringmodal process measurements/tyre_7 --out results/tyre_7
      ringmodal process config_1.uff config_2.uff --out result
      ringmodal process tyre_7 --out result --band-hz 40 300 --max-order 80
      ringmodal process tyre_7 --out result --pin 78.7,100.3,121.4 --force
      ringmodal process tyre_7 --out result --edits edits.toml
      ringmodal process tyre_7 --out result --given mass_per_area_kg_m2=19.7
      ringmodal process tyre_7 --out result --pdf --xlsx --figures pictures
    """  # noqa: D406, D407 - a heading of the help
    source = campaign[0] if len(campaign) == 1 else campaign
    looks = read_template(template, units)
    with reporting_outcome(out):
        require_free(out, force=force)
        _formats(figures, gif=gif)
        _require_possible(figures, out, pdf=pdf, xlsx=xlsx, force=force)
        record = () if edits is None else read_edits(edits)
        with shown(quiet=quiet) as progress:
            result = run(source, options, progress.stage, progress.step, record)
            progress.stage("Writing the result …")
            kinds = {"report": not no_report, "pdf": pdf, "xlsx": xlsx}
            save(result, out, **kinds, force=force, template=looks)
            if figures is not None:
                progress.stage("Drawing the figures …")
                write_figures(result, figures, _formats(figures, gif=gif), force=force)
        for stage, seconds in result.provenance.get("stage_seconds", {}).items():
            _LOG.info("%s took %.2f s", stage, seconds)
        told: dict[str, Any] = {"as_json": as_json, "quiet": quiet, "units": looks.units}
        show(result, out, report=not no_report, **told)


def tune(
    result_folder: opt.ResultFolder,
    objective: opt.Objective = "frequency",
    given: opt.Given = None,
    pressure_load: opt.TuningLoad = None,
    prior: opt.Prior = None,
    bounds: opt.Bounds = None,
    start: opt.Start = None,
    no_report: opt.NoReport = False,
    strict: opt.Strict = False,
    accept_changes: opt.AcceptChanges = False,
    template: opt.Template = None,
    units: opt.UnitSystem = None,
    as_json: opt.Json = False,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Determine the ring parameters again, from the modes of an earlier result.

    Examples:
      ringmodal tune result --objective paper
      ringmodal tune result --given mass_per_area_kg_m2=19.7
      ringmodal tune result --prior radial_growth_m=0.0009:0.0002
    """  # noqa: D406, D407 - a heading of the help
    objective = opt.choice("--objective", objective, opt.OBJECTIVES)
    known = opt.ring_parameters("--given", given)
    looks = read_template(template, units)
    with reporting_outcome(result_folder):
        result = retune(
            result_folder,
            objective,
            known,
            tuning=opt.tuning_table(pressure_load, prior, bounds, start),
            strict=strict,
            accept_changes=accept_changes,
        )
        pdf = has(result_folder, PDF) and not no_report
        written: dict[str, Any] = {"report": not no_report, "template": looks, "pdf": pdf}
        save(result, result_folder, xlsx=has(result_folder, WORKBOOK), force=True, **written)
        told: dict[str, Any] = {"as_json": as_json, "quiet": quiet, "units": looks.units}
        show(result, result_folder, report=not no_report, **told)


def report(
    result_folder: opt.ResultFolder,
    figures: opt.Figures = None,
    gif: opt.Gif = False,
    pdf: opt.Pdf = False,
    xlsx: opt.Xlsx = False,
    force: Annotated[bool, opt.replacing("earlier figures")] = False,
    accept_changes: opt.AcceptChanges = False,
    template: opt.Template = None,
    units: opt.UnitSystem = None,
    as_json: opt.Json = False,
    quiet: opt.Quiet = False,
) -> None:
    """Write the report of an earlier result again, as HTML and optionally as PDF.

    Examples:
      ringmodal report result
      ringmodal report result --pdf --figures pictures
      ringmodal report result --template laboratory.toml --units lab
    """  # noqa: D406, D407 - a heading of the help
    looks = read_template(template, units)
    pdf, xlsx = pdf or has(result_folder, PDF), xlsx or has(result_folder, WORKBOOK)
    with reporting_outcome(result_folder):
        _formats(figures, gif=gif)
        _require_possible(figures, result_folder, pdf=pdf, xlsx=xlsx, force=force)
        result = retune(result_folder, accept_changes=accept_changes)
        save(result, result_folder, pdf=pdf, xlsx=xlsx, force=True, template=looks)
        if figures is not None:
            write_figures(result, figures, _formats(figures, gif=gif), force=force)
    if as_json:
        print_json(_summary(result, result_folder, report=True))
    elif not quiet:
        _say_files(result_folder, report=True)


def _formats(figures: Path | None, *, gif: bool) -> tuple[str, ...]:
    """Formats of the figures; `gif` goes into their folder."""
    if gif and figures is None:
        raise InputError("--gif", "no --figures", "GIFs go into its folder", "Add --figures DIR")
    return (*STILL, MOVING) if gif else STILL


def _require_possible(
    figures: Path | None, result_folder: Path, *, pdf: bool, xlsx: bool, force: bool
) -> None:
    """Check before the processing that figures, PDF and workbook can be written after it."""
    if figures is not None:
        where = f"--figures {figures}"
        if figures.resolve().is_relative_to(result_folder.resolve()):
            rule = "that folder holds only the files of the result"
            raise InputError(where, "inside the result's folder", rule, "Use a folder beside it")
        if not force and any(any(figures.glob(f"*.{ending}")) for ending in ("png", "svg")):
            remedy = "Choose another folder, or use --force to replace them"
            raise InputError(where, "earlier pictures", "they already exist", remedy)
    if pdf:
        printing_library("--pdf")
    if xlsx:
        require_excel()


def show(
    result: Result,
    folder: Path,
    *,
    as_json: bool,
    report: bool,
    quiet: bool = False,
    units: Units = Units.LAB,
) -> None:
    """Print tables, verdict and files of a result; its warnings go to standard error."""
    if as_json:
        print_json(_summary(result, folder, report=report))
    if as_json or quiet:
        return
    overall = judge(result)
    _show_modes(result)
    if (tuning := result.tuning) is not None and ring_is_usable(result):
        rows = parameter_rows(tuning.ring, tuning, RING_NAMES, units)
        if (damping := result.damping) is not None:
            rows += parameter_rows(damping.damping, damping, DAMPING_NAMES, units)
        cells = [(f"{title} {symbol}", *others) for title, symbol, *others in rows]
        head = ("ring parameter", "value", "unit", "obtained")
        title = f"Ring parameters, pressure as {tuning.pressure_load} load"
        print_table(title, head, cells, texts=("ring parameter", "unit", "obtained"))
    for remark in overall.remarks:
        if remark.state is State.GOOD:
            _LOG.info("Note: %s", remark.text)
        else:
            warn(remark.text)
    for note in result.notes:
        _LOG.info("Note: %s", note)
    say(f"Verdict: {overall.line}")
    if result.edits:
        replayed = result.provenance.get("replayed")
        compared = f", against its record: {replayed}" if replayed else ""
        echo(f"Decided by hand: {counted(len(result.edits), 'decision')}{compared}")
    echo(f"Result: {folder}")
    _say_files(folder, report=report)


def _say_files(folder: Path, *, report: bool) -> None:
    if report:
        echo(f"Report: {folder / REPORT}")
    for title, name in (("PDF", PDF), ("Excel", WORKBOOK)):
        if has(folder, name):
            echo(f"{title}: {folder / name}")


def _show_modes(result: Result) -> None:
    rows = []
    for number, m in enumerate(result.modal_model.modes, 1):
        frequency = value_with_std(m.frequency_hz, m.frequency_std_hz)
        damping = value_with_std(100 * m.damping_ratio, 100 * m.damping_std)
        order, purity = "", ""
        if m.order is not None and not orders_in_doubt(result):
            order, purity = f"{m.order}{m.member}", f"{m.order_purity:.3f}"
        chosen = "" if m.chosen is Chosen.AUTOMATIC else m.chosen.value
        rows.append(
            (str(number), order, frequency, damping, purity, m.pair.value, chosen, m.status)
        )
    head = ("mode", "order", "frequency / Hz", "damping / %", "purity", "pair", "chosen", "status")
    looks: dict[str, Any] = {
        "texts": head[5:],
        "folding": head[5:],
        "first_to_go": ("purity", "mode"),
    }
    # modes.csv has the columns that a narrow screen leaves out.
    title = f"Modes of {result.name}, {band_text(result.modal_model.band_hz)}"
    print_table(title, head, rows, **looks)


def _ring(tuning: TuningResult) -> dict[str, dict[str, Any]]:
    return {
        name: {"value": getattr(tuning.ring, name), "how": how, "std": tuning.std.get(name)}
        for name, how in tuning.how.items()
    }


def _summary(result: Result, folder: Path, *, report: bool) -> dict[str, Any]:
    """Content of ``--json``."""
    table, overall = result.modal_model.to_columns(), judge(result)
    return {
        "result": str(folder),
        "report": str(folder / REPORT) if report else None,
        "pdf": str(folder / PDF) if has(folder, PDF) else None,
        "xlsx": str(folder / WORKBOOK) if has(folder, WORKBOOK) else None,
        "modes": [dict(zip(table, row, strict=True)) for row in plain_rows(table)],
        "ring": {} if result.tuning is None else _ring(result.tuning),
        "overall": {
            "state": overall.state.value,
            "line": overall.line,
            "remarks": [remark.text for remark in overall.remarks],
        },
        "verdict": None if result.tuning is None else result.tuning.verdict.state.value,
        "warnings": [f.detail for f in result.findings if not f.is_ok],
        "notes": list(result.notes),
        "edits": edit_records(result.edits),
        "replayed": result.provenance.get("replayed"),
    }
