"""Provenance of a result: software, inputs, options and stage times."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter
from typing import Any

from ema.core.campaign import Campaign, Processing
from ema.core.frf import FRF
from pipelines.results.options import Options
from pipelines.storage.checksums import sha256

DISTRIBUTION = "ringmodal"
LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pyuff")
UNKNOWN = "unknown"


@dataclass
class Stopwatch:
    """Wall time of each stage, in the order they ran; `announce` is called as one starts."""

    announce: Callable[[str], None]
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str, activity: str) -> Iterator[None]:
        """Announce an activity and time what happens inside."""
        self.announce(f"{activity} …")
        start = perf_counter()
        yield
        self.seconds[name] = round(perf_counter() - start, 4)


def provenance(
    campaign: Campaign,
    inputs: list[dict[str, Any]],
    options: Options,
    processing: Processing,
    frf: FRF,
    watch: Stopwatch,
) -> dict[str, Any]:
    """Content of ``provenance.json``: versions, inputs, options and settings in force, times."""
    settings = {name: asdict(getattr(campaign, name)) for name in ("identification", "checks")}
    chosen = {key: value for key, value in asdict(options).items() if key not in settings}
    return {
        "software": {"ringmodal": software_version(), **library_versions()},
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "campaign": campaign.name,
        "inputs": inputs,
        "options": {
            **chosen,
            "processing": {**asdict(processing), **_blocks_in_force(frf)},
        },
        "settings": settings,
        "stage_seconds": watch.seconds,
    }


@contextmanager
def checksummed(paths: Sequence[Path]) -> Iterator[Callable[[], list[dict[str, Any]]]]:
    """Yield a function that returns name, size and SHA-256 of files; a thread computes them."""

    def fingerprint(path: Path) -> dict[str, Any]:
        return {"file": path.name, "bytes": path.stat().st_size, "sha256": sha256(path)}

    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(lambda: [fingerprint(path) for path in paths]).result


def _blocks_in_force(frf: FRF) -> dict[str, Any]:
    if frf.blocks is None:
        return {}
    return {
        "window": frf.blocks.window,
        "block_seconds": frf.blocks.block_s,
        "overlap": frf.blocks.overlap,
        "averages_per_run": frf.blocks.n_blocks,
        "effective_averages": round(frf.n_effective, 2),
        "sampling_rate_hz": frf.blocks.sampling_rate_hz,
    }


def software_version() -> str:
    """Version of the installed distribution."""
    return installed_version(DISTRIBUTION)


def library_versions() -> dict[str, str]:
    """Versions of Python and of the libraries that numbers pass through."""
    python = {"python": platform.python_version()}
    return python | {name: installed_version(name) for name in LIBRARIES}


def installed_version(name: str) -> str:
    """Version of an installed distribution, ``"unknown"`` where there is none of that name."""
    try:
        return version(name)
    except PackageNotFoundError:
        return UNKNOWN
