"""One tyre of the library: versions of its parameter set, their origin, and their approvals."""

from __future__ import annotations

import getpass
import secrets
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path

import tomlkit

from ema.core.errors import InputError, unknown
from pipelines.library.numbering import APPROVED, NEWEST, numbered, numbered_files, write_next
from pipelines.results.parameter_set import (
    Parameter,
    ParameterSet,
    parameter_document,
    parameter_set_of,
)
from pipelines.results.provenance import software_version
from pipelines.results.verdict import accepted_verdict
from pipelines.storage.checksums import KEY, DamagedFile, damaged, sealed, texts_of, unsealed

SECTION = "version"
_REQUIRED = ("author", "created", "software")
_OPTIONAL = ("note", "tyre_id", "source", "source_sha256", "id")
SCHEMA = 1
FOLDER = "approvals"
_TEXTS = ("version_sha256", "author", "created")
_MORE_TEXTS = ("note", "accepted")


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


def login_name(option: str = "--author") -> str:
    """Login name of the user; `InputError` if the system has none."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError) as error:
        rule = "it needs an author"
        raise InputError(option, "no login name", rule, f"Give {option} NAME") from error


def version_text(parameters: ParameterSet, entry: Entry, number: int) -> str:
    """Text of a version's file."""
    document = parameter_document(parameters)
    stated = {key: text for key, text in asdict(entry).items() if text}
    document[SECTION] = {"number": number, **stated}
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
    if KEY not in section:
        raise damaged(path, f"the checksum outside the table [{SECTION}]")
    return Version(tyre, number, parameters, entry, section[KEY])


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
    accepted: str = ""  # the verdict that was accepted, where it is not good


def record_approval(
    folder: Path, event: Event, version: Version, author: str, note: str, accepted: str = ""
) -> None:
    """Write an approval as the next event of a tyre's folder."""
    record = {"event": event.value, "version": version.number, "version_sha256": version.sha256}
    stated = {"note": note, "accepted": accepted}
    record |= signed_now(author) | {key: text for key, text in stated.items() if text}

    def text_of(number: int) -> str:
        return sealed(tomlkit.dumps({"schema": SCHEMA, "number": number, **record}))

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
    return Approval(Event(event), version, **texts_of(path, content, _TEXTS, _MORE_TEXTS))


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


@dataclass(frozen=True)
class LibraryTyre:
    """A tyre's folder; reading a changed or missing file raises `DamagedFile`."""

    path: Path

    @property
    def name(self) -> str:
        """Name of the tyre in the library."""
        return self.path.name

    @property
    def newest(self) -> int:
        """Highest number of a version; 0 where there is none."""
        return max(numbered_files(self.path), default=0)

    def add(self, parameters: ParameterSet, entry: Entry) -> Version:
        """Write a new version under the next number; the folder must be that of the same tyre."""

        def text_of(number: int) -> str:
            if number > 1:  # checked for every number: another tyre may be added at the same time
                self._require_same(parameters.designation, entry.tyre_id)
            return version_text(parameters, entry, number)

        return self.version(write_next(self.path, text_of))

    def version(self, number: int) -> Version:
        """Read a version; `InputError` if there is none of that number."""
        newest = self.newest
        if not 1 <= number <= newest:
            rule = f"there are versions 1 to {newest}"
            remedy = f"The newest is {self.name}@{newest}"
            raise InputError(self.name, f"version {number}", rule, remedy)
        return read_version(numbered(self.path, number), self.name, number)

    def versions(self) -> tuple[list[Version], list[DamagedFile]]:
        """All readable versions, ascending, and the damage of the others."""
        intact, damage = [], []
        for number in range(1, self.newest + 1):
            try:
                intact.append(self.version(number))
            except DamagedFile as error:
                damage.append(error)
        return intact, damage

    def latest_intact(self) -> Version:
        """The newest readable version; without one, the damage of the newest is raised."""
        damage = []
        for number in range(self.newest, 0, -1):
            try:
                return self.version(number)
            except DamagedFile as error:
                damage.append(error)
        raise damage[0]

    def intact_versions(self) -> list[Version]:
        """All versions, ascending; none may be damaged."""
        intact, damage = self.versions()
        if damage:
            raise damage[0]
        return intact

    def approval(self) -> Approval | None:
        """The approval in force; None where nothing is approved."""
        stack = approvals_in_force(read_approvals(self.path))
        return stack[-1] if stack else None

    def approved(self) -> Version | None:
        """The approved version; None where nothing is approved."""
        approval = self.approval()
        return None if approval is None else self._approved_by(approval)

    def chosen(self, version: int | str = "") -> Version:
        """The version with a number, or ``"approved"``, or ``"newest"``.

        The empty text means the approved version, or the newest where none is approved.
        """
        if isinstance(version, int):
            return self.version(version)
        found = None if version == NEWEST else self.approved()
        if found is None and version == APPROVED:
            remedy = f"Approve one, e.g. with `ringmodal tyre approve {self.name}@{self.newest}`"
            raise InputError(self.name, "no approved version", "an approved one needed", remedy)
        return found or self.version(self.newest)

    def approve(
        self, number: int, author: str, note: str = "", *, accept_warnings: bool = False
    ) -> Version:
        """Approve a version; nothing is recorded where it is approved already.

        `InputError` for a version whose verdict is not good, unless that is accepted.
        """
        version, approval = self.version(number), self.approval()
        if approval is None or approval.version != number:
            basis = version.parameters.basis
            accepted = accepted_verdict(version.reference, basis, accept_warnings=accept_warnings)
            record_approval(self.path, Event.APPROVE, version, author, note, accepted)
        return version

    def rollback(self, author: str, number: int | None = None, note: str = "") -> Version:
        """Return to an approval before the present one, by default to the last."""
        stack = approvals_in_force(read_approvals(self.path))[:-1]
        earlier = {each.version: each for each in stack}
        rule = "a rollback returns to an earlier approval"
        if not stack:
            remedy = "Approve the version to use with `ringmodal tyre approve`"
            raise InputError(self.name, "no earlier approval", rule, remedy)
        wanted = stack[-1].version if number is None else number
        if wanted not in earlier:
            known = [f"{self.name}@{each}" for each in earlier]
            raise unknown(self.name, f"{self.name}@{wanted}", rule, known)
        version = self._approved_by(earlier[wanted])
        record_approval(self.path, Event.ROLLBACK, version, author, note)
        return version

    def standing(self, version: Version) -> str:
        """State of a version for people: approved by whom, newest, older."""
        approval, newest = self.approval(), self.newest
        if approval is None:
            which = "the newest" if version.number == newest else f"older than {newest}"
            return f"{which}; no version is approved"
        if approval.version != version.number:
            return f"not approved; version {approval.version} is"
        note = f": {approval.note}" if approval.note else ""
        note += f"; accepted as {approval.accepted}" if approval.accepted else ""
        later = newest - version.number
        more = f"; {later} newer not approved" if later else ""
        return f"approved by {approval.author}, {approval.created}{note}{more}"

    def _require_same(self, designation: str, tyre_id: str) -> None:
        latest = self.latest_intact()
        held = latest.parameters.designation, latest.entry.tyre_id
        if held != (designation, tyre_id):
            raise InputError(
                str(self.path),
                " ".join(filter(None, (designation, tyre_id))),
                f"this folder belongs to {' '.join(filter(None, held))}",
                "Distinguish the tyres with --tyre NAME, or use the same designation",
            )

    def _approved_by(self, approval: Approval) -> Version:
        if approval.version > self.newest:
            raise damaged(numbered(self.path, approval.version), "no file, though it was approved")
        version = self.version(approval.version)
        if version.sha256 != approval.version_sha256:
            path = numbered(self.path, version.number)
            raise damaged(path, "another content than the one that was approved")
        return version
