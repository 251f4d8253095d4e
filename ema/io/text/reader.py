"""Read tables of text: one channel for each column, its unit beside or below its name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ema.core.errors import RecordingFormatError
from ema.core.finding import Finding
from ema.io.columns import Column, content_of_columns, is_time
from ema.io.content import EXPORT_AGAIN, FileContent, remark
from ema.io.text.layout import Layout, find_layout
from ema.io.text.source import open_text, time_unit
from ema.io.text.table import Cells, missing_samples, read_cells

SUFFIXES = (".csv", ".tsv", ".csv.gz", ".tsv.gz")
NAMED_SUFFIXES = (".txt", ".asc", ".dat", ".txt.gz")


def read(path: Path) -> FileContent:
    """Read the time series of a table with a header row such as ``time [s],A01 [m/s^2]``.

    Columns are separated by comma, semicolon, tab, bar or blanks, with a decimal point or comma;
    the text is UTF-8, UTF-16 with a byte-order mark, or latin-1, and may be packed by gzip. Up to
    200 lines of other text may stand above the names, and units in a row below them. The rate
    follows from a column of time in s or of time stamps, from a line above the names such as
    ``Sampling rate: 2 kHz``, or from both, which then agree; it is NaN without either.
    Cells that are empty or say ``NaN`` are samples that are missing.

    Raises
    ------
    RecordingFormatError
        If the file is missing or empty, has no header, a cell is no number, rows differ in
        length, the last one is cut short, or time is uneven.
    """
    with open_text(path) as source:
        layout = find_layout(source)
        wanted, findings = _wanted(path, layout)
        cells = read_cells(source, layout, wanted, source.sections(layout.start))
    columns = [_column(layout, index, cells.pop(index), path, findings) for index in wanted]
    content = content_of_columns(
        path, [column for column in columns if column is not None], rate_hz=layout.rate_hz
    )
    return replace(content, findings=(*findings, *content.findings))


def _wanted(path: Path, layout: Layout) -> tuple[list[int], list[Finding]]:
    """Columns that are time or channels; which others are left out."""
    wanted: list[int] = []
    findings: list[Finding] = []
    headings = list(zip(layout.names, map(time_unit, layout.names, layout.units), strict=True))
    has_time = any(
        is_time(*heading) for i, heading in enumerate(headings) if i not in layout.clocks
    )
    for index, name in enumerate(layout.names):
        if not name and index >= layout.filled:
            continue
        if not name:
            detail = f"column {index + 1} has no name and is left out"
        elif index in layout.clocks and has_time:
            detail = "time stamps beside the time are left out"
        else:
            wanted.append(index)
            has_time = has_time or index in layout.clocks
            continue
        findings.append(remark(path, name, "ignored", detail))
    if not wanted:
        found = f"columns {', '.join(layout.names)}"
        rule = "at least one column with a name holds numbers"
        raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    return wanted, findings


def _column(
    layout: Layout, index: int, cells: Cells, path: Path, findings: list[Finding]
) -> Column | None:
    """A column with its name and unit; None where all its cells are empty."""
    name, unit = layout.names[index], layout.units[index]
    if index in layout.clocks:
        return Column("time", "s", cells.samples)
    if cells.n_missing == len(cells.samples):
        detail = "no number in any row; the column is left out"
        findings.append(remark(path, name, "ignored", detail))
        return None
    findings += missing_samples(path, name, cells)
    return Column(name, time_unit(name, unit), cells.samples)
