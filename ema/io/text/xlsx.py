"""Read Excel workbooks: the first sheet with a table, as if it had been exported as text."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from datetime import datetime, time
from pathlib import Path
from typing import Any

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check
from ema.io.content import FileContent, check_expansion, note, reading, require
from ema.io.text import csv
from ema.io.text.source import TextSource


def read(path: Path) -> FileContent:
    """Read the table of a workbook's first sheet that has one; cells of formulas by their value.

    `RecordingFormatError` if openpyxl is not installed, the file is damaged or protected, or no
    sheet has a table.
    """
    library = require("openpyxl", path)
    with reading(path, "an Excel workbook"), path.open("rb") as file:
        _check_size(path)
        book = library.load_workbook(file, read_only=True, data_only=True)
        sheets = {sheet.title: _as_text(sheet) for sheet in book.worksheets}
        book.close()
    content, faults, others = None, [], []
    for title, text in sheets.items():
        if content is not None:
            others.append(title)
            continue
        try:
            content = csv.read_table(path, TextSource(path, io.BytesIO(text)))
        except RecordingFormatError as fault:
            faults.append(fault)
            others.append(title)
    if content is None:
        raise faults[0]
    if others:
        used = next(title for title in sheets if title not in others)
        detail = f"sheet {used!r} is read, {', '.join(others)} left out"
        findings = (*content.findings, note(path, Check.CONTENT, detail))
        content = replace(content, findings=findings)
    return content


def _check_size(path: Path) -> None:
    """Refuse a workbook that unpacks to far more than its size."""
    try:
        with zipfile.ZipFile(path) as archive:
            n_bytes = sum(each.file_size for each in archive.infolist())
    except zipfile.BadZipFile as error:
        raise ValueError(str(error)) from error
    check_expansion(path.name, path, n_bytes)


def _as_text(sheet: Any) -> bytes:
    """Rows as lines of cells between tabs, numbers with all their digits."""
    rows = sheet.iter_rows(values_only=True)
    return "\n".join("\t".join(map(_cell, row)).rstrip("\t") for row in rows).encode() + b"\n"


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime | time):
        return value.isoformat()
    return repr(value) if isinstance(value, float) else " ".join(str(value).split())
