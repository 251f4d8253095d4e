"""A version of a parameter set (content, origin, author, time) and its approvals."""

from __future__ import annotations

import getpass
import secrets
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

import tomlkit

from ema.core.errors import InputError
from pipelines.library.numbering import numbered, numbered_files, write_next
from pipelines.results.parameter_set import (
    Parameter,
    ParameterSet,
    parameter_document,
    parameter_set_of,
)
from pipelines.results.provenance import software_version
from pipelines.storage.checksums import KEY, damaged, sealed, texts_of, unsealed

SECTION = "version"
_REQUIRED = ("author", "created", "software")
_OPTIONAL = ("note", "tyre_id", "source", "source_sha256", "id")


@dataclass(frozen=True)
class Entry:
    """Origin of a version."""

    author: str
    created: str  # time of adding, ISO 8601 in UTC
    software: str
    note: str = ""
    tyre_id: str = ""  # distinguishes tyres of one designation; may be empty
    # name, without path, of the result folder or parameter set; checksum of its ``tyre.toml``
    source: str = ""
    source_sha256: str = ""
    id: str = ""  # unique among all entries


@dataclass(frozen=True)
class Version:
    """A numbered, immutable version of a tyre's parameter set, with the checksum of its file."""

    tyre: str
    number: int
    parameters: ParameterSet
    entry: Entry
    sha256: str

    @property
    def reference(self) -> str:
        """Tyre and number, ``NAME@3``."""
        return f"{self.tyre}@{self.number}"

    @property
    def for_others(self) -> ParameterSet:
        """The parameter set, with its place in the library as part of its provenance."""
        entry = {key: text for key, text in asdict(self.entry).items() if text and key != "id"}
        place = {"tyre": self.tyre, "version": self.number, "sha256": self.sha256, **entry}
        own = self.parameters
        return replace(own, provenance={**own.provenance, "library": place})


def recordings(parameters: ParameterSet) -> frozenset[str]:
    """Checksums of the recordings from which a parameter set was identified."""
    inputs = parameters.provenance.get("inputs", {})
    if not isinstance(inputs, dict):
        return frozenset()
    return frozenset(str(sum_) for name, sum_ in inputs.items() if not name.endswith(".toml"))


def values_of(parameters: ParameterSet) -> dict[str, Parameter]:
    """All parameters by name; those of the wheel are ``wheel_mass_kg`` and ``wheel_inertia_…``."""
    wheel = {f"wheel_{name}": Parameter(value) for name, value in parameters.wheel.items()}
    return {**parameters.ring_and_damping, **wheel}


def signed_now(author: str) -> dict[str, str]:
    """Author, time, software and a unique id, for versions and approvals."""
    return {
        "author": author,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": f"ringmodal {software_version()}",
        "id": secrets.token_hex(8),
    }


def login_name() -> str:
    """Login name of the user; `InputError` if the system has none."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError) as error:
        rule = "every version needs an author"
        raise InputError("--author", "no login name", rule, "Give --author NAME") from error


def version_text(parameters: ParameterSet, entry: Entry, number: int) -> str:
    """Text of a version's file."""
    document = parameter_document(parameters)
    table = tomlkit.table()
    table["number"] = number
    table.update({key: text for key, text in asdict(entry).items() if text})
    document[SECTION] = table
    return sealed(tomlkit.dumps(document))


def read_version(path: Path, tyre: str, number: int) -> Version:
    """Read a version; `DamagedFile` if its file was changed."""
    content = unsealed(path)
    section = content.get(SECTION)
    if not isinstance(section, dict) or section.get("number") != number:
        found = section.get("number") if isinstance(section, dict) else None
        raise damaged(path, f"version {found}" if isinstance(found, int) else "no version")
    try:
        parameters = parameter_set_of(path, content)
    except InputError as error:
        raise damaged(path, f"{error.found} at {error.where}") from error
    entry = Entry(**texts_of(path, section, _REQUIRED, _OPTIONAL))
    return Version(tyre, number, parameters, entry, section[KEY])


SCHEMA = 1
FOLDER = "approvals"
_TEXTS = ("version_sha256", "author", "created")


class Event(StrEnum):
    """Kind of an approval, as its file states it."""

    APPROVE = "approve"
    ROLLBACK = "rollback"


class ApprovalState(StrEnum):
    """Whether a version is or was approved, as the history shows it."""

    APPROVED = "approved"
    EARLIER = "was approved"
    NEVER = ""


@dataclass(frozen=True)
class Approval:
    """Approval of a version with this checksum, in force from then on."""

    event: Event
    version: int
    version_sha256: str
    author: str
    created: str
    note: str = ""


def record_approval(folder: Path, event: Event, version: Version, author: str, note: str) -> None:
    """Write an approval as the next event of a tyre's folder."""
    record = {"event": event.value, "version": version.number, "version_sha256": version.sha256}
    record |= signed_now(author) | ({"note": note} if note else {})

    def text_of(number: int) -> str:
        document = tomlkit.document()
        document.update({"schema": SCHEMA, "number": number, **record})
        return sealed(tomlkit.dumps(document))

    write_next(folder / FOLDER, text_of)


def read_approvals(folder: Path) -> tuple[Approval, ...]:
    """All approvals of a tyre in order; `DamagedFile` if one was changed or is missing."""
    files = numbered_files(folder / FOLDER)
    return tuple(_read(folder / FOLDER, number) for number in range(1, max(files, default=0) + 1))


def _read(folder: Path, number: int) -> Approval:
    path = numbered(folder, number)
    content = unsealed(path)
    if content.get("number") != number or content.get("schema") != SCHEMA:
        raise damaged(path, f"event {content.get('number')}, schema {content.get('schema')}")
    version, event = content.get("version"), content.get("event")
    if not isinstance(version, int) or event not in tuple(Event):
        raise damaged(path, f"event {event!r} of version {version!r}")
    return Approval(Event(event), version, **texts_of(path, content, _TEXTS, ("note",)))


def approvals_in_force(approvals: Sequence[Approval]) -> list[Approval]:
    """Approvals to which a rollback can return, the one in force last.

    An approval is added on top; a rollback takes the place of the version it returns to.
    """
    stack: list[Approval] = []
    for approval in approvals:
        numbers = [each.version for each in stack]
        if approval.event is Event.ROLLBACK and approval.version in numbers:
            del stack[numbers.index(approval.version) :]
        stack.append(approval)
    return stack
