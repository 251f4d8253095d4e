"""The formats that can be read: a new one is a module in `ema.io` and a name in `FORMATS`.

A module has ``SUFFIXES``, the endings that mark a file as a recording, ``read(path)``, which
returns a `FileContent`, and perhaps ``read_headers(path)`` and ``NAMED_SUFFIXES``: endings that are
too common (``.txt``) to take every such file of a folder for a recording; these are read only where
the user names the file. Libraries that are optional are imported inside the functions.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from pathlib import Path

from ema.core.errors import RecordingFormatError
from ema.io import arrow, hdf5, matlab, tdms, wav
from ema.io.content import COPY_AGAIN, FileContent, unreadable
from ema.io.text import csv, lvm
from ema.io.uff import reader as uff

Reader = Callable[[Path], FileContent]

FORMATS = (arrow, csv, hdf5, lvm, matlab, tdms, uff, wav)


def _found(endings: str, verb: str = "read") -> dict[str, Reader]:
    """Readers by the endings that their modules list under a name."""
    table: dict[str, Reader] = {}
    for module in FORMATS:
        table |= dict.fromkeys(getattr(module, endings, ()), getattr(module, verb, module.read))
    return table


READERS: dict[str, Reader] = _found("SUFFIXES")
_NAMED_READERS: dict[str, Reader] = _found("NAMED_SUFFIXES")
_HEADER_READERS: dict[str, Reader] = _found("SUFFIXES", "read_headers")


def is_recording(path: Path) -> bool:
    """Whether the ending of the name is one of a known format."""
    return _reader(path, READERS) is not None


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


def read_file(path: Path) -> FileContent:
    """Read one file by the reader of its ending.

    `RecordingFormatError` if the file is missing, damaged, or of a format that is not known.
    """
    if not exists(path):
        rule = "the path must lead to a recording"
        raise RecordingFormatError(str(path), "file not found", rule, _suggestion(path))
    reader = _reader(path, READERS) or _reader(path, _NAMED_READERS)
    if reader is None or not path.is_file():
        found = f"ending {path.suffix!r}" if path.is_file() else "not a file"
        rule = f"recordings end in {', '.join(sorted({**READERS, **_NAMED_READERS}))}"
        raise RecordingFormatError(str(path), found, rule, "Export to one of these formats")
    try:
        with path.open("rb") as file:
            is_empty = not file.read(1)
    except OSError as error:
        raise unreadable(path, error) from error
    if is_empty:
        rule = "a recording must contain samples"
        raise RecordingFormatError(str(path), "the file is empty", rule, COPY_AGAIN)
    return reader(path)


def read_headers(path: Path) -> FileContent:
    """Read headers only; samples of formats that must be parsed for them may be NaN."""
    reader = _reader(path, _HEADER_READERS) if exists(path) and path.is_file() else None
    return read_file(path) if reader is None else reader(path)


def _reader(path: Path, table: dict[str, Reader]) -> Reader | None:
    """Reader of the longest ending that fits: ``.csv.gz`` before ``.gz``."""
    name = path.name.lower()
    fitting = [ending for ending in table if name.endswith(ending)]
    return table[max(fitting, key=len)] if fitting else None
