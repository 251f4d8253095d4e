"""A tyre property file is replaced whole, and what stood there is kept."""

from __future__ import annotations

import shutil
from itertools import count
from pathlib import Path

from pipelines.tir_file import TirFile
from pipelines.whole_file import file_written_whole


def save_tir(tir: TirFile, path: Path) -> Path | None:
    """Write a tyre property file; one that stands there is copied first.

    Parameters
    ----------
    tir : TirFile
    path : Path

    Returns
    -------
    Path or None
        The copy; None where no file stood there.

    Raises
    ------
    InputError
        If it cannot be written; what stood there stands.
    """
    with file_written_whole(path) as partial:
        partial.write_bytes(tir.content)
        backup = _backed_up(path) if path.exists() else None
        if backup is not None:
            shutil.copymode(path, partial)
    return backup


def _backed_up(path: Path) -> Path:
    """Copy a file to FILE.bak, or to FILE.bak2 and so on, whichever is free."""
    content = path.read_bytes()
    for number in count(1):
        backup = path.with_name(f"{path.name}.bak{number if number > 1 else ''}")
        try:
            copy = backup.open("xb")
        except FileExistsError:
            continue
        try:
            with copy:
                copy.write(content)
            shutil.copystat(path, backup)
        except BaseException:
            backup.unlink()
            raise
        return backup
    raise AssertionError("counting never ends")
