"""How long it takes to read 14 channels of 500 000 samples, next to pyuff and bare pyarrow.

Everybody reads the same file in the same run, and touches every sample once by summing it.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyuff

from ema.core.recording import ACCELERATION, Channel
from ema.io.formats import read_file
from ema.io.text.csv import write_csv
from ema.io.uff.dataset58_header import (
    DELIMITER,
    LITTLE_ENDIAN,
    REAL_SINGLE,
    Header58,
    format_header,
)
from ema.io.uff.scan import scan
from ema.io.uff.write import write_time_series

N_CHANNELS, N_SAMPLES, RATE_HZ = 14, 500_000, 2000.0
BLOCK = 1 << 16
GIGABYTE = 1 << 30
T = TypeVar("T")


@dataclass(frozen=True)
class Comparison:
    """One file, two ways to read it."""

    what: str
    path: Path
    peer_name: str
    peer: Callable[[Path], float]
    ours: Callable[[Path], float]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=N_SAMPLES)
    parser.add_argument("--repeat", type=int, default=3, help="the best of so many runs counts")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        print(f"{N_CHANNELS} channels of {options.samples} samples, {os.cpu_count()} processors\n")
        print("| file | MB | peer | peer, s | ringmodal, s | peer / ringmodal |")
        print("|---|---|---|---|---|---|")
        for each in comparisons(Path(folder), options.samples):
            print(row(each, options.repeat), flush=True)
        print()
        print("| listing of 2 GB, headers only | s |")
        print("|---|---|")
        for kind, path in (("58b", sparse_binary(folder)), ("58, text", sparse_text(folder))):
            print(f"| {kind} | {best(scan, path, options.repeat)[0]:.4f} |", flush=True)


def comparisons(folder: Path, n_samples: int) -> Iterator[Comparison]:
    """Write one file after the other; each is removed when the next one is asked for."""
    samples = 3.0 * np.random.default_rng(0).normal(size=(N_CHANNELS, n_samples))
    for precision, kind, digits in (("double", np.float64, 13), ("single", np.float32, 6)):
        channels = [
            Channel(f"A{k:02d}", ACCELERATION, "m/s^2", row.astype(kind), node=k)
            for k, row in enumerate(samples, 1)
        ]
        path = folder / "a.uff"
        write_time_series(path, channels, RATE_HZ)
        title = f"58b {precision}, summed"
        yield Comparison(f"{title} in double", path, "pyuff", by_pyuff, by_blocks)
        yield Comparison(f"{title} as stored", path, "pyuff", by_pyuff, as_stored)
        write_time_series(path, channels, RATE_HZ, binary=False)
        yield Comparison(f"58 text, {digits} digits", path, "pyuff", by_pyuff, by_blocks)
        path.unlink()
    path = folder / "a.csv"
    write_csv(path, channels, RATE_HZ)
    yield Comparison("CSV", path, "pyarrow", by_pyarrow, by_blocks)
    path.unlink()


def row(each: Comparison, repeat: int) -> str:
    theirs, their_sum = best(each.peer, each.path, repeat)
    ours, our_sum = best(each.ours, each.path, repeat)
    if not np.isclose(our_sum, their_sum, rtol=1e-3, atol=1.0):  # single sums in single
        raise SystemExit(f"{each.what}: {our_sum} and {their_sum}, not the same samples")
    size = each.path.stat().st_size / 1e6
    cells = (each.what, f"{size:.0f}", each.peer_name, f"{theirs:.3f}", f"{ours:.3f}")
    return f"| {' | '.join(cells)} | {theirs / ours:.1f} |"


def best(read: Callable[[Path], T], path: Path, repeat: int) -> tuple[float, T]:
    """Shortest time of several; the files are in the page cache, as they were just written."""
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        result = read(path)
        times.append(time.perf_counter() - start)
    return min(times), result


def by_blocks(path: Path) -> float:
    """The way FRFs are estimated: blocks in double precision and SI."""
    recording = read_file(path).recording
    assert recording is not None
    return sum(
        float(channel.block(start, start + BLOCK).sum())
        for channel in recording.channels
        for start in range(0, channel.n_samples, BLOCK)
    )


def as_stored(path: Path) -> float:
    recording = read_file(path).recording
    assert recording is not None
    return sum(float(channel.samples.sum()) for channel in recording.channels)


def by_pyuff(path: Path) -> float:
    return sum(float(each["data"].sum()) for each in pyuff.UFF(str(path)).read_sets())


def by_pyarrow(path: Path) -> float:
    table = pa.csv.read_csv(path)
    return sum(float(column.to_numpy().sum()) for column in table.columns[1:])


def sparse_binary(folder: str) -> Path:
    """Two functions of a gigabyte each; what lies between their headers is a hole."""
    path = Path(folder) / "binary.uff"
    header = format_header(_header(GIGABYTE // 4, binary=True))
    with path.open("wb") as file:
        for _ in range(2):
            file.write(header)
            file.seek(GIGABYTE, os.SEEK_CUR)
            file.write(DELIMITER + b"\n")
    return path


def sparse_text(folder: str) -> Path:
    """Two functions of a gigabyte each; only the ends of the lines that matter are there."""
    path = Path(folder) / "text.uff"
    line = b"  1.00000E+00" * 6 + b"\n"
    n_lines = GIGABYTE // len(line)
    header = format_header(_header(6 * n_lines, binary=False))
    with path.open("wb") as file:
        for _ in range(2):
            file.write(header + line)
            file.seek((n_lines - 2) * len(line) - 1, os.SEEK_CUR)
            file.write(b"\n" + line + DELIMITER + b"\n")
    return path


def _header(n_values: int, *, binary: bool) -> Header58:
    return Header58(
        id_lines=("A01", "NONE", "NONE", "NONE", "NONE"),
        function_type=1,
        ordinate=REAL_SINGLE,
        n_values=n_values,
        abscissa_step="5.00000E-04",
        binary=binary,
        byte_order=LITTLE_ENDIAN,
        n_bytes=4 * n_values if binary else 0,
    )


if __name__ == "__main__":
    main()
