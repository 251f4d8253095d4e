"""Read WAV files: one channel for each track, in fractions of full scale.

The chunks are walked through here because `scipy.io.wavfile` only warns of a cut file, and warns of
chunks that other programs add too.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.files import mapped
from ema.core.finding import Check
from ema.io.columns import Column, content_of_columns
from ema.io.content import EXPORT_AGAIN, LEAVE_OUT, FileContent, reading, remark
from ema.io.rates import exact_rate

_EXTENSIBLE = 0xFFFE  # the code is in the chunk's extension
_IN_DS64 = 0xFFFFFFFF  # the size is in the chunk 'ds64': files beyond 4 GB
# Types of samples by format code (1 integers, 3 floats) and number of bits.
_TYPES = {(1, 8): "u1", (1, 16): "<i2", (1, 24): "V3", (1, 32): "<i4", (3, 32): "<f4"}
_TYPES |= {(3, 64): "<f8"}
_CHUNKS = (b"LIST", b"bext", b"fact", b"cue ", b"id3 ", b"JUNK", b"iXML")  # after no samples


def read(path: Path) -> FileContent:
    """Read a WAV file of integers (8, 16, 24 or 32 bit) or floats (32 or 64 bit).

    Integers become fractions of full scale, −1 to 1. A finding notes that the unit is unknown.
    Floats stay on disk as a memory map. `RecordingFormatError` if the file is missing, damaged,
    truncated, or compressed.
    """
    with reading(path, "a WAV file"):
        data = mapped(path).data
    places: dict[bytes, tuple[int, int]] = {}
    for name, start, size in _chunks(path, data):
        places[name] = (start, size)
        if name == b"data":
            break
    start, size = _place(path, places, b"fmt ")
    layout, n_channels, rate_hz = _format(f"{path.name}, 'fmt '", bytes(data[start : start + size]))
    start, size = _place(path, places, b"data")
    row = n_channels * layout.itemsize
    detail = "WAV files have no unit; samples are fractions of full scale"
    findings = [remark(path, "", Check.UNIT, detail)]
    left = len(data) - start
    is_next = size == 0 and bytes(data[start : start + 4]) in _CHUNKS
    if size in (0, _IN_DS64) and left >= row and not is_next:
        size = left // row * row
        detail = f"the header was never completed: read to the end, {size // row} samples"
        findings.append(remark(path, "", Check.BYTE_COUNT, detail))
    if start + size > len(data):
        found = f"{len(data) - start} of {size} bytes of samples"
        raise RecordingFormatError(path.name, found, "the file is truncated", LEAVE_OUT)
    if size % row:
        found, rule = f"{size} bytes of samples", f"each instant takes {row} bytes"
        raise RecordingFormatError(path.name, found, rule, LEAVE_OUT)
    stored = np.asarray(mapped(path, layout, start, (size // layout.itemsize,)))
    tracks = enumerate(_fractions(stored).reshape(-1, n_channels).T, start=1)
    columns = [Column(f"channel {number}", "", track) for number, track in tracks]
    return content_of_columns(path, columns, rate=exact_rate(float(rate_hz)), findings=findings)


def _chunks(path: Path, data: memoryview) -> Iterator[tuple[bytes, int, int]]:
    """Names, first bytes and sizes of the chunks, in the order of the file."""
    begin = bytes(data[:12])
    if begin[:4] not in (b"RIFF", b"RF64") or begin[8:] != b"WAVE":
        rule = "a WAV file begins with RIFF or RF64, and WAVE"
        raise RecordingFormatError(path.name, repr(begin), rule, EXPORT_AGAIN)
    start, size_in_ds64 = 12, None
    while start + 8 <= len(data):
        name, size = struct.unpack("<4sI", data[start : start + 8])
        start += 8
        if name == b"ds64" and start + 16 <= len(data):
            size_in_ds64 = struct.unpack("<Q", data[start + 8 : start + 16])[0]
        if name == b"data" and size == _IN_DS64 and size_in_ds64 is not None:
            size = size_in_ds64 or size
        yield name, start, size
        start += size + size % 2


def _place(path: Path, places: Mapping[bytes, tuple[int, int]], name: bytes) -> tuple[int, int]:
    if name in places:
        return places[name]
    found = f"no chunk {name.decode()!r}"
    raise RecordingFormatError(path.name, found, "it needs 'fmt ' and 'data'", LEAVE_OUT)


def _format(where: str, chunk: bytes) -> tuple[np.dtype[Any], int, int]:
    """Type of the samples, number of channels, sampling rate."""
    if len(chunk) < 16:
        raise RecordingFormatError(where, f"{len(chunk)} bytes", "it takes at least 16", LEAVE_OUT)
    code, n_channels, rate_hz, _, row, n_bits = struct.unpack("<HHIIHH", chunk[:16])
    if code == _EXTENSIBLE and len(chunk) >= 26:
        code = struct.unpack("<H", chunk[24:26])[0]
    if (code, n_bits) not in _TYPES:
        rule = "integers of 8, 16, 24 or 32 bit and floats of 32 or 64 bit can be read"
        raise RecordingFormatError(where, f"format {code} of {n_bits} bit", rule, EXPORT_AGAIN)
    layout = np.dtype(_TYPES[code, n_bits])
    if not n_channels or not rate_hz or row != n_channels * layout.itemsize:
        found = f"{n_channels} channels of {layout.itemsize} bytes in rows of {row}, {rate_hz} Hz"
        rule = "each row must have one sample per channel, and the rate must be positive"
        raise RecordingFormatError(where, found, rule, LEAVE_OUT)
    return layout, n_channels, rate_hz


def _fractions(stored: NDArray[Any]) -> NDArray[Any]:
    """Samples as fractions of full scale; floats stay as they are."""
    if stored.dtype.kind == "f":
        return stored
    precision = np.float64 if stored.itemsize == 4 else np.float32
    if stored.dtype.kind == "V":  # 24 bit as 32 with an empty lowest byte
        wide = np.zeros((len(stored), 4), dtype=np.uint8)
        wide[:, 1:] = stored.view(np.uint8).reshape(-1, 3)
        stored = wide.view("<i4")[:, 0]
    values: NDArray[Any] = np.asarray(stored).astype(precision)
    if stored.dtype.kind == "u":  # 8 bit, with zero in the middle
        values -= 128
    values /= 1 << (8 * stored.itemsize - 1)
    return values
