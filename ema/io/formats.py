"""The formats that can be read, each a module of `ema.io`; docs/dev/adding.md adds one.

A module is loaded with the first file of its format: all of them take longer than a campaign.
"""

from __future__ import annotations

import difflib
import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Any

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check
from ema.io.content import COPY_AGAIN, FileContent, note, refuse_result, unreadable

FORMATS = {
    "arrow": (".parquet", ".feather", ".arrow"),
    "text.csv": (".csv", ".tsv", ".csv.gz", ".tsv.gz"),
    "hdf5": (".h5", ".hdf5"),
    "text.lvm": (".lvm",),
    "matlab": (".mat",),
    "tdms": (".tdms",),
    "uff.reader": (".uff", ".unv", ".uf", ".bunv", ".58", ".ufb"),
    "wav": (".wav",),
    "text.xlsx": (".xlsx", ".xlsm"),
}
READERS = {ending: name for name, endings in FORMATS.items() for ending in endings}
# Endings that are too common for recordings: such files are read where the user names them.
_NAMED = dict.fromkeys((".txt", ".asc", ".dat", ".txt.gz"), "text.csv")
_KNOWN = READERS | _NAMED
_HEAD_BYTES = 512
# What files of a format begin with, whatever their name ends in.
_BEGINNINGS = [
    (rb"(?:\s*\n)?    -1\s*\n\s*[0-9]{2,4}b?\s", "uff.reader"),
    (rb"LabVIEW Measurement", "text.lvm"),
    (rb"PK\x03\x04.{26}(?:\[Content_Types\]\.xml|xl/|_rels/|docProps/)", "text.xlsx"),
    (rb"\x89HDF\r\n\x1a\n", "hdf5"),
    (rb"MATLAB 5\.0 MAT-file", "matlab"),
    (rb"TDSm", "tdms"),
    (rb"(?:RIFF|RF64).{4}WAVE", "wav"),
    (rb"PAR1|ARROW1", "arrow"),
]
_BEGIN = [(re.compile(start, re.DOTALL), name) for start, name in _BEGINNINGS]
# Lines of damaged universal files and LabVIEW files, which are no tables.
_MARKS = re.compile(r"^[ \t]*-1[ \t\r]*$|^\*\*\*End|LabVIEW", re.MULTILINE)
_OLD_WORKBOOK = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
_LOADING = Lock()  # libraries do not stand being loaded by two threads at once


def is_recording(path: Path) -> bool:
    """Whether the ending of the name is one of a known format."""
    return path.name.lower().endswith(tuple(READERS))


def is_text_table(path: Path) -> bool:
    """Whether a file of an ending that is too common for recordings holds a table."""
    if not path.name.lower().endswith(tuple(_NAMED)):
        return False
    try:
        return _by_content(path, _head(path)) is not None or _module("text.csv").has_table(path)
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
    named = _KNOWN[max(fitting, key=len)] if fitting else None  # .csv.gz before .gz
    if inside is None and named not in (None, "text.csv") and _is_misnamed_table(path, head):
        inside = "text.csv"
    if inside == named or (named == "matlab" and inside == "hdf5"):
        inside = None
    try:
        content = _read(path, inside or str(named), headers_only=headers_only)
    except RecordingFormatError as fault:
        if inside is None:
            raise
        where = f"{fault.where}, by its content {FORMATS[inside][0]}"
        raise RecordingFormatError(where, fault.found, fault.rule, fault.remedy) from fault
    if inside is None:
        return content
    detail = f"by its content it is of the kind {FORMATS[inside][0]}, and read as that"
    return replace(content, findings=(*content.findings, note(path, Check.CONTENT, detail)))


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except OSError as error:
        raise unreadable(path, error) from error


def _by_content(path: Path, head: bytes) -> str | None:
    """The format that a file begins like; None where that is none of them."""
    if head.startswith(_OLD_WORKBOOK):
        rule = "it is an Excel workbook of the old kind, or another Office document"
        remedy = "Save it as .xlsx or CSV"
        raise RecordingFormatError(path.name, "an OLE file", rule, remedy)
    matches = (name for form, name in _BEGIN if form.match(head))
    return next(matches, None)


def _is_misnamed_table(path: Path, head: bytes) -> bool:
    """Whether a file has names above numbers, and no mark of the text formats."""
    if b"\x00" in head:
        return False
    try:
        return bool(_module("text.csv").has_table(path, without=_MARKS))
    except RecordingFormatError:
        return False


def _read(path: Path, name: str, *, headers_only: bool) -> FileContent:
    module = _module(name)
    reader = getattr(module, "read_headers", module.read) if headers_only else module.read
    content: FileContent = reader(path)
    return content


def _module(name: str) -> Any:
    """Module that reads a format."""
    with _LOADING:
        return import_module(f"ema.io.{name}")


def read_headers(path: Path) -> FileContent:
    """Read headers only; samples of formats that must be parsed for them may be NaN."""
    return read_file(path, headers_only=True)
