"""Files that never change once written: their last line is a checksum over all lines above it."""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ema.errors import InputError

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
