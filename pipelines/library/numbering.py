"""Numbered files of many writers, each file complete from the moment it is visible.

A file is written and flushed under a hidden name. Then it takes the next free number by an
operation that fails where the number is taken: a hard link, on Windows a rename. On drives without
hard links the writers take turns. A kill leaves the number free.
"""

from __future__ import annotations

import errno
import os
import re
import time
import unicodedata
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ema.core.errors import InputError
from pipelines.storage.atomic import folder_in_use, partial_name, remove_abandoned

VARIABLE = "RINGMODAL_LIBRARY"  # of the environment: the folder of the library

ABANDONED_S = 30.0  # a turn takes milliseconds; after this time without change it is abandoned
_POLL_S = 0.02
_ATTEMPTS = 6  # a virus scanner may lock a new file for a moment
_RENAME_KEEPS = os.name == "nt"  # there, a rename fails where the name is taken
_NO_LINKS = {
    *(errno.EPERM, errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOTSUP),
    *(errno.EINVAL, errno.EMLINK, errno.EXDEV, errno.EACCES),
}
_NUMBERED = re.compile(r"(\d{4,})\.toml")
_NEXT = "next.toml"
APPROVED, NEWEST = "approved", "newest"
_LONGEST = 80  # bytes in UTF-8: a name has 255, and on Windows a whole path about 250 characters
_OF_WINDOWS = re.compile(r"(con|prn|aux|nul|(com|lpt)[\d¹²³])(\..*)?", re.IGNORECASE)


def numbered_files(folder: Path) -> dict[int, Path]:
    """Numbered files of a folder, ascending; none where the folder does not exist."""
    if not folder.is_dir():
        return {}
    names = (_NUMBERED.fullmatch(path.name) for path in folder.iterdir())
    numbers = sorted(int(name[1]) for name in names if name is not None)
    return {number: numbered(folder, number) for number in numbers}


def numbered(folder: Path, number: int) -> Path:
    """Path of the file of a number."""
    return folder / f"{number:04}.toml"


def write_next(folder: Path, text_of: Callable[[int], str]) -> int:
    """Write a file under the next free number; numbers are consecutive.

    `text_of` a number must be different for every call on any machine. Nothing is left behind if
    the drive cannot be written.
    """
    with folder_in_use(folder):
        remove_abandoned(folder / _NEXT)
        number = 0
        while True:
            # A network drive may list files late: a number found taken is not tried again.
            number = max([number, *numbered_files(folder)]) + 1
            if _taken(numbered(folder, number), text_of(number)):
                _flush_folder(folder)
                return number


def _taken(place: Path, text: str) -> bool:
    """Write `text` to a place; False if the place is taken."""
    partial = partial_name(place.with_name(_NEXT))
    try:
        _write(partial, text)
        return _renamed(partial, place) if _RENAME_KEEPS else _linked(partial, place)
    except OSError as error:
        if _RENAME_KEEPS or error.errno not in _NO_LINKS:
            raise
    finally:
        with suppress(OSError):  # renamed, or not written
            partial.unlink()
    return _taken_in_turn(place, text)


def _linked(partial: Path, place: Path) -> bool:
    try:
        os.link(partial, place)
    except FileExistsError:
        return partial.samefile(place)  # a network drive had lost its first answer
    return True


def _renamed(partial: Path, place: Path) -> bool:
    for attempts_left in reversed(range(_ATTEMPTS)):
        try:
            partial.rename(place)
        except FileExistsError:
            return False
        except PermissionError:
            if not attempts_left:
                raise
            time.sleep(_POLL_S * (_ATTEMPTS - attempts_left))
        else:
            break
    return True


def _taken_in_turn(place: Path, text: str) -> bool:
    """The same without links: the writer that creates the one hidden file has the turn.

    That file has the text; renaming it to its place ends the turn in the same step, so that no
    kill and no abandoned turn loses a version. A lock beside the file cannot do this.
    """
    turn = place.with_name(".turn")
    while not place.exists():
        _await_turn(turn, text)
        if place.exists():  # another turn ended just before ours began
            turn.unlink(missing_ok=True)
            break
        with suppress(FileNotFoundError):  # another writer took our turn for abandoned
            turn.rename(place)
    return place.read_text(encoding="utf-8") == text


def _await_turn(turn: Path, text: str) -> None:
    seen, since_s = None, time.monotonic()
    while True:
        try:
            _write(turn, text)
        except FileExistsError:
            time.sleep(_POLL_S)
        else:
            return
        with suppress(FileNotFoundError):  # the turn ended
            found = turn.stat()
            state = found.st_ino, found.st_mtime_ns, found.st_size
            # Clocks of other machines differ: measure how long nothing has changed.
            if state != seen:
                seen, since_s = state, time.monotonic()
            elif time.monotonic() - since_s > ABANDONED_S:
                turn.rename(aside := partial_name(turn.with_name(_NEXT)))
                aside.unlink()


def _write(path: Path, text: str) -> None:
    """Write and flush a new file; FileExistsError where there is one."""
    file = path.open("x", encoding="utf-8", newline="\n")
    try:
        with file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:  # on a full drive without the name of the file
        path.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path.parent)) from error


def _flush_folder(folder: Path) -> None:
    """Flush the new entry of a folder, where the system can."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def folder_name(designation: str, tyre_id: str = "") -> str:
    """Name of a tyre's folder, allowed on Windows too: ``225-55R17`` or ``225-55R17_winter-A``."""

    def safe(text: str) -> str:
        words = re.sub(r"[^\w.]+", "-", unicodedata.normalize("NFC", text))
        return words.encode()[:_LONGEST].decode(errors="ignore").strip("-._")

    name = "_".join(filter(None, map(safe, (designation, tyre_id))))
    if not name:
        rule = "it must contain a letter or a digit for the name of its folder"
        raise InputError("tyre's name", repr(designation), rule, "Name the tyre with --tyre")
    return f"tyre-{name}" if _OF_WINDOWS.fullmatch(name) else name


def split_reference(text: str) -> tuple[str, int | str]:
    """Tyre and version of ``NAME`` (version ``""``), ``NAME@3``, ``NAME@approved``, ``@newest``."""
    name, at, version = text.rpartition("@")
    if not at:
        return text, ""
    if version in (APPROVED, NEWEST):
        return name, version
    if not re.fullmatch(r"[0-9]{1,9}", version) or int(version) == 0:
        rule = f"a version must be a number from 1, {APPROVED} or {NEWEST}"
        raise InputError(text, f"version {version!r}", rule, f"Write e.g. {name}@1")
    return name, int(version)


def require_version(reference: str, command: str) -> str:
    """Tyre of a reference that must name a version; `InputError` if it does not."""
    name, version = split_reference(reference)
    if not version:
        rule = "name the version: a newer one may have been added in the meantime"
        remedy = f"Write e.g. `ringmodal tyre {command} {name}@1`"
        raise InputError(reference, "no version", rule, remedy)
    return name
