"""Global heaps of HDF5 files, where texts of attributes are kept; damaged ones hang the library."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path

from ema.errors import RecordingFormatError

_SIGNATURE = b"GCOL\x01\0\0\0"
_HEADER_BYTES = 16  # of a heap and of each object in it


def check_heaps(path: Path) -> None:
    """Refuse a file with a heap whose objects do not lead to its end.

    After "HDF5 File Format Specification", III.E (The HDF Group). The library follows free space
    of size zero for ever.

    Raises
    ------
    RecordingFormatError
        If a heap is damaged.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        start = data.find(_SIGNATURE)
        while start >= 0:
            if not _is_whole(data, start):
                found = f"texts at byte {start} whose lengths do not add up"
                rule = "the file is damaged"
                raise RecordingFormatError(path.name, found, rule, "Copy or export it again")
            start = data.find(_SIGNATURE, start + 1)


def _is_whole(data: mmap.mmap, start: int) -> bool:
    place = start + _HEADER_BYTES
    if place > len(data):
        return True  # the signature by chance, in the last samples
    stop = start + struct.unpack("<Q", data[place - 8 : place])[0]
    while place + _HEADER_BYTES <= min(stop, len(data)):
        index, size = struct.unpack("<H6xQ", data[place : place + _HEADER_BYTES])
        if index == 0:  # free space, which counts its header
            return bool(size > 0)
        place += _HEADER_BYTES + -(-size // 8) * 8
    return True
