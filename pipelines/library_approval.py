"""Approvals: which version counts, as a list of events that never change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipelines.library_claim import numbered_files, write_next
from pipelines.library_seal import damaged, sealed, texts_of, unsealed
from pipelines.library_version import Version, signed_now

SCHEMA = 1
FOLDER = "approvals"
APPROVE, ROLLBACK = "approve", "rollback"
_TEXTS = ("event", "version_sha256", "author", "created")


@dataclass(frozen=True)
class Approval:
    """That a version counts from now on.

    Parameters
    ----------
    event : {"approve", "rollback"}
    version : int
    version_sha256 : str
        Checksum of the version that was approved.
    author, created, note : str
    """

    event: str
    version: int
    version_sha256: str
    author: str
    created: str
    note: str = ""


def record_approval(folder: Path, event: str, version: Version, author: str, note: str) -> Approval:
    """Write an approval down as the next event of a tyre's folder."""
    signed = signed_now(author)
    told = {"event": event, "version": version.number, "version_sha256": version.sha256, **signed}
    if note:
        told["note"] = note
    write_next(folder / FOLDER, lambda number: _text({"number": number, **told}))
    return Approval(event, version.number, version.sha256, author, signed["created"], note)


def read_approvals(folder: Path) -> tuple[Approval, ...]:
    """All approvals of a tyre's folder, in the order they were made.

    Raises
    ------
    DamagedFile
        If one is not what was written, or is gone.
    """
    files = numbered_files(folder / FOLDER)
    return tuple(_read(folder, number) for number in range(1, max(files, default=0) + 1))


def standing(approvals: Sequence[Approval]) -> list[Approval]:
    """Approvals that a rollback leads back to, the one in force last.

    An approval comes on top; a rollback takes the place of the version it goes back to.
    """
    stack: list[Approval] = []
    for approval in approvals:
        numbers = [each.version for each in stack]
        if approval.event == ROLLBACK and approval.version in numbers:
            del stack[numbers.index(approval.version) :]
        stack.append(approval)
    return stack


def _text(told: dict[str, object]) -> str:
    import tomlkit

    document = tomlkit.document()
    document["schema"] = SCHEMA
    document.update(told)
    return sealed(tomlkit.dumps(document))


def _read(folder: Path, number: int) -> Approval:
    path = folder / FOLDER / f"{number:04}.toml"
    content = unsealed(path)
    if content.get("number") != number or content.get("schema") != SCHEMA:
        raise damaged(path, f"event {content.get('number')}, schema {content.get('schema')}")
    version = content.get("version")
    if not isinstance(version, int) or content.get("event") not in (APPROVE, ROLLBACK):
        raise damaged(path, f"event {content.get('event')!r} of version {version!r}")
    return Approval(version=version, **texts_of(path, content, _TEXTS, ("note",)))
