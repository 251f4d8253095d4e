"""A version of a parameter set: the set, where it comes from, who added it, when and why."""

from __future__ import annotations

import getpass
import secrets
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeGuard

import tomlkit

from ema.core.errors import InputError
from pipelines.library.numbering import numbered_files, write_next
from pipelines.results.parameter_set import ParameterSet, parameter_document, parameter_set_of
from pipelines.results.provenance import software_version
from pipelines.storage.checksums import checksum, damaged, sealed, texts_of, unsealed

SECTION = "version"
_SIGNED = ("author", "created", "software")
_MORE = ("note", "tyre_id", "source", "source_sha256", "id")


@dataclass(frozen=True)
class Entry:
    """What a version tells besides its parameter set.

    Parameters
    ----------
    author : str
    created : str
        Moment of adding, ISO 8601 in UTC.
    software : str
    note : str
    tyre_id : str
        Tells tyres of one designation apart; empty where there is one of each.
    source : str
        Name of the result folder or parameter set that was added, without its path.
    source_sha256 : str
        Checksum of its ``tyre.toml``.
    id : str
        Unique among all entries.
    """

    author: str
    created: str
    software: str
    note: str = ""
    tyre_id: str = ""
    source: str = ""
    source_sha256: str = ""
    id: str = ""


@dataclass(frozen=True)
class Version:
    """A numbered, immutable version of a tyre's parameter set.

    Parameters
    ----------
    tyre : str
        The tyre's name in the library.
    number : int
    parameters : ParameterSet
    entry : Entry
    sha256 : str
        Checksum over the content of its file.
    """

    tyre: str
    number: int
    parameters: ParameterSet
    entry: Entry
    sha256: str

    @property
    def reference(self) -> str:
        """How the version is called: ``NAME@3``."""
        return f"{self.tyre}@{self.number}"

    @property
    def for_others(self) -> ParameterSet:
        """The parameter set with its place in the library among its provenance."""
        told = {"tyre": self.tyre, "version": self.number, "sha256": self.sha256}
        entry = {key: text for key, text in asdict(self.entry).items() if text and key != "id"}
        own = self.parameters
        provenance = {**own.provenance, "library": {**told, **entry}}
        return ParameterSet(
            own.designation, own.conditions, own.ring, own.damping, own.wheel, provenance
        )


def signed_now(author: str) -> dict[str, str]:
    """Author, moment, software and a unique id, as versions and approvals carry them."""
    return {
        "author": author,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": f"ringmodal {software_version()}",
        "id": secrets.token_hex(8),
    }


def login_name() -> str:
    """Login name of whoever runs the program.

    Raises
    ------
    InputError
        If the system tells none.
    """
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError) as error:
        rule = "every version has an author"
        raise InputError("--author", "no login name", rule, "Give --author NAME") from error


def version_text(parameters: ParameterSet, entry: Entry, number: int) -> str:
    """Text of a version's file."""
    document = parameter_document(parameters)
    table = tomlkit.table()
    table["number"] = number
    for key, text in asdict(entry).items():
        if text:
            table[key] = text
    document[SECTION] = table
    return sealed(tomlkit.dumps(document))


def read_version(path: Path, tyre: str, number: int) -> Version:
    """Read a version.

    Raises
    ------
    DamagedFile
        If its file is not what was written.
    """
    content = unsealed(path)
    told = content.get(SECTION)
    if not isinstance(told, dict) or told.get("number") != number:
        raise damaged(path, f"version {told['number']}" if _has_number(told) else "no version")
    try:
        parameters = parameter_set_of(path, content)
    except InputError as error:
        raise damaged(path, f"{error.found} at {error.where}") from error
    entry = Entry(**texts_of(path, told, _SIGNED, _MORE))
    return Version(tyre, number, parameters, entry, checksum(path))


def _has_number(told: object) -> TypeGuard[dict[str, Any]]:
    return isinstance(told, dict) and isinstance(told.get("number"), int)


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
