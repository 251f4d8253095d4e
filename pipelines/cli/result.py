"""The command line from recordings to a result: ``process``, ``tune``, ``report``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ema.core.errors import InputError
from pipelines.cli import show_result, terminal, values
from pipelines.cli.interrupt import stating_what_stands
from pipelines.cli.options import (
    AcceptChanges,
    Figures,
    Force,
    Given,
    Json,
    NoReport,
    Objective,
    Out,
    Pdf,
    Quiet,
    ResultFolder,
    Strict,
    replacing,
    with_processing_options,
)
from pipelines.cli.progress import shown
from pipelines.process.run import process as run
from pipelines.process.run import retune
from pipelines.report.figure_files import write_figures
from pipelines.report.paper import printing_library
from pipelines.report.save import PDF, has_pdf, save
from pipelines.storage.result_folder import require_free

if TYPE_CHECKING:
    from pipelines.results.options import Options
    from pipelines.results.result import Result


@with_processing_options
def process(
    campaign: Annotated[
        list[Path],
        typer.Argument(
            metavar="CAMPAIGN…", help="Campaign folder, its campaign.toml, or recordings."
        ),
    ],
    out: Out,
    options: Options,
    no_report: NoReport = False,
    figures: Figures = None,
    pdf: Pdf = False,
    force: Force = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Recordings → FRFs → poles → modes → ring parameters → validation → report.

    Examples:
      ringmodal process measurements/tyre_7 --out results/tyre_7
      ringmodal process config_1.uff config_2.uff --out result
      ringmodal process tyre_7 --out result --band-hz 40 300 --max-order 80
      ringmodal process tyre_7 --out result --pin 78.7,100.3,121.4 --force
      ringmodal process tyre_7 --out result --given mass_per_area_kg_m2=19.7
      ringmodal process tyre_7 --out result --pdf --figures pictures
    """  # noqa: D406, D407 - a heading of the help
    source = campaign[0] if len(campaign) == 1 else campaign
    with stating_what_stands(out):
        require_free(out, force=force)
        require_pictures(figures, out, force=force)
        require_pdf(pdf=pdf)
        with shown(quiet=quiet) as progress:
            result = run(source, options, progress.stage, progress.step)
            progress.stage("Writing the result …")
            save(result, out, report=not no_report, pdf=pdf, force=force)
            if figures is not None:
                progress.stage("Drawing the figures …")
                _draw(result, figures, force=force)
        show_result.show(result, out, as_json=as_json, report=not no_report)


def tune(
    result_folder: ResultFolder,
    objective: Objective = "frequency",
    given: Given = None,
    no_report: NoReport = False,
    strict: Strict = False,
    accept_changes: AcceptChanges = False,
    as_json: Json = False,
) -> None:
    """Determine the ring's parameters again, from the modes of an earlier result.

    Examples:
      ringmodal tune result --objective paper
      ringmodal tune result --given mass_per_area_kg_m2=19.7
    """  # noqa: D406, D407 - a heading of the help
    objective = values.choice("--objective", objective, values.OBJECTIVES)
    known = values.ring_parameters("--given", given)
    with stating_what_stands(result_folder):
        result = retune(
            result_folder, objective, known, strict=strict, accept_changes=accept_changes
        )
        pdf = has_pdf(result_folder) and not no_report
        save(result, result_folder, report=not no_report, pdf=pdf, force=True)
        show_result.show(result, result_folder, as_json=as_json, report=not no_report)


def report(
    result_folder: ResultFolder,
    figures: Figures = None,
    pdf: Pdf = False,
    force: Annotated[bool, replacing("earlier figures")] = False,
    accept_changes: AcceptChanges = False,
    as_json: Json = False,
) -> None:
    """Write the report of an earlier result again, as HTML and where wanted as PDF.

    Examples:
      ringmodal report result
      ringmodal report result --pdf --figures pictures
    """  # noqa: D406, D407 - a heading of the help
    pdf = pdf or has_pdf(result_folder)
    with stating_what_stands(result_folder):
        require_pictures(figures, result_folder, force=force)
        require_pdf(pdf=pdf)

        result = retune(result_folder, accept_changes=accept_changes)
        save(result, result_folder, pdf=pdf, force=True)
        if figures is not None:
            _draw(result, figures, force=force)
    if as_json:
        terminal.print_json(show_result.summary(result, result_folder, report=True))
        return
    terminal.say(f"Report: {result_folder / show_result.REPORT}")
    if pdf:
        terminal.say(f"PDF: {result_folder / PDF}")


def _draw(result: Result, folder: Path, *, force: bool) -> None:

    write_figures(result, folder, force=force)


def require_pictures(figures: Path | None, result_folder: Path, *, force: bool) -> None:
    """Refuse a folder for figures before an hour of processing, not after.

    Raises
    ------
    InputError
        If it lies in the result's own folder, or holds pictures and may not be replaced.
    """
    if figures is None:
        return
    if figures.resolve().is_relative_to(result_folder.resolve()):
        raise InputError(
            f"--figures {figures}",
            "inside the result's folder",
            "that holds the files of the result alone",
            "Choose a folder beside it",
        )
    if not force and any(any(figures.glob(f"*.{ending}")) for ending in ("png", "svg")):
        raise InputError(
            f"--figures {figures}",
            "earlier pictures",
            "already exist",
            "Choose another folder, or replace them with --force",
        )


def require_pdf(*, pdf: bool) -> None:
    """Refuse to make a PDF where what prints it is missing.

    Raises
    ------
    InputError
        Says what to install.
    """
    if not pdf:
        return

    printing_library("--pdf")
