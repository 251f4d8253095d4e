"""Peak memory of reading and inspecting a large file, against its size, for each format.

python benchmarks/fuzz_memory.py [--megabytes 40]

A process of its own reads and inspects a small file first, so that libraries are loaded and threads
run, and then the large one. Printed is by how much its address space (VmPeak, memory maps of the
file and stacks of new threads included) and its resident memory (VmHWM) grew, over the size of the
file; and over the size of the numbers in double precision, where the file is compressed. Fuzzing
holds small files to the same rule.
"""

from __future__ import annotations

import argparse
import contextlib
import gzip
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from fuzz_files import PLAIN_MEMORY

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]
import scenarios_binary as binary  # noqa: E402
from builders import ascii58, fixed  # noqa: E402
from scenarios import RATE_HZ, force, sensor, table  # noqa: E402

import ema  # noqa: E402
from ema.core.errors import InputError  # noqa: E402
from pipelines.prepare.inspection import inspect_files  # noqa: E402

MOST = 4.0
FLOOR_BYTES = 64 << 20

Builder = Callable[[np.ndarray], bytes]


def builders() -> Iterator[tuple[str, Builder]]:
    """Names of files, and how each is made from force and acceleration, (2, n)."""

    def ascii_functions(signals: np.ndarray) -> bytes:
        text = [fixed(values) for values in signals]
        newton = (13, 0, 0, "Force", "N")
        first = ascii58(text[0], name="force", node=0, n=signals.shape[1], axis=newton)
        return first + ascii58(text[1], n=signals.shape[1])

    def hdf5(signals: np.ndarray, **options: object) -> bytes:
        def fill(file) -> None:
            file.attrs["fs"] = RATE_HZ
            for name, values in zip(("force [N]", "A01 [g]"), signals, strict=True):
                file.create_dataset(name, data=values, **options)

        return binary.hdf5_file(fill)

    def matlab(signals: np.ndarray, *, compressed: bool = False) -> bytes:
        variables = {"force": signals[0], "A01": signals[1], "fs": RATE_HZ}
        return binary.mat_file(variables, compressed=compressed)

    yield "binary.uff", lambda s: force(s[0]) + sensor(s[1])
    yield "ascii.uff", ascii_functions
    yield "plain.csv", lambda s: table(signals=s).encode()
    yield "plain.csv.gz", lambda s: gzip.compress(table(signals=s).encode(), 1)
    yield (
        "plain.parquet",
        lambda s: binary.parquet_file(
            binary.arrow_table(s), compression="none", use_dictionary=False
        ),
    )
    yield "snappy.parquet", lambda s: binary.parquet_file(binary.arrow_table(s))
    yield "plain.feather", lambda s: binary.feather_file(table=binary.arrow_table(s))
    yield "lz4.feather", lambda s: binary.feather_file("lz4", binary.arrow_table(s))
    yield "plain.mat", matlab
    yield "packed.mat", lambda s: matlab(s, compressed=True)
    yield "plain.h5", hdf5
    yield "packed.h5", lambda s: hdf5(s, chunks=True, compression="gzip")
    yield "plain.tdms", binary.tdms_file
    yield "plain.wav", lambda s: binary.wav_file(samples=s.T.astype("<i2").tobytes())


def _status(key: str) -> int:
    """Bytes that the kernel counts for this process under `key`."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line for line in lines if line.startswith(key)).split()[1])


def measure(small: Path, large: Path) -> None:
    """Print growth of VmPeak and VmHWM from the small file to the large one, in bytes."""

    def read(path: Path) -> None:
        with contextlib.suppress(InputError):  # WAV and MATLAB files state no force
            ema.read_campaign(path)
        errors = inspect_files([path]).errors
        if errors:
            raise errors[0]

    read(small)
    before = _status("VmPeak"), _status("VmHWM")
    read(large)
    print(_status("VmPeak") - before[0], _status("VmHWM") - before[1])


def main() -> None:
    """Measure all formats; fail where one takes more than it may."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--megabytes", type=float, default=40.0)
    parser.add_argument("--measure", type=Path, nargs=2, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.measure:
        measure(*asked.measure)
        return
    n_samples = int(asked.megabytes * 1e6 / 16)
    large = np.random.default_rng(1).normal(0.0, 1e3, (2, n_samples)).round(1)
    failed = False
    for name, build in builders():
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder, each, name) for each in ("small", "large")]
            for path, signals in zip(paths, (large[:, :1000], large), strict=True):
                path.parent.mkdir()
                path.write_bytes(build(signals))
            command = [sys.executable, __file__, "--measure", *map(str, paths)]
            environment = {**os.environ, **PLAIN_MEMORY}
            ended = subprocess.run(
                command, env=environment, check=False, capture_output=True, text=True
            )
            size = paths[1].stat().st_size
        if ended.returncode:
            print(f"{name:15s} {ended.stderr.splitlines()[-1]}")
            failed = True
            continue
        reserved, resident = map(int, ended.stdout.split())
        numbers = max(size, large.nbytes)
        print(
            f"{name:15s} {size / 1e6:6.1f} MB: reserved {reserved / size:5.2f} × the file, "
            f"resident {resident / size:5.2f} × ({resident / numbers:5.2f} × the numbers)",
            flush=True,
        )
        failed |= resident > MOST * numbers + FLOOR_BYTES
    raise SystemExit(failed)


if __name__ == "__main__":
    main()
