"""Checksums: markers that list the files of a folder, and files of a library.

A folder that the program wrote has a marker, a JSON file. Its key ``files`` lists every other
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
ACCEPTED = "accepted_changes"  # key of a provenance: changed files that were accepted
KEY = "sha256"  # last key of a file of a library

_OF_FILE_MANAGERS = ("Thumbs.db", "desktop.ini", ".DS_Store")
_SEAL = re.compile(rf'\n{KEY} = "[0-9a-f]{{64}}"\s*\Z'.encode())
_LONGEST_SEAL = 100  # bytes, with line ends of any kind


class Fault(Enum):
    """Why a marker does not confirm the files of its folder."""

    UNREADABLE = "it cannot be read"
    FOREIGN = "it lists no files"
    CHANGED = "its content was changed after it was written"


@dataclass(frozen=True)
class Marker:
    """A marker as it was found."""

    content: dict[str, Any]  # everything but the list
    files: dict[str, str]  # SHA-256 of each file by its name; empty if unknown
    fault: Fault | None = None  # why it does not confirm the files; None if it does


def sha256(path: Path) -> str:
    """Checksum of a file, read piece by piece."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def content_sha256(content: Mapping[str, Any]) -> str:
    """Checksum of content as JSON, independent of the order of its keys; `OWN` is left out."""
    counted = {key: value for key, value in content.items() if key != OWN}
    text = json.dumps(counted, sort_keys=True, separators=(",", ":"), default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def write_marker(path: Path, content: Mapping[str, Any]) -> None:
    """Write a marker. It lists all other files of its folder, so write it last."""
    files = {each.name: sha256(each) for each in sorted(path.parent.iterdir()) if each != path}
    full = json.loads(json.dumps({**content, FILES: files}, default=str))
    full[OWN] = content_sha256(full)
    text = escaped(json.dumps(full, indent=2, ensure_ascii=False))
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def read_marker(path: Path) -> Marker:
    """Read a marker, however damaged it is."""
    try:
        content = json.loads(require_regular(path).read_text(encoding="utf-8"))
    except (FileNotFoundError, IsADirectoryError, ValueError, RecursionError):
        return Marker({}, {}, Fault.UNREADABLE)
    if not isinstance(content, dict) or FILES not in content:
        return Marker({}, {}, Fault.FOREIGN)
    files = content[FILES]
    about = {key: value for key, value in content.items() if key not in (FILES, OWN)}
    if not (isinstance(files, dict) and all(isinstance(sha, str) for sha in files.values())):
        return Marker(about, {}, Fault.CHANGED)
    is_intact = content.get(OWN) == content_sha256(content)
    return Marker(about, files, None if is_intact else Fault.CHANGED)


def is_system_file(path: Path) -> bool:
    """Whether a file manager made it."""
    return path.name in _OF_FILE_MANAGERS and is_plain_file(path)


def is_plain_file(path: Path) -> bool:
    """Whether it is a file and not a link to one."""
    return path.is_file() and not path.is_symlink()


def is_as_written(path: Path, files: Mapping[str, str]) -> bool:
    """Whether a file is one of `files` and has the checksum it had then."""
    return is_plain_file(path) and path.name in files and sha256(path) == files[path.name]


def unknown_entries(
    folder: Path, marker: str, accepted: Mapping[str, str] | None = None
) -> list[str]:
    """Names in a folder that the program did not write, or that were changed since, sorted.

    The marker itself is unknown if it does not confirm the files. `accepted` are checksums, by
    name, of changed files that count as known.
    """
    known = known_files(folder / marker, accepted)
    paths = (path for path in folder.iterdir() if not is_system_file(path))
    return sorted(path.name for path in paths if not is_as_written(path, known))


def known_files(marker: Path, accepted: Mapping[str, str] | None = None) -> dict[str, str]:
    """Checksums of the files that a marker confirms, itself included; see `unknown_entries`."""
    extra = dict(accepted or {})
    if not is_plain_file(marker):
        return extra
    found, own = read_marker(marker), sha256(marker)
    if found.fault is not None and extra.get(marker.name) != own:
        return extra
    return {**found.files, marker.name: own, **extra}


class DamagedFile(InputError):  # noqa: N818 - it is about a file
    """A file of the library was changed or is missing."""


def sealed(text: str) -> str:
    """TOML text with its checksum as the last line, in its last table."""
    encodable = text.encode("utf-8", "replace").decode()  # a command line may have any bytes
    body = encodable.rstrip("\n") + "\n"
    return f"{body}{_seal(body)}"


def unsealed(path: Path) -> dict[str, Any]:
    """Content of a file of a library whose checksum fits; line ends may have been converted."""
    if path.exists() and not path.is_file():
        raise damaged(path, "not a regular file")
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise damaged(path, error.strerror or "unreadable") from error
    except UnicodeDecodeError as error:
        raise damaged(path, "binary data, no text") from error
    body, _, last = text.removesuffix("\n").rpartition("\n")
    body += "\n"
    if not last.startswith(f"{KEY} = "):
        raise damaged(path, f"no checksum in its last line ({len(text)} characters)")
    if last + "\n" != _seal(body):
        raise damaged(path, "a checksum that does not fit its content")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOML, an endless number, nesting
        raise damaged(path, f"not TOML ({error})") from error


def texts_of(
    path: Path, content: dict[str, Any], required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, str]:
    """Values of keys of a file of the library that must be texts; other keys are ignored."""
    texts = {key: content.get(key) for key in required}
    texts |= {key: content[key] for key in optional if key in content}
    for key, text in texts.items():
        if not isinstance(text, str):
            raise damaged(path, f"no {key}" if text is None else f"{key} = {text!r}")
    return {key: str(text) for key, text in texts.items()}


def is_sealed(path: Path) -> bool:
    """Whether a file is one of a library, damaged or not; reads the end of it only."""
    if path.suffix.lower() != ".toml" or not path.is_file():
        return False
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _LONGEST_SEAL))
        return _SEAL.search(file.read()) is not None


def damaged(path: Path, found: str) -> DamagedFile:
    """The error for a file of a library that was changed or is missing."""
    rule = "files of a library never change once written"
    remedy = "Restore this file from a backup; add a new version to change values"
    return DamagedFile(str(path), found, rule, remedy)


def _seal(body: str) -> str:
    return f'{KEY} = "{hashlib.sha256(body.encode()).hexdigest()}"\n'
