"""State of a batch on disk: records of campaigns, their fingerprints, and the folder of both."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from ema.core.display import jsonable
from ema.core.errors import InputError, ManifestError
from ema.core.files import require_regular, resolve
from ema.io.campaign.manifest import MANIFEST_NAME, read_manifest
from pipelines.results.options import Options
from pipelines.results.provenance import software_version
from pipelines.storage.atomic import file_written_whole, partial_folder
from pipelines.storage.checksums import sha256

DONE = "done"
FAILED = "failed"
SCHEMA = 1

Row = tuple[Any, ...]
CAMPAIGNS = "campaigns.parquet"


@dataclass(frozen=True)
class Record:
    """Outcome of a campaign: a row of the batch's tables, kept for the next run."""

    campaign: str  # its name
    status: str  # {"done", "failed"}
    fingerprint: Fingerprint  # what it was processed from
    message: str = ""  # why it failed; empty where it is done
    traceback: str = ""  # where it failed, for internal errors only
    seconds: float = 0.0  # wall time of the processing
    designation: str = ""  # the tyre's; empty where there is none
    inflation_pressure_pa: float | None = None
    n_warnings: int = 0  # findings that are not ok
    modes: tuple[Row, ...] = ()  # rows of ``modes.csv``
    # name, value, standard deviation and origin of each ring and damping parameter
    parameters: tuple[Row, ...] = ()

    @property
    def is_done(self) -> bool:
        """Whether there is a result."""
        return self.status == DONE


def write_record(record: Record, path: Path) -> None:
    """Write a record atomically."""
    text = json.dumps({"schema": SCHEMA, **jsonable(asdict(record))}, ensure_ascii=False)
    with file_written_whole(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8", newline="\n")


def read_record(path: Path) -> Record | None:
    """Read a record; None if it is missing, damaged, or of another version."""
    try:
        content = json.loads(require_regular(path).read_text(encoding="utf-8"))
        if content.pop("schema") != SCHEMA:
            return None
        return TypeAdapter(Record).validate_python(content)
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        return None


_RECORDS, _RESULTS, _RECORD = "records", "results", "record.json"


@dataclass(frozen=True)
class BatchFolder:
    """The folder of a batch: results, records and tables. Its path is absolute, for workers."""

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
        """Outcome of each campaign."""
        return self.path / CAMPAIGNS

    @property
    def summary(self) -> Path:
        """The summary page."""
        return self.path / "summary.html"

    def result(self, place: str) -> Path:
        """Result folder of a campaign."""
        return self.path / _RESULTS / place

    def record(self, place: str) -> Path:
        """Record of a campaign."""
        return self.path / _RECORDS / place / _RECORD

    def is_complete(self) -> bool:
        """Whether all tables and the summary exist."""
        wanted = (self.modes, self.parameters, self.campaigns, self.summary)
        return all(path.is_file() for path in wanted)


def prepared(out: Path) -> BatchFolder:
    """Make the folder of a batch, or open the one of an earlier run."""
    folder = BatchFolder(Path(os.path.realpath(out)))
    records = folder.path / _RECORDS
    try:
        if folder.path.is_dir() and not _is_of_a_batch(folder.path, records):
            rule = "a batch requires an empty folder or that of an earlier batch"
            raise InputError(str(out), "a folder with other files", rule, "Choose another folder")
        records.mkdir(parents=True, exist_ok=True)
        with partial_folder(folder.path / "probe"):
            pass
    except OSError as error:
        rule = "a batch writes its results there"
        remedy = "Check free space and permissions, or choose another folder"
        raise InputError(str(out), error.strerror or str(error), rule, remedy) from error
    return folder


def _is_of_a_batch(folder: Path, records: Path) -> bool:
    """Whether a folder is empty, just begun, or has records of an earlier batch."""
    others = [path for path in folder.iterdir() if path.name not in (_RECORDS, _RESULTS)]
    return not others or any(path.is_file() for path in records.rglob(_RECORD))


@dataclass(frozen=True)
class FileState:
    """State of an input file."""

    file: str  # path in the campaign
    # size and time of modification; −1 if the file is missing
    n_bytes: int = -1
    modified_ns: int = -1
    sha256: str = ""  # checksum; empty if the file cannot be read


@dataclass(frozen=True)
class Fingerprint:
    """Input files, options and version of a result; the digest is the SHA-256 over all of them."""

    digest: str
    files: tuple[FileState, ...]


def choices(options: Options) -> str:
    """Options and version as a text that differs whenever a result might."""
    content = {"options": asdict(options), "version": software_version()}
    return json.dumps(content, sort_keys=True, ensure_ascii=False)


def take_fingerprint(campaign: Path, chosen: str, known: Iterable[FileState] = ()) -> Fingerprint:
    """Fingerprint of a campaign as it is now, with `choices` of options.

    Files with the size and time of a `known` state are not read again.
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
    """Sizes and times of the manifest and of the files it lists."""
    return tuple(_seen(campaign, name) for name in _inputs(campaign))


def _inputs(campaign: Path) -> list[str]:
    """Names of a campaign's files; of a faulty manifest alone, which must change first."""
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
    earlier = known.get(state.file, state)
    if earlier.sha256 and replace(earlier, sha256="") == state:  # same size and time
        return earlier
    try:
        return replace(state, sha256=sha256(campaign / state.file))
    except OSError:
        return state
