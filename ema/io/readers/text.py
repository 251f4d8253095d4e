"""Read tables of text: one channel for each column, its unit in the header's square brackets."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from ema.errors import RecordingFormatError
from ema.io.columns import EXPORT_AGAIN, Column, content_of_columns, name_and_unit
from ema.io.content import FileContent

SUFFIXES = (".csv", ".tsv")
_LONGEST_HEADER = 1 << 20
_SEPARATORS = ("\t", ";", ",")
_NUMBER = re.compile(r"^[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?$")


@dataclass(frozen=True)
class _Header:
    """First line of a table: how it is written, and its cells' names and units."""

    encoding: str
    separator: str
    names: tuple[str, ...]
    units: tuple[str, ...]


def read(path: Path) -> FileContent:
    """Read the time series of a CSV file with a header row such as ``time [s],A01 [m/s^2]``.

    Columns are separated by comma, semicolon or tab; with the latter two, a decimal comma is
    understood. The rate follows from a column ``time`` or ``t``, and is NaN without one.

    Raises
    ------
    RecordingFormatError
        If the file is missing or empty, has no header, a cell is no number, or time is uneven.
    """
    header, first_row = _read_header(path)
    named = [index for index, name in enumerate(header.names) if name]
    columns = _read_columns(path, header, named, decimal_point=_decimal_point(header, first_row))
    return content_of_columns(
        path, [Column(header.names[i], header.units[i], columns[i]) for i in named]
    )


def _line(path: Path, number: int) -> str:
    return f"{path.name}, line {number}"


def _read_header(path: Path) -> tuple[_Header, str]:
    """Cells of the first line, and the second line to tell the decimal sign from."""
    try:
        with path.open("rb") as file:
            raw = file.readline(_LONGEST_HEADER)
            row = file.readline(_LONGEST_HEADER)
    except OSError as error:
        reason = error.strerror or str(error)
        rule = "it must be a file that can be read"
        raise RecordingFormatError(str(path), reason, rule, "Check name and rights") from error
    if not raw.strip() or not row:
        found = "no rows below the header" if raw.strip() else "the file is empty"
        rule = "a table begins with a header row and holds at least one row of numbers"
        raise RecordingFormatError(str(path), found, rule, EXPORT_AGAIN)
    if b"\x00" in raw:
        rule = "a table is text in UTF-8 or latin-1"
        raise RecordingFormatError(_line(path, 1), "binary data", rule, EXPORT_AGAIN)
    try:
        text, encoding = raw.decode("utf-8-sig"), "utf8"
    except UnicodeDecodeError:
        text, encoding = raw.decode("latin-1"), "latin-1"
    separator = max(_SEPARATORS, key=text.count)
    cells = [cell.strip().strip('"').strip() for cell in text.rstrip("\r\n").split(separator)]
    if any(_NUMBER.match(cell) for cell in cells):
        found = f"no header: {cells[0][:20]!r} …"
        rule = "the first line names each column, its unit in square brackets"
        raise RecordingFormatError(_line(path, 1), found, rule, "Add a header line")
    names, units = zip(*(name_and_unit(cell) for cell in cells), strict=True)
    return _Header(encoding, separator, names, units), row.decode("latin-1")


def _decimal_point(header: _Header, row: str) -> str:
    return "," if header.separator != "," and "," in row and "." not in row else "."


def _read_columns(
    path: Path, header: _Header, wanted: list[int], *, decimal_point: str
) -> dict[int, NDArray[np.float64]]:
    labels = [str(index) for index in range(len(header.names))]
    chosen = [labels[index] for index in wanted]
    try:
        table = pa.csv.read_csv(
            path,
            read_options=pa.csv.ReadOptions(
                column_names=labels, skip_rows=1, encoding=header.encoding
            ),
            parse_options=pa.csv.ParseOptions(delimiter=header.separator),
            convert_options=pa.csv.ConvertOptions(
                column_types=dict.fromkeys(chosen, pa.float64()),
                include_columns=chosen,
                null_values=[],
                decimal_point=decimal_point,
            ),
        )
    except (pa.ArrowInvalid, pa.ArrowKeyError) as error:
        rule = f"each of the {len(labels)} columns holds a number in every row"
        raise RecordingFormatError(path.name, str(error), rule, EXPORT_AGAIN) from error
    if not table.num_rows:
        rule = "a table holds at least one row of numbers"
        raise RecordingFormatError(path.name, "blank rows only", rule, EXPORT_AGAIN)
    columns = {}
    for index, label in zip(wanted, chosen, strict=True):
        samples = table.column(label).to_numpy()
        samples.setflags(write=False)
        columns[index] = samples
    return columns
