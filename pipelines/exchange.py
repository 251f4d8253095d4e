"""Two folders change places in one step, where the system can."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

_SWAP = 2  # RENAME_EXCHANGE on Linux, RENAME_SWAP on macOS
_HERE = -100  # AT_FDCWD: relative paths start at the current folder


def exchange(one: Path, other: Path) -> bool:
    """Let two existing paths change their names in one step, which nothing can interrupt.

    Linux (``renameat2``) and macOS (``renamex_np``) can; Windows cannot, nor can some network and
    USB filesystems.

    Parameters
    ----------
    one, other : Path
        On the same filesystem.

    Returns
    -------
    bool
        Whether it was done; otherwise both are as they were.
    """
    paths = os.fsencode(one), os.fsencode(other)
    if sys.platform == "linux":
        rename = getattr(ctypes.CDLL(None), "renameat2", None)  # an older C library has none
        if rename is None:
            return False
        rename.argtypes = (
            *(ctypes.c_int, ctypes.c_char_p, ctypes.c_int, ctypes.c_char_p),
            ctypes.c_uint,
        )
        return bool(rename(_HERE, paths[0], _HERE, paths[1], _SWAP) == 0)
    if sys.platform == "darwin":
        rename = getattr(ctypes.CDLL(None), "renamex_np", None)
        if rename is None:
            return False
        rename.argtypes = (ctypes.c_char_p, ctypes.c_char_p, ctypes.c_uint)
        return bool(rename(*paths, _SWAP) == 0)
    return False
