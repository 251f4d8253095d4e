"""The formats that can be read, each a module of `ema.io`; docs/dev/adding.md adds one."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check
from ema.io import arrow, hdf5, matlab, tdms, wav
from ema.io.content import COPY_AGAIN, FileContent, note, refuse_result, unreadable
from ema.io.text import csv, lvm, xlsx
from ema.io.uff import reader as uff

Reader = Callable[[Path], FileContent]

FORMATS = (arrow, csv, hdf5, lvm, matlab, tdms, uff, wav, xlsx)
READERS = {ending: module for module in FORMATS for ending in module.SUFFIXES}
_NAMED = {end: module for module in FORMATS for end in getattr(module, "NAMED_SUFFIXES", ())}
_KNOWN = READERS | _NAMED
_HEAD_BYTES = 512
# What files of a format begin with, whatever their name ends in.
_BEGINNINGS = [
    (rb"(?:\s*\n)?    -1\s*\n\s*[0-9]{2,4}b?\s", uff),
    (rb"LabVIEW Measurement", lvm),
    (rb"PK\x03\x04.{26}(?:\[Content_Types\]\.xml|xl/|_rels/|docProps/)", xlsx),
    (rb"\x89HDF\r\n\x1a\n", hdf5),
    (rb"MATLAB 5\.0 MAT-file", matlab),
    (rb"TDSm", tdms),
    (rb"(?:RIFF|RF64).{4}WAVE", wav),
    (rb"PAR1|ARROW1", arrow),
]
_BEGIN = [(re.compile(start, re.DOTALL), module) for start, module in _BEGINNINGS]
# Lines of damaged universal files and LabVIEW files, which are no tables.
_MARKS = re.compile(r"^[ \t]*-1[ \t\r]*$|^\*\*\*End|LabVIEW", re.MULTILINE)
_OLD_WORKBOOK = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"


def is_recording(path: Path) -> bool:
    """Whether the ending of the name is one of a known format."""
    return path.name.lower().endswith(tuple(READERS))


def is_text_table(path: Path) -> bool:
    """Whether a file of an ending that is too common for recordings holds a table."""
    if not path.name.lower().endswith(tuple(_NAMED)):
        return False
    try:
        return _by_content(path, _head(path)) is not None or csv.has_table(path)
    except RecordingFormatError:
        return False


def exists(path: Path) -> bool:
    """Whether there is such a file or folder; False also for a name that cannot be looked up."""
    try:
        return path.exists()
    except OSError:
        return False


def is_folder(path: Path) -> bool:
    """Whether there is such a folder; see `exists`."""
    return exists(path) and path.is_dir()


def _suggestion(path: Path) -> str:
    """Remedy for a path that does not exist: the nearest name."""
    try:
        names = sorted({each.name for each in path.parent.iterdir()} - {path.name})  # a dead link
    except OSError:
        return "Check the name"
    similar = difflib.get_close_matches(path.name, names, 1)
    return f"Did you mean {path.with_name(similar[0])}?" if similar else "Check the name"


def read_file(path: Path, *, headers_only: bool = False) -> FileContent:
    """Read one file by the reader of its ending.

    `RecordingFormatError` if the file is missing, damaged, or of a format that is not known.
    """
    if not exists(path):
        rule = "the path must lead to a recording"
        raise RecordingFormatError(str(path), "file not found", rule, _suggestion(path))
    name, is_file = path.name.lower(), path.is_file()
    fitting = [ending for ending in _KNOWN if name.endswith(ending)]
    head = _head(path) if is_file else b""
    inside = _by_content(path, head)
    if not is_file or not (fitting or inside):
        found = f"ending {path.suffix!r}" if is_file else "not a file"
        rule = f"recordings end in {', '.join(sorted(_KNOWN))}"
        raise RecordingFormatError(str(path), found, rule, "Export to one of these formats")
    if not head:
        rule = "a recording must contain samples"
        raise RecordingFormatError(str(path), "the file is empty", rule, COPY_AGAIN)
    refuse_result(path, head.splitlines()[0].decode("latin-1").strip().split(","))
    module = _KNOWN[max(fitting, key=len)] if fitting else None  # .csv.gz before .gz
    if inside is None and module not in (None, csv) and _is_misnamed_table(path, head):
        inside = csv
    if inside is module or (module is matlab and inside is hdf5):
        inside = None
    try:
        content = _read(path, inside or module, headers_only=headers_only)
    except RecordingFormatError as fault:
        if inside is None:
            raise
        where = f"{fault.where}, by its content {inside.SUFFIXES[0]}"
        raise RecordingFormatError(where, fault.found, fault.rule, fault.remedy) from fault
    if inside is None:
        return content
    detail = f"by its content it is of the kind {inside.SUFFIXES[0]}, and read as that"
    return replace(content, findings=(*content.findings, note(path, Check.CONTENT, detail)))


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except OSError as error:
        raise unreadable(path, error) from error


def _by_content(path: Path, head: bytes) -> Any:
    """Module of the format that a file begins like; None where that is none of them."""
    if head.startswith(_OLD_WORKBOOK):
        rule = "it is an Excel workbook of the old kind, or another Office document"
        remedy = "Save it as .xlsx or CSV"
        raise RecordingFormatError(path.name, "an OLE file", rule, remedy)
    matches = (module for form, module in _BEGIN if form.match(head))
    return next(matches, None)


def _is_misnamed_table(path: Path, head: bytes) -> bool:
    """Whether a file has names above numbers, and no mark of the text formats."""
    if b"\x00" in head:
        return False
    try:
        return csv.has_table(path, without=_MARKS)
    except RecordingFormatError:
        return False


def _read(path: Path, module: Any, *, headers_only: bool) -> FileContent:
    reader: Reader = getattr(module, "read_headers", module.read) if headers_only else module.read
    return reader(path)


def read_headers(path: Path) -> FileContent:
    """Read headers only; samples of formats that must be parsed for them may be NaN."""
    return read_file(path, headers_only=True)
