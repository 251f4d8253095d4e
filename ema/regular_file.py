"""Only regular files are read: opening a pipe waits for whoever writes into it, maybe for ever."""

from __future__ import annotations

import stat
from pathlib import Path

from ema.errors import InputError


def require_regular(path: Path) -> Path:
    """Refuse a pipe, a socket or a device before it is opened.

    Parameters
    ----------
    path : Path
        What is not there, or is a folder, is left to whoever opens it.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    InputError
        If it is something else than a file or folder.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # opening it says what is wrong
        return path
    if stat.S_ISREG(mode) or stat.S_ISDIR(mode):
        return path
    rule = "only regular files are read: nobody knows when a pipe or device ends"
    raise InputError(str(path), "not a regular file", rule, "Name a file, or write it to one first")
