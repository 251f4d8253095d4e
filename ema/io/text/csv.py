"""Read and write tables of text: one channel for each column, its unit beside or below its name."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from ema.core.errors import RecordingFormatError, inert
from ema.core.finding import Check, Finding
from ema.core.recording import Channel
from ema.core.units import is_stated
from ema.io.columns import Column, content_of_columns, is_time, rises_evenly
from ema.io.content import EXPORT_AGAIN, FileContent, note, remark, states_scale
from ema.io.frf_table import frf_content, has_frequency, refuse_other_lines
from ema.io.text.layout import Layout, find_layout
from ema.io.text.preamble import refuse_frequencies
from ema.io.text.source import TextSource, label, open_text
from ema.io.text.table import Cells, missing_samples, read_cells
from ema.io.uff.write import check_time_series, in_own_unit

_UNNAMED = "column 1"
# Factors of one and offsets of zero.
_IDLE = re.compile(r"(?:[01](?:[.,]0*)?(?:\s+|$))*")


def read(path: Path) -> FileContent:
    """Read the time series or FRFs of a table with a header row such as ``time [s],A01 [m/s^2]``.

    What such a table may look like is in docs/recordings.md. `RecordingFormatError` if the file is
    missing or empty, has no header, a cell is not a number, rows differ in length, the last one is
    cut short, or time is uneven.
    """
    with open_text(path) as source:
        return read_table(path, source)


def has_table(path: Path, without: re.Pattern[str] | None = None) -> bool:
    """Whether there are names above rows of numbers; False where a pattern is in the text."""
    with open_text(path) as source:
        if without is not None and without.search(source.head):
            return False
        find_layout(source)
    return True


def read_table(path: Path, source: TextSource) -> FileContent:
    """Read the table in an open text; see `read`."""
    layout = find_layout(source)
    wanted, findings = _wanted(path, layout)
    cells = read_cells(source, layout, wanted, source.sections(layout.start), findings)
    read_in = [_column(layout, index, cells.pop(index), path, findings) for index in wanted]
    columns = [column for column in read_in if column is not None]
    if not layout.names[0] and columns and columns[0].name == _UNNAMED:
        columns = _without_labels(path, columns, findings)
    if not has_frequency(columns) and not any(is_time(each.name, each.unit) for each in columns):
        columns = columns[-1:] + columns[:-1] if has_frequency(columns[-1:]) else columns
    if has_frequency(columns):
        return frf_content(path, columns, findings, layout.statements)
    refuse_other_lines(path, columns)
    refuse_frequencies(path, layout.statements)
    if sum(is_time(each.name, each.unit) for each in columns) > 1:
        columns = [replace(each, start_s=0.0) for each in columns]  # each time shows its start
    _check_scaled(path, columns, layout.statements)
    return content_of_columns(
        path, columns, rate=layout.rate, findings=findings, statements=layout.statements
    )


def _check_scaled(path: Path, columns: Sequence[Column], statements: Mapping[str, str]) -> None:
    """Refuse integers below a line that may state what scales them; an offset changes no FRF."""
    stated = {key: value for key, value in statements.items() if states_scale(label(key)[0])}
    stated = {key: value for key, value in stated.items() if "offset" not in key.lower()}
    used = {key: value for key, value in stated.items() if not _IDLE.fullmatch(value)}
    signals = [each.samples for each in columns if not is_time(each.name, each.unit)]
    if used and all(np.array_equal(each, np.rint(each), equal_nan=True) for each in signals):
        key, value = next(iter(used.items()))
        rule = "integers must be in the unit of their column"
        remedy = "Export scaled numbers; if they are, remove that line"
        raise RecordingFormatError(path.name, f"{key!r} {value!r} above integers", rule, remedy)


def _without_labels(path: Path, columns: list[Column], findings: list[Finding]) -> list[Column]:
    """Columns without a first one that has no name, unless it is an index such as time."""
    if rises_evenly(columns[0].samples):
        return columns
    findings.append(remark(path, "", Check.IGNORED, f"{_UNNAMED} has no name and is left out"))
    return columns[1:]


def _wanted(path: Path, layout: Layout) -> tuple[list[int], list[Finding]]:
    """Columns that are time or channels, and findings about the others."""
    wanted: list[int] = []
    findings: list[Finding] = []
    times = [i for i, each in enumerate(map(is_time, layout.names, layout.units)) if each]
    has_time = not layout.clocks.issuperset(times)
    for index, name in enumerate(layout.names):
        if not name and index >= layout.filled:
            continue
        if not name and index and index not in layout.clocks:
            detail = f"column {index + 1} has no name and is left out"
        elif index in layout.clocks and has_time:
            detail = "time stamps beside the time are left out"
        elif index in layout.dates:
            findings.append(note(path, Check.IGNORED, f"{name!r}: dates alone are left out"))
            continue
        else:
            wanted.append(index)
            has_time = has_time or index in layout.clocks
            continue
        findings.append(remark(path, name, Check.IGNORED, detail))
    if not wanted:
        found = f"columns {', '.join(layout.names)}"
        rule = "at least one column with a name must have numbers"
        raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    return wanted, findings


def _column(
    layout: Layout, index: int, cells: Cells, path: Path, findings: list[Finding]
) -> Column | None:
    """A column with its name and unit; None where all its cells are empty."""
    name, unit = layout.names[index] or _UNNAMED, layout.units[index]
    if index in layout.clocks:
        return Column("time", "s", cells.samples)
    if cells.n_missing == len(cells.samples):
        findings.append(remark(path, name, Check.IGNORED, "no number in any row; left out"))
        return None
    findings += missing_samples(path, name, cells)
    start_s = layout.starts_s[index] if layout.starts_s else 0.0
    return Column(name, unit, cells.samples, start_s=start_s)


def write_csv(path: Path | str, channels: Sequence[Channel], sampling_rate_hz: float) -> None:
    """Write channels that share one clock as columns under ``name [unit]``, first ``time [s]``.

    Numbers have as many digits as they need to be read back unchanged. A negative direction is
    written as negative samples, because a table has no other place for it. A name that a
    spreadsheet would take for a formula gets an apostrophe in front, which is removed on reading.
    `InputError` if there are no channels, their lengths differ, or the rate is not positive.
    """
    check_time_series(path, channels, sampling_rate_hz)
    names = ["time [s]"]
    columns = [pa.array(np.arange(channels[0].n_samples) / sampling_rate_hz)]
    for channel in channels:
        samples, unit, sense = in_own_unit(channel)
        name = " ".join(channel.name.split())
        names.append(inert(f"{name} [{unit}]" if is_stated(unit) else name))
        native = samples.astype(samples.dtype.newbyteorder("="), copy=False)
        columns.append(pa.array(native if sense > 0 else -native))
    table = pa.table(columns, names=names)
    options = pa.csv.WriteOptions(include_header=True, quoting_style="needed")
    pa.csv.write_csv(table, Path(path), options)
