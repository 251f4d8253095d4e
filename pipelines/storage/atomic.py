"""Atomic writes of files, and temporary names; functions raise `OSError` as the drive does."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ema.core.errors import InputError
from pipelines.storage.checksums import is_sealed


@contextmanager
def file_written_whole(path: Path) -> Iterator[Path]:
    """Yield a name beside `path`; the file written there replaces it at the end.

    A kill at any moment leaves the old file or the new one. A device or a pipe (`/dev/stdout`) is
    written into, never replaced.
    """
    place = Path(os.path.realpath(path))  # a link to a file stays a link
    if is_sealed(place):
        rule = "a version in a library never changes"
        raise InputError(str(path), "a file of a library", rule, "Choose another file")
    partial = partial_name(place)
    try:
        if place.exists() and not place.is_file() and not place.is_dir():
            with _passed_on(place) as whole:
                yield whole
            return
        remove_abandoned(place)
        yield partial
        partial.replace(place)
    except OSError as error:
        raise not_written(path, error) from error
    finally:
        with suppress(OSError):  # it was renamed, or its folder is gone
            partial.unlink()


@contextmanager
def _passed_on(device: Path) -> Iterator[Path]:
    """Yield a temporary file whose contents go to a device or a pipe at the end."""
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "whole"
        yield whole
        with whole.open("rb") as source, device.open("wb") as sink:
            shutil.copyfileobj(source, sink)


def not_written(path: Path, error: OSError) -> InputError:
    """The error for a file or folder that could not be written."""
    reason = os.strerror(error.errno) if error.errno else str(error)
    remedy = "Check free space and permissions, or choose another place"
    return InputError(str(path), reason, "it could not be written", remedy)


def require_free_file(target: Path, *, force: bool) -> None:
    """Refuse a folder, an existing file without `force`, and a missing parent folder."""
    if target.is_dir():
        raise InputError(str(target), "a folder", "the name of a file is needed", "Name a file")
    if target.exists() and not force:
        remedy = "Choose another name, or use --force to replace it"
        raise InputError(str(target), "exists already", "files are not replaced", remedy)
    if not target.absolute().parent.is_dir():
        found = "its folder does not exist"
        raise InputError(str(target), found, "the folder must exist", "Create it first")


_OWNER = r"(\d{1,9})-[0-9a-f]{8}"
_ANY_PARTIAL = re.compile(rf"\..+\.\w+-{_OWNER}\.partial")


def partial_name(place: Path, ending: str = "partial") -> Path:
    """A new hidden name beside `place` with the machine and the process it belongs to.

    The ending is ``"old"`` for what is replaced there.
    """
    return place.with_name(f"{_prefix(place)}{os.getpid()}-{secrets.token_hex(4)}.{ending}")


def backups(place: Path) -> list[Path]:
    """Folders moved aside by a process of any machine and neither put back nor removed."""
    ours = re.compile(rf"\.{re.escape(place.name)}\.[\w-]+\.old")
    found = [path for path in place.parent.iterdir() if ours.fullmatch(path.name)]
    return sorted(path for path in found if path.is_dir() and not path.is_symlink())


def ended_backups(place: Path) -> list[Path]:
    """Backups of this process and of ended ones, which will not be put back."""
    theirs = re.compile(re.escape(_prefix(place)) + rf"{_OWNER}\.old")

    def ended(path: Path) -> bool:
        found = theirs.fullmatch(path.name)
        owner = int(found[1]) if found else None
        return owner is not None and (owner == os.getpid() or not _may_run(owner))

    return [path for path in backups(place) if ended(path)]


@contextmanager
def partial_folder(place: Path) -> Iterator[Path]:
    """Yield a new folder beside `place` that is removed at the end, unless it was renamed.

    What killed processes of this machine left beside `place` is removed first.
    """
    remove_abandoned(place)
    partial = partial_name(place)
    try:
        partial.mkdir()
        yield partial
    finally:
        shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def folder_in_use(folder: Path) -> Iterator[None]:
    """Make a folder and those above it; after an error the new ones are removed again."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:  # an interrupt too
        for path in missing:
            with suppress(OSError):  # not made, or in use by now
                path.rmdir()
        raise


def remove_abandoned(place: Path) -> None:
    """Remove what ended processes left half-written beside `place`.

    Files of running processes and of other machines stay, and folders with anything that this
    program does not write. On Windows nothing is removed, as running processes cannot be probed.
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
    """Remove a folder of files, unless it has entries that this program does not write."""

    def is_ours(path: Path) -> bool:
        visible = not path.name.startswith(".") or _ANY_PARTIAL.fullmatch(path.name)
        return bool(visible) and path.is_file() and not path.is_symlink()

    entries = list(folder.iterdir())
    if all(map(is_ours, entries)):
        for entry in entries:
            entry.unlink()
        folder.rmdir()


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
    except PermissionError:  # of another user
        pass
    return True
