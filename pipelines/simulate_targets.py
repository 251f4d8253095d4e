"""Files that simulated numbers can go to."""

from __future__ import annotations

from pathlib import Path

from ema.errors import InputError

TABLE_ENDINGS = (".csv", ".parquet")
FIGURE_ENDINGS = (".png", ".svg")


def require_target(path: Path, endings: tuple[str, ...]) -> Path:
    """Refuse a file that could not be written, before anything is computed.

    Raises
    ------
    InputError
        For another ending, or a folder that does not exist.
    """
    if path.suffix.lower() not in endings:
        raise InputError(
            str(path),
            f"the ending {path.suffix!r}",
            f"it must be {' or '.join(endings)}",
            "Choose another name",
        )
    if path.is_dir() or not path.absolute().parent.is_dir():
        found = "a folder" if path.is_dir() else "a place in a folder that does not exist"
        raise InputError(str(path), found, "it must be a new or old file", "Choose another place")
    return path
