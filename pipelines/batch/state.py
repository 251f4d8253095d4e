"""What became of a campaign: a row of the batch's tables, remembered for the next run."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ema.core.errors import InputError, ManifestError
from ema.core.files import require_regular
from ema.io.campaign.manifest import MANIFEST_NAME, read_manifest, resolve
from pipelines.results.options import Options
from pipelines.results.provenance import software_version
from pipelines.storage.atomic import file_written_whole, partial_folder
from pipelines.storage.checksums import sha256
from pipelines.storage.rounding import jsonable

DONE = "done"
FAILED = "failed"
SCHEMA = 1

Row = tuple[Any, ...]


@dataclass(frozen=True)
class Record:
    """What became of a campaign.

    Parameters
    ----------
    campaign : str
        Name of the campaign.
    status : {"done", "failed"}
    fingerprint : Fingerprint
        What it was processed from.
    message : str
        Why it failed; empty where it is done.
    traceback : str
        Where it failed, for faults of the program only.
    seconds : float
        Wall time of the processing.
    designation : str
        The tyre's; empty where there is none.
    inflation_pressure_pa : float or None
    n_warnings : int
        Findings that are warnings or tell that something was left out.
    modes : tuple of tuple
        Rows of ``modes.csv``.
    parameters : tuple of tuple
        Name, value, standard deviation and origin of each ring and damping parameter.
    """

    campaign: str
    status: str
    fingerprint: Fingerprint
    message: str = ""
    traceback: str = ""
    seconds: float = 0.0
    designation: str = ""
    inflation_pressure_pa: float | None = None
    n_warnings: int = 0
    modes: tuple[Row, ...] = ()
    parameters: tuple[Row, ...] = ()

    @property
    def is_done(self) -> bool:
        """Whether there is a result."""
        return self.status == DONE


def write_record(record: Record, path: Path) -> None:
    """Write a record, whole or not at all.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    text = json.dumps({"schema": SCHEMA, **jsonable(asdict(record))}, ensure_ascii=False)
    with file_written_whole(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8", newline="\n")


def read_record(path: Path) -> Record | None:
    """Read a record; None where there is none of this version that is whole."""
    try:
        content = json.loads(require_regular(path).read_text(encoding="utf-8"))
        if content.pop("schema") != SCHEMA:
            return None
        fingerprint = content.pop("fingerprint")
        files = tuple(FileState(**state) for state in fingerprint["files"])
        content["fingerprint"] = Fingerprint(fingerprint["digest"], files)
        for name in ("modes", "parameters"):
            content[name] = tuple(map(tuple, content[name]))
        return Record(**content)
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return None


CAMPAIGNS = "campaigns.parquet"
_RECORDS, _RESULTS, _RECORD = "records", "results", "record.json"


@dataclass(frozen=True)
class BatchFolder:
    """Where a batch keeps its results, what it remembers of them, and its tables.

    Parameters
    ----------
    path : Path
        Absolute: workers elsewhere use it too.
    """

    path: Path

    @property
    def modes(self) -> Path:
        """Modes of all campaigns."""
        return self.path / "modes.parquet"

    @property
    def parameters(self) -> Path:
        """Ring parameters of all campaigns."""
        return self.path / "parameters.parquet"

    @property
    def campaigns(self) -> Path:
        """What became of each campaign."""
        return self.path / CAMPAIGNS

    @property
    def summary(self) -> Path:
        """The summary page."""
        return self.path / "summary.html"

    def result(self, place: str) -> Path:
        """Result folder of a campaign."""
        return self.path / _RESULTS / place

    def record(self, place: str) -> Path:
        """What is remembered of a campaign, so that it need not be processed again."""
        return self.path / _RECORDS / place / _RECORD

    def is_complete(self) -> bool:
        """Whether all tables and the summary are there."""
        wanted = (self.modes, self.parameters, self.campaigns, self.summary)
        return all(path.is_file() for path in wanted)


def prepared(out: Path) -> BatchFolder:
    """Make the folder of a batch, or take the one of an earlier run.

    Raises
    ------
    InputError
        If it cannot be written, or holds other files.
    """
    folder = BatchFolder(Path(os.path.realpath(out)))
    records = folder.path / _RECORDS
    try:
        if folder.path.is_dir() and not _is_of_a_batch(folder.path, records):
            rule = "a batch needs a folder of its own"
            raise InputError(str(out), "a folder with other files", rule, "Choose another folder")
        records.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _unwritable(out, error) from error
    _require_writable(out, folder.path)
    return folder


def _is_of_a_batch(folder: Path, records: Path) -> bool:
    """Whether a folder is empty, just begun, or holds what an earlier batch remembers."""
    others = [path for path in folder.iterdir() if path.name not in (_RECORDS, _RESULTS)]
    return not others or any(path.is_file() for path in records.rglob(_RECORD))


def _require_writable(out: Path, folder: Path) -> None:
    try:
        with partial_folder(folder / "probe"):
            pass
    except OSError as error:
        raise _unwritable(out, error) from error


def _unwritable(out: Path, error: OSError) -> InputError:
    rule = "a batch writes its results there"
    remedy = "Check free space and permissions, or choose another folder"
    return InputError(str(out), error.strerror or str(error), rule, remedy)


@dataclass(frozen=True)
class FileState:
    """An input file at a moment.

    Parameters
    ----------
    file : str
        Path in the campaign.
    n_bytes, modified_ns : int
        Size and time of modification; −1 where there is no such file.
    sha256 : str
        Checksum; empty where the file cannot be read.
    """

    file: str
    n_bytes: int = -1
    modified_ns: int = -1
    sha256: str = ""

    def looks_like(self, other: FileState) -> bool:
        """Whether size and time are the same, so that the content need not be read again."""
        return (self.n_bytes, self.modified_ns) == (other.n_bytes, other.modified_ns)


@dataclass(frozen=True)
class Fingerprint:
    """What a campaign was processed from.

    Parameters
    ----------
    digest : str
        SHA-256 over the files' names and checksums, the options and the version.
    files : tuple of FileState
    """

    digest: str
    files: tuple[FileState, ...]


def choices(options: Options) -> str:
    """Options and version as a text that differs whenever a result might."""
    content = {"options": asdict(options), "version": software_version()}
    return json.dumps(content, sort_keys=True, ensure_ascii=False)


def take_fingerprint(campaign: Path, chosen: str, known: Iterable[FileState] = ()) -> Fingerprint:
    """Fingerprint of a campaign as it is now.

    Parameters
    ----------
    campaign : Path
    chosen : str
        From `choices`.
    known : iterable of FileState
        From an earlier time: a file that still looks like that is not read.
    """
    earlier = {state.file: state for state in known}
    return fingerprint_of(
        (_with_checksum(campaign, state, earlier) for state in glance(campaign)), chosen
    )


def fingerprint_of(files: Iterable[FileState], chosen: str) -> Fingerprint:
    """Fingerprint of files whose checksums are known."""
    states = tuple(files)
    content = json.dumps([[[state.file, state.sha256] for state in states], chosen])
    return Fingerprint(hashlib.sha256(content.encode()).hexdigest(), states)


def glance(campaign: Path) -> tuple[FileState, ...]:
    """Sizes and times of the manifest and of the files it names, in its order."""
    return tuple(_seen(campaign, name) for name in _inputs(campaign))


def _inputs(campaign: Path) -> list[str]:
    """Names of a campaign's files; of a faulty manifest alone, as it has to change first."""
    manifest = campaign / MANIFEST_NAME
    try:
        names = [section.file for section in read_manifest(manifest).runs]
        for name in names:
            resolve(manifest, name)
    except ManifestError:
        return [MANIFEST_NAME]
    return [MANIFEST_NAME, *names]


def _seen(campaign: Path, name: str) -> FileState:
    try:
        status = (campaign / name).stat()
    except OSError:
        return FileState(name)
    return FileState(name, status.st_size, status.st_mtime_ns)


def _with_checksum(campaign: Path, state: FileState, known: Mapping[str, FileState]) -> FileState:
    if state.file in known and state.looks_like(known[state.file]):
        return known[state.file]
    try:
        return replace(state, sha256=sha256(campaign / state.file))
    except OSError:
        return state
