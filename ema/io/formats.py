"""The formats that can be read, each a module of `ema.io`; docs/dev/adding.md adds one."""

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
READERS = {ending: module for module in FORMATS for ending in module.SUFFIXES}
_NAMED = {end: module for module in FORMATS for end in getattr(module, "NAMED_SUFFIXES", ())}


def is_recording(path: Path) -> bool:
    """Whether the ending of the name is one of a known format."""
    return path.name.lower().endswith(tuple(READERS))


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
    known = READERS | _NAMED
    fitting = [ending for ending in known if path.name.lower().endswith(ending)]
    if not fitting or not path.is_file():
        found = f"ending {path.suffix!r}" if path.is_file() else "not a file"
        rule = f"recordings end in {', '.join(sorted(known))}"
        raise RecordingFormatError(str(path), found, rule, "Export to one of these formats")
    try:
        with path.open("rb") as file:
            is_empty = not file.read(1)
    except OSError as error:
        raise unreadable(path, error) from error
    if is_empty:
        rule = "a recording must contain samples"
        raise RecordingFormatError(str(path), "the file is empty", rule, COPY_AGAIN)
    module = known[max(fitting, key=len)]  # .csv.gz before .gz
    reader: Reader = getattr(module, "read_headers", module.read) if headers_only else module.read
    return reader(path)


def read_headers(path: Path) -> FileContent:
    """Read headers only; samples of formats that must be parsed for them may be NaN."""
    return read_file(path, headers_only=True)
