"""A version of a parameter set: the set, where it comes from, who added it, when and why."""

from __future__ import annotations

import secrets
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeGuard

from ema.errors import InputError
from pipelines.library_seal import checksum, damaged, sealed, texts_of, unsealed
from pipelines.parameter_set import ParameterSet, parameter_document, parameter_set_of

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
        Result folder or parameter set that was added.
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
    from pipelines.versions import software_version

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
    import getpass

    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError) as error:
        rule = "every version has an author"
        raise InputError("--author", "no login name", rule, "Give --author NAME") from error


def version_text(parameters: ParameterSet, entry: Entry, number: int) -> str:
    """Text of a version's file."""
    import tomlkit

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
