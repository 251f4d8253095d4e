"""The formats that can be read: adding one is one module and its line here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ema.errors import RecordingFormatError
from ema.io import csv, uff
from ema.io.content import FileContent

Reader = Callable[[Path], FileContent]

READERS: dict[str, Reader] = {
    **dict.fromkeys(uff.SUFFIXES, uff.read_uff),
    **dict.fromkeys(csv.SUFFIXES, csv.read_csv),
}


def is_recording(path: Path) -> bool:
    """Whether the name's ending is one of a known format."""
    return path.suffix.lower() in READERS


def read_file(path: Path) -> FileContent:
    """Read one file by the reader that its name's ending calls for.

    Raises
    ------
    RecordingFormatError
        If the file is missing, damaged, or of a format that is not known.
    """
    if not path.exists():
        rule = "the file does not exist"
        raise RecordingFormatError(str(path), "nothing there", rule, "Check the name")
    reader = READERS.get(path.suffix.lower())
    if reader is None or not path.is_file():
        found = f"ending {path.suffix!r}" if path.is_file() else "not a file"
        rule = f"recordings end in {', '.join(sorted(READERS))}"
        raise RecordingFormatError(str(path), found, rule, "Export it in one of these formats")
    return reader(path)
