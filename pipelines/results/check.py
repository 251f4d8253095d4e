"""Whether a result is as it was written: every part of it against the checksum in its marker.

Whoever reads a result checks all of it, and stops at a part that was changed, is missing or was
added, unless that is accepted on purpose. Files that are no part of a result are nobody's business
here; they only keep a result from being replaced.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from ema.core.errors import InputError
from pipelines.storage.checksums import ACCEPTED, Fault, Marker, is_plain_file, read_marker, sha256
from pipelines.storage.result_folder import MARKER, recover

PAGES = ("report.html", "report.pdf")  # left out or deleted at will
READ_BACK = ("identification.json", "frf.parquet", "residues.parquet", "poles.parquet")
OPTIONAL_READ_BACK = ("reference.parquet",)
PARTS = (
    *READ_BACK,
    *OPTIONAL_READ_BACK,
    *("modes.csv", "shapes.csv", "orders.csv", "quality.csv", "validation.csv"),
    *("frf.uff", "tyre.toml"),
    *PAGES,
)

_MOST_NAMED = 3


class Change(Enum):
    """What became of a part."""

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
        What became of the parts that were accepted.
    sha256 : dict of str to str
        Their checksums; empty texts for those that are missing.
    """

    folder: Path
    marker: Marker
    accepted: dict[str, Change]
    sha256: dict[str, str]


def checked_result(folder: Path, *, accept_changes: bool = False) -> CheckedResult:
    """Check all parts of a result.

    Parameters
    ----------
    folder : Path
    accept_changes : bool
        Whether parts that are not as they were written are accepted.

    Raises
    ------
    InputError
        If the folder is no result, or names a part that is not accepted.
    """
    recover(folder)
    if not (folder / MARKER).is_file():
        raise InputError(
            str(folder), f"no {MARKER}", "it must be a result folder", "Run `ringmodal process`"
        )
    try:
        return _checked(folder, accept_changes=accept_changes)
    except OSError as error:
        place, reason = error.filename or folder, error.strerror or str(error)
        rule, remedy = "all parts of a result are read", "Check permissions and the drive"
        raise InputError(str(place), reason, rule, remedy) from error


def _checked(folder: Path, *, accept_changes: bool) -> CheckedResult:
    marker = read_marker(folder / MARKER)
    if marker.fault in (Fault.UNREADABLE, Fault.FOREIGN):
        where, rule = f"{folder}, {MARKER}", "a result lists its files there"
        raise InputError(where, marker.fault.value, rule, "Process the recordings again")
    changes = changed_parts(folder, marker)
    if changes and not accept_changes:
        raise _refusal(folder, changes)
    checksums = {
        name: sha256(folder / name) if (folder / name).is_file() else "" for name in changes
    }
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
    for name in marker.files:
        path = folder / name
        if not is_plain_file(path):
            if name not in PAGES or path.exists():
                changes[name] = Change.MISSING
        elif sha256(path) != marker.files[name]:
            changes[name] = Change.CHANGED
    for name in PARTS:
        if name not in marker.files and (folder / name).exists():
            changes[name] = Change.ADDED
    return changes


def accepted_notes(record: Mapping[str, Any], name: str) -> tuple[str, ...]:
    """A note on what was accepted although it had changed, if there is any.

    Parameters
    ----------
    record : mapping
        Provenance of a result.
    name : str
        What to call the result.
    """
    changed = sorted(record.get(ACCEPTED, ()))
    return (f"{name} was changed after it was written: {', '.join(changed)}",) if changed else ()


def _refusal(folder: Path, changes: dict[str, Change]) -> InputError:
    if Change.UNPROVEN in changes.values():
        return InputError(
            str(folder),
            "a result of version 0.1.0, without checksums",
            "nothing tells whether its files are as they were written",
            "Process the recordings again, or accept them as they are with --accept-changes",
        )
    named = [f"{name} {change.value}" for name, change in list(changes.items())[:_MOST_NAMED]]
    more = f" and {len(changes) - _MOST_NAMED} more" if len(changes) > _MOST_NAMED else ""
    return InputError(
        str(folder),
        f"{', '.join(named)}{more}",
        "a result is used as it was written",
        "Process the recordings again, or accept what was changed with --accept-changes",
    )
