"""A single file that is written whole or not at all."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ema.core.errors import InputError
from pipelines.storage.checksums import is_sealed


@contextmanager
def file_written_whole(path: Path) -> Iterator[Path]:
    """Yield a name beside `path`; the file written there takes its place at the end.

    A kill at any moment leaves the old file or the new one.

    Raises
    ------
    InputError
        If it cannot be written, or is a file of a library, which never changes; the old file
        stands and nothing is left behind.
    """
    place = Path(os.path.realpath(path))  # a link to a file stays a link
    if is_sealed(place):
        rule = "a version in a library never changes"
        raise InputError(str(path), "a file of a library", rule, "Choose another place")
    partial = partial_name(place)
    try:
        remove_abandoned(place)
        yield partial
        partial.replace(place)
    except OSError as error:
        raise InputError(
            str(path),
            os.strerror(error.errno) if error.errno else str(error),
            "the file could not be written",
            "Check free space and permissions, or choose another place",
        ) from error
    finally:
        with suppress(OSError):  # it took its place, or its folder is gone
            partial.unlink()


_OWNER = r"(\d{1,9})-[0-9a-f]{8}"
_HIDDEN = re.compile(rf"\..+\.\w+-{_OWNER}\.partial")  # of any place


def partial_name(place: Path) -> Path:
    """A new hidden name beside `place`, which tells the machine and the process it belongs to."""
    return _new_name(place, "partial")


def backup_name(place: Path) -> Path:
    """A new hidden name beside `place` for what is replaced there."""
    return _new_name(place, "old")


def backups(place: Path) -> list[Path]:
    """Folders that a process moved aside and did not put back or remove, on whichever machine.

    Raises
    ------
    OSError
        If the folder of `place` cannot be listed.
    """
    ours = re.compile(rf"\.{re.escape(place.name)}(\.[\w-]+)?\.old")
    found = [path for path in place.parent.iterdir() if ours.fullmatch(path.name)]
    return sorted(path for path in found if path.is_dir() and not path.is_symlink())


def ended_backups(place: Path) -> list[Path]:
    """Backups that no other process may still put back: its own, and those of the dead.

    Raises
    ------
    OSError
        If the folder of `place` cannot be listed.
    """
    theirs = re.compile(re.escape(_prefix(place)) + rf"{_OWNER}\.old")
    without_owner = f".{place.name}.old"  # as version 0.1.0 called it

    def ended(path: Path) -> bool:
        found = theirs.fullmatch(path.name)
        if found is None:
            return path.name == without_owner
        return int(found[1]) == os.getpid() or not _may_run(int(found[1]))

    return [path for path in backups(place) if ended(path)]


@contextmanager
def partial_folder(place: Path) -> Iterator[Path]:
    """Yield a new folder beside `place` that is gone at the end, unless it was renamed.

    What killed processes of this machine left beside `place` is removed first.

    Raises
    ------
    OSError
        If no folder can be made there.
    """
    remove_abandoned(place)
    partial = partial_name(place)
    try:
        partial.mkdir()
        yield partial
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def remove_abandoned(place: Path) -> None:
    """Remove what processes that are gone left half-written beside `place`.

    A process that runs, or runs on another machine, keeps what it has, and a folder with anything
    in it that such a process does not write stays. On Windows nothing is removed: there is no
    harmless question whether a process runs.

    Raises
    ------
    OSError
        If the folder of `place` cannot be listed.
    """
    ours = re.compile(re.escape(_prefix(place)) + rf"{_OWNER}\.partial")
    for path in place.parent.iterdir():
        found = ours.fullmatch(path.name)
        if found is None or _may_run(int(found[1])) or path.is_symlink():
            continue
        with suppress(OSError):  # it stays until the next time
            if path.is_dir():
                _remove_flat(path)
            else:
                path.unlink()


def _remove_flat(folder: Path) -> None:
    """Remove a folder of files, unless it holds what no writer of this program makes."""
    entries = list(folder.iterdir())
    if any(entry.is_symlink() or not entry.is_file() or _is_hidden(entry) for entry in entries):
        return
    for entry in entries:
        entry.unlink()
    folder.rmdir()


def _is_hidden(path: Path) -> bool:
    """Whether a file is hidden and no half-written one."""
    return path.name.startswith(".") and not _HIDDEN.fullmatch(path.name)


def _new_name(place: Path, ending: str) -> Path:
    return place.with_name(f"{_prefix(place)}{os.getpid()}-{secrets.token_hex(4)}.{ending}")


def _prefix(place: Path) -> str:
    machine = re.sub(r"\W", "_", socket.gethostname())
    return f".{place.name}.{machine}-"


def _may_run(process: int) -> bool:
    if os.name == "nt":  # there, os.kill ends a process whatever the signal
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # somebody else's
        return True
    return True
