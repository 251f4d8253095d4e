"""Provenance of a result: software, inputs, options, times; and whether its files are unchanged."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from enum import Enum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter
from typing import Any

from ema.core.campaign import Campaign, Processing
from ema.core.errors import InputError
from ema.core.files import Stamp, stamp_of
from ema.core.frf import FRF
from pipelines.results.options import Options, given_processing
from pipelines.storage.atomic import MARKER, named, recover
from pipelines.storage.checksums import ACCEPTED, Fault, Marker, is_plain_file, read_marker, sha256

DISTRIBUTION = "ringmodal"
LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "matplotlib", "pyuff")
UNKNOWN = "unknown"
PAGES = ("report.html", "report.pdf")  # may be left out or deleted
READ_BACK = ("identification.json", "frf.parquet", "residues.parquet", "poles.parquet")
OPTIONAL_READ_BACK = ("reference.parquet", "force.parquet")
PARTS = (
    *READ_BACK,
    *OPTIONAL_READ_BACK,
    *("modes.csv", "shapes.csv", "orders.csv", "references.csv", "quality.csv"),
    *("corrections.csv", "other_modes.csv", "validation.csv"),
    *("frf.uff", "tyre.toml", "edits.toml"),
    *PAGES,
)


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
        **made_now(),
        "campaign": campaign.name,
        "inputs": inputs,
        "options": {**chosen, "processing": {**asdict(processing), **_blocks_in_force(frf)}},
        "given_processing": given_processing(options),
        "settings": settings,
        "stage_seconds": watch.seconds,
    }


def made_now() -> dict[str, Any]:
    """Versions and time of a provenance."""
    return {
        "software": {"ringmodal": software_version(), **library_versions()},
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }


@contextmanager
def checksummed(files: Mapping[Path, Stamp]) -> Iterator[Callable[[], list[dict[str, Any]]]]:
    """Yield a function that returns name, size and SHA-256 of files; a thread computes them.

    The function refuses a file that is not as it was when it was read.
    """

    def fingerprint(path: Path, stamp: Stamp) -> dict[str, Any]:
        checksum, now = sha256(path), stamp_of(path.stat())
        if now != stamp:
            rule = "a recording stays as it is until its result is done"
            raise InputError(str(path), "changed since it was read", rule, "Process it again")
        about = {"file": path.name, "bytes": now[0], "sha256": checksum}
        return {**about, "path": str(path.resolve())}

    with ThreadPoolExecutor(1) as pool:
        yield pool.submit(lambda: [fingerprint(*each) for each in files.items()]).result


def with_inputs_at(record: dict[str, Any], place: Callable[[Path], Path | str]) -> dict[str, Any]:
    """Provenance with the path of each input that is known changed."""
    inputs = [
        {**entry, "path": Path(place(Path(entry["path"]))).as_posix()} if "path" in entry else entry
        for entry in record.get("inputs", ())
    ]
    return {**record, "inputs": inputs} if inputs else record


def relative_to(folder: Path) -> Callable[[Path], Path | str]:
    """A path as seen from a folder; as it is where there is no way, as to another drive."""

    def seen(path: Path) -> Path | str:
        with suppress(ValueError):
            return os.path.relpath(path, os.path.realpath(folder))
        return path

    return seen


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
    """Version of an installed distribution, ``"unknown"`` if there is none."""
    try:
        return version(name)
    except PackageNotFoundError:
        return UNKNOWN


class Change(Enum):
    """How a part differs from what was written."""

    CHANGED = "changed after it was written"
    MISSING = "missing"
    ADDED = "added after the result was written"


@dataclass(frozen=True)
class CheckedResult:
    """A result folder whose parts are as they were written, or accepted as they are."""

    folder: Path
    marker: Marker
    accepted: dict[str, Change]  # accepted changes by part
    sha256: dict[str, str]  # checksums of the accepted parts; empty for missing ones


def checked_result(folder: Path, *, accept_changes: bool = False) -> CheckedResult:
    """Check all parts of a result; other files in its folder do not count."""
    recover(folder)
    if not (folder / MARKER).is_file():
        rule, remedy = "it must be a result folder", "Run `ringmodal process`"
        raise InputError(str(folder), f"no {MARKER}", rule, remedy)
    try:
        marker = read_marker(folder / MARKER)
        if marker.fault in (Fault.UNREADABLE, Fault.FOREIGN):
            where, rule = f"{folder}, {MARKER}", "it must list the files of the result"
            raise InputError(where, marker.fault.value, rule, "Process the recordings again")
        changes = changed_parts(folder, marker)
        if changes and not accept_changes:
            raise _refusal(folder, changes)
        paths = {name: folder / name for name in changes}
        checksums = {name: sha256(path) if path.is_file() else "" for name, path in paths.items()}
    except OSError as error:
        place, reason = error.filename or folder, error.strerror or str(error)
        rule, remedy = "all parts of a result must be readable", "Check permissions and the drive"
        raise InputError(str(place), reason, rule, remedy) from error
    return CheckedResult(folder, marker, changes, checksums)


def is_as_written(folder: Path) -> bool:
    """Whether a folder is a result whose parts are all as they were written."""
    recover(folder)
    try:
        marker = read_marker(folder / MARKER)
        return bool(marker.files) and not changed_parts(folder, marker)
    except OSError:
        return False


def changed_parts(folder: Path, marker: Marker) -> dict[str, Change]:
    """Parts that are not as they were written, the marker itself included."""
    changes = {MARKER: Change.CHANGED} if marker.fault is Fault.CHANGED else {}
    for name, checksum in marker.files.items():
        path = folder / name
        if not is_plain_file(path):
            if name not in PAGES or path.exists():
                changes[name] = Change.MISSING
        elif sha256(path) != checksum:
            changes[name] = Change.CHANGED
    added = (name for name in PARTS if name not in marker.files and (folder / name).exists())
    return changes | dict.fromkeys(added, Change.ADDED)


def accepted_notes(record: Mapping[str, Any], name: str) -> tuple[str, ...]:
    """A note on accepted changes, if the provenance of the result called `name` has any."""
    changed = sorted(record.get(ACCEPTED, ()))
    return (f"{name} was changed after it was written: {', '.join(changed)}",) if changed else ()


def _refusal(folder: Path, changes: dict[str, Change]) -> InputError:
    found = named([f"{name} {change.value}" for name, change in changes.items()])
    remedy = "Process the recordings again, or accept the changes with --accept-changes"
    return InputError(str(folder), found, "a result must be as it was written", remedy)
