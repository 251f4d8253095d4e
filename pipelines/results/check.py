"""Integrity of a result folder: each part is compared with its checksum in the marker."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from ema.core.errors import InputError
from pipelines.storage.checksums import ACCEPTED, Fault, Marker, is_plain_file, read_marker, sha256
from pipelines.storage.result_folder import MARKER, named, recover

PAGES = ("report.html", "report.pdf")  # may be left out or deleted
READ_BACK = ("identification.json", "frf.parquet", "residues.parquet", "poles.parquet")
OPTIONAL_READ_BACK = ("reference.parquet",)
PARTS = (
    *READ_BACK,
    *OPTIONAL_READ_BACK,
    *("modes.csv", "shapes.csv", "orders.csv", "quality.csv", "validation.csv"),
    *("frf.uff", "tyre.toml"),
    *PAGES,
)


class Change(Enum):
    """How a part differs from what was written."""

    CHANGED = "changed after it was written"
    MISSING = "missing"
    ADDED = "added after the result was written"
    UNPROVEN = "without a checksum"


@dataclass(frozen=True)
class CheckedResult:
    """A result folder whose parts are as they were written, or accepted as they are.

    Parameters
    ----------
    folder : Path
    marker : Marker
    accepted : dict of str to Change
        Accepted changes by part.
    sha256 : dict of str to str
        Checksums of the accepted parts; empty for missing ones.
    """

    folder: Path
    marker: Marker
    accepted: dict[str, Change]
    sha256: dict[str, str]


def checked_result(folder: Path, *, accept_changes: bool = False) -> CheckedResult:
    """Check all parts of a result; other files in its folder do not count.

    Parameters
    ----------
    folder : Path
    accept_changes : bool
        Whether changed, missing and added parts are accepted.

    Raises
    ------
    InputError
        If the folder is no result; names the parts that are not accepted.
    """
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
    """Whether a folder holds a result whose parts are all as they were written."""
    recover(folder)
    try:
        marker = read_marker(folder / MARKER)
        return bool(marker.files) and not changed_parts(folder, marker)
    except OSError:
        return False


def changed_parts(folder: Path, marker: Marker) -> dict[str, Change]:
    """Parts that are not as they were written, the marker itself included."""
    if marker.fault is Fault.NO_CHECKSUMS:
        there = {name: Change.UNPROVEN for name in PARTS if (folder / name).is_file()}
        return {MARKER: Change.UNPROVEN, **there}
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
    if Change.UNPROVEN in changes.values():
        found = "a result of version 0.1.0, without checksums"
        rule = "changes to its files cannot be detected"
        remedy = "Process the recordings again, or accept them as they are with --accept-changes"
        return InputError(str(folder), found, rule, remedy)
    found = named([f"{name} {change.value}" for name, change in changes.items()])
    rule = "a result must be as it was written"
    remedy = "Process the recordings again, or accept the changes with --accept-changes"
    return InputError(str(folder), found, rule, remedy)
