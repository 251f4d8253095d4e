"""One tyre of the library: its versions and their approvals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ema.core.errors import InputError, unknown
from pipelines.library.numbering import APPROVED, NEWEST, numbered, numbered_files, write_next
from pipelines.library.version import (
    Approval,
    Entry,
    Event,
    Version,
    approvals_in_force,
    read_approvals,
    read_version,
    record_approval,
    version_text,
)
from pipelines.results.parameter_set import ParameterSet
from pipelines.storage.checksums import DamagedFile, damaged


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

    def approve(self, number: int, author: str, note: str = "") -> Version:
        """Approve a version; nothing is recorded where it is approved already."""
        version, approval = self.version(number), self.approval()
        if approval is None or approval.version != number:
            record_approval(self.path, Event.APPROVE, version, author, note)
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
