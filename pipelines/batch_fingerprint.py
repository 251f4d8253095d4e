"""What a result depends on, in one number: the bytes of its inputs, the options, the version."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from ema.errors import ManifestError
from ema.io.manifest import MANIFEST_NAME, read_manifest, resolve
from pipelines.checksums import sha256
from pipelines.options import Options
from pipelines.versions import software_version


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
