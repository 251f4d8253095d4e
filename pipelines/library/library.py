"""The library of parameter sets: a folder of tyres with numbered versions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from ema.core.errors import InputError, unknown
from model.errors import ParameterError
from model.verdict import State
from pipelines.library.numbering import VARIABLE, folder_name, numbered_files, split_reference
from pipelines.library.version import Entry, LibraryTyre, Version, login_name, signed_now
from pipelines.results.parameter_set import (
    CONDITION_NAMES,
    ParameterSet,
    accepted,
    read_parameter_set,
)
from pipelines.results.provenance import READ_BACK, checked_result
from pipelines.results.verdict import accepted_verdict
from pipelines.storage.atomic import folder_in_use
from pipelines.storage.checksums import DamagedFile, sha256

_RESULT, _SET = "provenance.json", "tyre.toml"


@dataclass(frozen=True)
class NamedSet:
    """A parameter set and its name in messages: ``NAME@3``, or the path of its file."""

    name: str
    parameters: ParameterSet


@dataclass(frozen=True)
class TyreLibrary:
    """A folder with one subfolder per tyre."""

    folder: Path

    def tyres(self) -> tuple[LibraryTyre, ...]:
        """All tyres, by name; `InputError` if there is no such folder."""
        if not self.folder.is_dir():
            place = "a file" if self.folder.exists() else "no such folder"
            remedy = "Check the path; `ringmodal tyre add` creates a library"
            raise InputError(str(self.folder), place, "a library must be a folder", remedy)
        folders = (path for path in self.folder.iterdir() if path.is_dir())
        found = [LibraryTyre(path) for path in folders if numbered_files(path)]
        return tuple(sorted(found, key=lambda tyre: tyre.name.casefold()))

    def tyre(self, name: str) -> LibraryTyre:
        """The only tyre with this name in the library, this designation, or this id."""
        tyres = self.tyres()
        exact = [tyre for tyre in tyres if tyre.name.casefold() == _as_folder(name)]
        matching = exact or [tyre for tyre in tyres if _as_folder(name) in _names(tyre)]
        if len(matching) == 1:
            return matching[0]
        names = [tyre.name for tyre in matching or tyres]
        if not matching:
            raise unknown("tyre", name, f"not found in {self.folder}", names)
        rule = f"several tyres match: {', '.join(names)}"
        raise InputError("tyre", repr(name), rule, f"Write e.g. {names[0]}")

    def version(self, reference: str) -> Version:
        """The version ``NAME``, ``NAME@3``, ``NAME@approved`` or ``NAME@newest``."""
        name, version = split_reference(reference)
        return self.tyre(name).chosen(version)

    def add(
        self,
        source: Path | str,
        *,
        tyre_id: str = "",
        note: str = "",
        author: str = "",
        conditions: Mapping[str, float] | None = None,
        accept_changes: bool = False,
        accept_warnings: bool = False,
    ) -> Version:
        """Add the parameter set of a result folder or a TOML file as a new version of its tyre.

        Parameters
        ----------
        tyre_id : str
            Distinguishes tyres of one designation.
        note, author : str
            Default author: the login name.
        conditions : mapping of str to float, optional
            Further conditions, named as in `CONDITION_NAMES`.
        accept_changes : bool
            Accept an edited result or set; this is recorded in its provenance.
        accept_warnings : bool
            Accept a set whose verdict is bad; a doubtful one needs nothing until it is approved.

        Raises
        ------
        InputError
            If the parameters do not describe a ring, were edited or are bad and not accepted, or
            the name belongs to another tyre.
        """
        path = parameter_file(Path(source))
        found = read_source(Path(source), accept_changes=accept_changes)
        if found.basis.state is State.BAD:
            accepted_verdict(str(source), found.basis, accept_warnings=accept_warnings)
        for name in conditions or {}:
            if name not in CONDITION_NAMES:
                raise unknown("--condition", name, "unknown condition", CONDITION_NAMES)
        parameters = replace(found, conditions={**found.conditions, **(conditions or {})})
        try:
            _ = parameters.ring_parameters, parameters.ring_damping, parameters.wheel_parameters
        except ParameterError as error:
            where = f"{path}, {error.where}"
            raise InputError(where, error.found, error.rule, error.remedy) from error
        entry = Entry(
            **signed_now(author or login_name()),
            note=note,
            tyre_id=tyre_id,
            source=Path(source).resolve().name,
            source_sha256=sha256(path),
        )
        # A missing parent is a typing error.
        if not self.folder.absolute().parent.is_dir():
            rule = "the parent folder of a library must exist"
            raise InputError(str(self.folder), "no such folder", rule, "Check the path")
        if self.folder.exists() and not self.folder.is_dir():
            raise InputError(str(self.folder), "a file", "it must be a folder", "Name a folder")
        with folder_in_use(self.folder):
            wanted = folder_name(parameters.designation, tyre_id)
            same = [t for t in self.tyres() if t.name.casefold() == wanted.casefold()]
            tyre = same[0] if same else LibraryTyre(self.folder / wanted)
            return tyre.add(parameters, entry)


def resolve(
    reference: str, library: Path | None = None, *, accept_changes: bool = False
) -> NamedSet:
    """Parameter set of a reference on the command line.

    It names a result folder, a parameter set in TOML, or a version of a tyre in the library,
    ``NAME`` or ``NAME@3``. Edited results and sets are refused unless accepted.
    """
    path = Path(reference)
    if path.is_file() or any((path / name).is_file() for name in (_RESULT, _SET)):
        return NamedSet(reference, read_source(path, accept_changes=accept_changes))
    if library is None:
        rule = "it is not a file or result folder, and no library is given"
        remedy = f"Check the path, or give --library or {VARIABLE}"
        raise InputError(reference, "no such file", rule, remedy)
    version = TyreLibrary(library).version(reference)
    return NamedSet(version.reference, version.for_others)


def read_source(source: Path, *, accept_changes: bool = False, lone: bool = True) -> ParameterSet:
    """Parameter set of a result folder or file, which must not be edited.

    With `accept_changes` it may be, which is recorded in its provenance; unless `lone`, a single
    file may be as well.
    """
    changes: Iterable[str] = ()
    if any((source / name).is_file() for name in (_RESULT, *READ_BACK)):
        changes = checked_result(source, accept_changes=accept_changes).accepted
    found = read_parameter_set(
        parameter_file(source),
        must_be_as_written=lone and not source.is_dir(),
        accept_changes=accept_changes,
    )
    return accepted(found, changes) if changes else found


def parameter_file(source: Path) -> Path:
    """The parameter set of a result folder, or the file itself; `InputError` if there is none."""
    if not source.is_dir():
        return source
    path = source / _SET
    if not path.is_file():
        is_result = (source / _RESULT).is_file()
        remedy = "Give pressure and radius in [tyre] and process it again; see its report"
        raise InputError(
            str(source),
            f"no {_SET}",
            "its ring steps were left out" if is_result else "it is not a result folder",
            remedy if is_result else "Give a result folder or a parameter set",
        )
    return path


def _as_folder(name: str) -> str:
    """Name of the folder of a tyre; empty where the name makes no folder."""
    with suppress(InputError):
        return folder_name(name).casefold()
    return ""


def _names(tyre: LibraryTyre) -> set[str]:
    """Designation and id of a tyre, as names of folders; none where all is damaged."""
    with suppress(DamagedFile):
        latest = tyre.latest_intact()
        texts = (latest.parameters.designation, latest.entry.tyre_id)
        return {folder_name(text).casefold() for text in texts if text}
    return set()
