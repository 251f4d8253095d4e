"""Whether the machine can work: linear algebra, memory, folders, terminal, a small campaign."""

from __future__ import annotations

import shutil
import sys
import tempfile
import tomllib
from pathlib import Path

from ema.errors import FitError, InputError
from pipelines.console_encoding import lacking
from pipelines.doctor_check import ADVICE, OK, PROBLEM, Check

_LEAST_MEMORY_BYTES = 1e9  # a large campaign takes about as much
_LEAST_DISK_BYTES = 0.5e9
_PROOF_S = 4.0  # length of the simulated runs
_PROOF_MODES = 7  # orders 1 to 7 lie in the band
_PROOF_LIMIT = 0.005  # of a frequency; runs of 4 s come within a tenth of it


def check_linear_algebra() -> Check:
    """The library beneath numpy, and how many threads it may use."""
    import numpy as np  # noqa: F401 - loads the library that is asked about
    from threadpoolctl import threadpool_info

    from ema.threads import available_cores, available_threads

    found = [each for each in threadpool_info() if each["user_api"] == "blas"]
    threads = f"{available_threads()} of {available_cores()} cores"
    if not found:
        # Apple's own library tells nothing about itself.
        return Check("linear algebra", OK, f"a library that does not tell its name; {threads}")
    names = ", ".join(f"{each['internal_api']} {each['version']}" for each in found)
    return Check("linear algebra", OK, f"{names}; {threads}")


def check_memory() -> Check:
    """Memory that is free."""
    free_bytes = _free_memory_bytes()
    if free_bytes is None:
        return Check("memory", OK, "this system does not tell how much is free")
    found = f"{free_bytes / 1e9:.1f} GB free"
    if free_bytes < _LEAST_MEMORY_BYTES:
        return Check("memory", ADVICE, found, "Close other programs before large campaigns")
    return Check("memory", OK, found)


def _free_memory_bytes() -> float | None:
    """Memory that programs can have without others being written to disk; None if unknown."""
    listing = Path("/proc/meminfo")
    if listing.is_file():
        for line in listing.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return 1024.0 * int(line.split()[1])
    if sys.platform == "win32":
        import ctypes
        import struct

        status = ctypes.create_string_buffer(64)  # MEMORYSTATUSEX: its size first, then numbers
        struct.pack_into("<I", status, 0, 64)
        if ctypes.windll.kernel32.GlobalMemoryStatusEx(status):
            return float(struct.unpack_from("<Q", status, 16)[0])
    return None


def check_folders() -> list[Check]:
    """Whether the temporary and the current folder take files, and how many."""
    return [
        _folder("temporary folder", Path(tempfile.gettempdir())),
        _folder("current folder", Path.cwd()),
    ]


def _folder(name: str, path: Path) -> Check:
    remedy = "Free some space there, or work in another folder"
    try:
        with tempfile.TemporaryFile(dir=path) as file:
            file.write(b"can be written")
        free_bytes = shutil.disk_usage(path).free
    except OSError as error:
        return Check(name, PROBLEM, f"{path}: {error.strerror}", remedy)
    found = f"{path}, {free_bytes / 1e9:.1f} GB free"
    return (
        Check(name, OK, found)
        if free_bytes >= _LEAST_DISK_BYTES
        else Check(name, ADVICE, found, remedy)
    )


def check_terminal() -> Check:
    """Whether the terminal has the signs that results are written with."""
    encoding = sys.stdout.encoding or "ascii"
    missing = lacking(encoding)
    if not missing:
        return Check("terminal", OK, encoding)
    found = f"{encoding} lacks {len(missing)} signs of results; they are written otherwise"
    return Check("terminal", ADVICE, found, "Set PYTHONIOENCODING=utf-8, or use Windows Terminal")


def check_campaign() -> Check:
    """Whether a simulated campaign comes back as the modes it was made with."""
    from pipelines.options import Options
    from pipelines.process import process
    from pipelines.simulate_campaign import simulate_campaign

    remedy = "Please report it with this line"
    try:
        with tempfile.TemporaryDirectory() as scratch:
            folder = simulate_campaign(Path(scratch) / "campaign", duration_s=_PROOF_S)
            truth = tomllib.loads((folder / "truth.toml").read_text(encoding="utf-8"))
            modes = process(folder, Options(tune=False)).modal_model.modes
    except (InputError, FitError, OSError) as error:
        return Check("campaign", PROBLEM, str(error), remedy)
    known_hz = {mode["order"]: mode["frequency_hz"] for mode in truth["modes"]}
    errors = [abs(m.frequency_hz / known_hz[m.order] - 1) for m in modes if m.order in known_hz]
    worst = max(errors, default=float("inf"))
    found = f"{len(errors)} modes of a simulated tyre found, each within {100 * worst:.2f} %"
    if len(errors) < _PROOF_MODES or worst > _PROOF_LIMIT:
        return Check("campaign", PROBLEM, found, remedy)
    return Check("campaign", OK, found)
