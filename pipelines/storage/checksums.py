"""What this program wrote is known by content: a list of files with their checksums in a marker.

A folder that the program wrote holds a marker, a JSON file. Its key ``files`` lists every other
file with its SHA-256, its key ``content_sha256`` is the checksum of the marker's own content.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from ema.core.errors import InputError, escaped
from ema.core.files import require_regular

FILES = "files"
OWN = "content_sha256"
ACCEPTED = "accepted_changes"  # key of a provenance: what was taken although it had changed

_OF_FILE_MANAGERS = ("Thumbs.db", "desktop.ini", ".DS_Store")


class Fault(Enum):
    """Why a marker does not vouch for its folder."""

    UNREADABLE = "it cannot be read"
    FOREIGN = "it lists no files"
    NO_CHECKSUMS = "it lists files without checksums, as version 0.1.0 did"
    CHANGED = "its content was changed after it was written"


@dataclass(frozen=True)
class Marker:
    """A marker as it was found.

    Parameters
    ----------
    content : dict
        What it says besides the list.
    files : dict of str to str
        SHA-256 of each file by its name; empty texts where there are only names.
    fault : Fault or None
        Why it does not vouch for the files; None where it does.
    """

    content: dict[str, Any]
    files: dict[str, str]
    fault: Fault | None = None


def sha256(path: Path) -> str:
    """Checksum of a file, read piece by piece."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def content_sha256(content: Mapping[str, Any]) -> str:
    """Checksum of content as JSON has it, whatever the order of its keys; `OWN` is left out."""
    counted = {key: value for key, value in content.items() if key != OWN}
    text = json.dumps(counted, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def write_marker(path: Path, content: Mapping[str, Any]) -> None:
    """Write a marker; it lists all other files of its folder and is therefore written last."""
    files = {each.name: sha256(each) for each in sorted(path.parent.iterdir()) if each != path}
    full = json.loads(json.dumps({**content, FILES: files}, default=str))
    full[OWN] = content_sha256(full)
    text = escaped(json.dumps(full, indent=2, ensure_ascii=False))
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def read_marker(path: Path) -> Marker:
    """Read a marker, whatever became of it.

    Raises
    ------
    OSError
        If it is there and the drive does not let it be read.
    """
    try:
        content = json.loads(require_regular(path).read_text(encoding="utf-8"))
    except (FileNotFoundError, IsADirectoryError, ValueError, RecursionError):
        return Marker({}, {}, Fault.UNREADABLE)
    if not isinstance(content, dict) or FILES not in content:
        return Marker({}, {}, Fault.FOREIGN)
    files, told = content[FILES], content.get(OWN)
    about = {key: value for key, value in content.items() if key not in (FILES, OWN)}
    if isinstance(files, list) and all(isinstance(name, str) for name in files):
        return Marker(about, dict.fromkeys(files, ""), Fault.NO_CHECKSUMS)
    if not (isinstance(files, dict) and all(isinstance(sha, str) for sha in files.values())):
        return Marker(about, {}, Fault.CHANGED)
    is_intact = told == content_sha256(content)
    return Marker(about, files, None if is_intact else Fault.CHANGED)


def is_litter(path: Path) -> bool:
    """Whether a file manager left it: nobody misses it."""
    return path.name in _OF_FILE_MANAGERS and is_plain_file(path)


def is_plain_file(path: Path) -> bool:
    """Whether it is a file itself, no link to one."""
    return path.is_file() and not path.is_symlink()


def is_as_written(path: Path, files: Mapping[str, str]) -> bool:
    """Whether a file is one of `files` and has the checksum it had then."""
    return is_plain_file(path) and path.name in files and sha256(path) == files[path.name]


def unknown_entries(
    folder: Path, marker: str, accepted: Mapping[str, str] | None = None
) -> list[str]:
    """Names in a folder that the program did not write, or that changed since.

    Parameters
    ----------
    folder : Path
    marker : str
        Name of its marker, which is one of them where it does not vouch for the others.
    accepted : mapping of str to str, optional
        Checksums, by name, of changed files that count as known.

    Returns
    -------
    list of str
        Sorted; hidden files, folders and links count, litter of file managers does not.
    """
    known = known_files(folder / marker, accepted)
    return sorted(
        path.name
        for path in folder.iterdir()
        if not (is_litter(path) or is_as_written(path, known))
    )


def known_files(marker: Path, accepted: Mapping[str, str] | None = None) -> dict[str, str]:
    """Checksums of the files that a marker vouches for, itself included; see `unknown_entries`."""
    extra = dict(accepted or {})
    if not is_plain_file(marker):
        return extra
    found, own = read_marker(marker), sha256(marker)
    if found.fault is not None and extra.get(marker.name) != own:
        return extra
    return {**found.files, marker.name: own, **extra}


KEY = "sha256"
_SEAL = re.compile(rf'\n{KEY} = "[0-9a-f]{{64}}"\s*\Z'.encode())
_LONGEST_SEAL = 100  # bytes, with line ends of any kind


class DamagedFile(InputError):  # noqa: N818 - said of a file, not of the program
    """A file of the library is not what was written, or is gone."""


def sealed(text: str) -> str:
    """TOML text with its checksum as the last line, in its last table."""
    encodable = text.encode("utf-8", "replace").decode()  # a command line may hold any bytes
    body = encodable.rstrip("\n") + "\n"
    return f"{body}{_seal(body)}"


def unsealed(path: Path) -> dict[str, Any]:
    """Content of a sealed file.

    Parameters
    ----------
    path : Path
        Line ends may have been converted, as some version control systems do.

    Returns
    -------
    dict
        What the file tells, without its checksum.

    Raises
    ------
    DamagedFile
        If it is not what was written, or cannot be read.
    """
    if path.exists() and not path.is_file():
        raise damaged(path, "not a regular file")
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise damaged(path, error.strerror or "unreadable") from error
    except UnicodeDecodeError as error:
        raise damaged(path, "bytes that are no text") from error
    body, _, last = text.removesuffix("\n").rpartition("\n")
    body += "\n"
    if not last.startswith(f"{KEY} = "):
        raise damaged(path, f"no checksum in its last line ({len(text)} characters)")
    if last + "\n" != _seal(body):
        raise damaged(path, "a checksum that does not fit its content")
    try:
        return tomllib.loads(body)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise damaged(path, f"no TOML ({error})") from error


def texts_of(
    path: Path, told: dict[str, Any], required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, str]:
    """Texts that a file of the library tells; what is told beside them is left.

    Parameters
    ----------
    path : Path
        For messages.
    told : dict
    required, optional : sequence of str
        Keys.

    Raises
    ------
    DamagedFile
        If one that is required is not there, or one is no text.
    """
    texts = {key: told.get(key) for key in required}
    texts |= {key: told[key] for key in optional if key in told}
    for key, text in texts.items():
        if not isinstance(text, str):
            raise damaged(path, f"no {key}" if text is None else f"{key} = {text!r}")
    return {key: str(text) for key, text in texts.items()}


def is_sealed(path: Path) -> bool:
    """Whether a file is one of a library, whole or damaged; cheap for files of any size."""
    if path.suffix.lower() != ".toml" or not path.is_file():
        return False
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _LONGEST_SEAL))
        return _SEAL.search(file.read()) is not None


def checksum(path: Path) -> str:
    """Checksum that a sealed file carries; `unsealed` tells whether it holds."""
    return path.read_text(encoding="utf-8").rstrip("\n").rpartition('= "')[2].rstrip('"')


def damaged(path: Path, found: str) -> DamagedFile:
    """The error for a file that is not what was written."""
    return DamagedFile(
        str(path),
        found,
        "files of a library never change once written",
        "Restore this file from a backup; values are changed by adding a new version",
    )


def _seal(body: str) -> str:
    return f'{KEY} = "{hashlib.sha256(body.encode()).hexdigest()}"\n'
