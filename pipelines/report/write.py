"""Write the report and the whole result folder."""

from __future__ import annotations

import logging
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import asdict, replace
from importlib import import_module
from io import BytesIO
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ema.core.errors import InputError, require_type, visible
from ema.core.modes import ModalModel
from ema.core.numerics import one_blas_thread
from pipelines.export.data import write_workbook
from pipelines.plots.chart import Chart, Drawn
from pipelines.process.validate import ring_orders
from pipelines.report import by_hand, identification, measurement, responses, ring, summary
from pipelines.report.page import (
    PLAIN,
    Alone,
    Beside,
    Block,
    Paragraph,
    Picture,
    Section,
    Table,
    Template,
    drawings,
    render_page,
)
from pipelines.results import tables
from pipelines.results.edits_file import EDITS_NAME, record_of, write_edits
from pipelines.results.parameter_set import ParameterSet, from_tuning, write_parameter_set
from pipelines.results.provenance import OPTIONAL_READ_BACK, READ_BACK, relative_to, with_inputs_at
from pipelines.results.result import Result
from pipelines.results.store import write_identification, write_measured
from pipelines.results.tables import short
from pipelines.results.verdict import MeasuredOrder
from pipelines.storage.atomic import (
    MARKER,
    file_written_whole,
    not_written,
    require_free_file,
    written_whole,
)
from pipelines.storage.checksums import ACCEPTED, write_marker
from pipelines.storage.tables import write_csv, write_parquet

STYLE = Path(__file__).parent / "paper.css"
MOST_FOLDED_ROWS = 30  # of a table that is folded on the screen: longer ones are not printed
STILL, MOVING = ("png", "svg"), "gif"
INSTALL = (
    'Install it with pip install "weasyprint>=68"; it needs the library Pango as well: on Windows '
    "from MSYS2 (pacman -S mingw-w64-ucrt-x86_64-pango), on macOS brew install pango, on Debian "
    "and Ubuntu apt install libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0. Without it, "
    "open the HTML report and print it to a PDF"
)


def report_sections(result: Result, template: Template = PLAIN) -> tuple[Section, ...]:
    """All sections of the report in their order."""
    units = template.units
    return (
        summary.summary(result, units),
        measurement.identity(result, template),
        measurement.setup(result),
        measurement.quality(result),
        identification.stability(result),
        identification.modes(result),
        *identification.references(result),
        *by_hand.changed_by_hand(result),
        responses.responses(result),
        identification.shapes(result),
        ring.validation(result),
        ring.parameters(result, units),
        summary.warnings(result),
        summary.origin(result),
        summary.definitions(result),
    )


def render_report(result: Result, template: Template = PLAIN) -> str:
    """Render a result as one HTML page with styles, scripts and pictures inside."""
    template = _completed(template, result)
    sections = report_sections(result, template)
    return render_page(template.title, subject_of(result), sections, template)


def _completed(template: Template, result: Result) -> Template:
    return template if result.tyre is None else template.completed(result.tyre.details)


def subject_of(result: Result) -> str:
    """What the report is about: the tyre, or the campaign of a structure."""
    return result.tyre.designation if result.tyre is not None else result.name


def write_report(result: Result, path: str | Path, template: Template = PLAIN) -> Path:
    """Write the report to `path` and return it; a template adds texts, a logo and units.

    Examples
    --------
    >>> import ringmodal as rm
    >>> rm.write_report(rm.retune("result"), "report.html").name
    'report.html'
    """
    target = Path(path)
    target.write_text(render_report(result, template), encoding="utf-8")
    return target


def write_pdf(result: Result, path: str | Path, template: Template = PLAIN) -> Path:
    """Write the report as PDF, A4, with a line for the signature, and return `path`.

    Parameters
    ----------
    result : Result
    path : path
        Written atomically; an earlier file is replaced.
    template : Template
        Texts, logo and units of a laboratory.

    Raises
    ------
    InputError
        Where WeasyPrint or what it needs is not installed, or the file cannot be written.
    """
    target = Path(path)
    weasyprint = printing_library(str(target))
    template = _completed(template, result)
    sections = tuple(map(_for_paper, report_sections(result, template)))
    page = render_page(template.title, subject_of(result), sections, template)
    # Everything is inside the page: no other address is fetched.
    inside = weasyprint.URLFetcher(allowed_protocols=["data"])
    document = weasyprint.HTML(string=page, url_fetcher=inside)
    sheets = [
        weasyprint.CSS(filename=STYLE),
        weasyprint.CSS(string=_running_texts(result, template)),
    ]
    with file_written_whole(target) as partial:
        partial.write_bytes(document.write_pdf(stylesheets=sheets, pdf_tags=True))
    return target


def printing_library(where: str) -> Any:
    """Load WeasyPrint; `where` is the file or option that needs it, for the message.

    A library that WeasyPrint needs in turn is missed as an OSError.
    """
    # It warns of every rule for the screen in the page's style.
    logging.getLogger("weasyprint").setLevel(logging.CRITICAL)
    try:
        return import_module("weasyprint")
    except (ImportError, OSError) as error:
        found = f"no PDF can be made ({str(error).splitlines()[0]})"
        raise InputError(where, found, "WeasyPrint makes it", INSTALL) from error


def write_figures(
    result: Result, folder: str | Path, formats: Sequence[str] = STILL, *, force: bool = False
) -> list[Path]:
    """Write each figure of the report as files, such as ``stability.png``.

    Parameters
    ----------
    result : Result
    folder : path
        Made where it is missing; other files in it stay.
    formats : sequence of {"png", "svg", "gif"}
        PNG with 300 dots per inch; texts in SVG stay texts. GIF has each shape on a tyre that
        moves (``shape-1.gif``), where the positions are a circle.
    force : bool
        Replace existing files of the same names.

    Returns
    -------
    list of Path
        The files, figure by figure in the order of the report.

    Raises
    ------
    InputError
        For an unknown format, for a file that exists without `force`, and where nothing can be
        written.
    """
    target = Path(folder)
    for name in formats:
        if name not in (*STILL, MOVING):
            known = f"known are {', '.join((*STILL, MOVING))}"
            raise InputError("figures", f"format {name!r}", known, "Choose one of them")
    still = [ending for ending in formats if ending != MOVING]
    figures = drawings(report_sections(result)) if still else ()
    model = result.modal_model
    on_circle = MOVING in formats and bool(np.isfinite(model.position_deg).all())
    shapes = {target / f"shape-{k}.gif": m for k, m in enumerate(model.modes, 1) if on_circle}
    paths = [target / f"{figure.name}.{ending}" for figure in figures for ending in still]
    paths += shapes
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise not_written(target, error) from error
    # Refused before the first figure is drawn, not after half of them are replaced.
    for path in paths:
        require_free_file(path, force=force)
    # Loads matplotlib, which the page does without; the checks come first.
    from pipelines.plots.figures import write_figure, write_shape_gif

    for figure in figures:
        drawn = figure.draw()
        for ending in still:
            write_figure(target / f"{figure.name}.{ending}", drawn)
    for path, mode in shapes.items():
        with file_written_whole(path) as partial:
            write_shape_gif(mode, model.position_deg, partial)
    return paths


def _for_paper(section: Section) -> Section:
    """The section without anything that moves; wide pictures get a row each."""
    blocks: list[Block] = []
    for block in section.blocks:
        beside = block.blocks if isinstance(block, Beside) else (block,)
        still = [each for one in beside for each in _still(one)]
        wide = [one for one in still if isinstance(one, Picture) and one.wide]
        narrow = tuple(one for one in still if one not in wide)
        blocks += [*wide, Beside(narrow)] if narrow and isinstance(block, Beside) else still
    return replace(section, blocks=tuple(blocks))


def _still(block: Alone) -> tuple[Alone, ...]:
    """A block in print: what needs a script as pictures, a long table that is folded named."""
    if isinstance(block, Drawn):
        return tuple(map(_picture, block.printed()))
    if isinstance(block, Table) and block.folded and len(block.rows) > MOST_FOLDED_ROWS:
        return (Paragraph(f"{block.caption}: the {len(block.rows)} rows are in the HTML report."),)
    return (block,)


def _picture(drawing: Chart) -> Picture:
    buffer = BytesIO()
    drawing.draw().savefig(buffer, format="svg")
    source = "data:image/svg+xml;base64," + b64encode(buffer.getvalue()).decode("ascii")
    return Picture(source, drawing.alternative, drawing.caption, drawing.wide)


def _running_texts(result: Result, template: Template) -> str:
    """Style with the texts at the head and foot of each page."""
    version = result.provenance.get("software", {}).get("ringmodal", "")
    number = f" – {short(template.report_number, 30)}" if template.report_number else ""
    texts = {
        "top-left": f"{short(template.title, 40)}{number} – {short(subject_of(result), 60)}",
        "top-right": str(result.provenance.get("created", ""))[:10],
        "bottom-left": f"ringmodal {version}".strip(),
    }
    boxes = (f"@{place} {{ content: {_quoted(text)} }}" for place, text in texts.items())
    return f"@page {{ {' '.join(boxes)} }}"


def _quoted(text: Any) -> str:
    """A text as CSS writes it: nothing in it is taken for style."""
    return '"' + "".join(f"\\{ord(character):06x}" for character in visible(text)) + '"'


PDF, WORKBOOK = "report.pdf", "result.xlsx"


@one_blas_thread
def save(
    result: Result,
    folder: Path | str,
    *,
    report: bool = True,
    pdf: bool = False,
    xlsx: bool = False,
    force: bool = False,
    template: Template = PLAIN,
) -> None:
    """Write a result folder as the contract describes it.

    Parameters
    ----------
    result : Result
    folder : path
        Written atomically.
    report : bool
        Whether to write ``report.html``.
    pdf : bool
        Whether to write ``report.pdf`` too.
    xlsx : bool
        Whether to write ``result.xlsx`` too, the tables for Excel; needs openpyxl.
    force : bool
        Replace an existing result.
    template : Template
        Texts, logo and units of the report.

    Raises
    ------
    InputError
        If the folder exists and may not be replaced, or cannot be written.

    Examples
    --------
    >>> import ringmodal as rm
    >>> rm.save(rm.load("result"), "copy", report=False)
    >>> rm.load("copy")
    <Result tyre_225_55R17: 9 modes, no ring, 0 warnings>
    """
    require_type("result", result, Result, "Use process, load or retune")
    folder = Path(require_type("folder", folder, (str, Path), "Name a folder"))
    with written_whole(folder, force=force, accepted=_replaceable(result)) as partial:
        for name, table in tables.csv_tables(result).items():
            write_csv(partial / name, table)
        write_parquet(partial / "poles.parquet", tables.poles(result.diagram))
        write_measured(result, partial)
        write_identification(result, partial)
        ring = _parameter_set(result)
        if ring is not None:
            write_parameter_set(partial / "tyre.toml", ring)
        if xlsx:
            write_workbook(partial / WORKBOOK, result, ring)
        if report:
            write_report(result, partial / "report.html", template)
        if pdf:
            write_pdf(result, partial / PDF, template)
        record = with_inputs_at(result.provenance, relative_to(folder))
        if result.edits:
            write_edits(partial / EDITS_NAME, record_of(replace(result, provenance=record)))
        warnings = [asdict(finding) for finding in result.findings if not finding.is_ok]
        write_marker(partial / MARKER, {**record, "warnings": warnings})


def has(folder: Path | str, name: str) -> bool:
    """Whether a result has a `PDF` or a `WORKBOOK`: then it is written again with the others."""
    return (Path(folder) / name).is_file()


def _parameter_set(result: Result) -> ParameterSet | None:
    if result.tuning is None or result.tyre is None:
        return None
    record = result.provenance
    origin = {
        "software": f"ringmodal {record['software']['ringmodal']}",
        "created": record["created"],
        "campaign": result.name,
        "inputs": {entry["file"]: entry["sha256"] for entry in record["inputs"]},
    }
    if record.get(ACCEPTED):
        origin[ACCEPTED] = sorted(record[ACCEPTED])
    tyre = result.tyre
    parameters = from_tuning(
        tyre.designation,
        result.tuning,
        result.damping,
        origin,
        tyre.details,
        tuple(f"{each.check}: {each.detail}" for each in result.findings if not each.is_ok),
    )
    measured = replace(parameters.basis, measured=_measured_orders(result.modal_model))
    return replace(parameters, basis=measured)


def _measured_orders(model: ModalModel) -> tuple[MeasuredOrder, ...]:
    def known(std: float) -> float | None:
        return std if isfinite(std) and std > 0 else None

    return tuple(
        MeasuredOrder(
            order=each.order,
            frequency_hz=each.frequency_hz,
            damping_ratio=each.damping_ratio,
            frequency_std_hz=known(each.frequency_std_hz),
            damping_ratio_std=known(each.damping_std),
        )
        for each in ring_orders(model)
        if each.damping_ratio > 0
    )


def _replaceable(result: Result) -> dict[str, str]:
    """Checksums of changed parts that the result contains: it may replace them."""
    accepted = result.provenance.get(ACCEPTED, {})
    kept = (MARKER, *READ_BACK, *OPTIONAL_READ_BACK)
    return {name: sha for name, sha in accepted.items() if name in kept and sha}
