"""Read WAV files: one channel for each track, in fractions of full scale.

The chunks are walked through here because `scipy.io.wavfile` only warns of a cut file, and warns of
chunks that other programs add too.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check
from ema.io.columns import Column, content_of_columns
from ema.io.content import EXPORT_AGAIN, LEAVE_OUT, FileContent, reading, remark

SUFFIXES = (".wav",)
_INTEGER, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_SAMPLE_BYTES = {_INTEGER: (1, 2, 3, 4), _FLOAT: (4, 8)}
_IN_DS64 = 0xFFFFFFFF  # the size is in the chunk 'ds64': files beyond 4 GB


@dataclass(frozen=True)
class _Format:
    """How samples are stored."""

    code: int
    n_channels: int
    rate_hz: int
    sample_bytes: int


def read(path: Path) -> FileContent:
    """Read a WAV file of integers (8, 16, 24 or 32 bit) or floats (32 or 64 bit).

    Integers become fractions of full scale, −1 to 1. A finding notes that the unit is unknown.
    Floats stay on disk as a memory map. `RecordingFormatError` if the file is missing, damaged,
    truncated, or compressed.
    """
    with reading(path, "a WAV file"), path.open("rb") as file:
        data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    layout, start, size = _layout(path, data)
    tracks = enumerate(_samples(data, layout, start, size).T, start=1)
    columns = [Column(f"channel {number}", "", track) for number, track in tracks]
    detail = "WAV files have no unit; samples are fractions of full scale"
    findings = [remark(path, "", Check.UNIT, detail)]
    return content_of_columns(path, columns, rate_hz=float(layout.rate_hz), findings=findings)


def _layout(path: Path, data: mmap.mmap) -> tuple[_Format, int, int]:
    """Format, and where the samples are: first byte and number of bytes."""
    layout = None
    for name, start, size in _chunks(path, data):
        if name == b"fmt ":
            layout = _format(f"{path.name}, 'fmt '", data[start : start + size])
        if name == b"data" and layout is not None:
            row = layout.n_channels * layout.sample_bytes
            if start + size > len(data):
                found = f"{len(data) - start} of {size} bytes of samples"
                raise RecordingFormatError(path.name, found, "the file is truncated", LEAVE_OUT)
            if size % row:
                found, rule = f"{size} bytes of samples", f"each instant takes {row} bytes"
                raise RecordingFormatError(path.name, found, rule, LEAVE_OUT)
            return layout, start, size
    found = "no chunk 'data'" if layout else "no chunk 'fmt ' before the samples"
    raise RecordingFormatError(path.name, found, "it needs 'fmt ' and 'data'", LEAVE_OUT)


def _chunks(path: Path, data: mmap.mmap) -> Iterator[tuple[bytes, int, int]]:
    """Names, first bytes and sizes of the chunks, in the order of the file."""
    if data[:4] not in (b"RIFF", b"RF64") or data[8:12] != b"WAVE":
        rule = "a WAV file begins with RIFF or RF64, and WAVE"
        raise RecordingFormatError(path.name, repr(data[:12]), rule, EXPORT_AGAIN)
    start, size_in_ds64 = 12, None
    while start + 8 <= len(data):
        name, size = struct.unpack("<4sI", data[start : start + 8])
        start += 8
        if name == b"ds64" and start + 16 <= len(data):
            size_in_ds64 = struct.unpack("<Q", data[start + 8 : start + 16])[0]
        if name == b"data" and size == _IN_DS64 and size_in_ds64 is not None:
            size = size_in_ds64
        yield name, start, size
        start += size + size % 2


def _format(where: str, chunk: bytes) -> _Format:
    if len(chunk) < 16:
        raise RecordingFormatError(where, f"{len(chunk)} bytes", "it takes at least 16", LEAVE_OUT)
    code, n_channels, rate_hz, _, row, n_bits = struct.unpack("<HHIIHH", chunk[:16])
    if code == _EXTENSIBLE and len(chunk) >= 26:
        code = struct.unpack("<H", chunk[24:26])[0]
    sample_bytes = -(-n_bits // 8)
    if sample_bytes not in _SAMPLE_BYTES.get(code, ()) or n_bits % 8:
        rule = "integers of 8, 16, 24 or 32 bit and floats of 32 or 64 bit can be read"
        raise RecordingFormatError(where, f"format {code} of {n_bits} bit", rule, EXPORT_AGAIN)
    if not n_channels or not rate_hz or row != n_channels * sample_bytes:
        found = f"{n_channels} channels of {sample_bytes} bytes in rows of {row}, {rate_hz} Hz"
        rule = "each row must have one sample per channel, and the rate must be positive"
        raise RecordingFormatError(where, found, rule, LEAVE_OUT)
    return _Format(code, n_channels, rate_hz, sample_bytes)


def _samples(data: mmap.mmap, layout: _Format, start: int, size: int) -> NDArray[Any]:
    """Samples as fractions of full scale, (n_samples, n_channels)."""
    width, shape = layout.sample_bytes, (-1, layout.n_channels)
    if layout.code == _FLOAT:
        return np.frombuffer(data, f"<f{width}", size // width, start).reshape(shape)
    if width == 3:  # as integers of 32 bit with an empty lowest byte, which the shift removes
        wide = np.zeros((size // 3, 4), dtype=np.uint8)
        wide[:, 1:] = np.frombuffer(data, np.uint8, size, start).reshape(-1, 3)
        stored: NDArray[Any] = wide.view("<i4")[:, 0] >> 8
    else:
        kind = "u1" if width == 1 else f"<i{width}"
        stored = np.frombuffer(data, kind, size // width, start)
    values: NDArray[Any] = stored.astype(np.float64 if width == 4 else np.float32)
    if width == 1:  # the only unsigned ones, with zero in the middle
        values -= 128
    values /= 1 << (8 * width - 1)
    return values.reshape(shape)
