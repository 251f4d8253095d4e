"""The floor: read the same bytes and do the same FFTs, nothing else. One process, one thread.

Run by speed.py as `python speed_floor.py FOLDER BLOCK STEP`.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np

DOUBLES_58B = re.compile(rb"    58b     1     2 +11 +(\d+) .*\r?\n(?:.*\n){11}")


def payloads(path: Path) -> list[np.ndarray]:
    """Double-precision values of all datasets 58b of a file, read into memory."""
    data = path.read_bytes()
    found, position = [], 0
    while match := DOUBLES_58B.search(data, position):
        count = int(match[1])
        found.append(np.frombuffer(data, "<f8", count // 8, match.end()))
        position = match.end() + count
    return found


def transform(folder: Path, block: int, step: int) -> None:
    """Read all recordings of a folder and transform their blocks."""
    taper = np.hanning(block)
    for path in sorted(folder.glob("*.uff")):
        channels = payloads(path)
        samples = np.empty((len(channels), block))
        spectrum = np.empty((len(channels), block // 2 + 1), dtype=complex)
        for start in range(0, len(channels[0]) - block + 1, step):
            for row, channel in zip(samples, channels, strict=True):
                np.multiply(channel[start : start + block], taper, out=row)
            np.fft.rfft(samples, axis=1, out=spectrum)


def main() -> None:
    transform(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))


if __name__ == "__main__":
    main()
