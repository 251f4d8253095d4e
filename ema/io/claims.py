"""Sizes that a file claims, checked before memory is reserved for them."""

from __future__ import annotations

from pathlib import Path

from ema.errors import RecordingFormatError

MOST_EXPANSION = (
    64  # of a compressed file: vibration compresses by 1.1 to 10, a silent channel more
)
_ALWAYS_BYTES = 1 << 24
_COPY_AGAIN = "Copy the file again, or export it without compression"


def check_expansion(where: str, path: Path, n_bytes: int) -> None:
    """Refuse data that would be far larger in memory than in a compressed file.

    Parameters
    ----------
    where : str
        File and place in it.
    path : Path
        The file, whose size counts.
    n_bytes : int
        Size of the data in memory; up to 16 MiB are never refused.

    Raises
    ------
    RecordingFormatError
        If it is more than `MOST_EXPANSION` times the size of the file.
    """
    size = path.stat().st_size
    if n_bytes <= max(MOST_EXPANSION * size, _ALWAYS_BYTES):
        return
    found = f"{n_bytes} bytes of numbers claimed by a file of {size} bytes"
    rule = f"no recording is compressed to less than 1/{MOST_EXPANSION}"
    raise RecordingFormatError(where, found, rule, _COPY_AGAIN)


def check_stored(where: str, n_claimed: int, n_stored: int) -> None:
    """Refuse uncompressed data that claim more bytes than are there.

    Raises
    ------
    RecordingFormatError
        If `n_claimed` exceeds `n_stored`.
    """
    if n_claimed <= n_stored:
        return
    found = f"{n_claimed} bytes of numbers claimed, {n_stored} stored"
    raise RecordingFormatError(where, found, "the file is truncated or damaged", _COPY_AGAIN)
