"""One tyre of the library: its versions, and which of them counts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ema.core.errors import InputError, unknown
from pipelines.library.numbering import APPROVED, NEWEST, numbered, numbered_files, write_next
from pipelines.library.version import (
    APPROVE,
    ROLLBACK,
    Approval,
    Entry,
    Version,
    read_approvals,
    read_version,
    record_approval,
    standing,
    version_text,
)
from pipelines.results.parameter_set import ParameterSet
from pipelines.storage.checksums import DamagedFile, damaged


@dataclass(frozen=True)
class LibraryTyre:
    """A tyre's folder.

    Parameters
    ----------
    path : Path
    """

    path: Path

    @property
    def name(self) -> str:
        """The tyre's name in the library."""
        return self.path.name

    @property
    def newest(self) -> int:
        """Highest number of a version; 0 where there is none."""
        return max(numbered_files(self.path), default=0)

    def add(self, parameters: ParameterSet, entry: Entry) -> Version:
        """Write a new version under the next number.

        Raises
        ------
        InputError
            If the folder belongs to another tyre.
        OSError
            If the drive refuses; nothing is written then.
        """

        def text_of(number: int) -> str:
            if number > 1:  # looked at for every number: another tyre may come at the same moment
                self._require_same(parameters.designation, entry.tyre_id)
            return version_text(parameters, entry, number)

        return self.version(write_next(self.path, text_of))

    def version(self, number: int) -> Version:
        """Read a version.

        Raises
        ------
        InputError
            If there is none of that number.
        DamagedFile
            If its file is not what was written, or is gone.
        """
        newest = self.newest
        if not 1 <= number <= newest:
            rule = f"there are versions 1 to {newest}"
            remedy = f"The newest is {self.name}@{newest}"
            raise InputError(self.name, f"version {number}", rule, remedy)
        return read_version(numbered(self.path, number), self.name, number)

    def versions(self) -> tuple[list[Version], list[DamagedFile]]:
        """All versions that can be read, ascending, and the damage that hides the others."""
        whole, hidden = [], []
        for number in range(1, self.newest + 1):
            try:
                whole.append(self.version(number))
            except DamagedFile as error:
                hidden.append(error)
        return whole, hidden

    def latest_intact(self) -> Version:
        """The newest version that can be read.

        Raises
        ------
        DamagedFile
            If there is none; names the newest.
        """
        damage = []
        for number in range(self.newest, 0, -1):
            try:
                return self.version(number)
            except DamagedFile as error:
                damage.append(error)
        raise damage[0]

    def intact_versions(self) -> list[Version]:
        """All versions, ascending.

        Raises
        ------
        DamagedFile
            If any of them is not what was written.
        """
        whole, hidden = self.versions()
        if hidden:
            raise hidden[0]
        return whole

    def approval(self) -> Approval | None:
        """The approval in force; None where nothing is approved.

        Raises
        ------
        DamagedFile
            If any approval is not what was written.
        """
        stack = standing(read_approvals(self.path))
        return stack[-1] if stack else None

    def approved(self) -> Version | None:
        """The approved version; None where nothing is approved.

        Raises
        ------
        DamagedFile
            If its file or any approval is not what was written.
        """
        approval = self.approval()
        return None if approval is None else self._approved_by(approval)

    def chosen(self, version: int | str = "") -> Version:
        """The version that is meant.

        Parameters
        ----------
        version : int or {"approved", "newest", ""}
            The empty text stands for the approved version, and the newest where none is.

        Raises
        ------
        InputError
            If there is none such.
        """
        if isinstance(version, int):
            return self.version(version)
        found = None if version == NEWEST else self.approved()
        if found is None and version == APPROVED:
            remedy = f"Approve one, e.g. with `ringmodal tyre approve {self.name}@{self.newest}`"
            raise InputError(self.name, "no approved version", "an approved one is wanted", remedy)
        return found or self.version(self.newest)

    def approve(self, number: int, author: str, note: str = "") -> Version:
        """Make a version the approved one; nothing is recorded where it is already.

        Raises
        ------
        InputError
            If there is no such version.
        """
        version, approval = self.version(number), self.approval()
        if approval is None or approval.version != number:
            record_approval(self.path, APPROVE, version, author, note)
        return version

    def rollback(self, author: str, number: int | None = None, note: str = "") -> Version:
        """Make a version that was approved earlier the approved one again.

        Parameters
        ----------
        author : str
        number : int, optional
            Default: the version that was approved before the present one.
        note : str

        Raises
        ------
        InputError
            If it was not approved earlier.
        """
        stack = standing(read_approvals(self.path))[:-1]
        earlier = [each.version for each in stack]
        if not earlier:
            rule = "a rollback goes back to an approval before the present one"
            remedy = "Approve the version that is to count with `ringmodal tyre approve`"
            raise InputError(self.name, "no earlier approval", rule, remedy)
        if number is not None and number not in earlier:
            known = [f"{self.name}@{each}" for each in earlier]
            rule = "a rollback goes back to a version that was approved earlier"
            raise unknown(self.name, f"{self.name}@{number}", rule, known)
        wanted = earlier[-1] if number is None else number
        version = self._approved_by(next(each for each in stack if each.version == wanted))
        record_approval(self.path, ROLLBACK, version, author, note)
        return version

    def standing(self, version: Version) -> str:
        """What a version is among the others, in words: approved by whom, newest, older."""
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
                "Tell the tyres apart with --tyre NAME, or write the designation as there",
            )

    def _approved_by(self, approval: Approval) -> Version:
        if approval.version > self.newest:
            raise damaged(numbered(self.path, approval.version), "no file, though it was approved")
        version = self.version(approval.version)
        if version.sha256 != approval.version_sha256:
            path = numbered(self.path, version.number)
            raise damaged(path, "another content than the one that was approved")
        return version
