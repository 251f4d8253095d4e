"""Write files and result folders whole: after a kill the old one is there, or the new one."""

from __future__ import annotations

import logging
import os
import re
import secrets
import shutil
import socket
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

from ema.core.errors import InputError
from pipelines.storage.checksums import (
    Fault,
    is_as_written,
    is_sealed,
    is_system_file,
    known_files,
    read_marker,
    unknown_entries,
)

_OWNER = r"(\d{1,9})-[0-9a-f]{8}"
_ANY_PARTIAL = re.compile(rf"\..+\.\w+-{_OWNER}\.partial")
MARKER = "provenance.json"  # every result folder has it
_LOG = logging.getLogger(__name__)
_PROBE_BYTES = 2**20
_ATTEMPTS = 50  # other processes may be replacing or reading the same result
_PAUSE_S = 0.01


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


Checksums = Mapping[str, str]


def require_free(
    folder: Path, *, force: bool, marker: str | None = MARKER, accepted: Checksums | None = None
) -> None:
    """Refuse a folder where a result may not or cannot be written, before anything is computed.

    With `force` an earlier result may be replaced; `marker` lists its files, None if none may be.
    `accepted` are checksums, by name, of changed files that may be replaced too.
    """
    with _as_input_error(folder):
        place = Path(os.path.realpath(folder))  # a link to a folder stays
        recover(place, marker)
        if marker is not None and (place / marker).is_file():
            for left in ended_backups(place):
                _remove_backup(left, place, marker, None)
        _refuse_occupied(folder, place, force, marker, accepted)
        existing = next((path for path in place.parents if path.exists()), place.parent)
        with partial_folder(existing / place.name) as probe:
            (probe / "probe").write_bytes(bytes(_PROBE_BYTES))


@contextmanager
def written_whole(
    folder: Path,
    *,
    force: bool = False,
    marker: str | None = MARKER,
    accepted: Checksums | None = None,
) -> Iterator[Path]:
    """Yield a folder beside the wanted one; it is renamed to it when all is written.

    Missing folders above it are made; the block writes the marker last, with `write_marker`. If it
    fails, nothing is left behind. If two processes write to the same folder, the last one wins with
    `force`, the first without. Arguments as for `require_free`.
    """
    require_free(folder, force=force, marker=marker, accepted=accepted)
    with _as_input_error(folder):
        place = Path(os.path.realpath(folder))
        with folder_in_use(place.parent), partial_folder(place) as partial:
            yield partial
            _to_disk(partial)
            occupied = (folder, place, force, marker, accepted)
            backup = _put(partial, place, lambda: _refuse_occupied(*occupied))
            if backup is not None and marker is not None:
                _remove_backup(backup, place, marker, accepted)


def recover(folder: Path, marker: str | None = MARKER) -> None:
    """Put an earlier result back that a killed process had moved aside."""
    place = Path(os.path.realpath(folder))
    if marker is None or place.exists():
        return
    with suppress(OSError):  # another process did it, or the drive is read-only
        complete = [path for path in backups(place) if _is_complete(path, marker)]
        if complete:
            max(complete, key=lambda path: path.stat().st_mtime_ns).rename(place)


def _is_complete(backup: Path, marker: str) -> bool:
    """Whether nothing has been removed from a backup yet; its list is removed last."""
    found = read_marker(backup / marker)
    if not found.files:  # then nothing is ever removed
        return any(backup.iterdir())
    return all((backup / name).exists() for name in found.files)


def _refuse_occupied(
    folder: Path, place: Path, force: bool, marker: str | None, accepted: Checksums | None
) -> None:
    def refusal(found: str, rule: str, remedy: str = "Choose another folder") -> InputError:
        return InputError(str(folder), found, rule, remedy)

    if not os.path.lexists(place):
        return
    if not place.is_dir():
        raise refusal("a file", "a result is a folder")
    if os.path.ismount(place):
        remedy = f"Choose a folder in it, such as {folder / 'result'}"
        raise refusal("a drive", "a result is renamed to its place, a drive cannot be", remedy)
    entries = sorted(path.name for path in place.iterdir() if not is_system_file(path))
    if not entries:
        return
    fault = None if marker is None else read_marker(place / marker).fault
    if marker is None or fault in (Fault.UNREADABLE, Fault.FOREIGN):
        found = f"a folder with other files: {named(entries)}"
        if marker is not None and fault is not None and (place / marker).exists():
            found = f"{marker}: {fault.value}"
        raise refusal(found, "a result needs a new or empty folder, or replaces an earlier result")
    if not force:
        remedy = "Choose another folder, or replace it with --force"
        raise refusal("an earlier result", "it already exists", remedy)
    if not os.access(place, os.W_OK):
        raise refusal("a read-only folder", "it cannot be replaced")
    if unknown := unknown_entries(place, marker, accepted):
        rule = "added to the earlier result or changed, and would be lost"
        raise refusal(named(unknown), rule, "Move it, or choose another folder for the result")


def named(names: Sequence[str], most: int = 3) -> str:
    """The first `most` names in one text, and how many more there are."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"


def _to_disk(folder: Path) -> None:
    """Wait until all is on the disk; a full or missing drive may only fail now."""
    for path in folder.rglob("*"):
        if path.is_file():
            with path.open("rb+") as file:
                os.fsync(file.fileno())


def _put(partial: Path, place: Path, check: Callable[[], None]) -> Path | None:
    """Rename `partial` to `place`, checked right before each attempt; returns the backup."""
    for attempts_left in reversed(range(_ATTEMPTS)):
        try:
            check()
            return _swapped(partial, place)
        except OSError:
            if not attempts_left or not partial.exists():
                raise
            time.sleep(_PAUSE_S)
    return None


def _swapped(partial: Path, place: Path) -> Path | None:
    if not os.path.lexists(place):
        partial.rename(place)
        return None
    backup = partial_name(place, "old")
    try:
        place.rename(backup)
        partial.rename(place)
    finally:
        if not os.path.lexists(place):
            with suppress(OSError):  # another process put it back
                backup.rename(place)
    return backup


def _remove_backup(backup: Path, place: Path, marker: str, accepted: Checksums | None) -> None:
    """Remove from a backup what the program wrote, its marker last; the rest becomes visible.

    Files added at the last moment move to the new result if their names are free. What cannot be
    removed or moved stays hidden until the next time.
    """
    with suppress(OSError):
        _empty(backup, place, marker, accepted)


def _empty(backup: Path, place: Path, marker: str, accepted: Checksums | None) -> None:
    own = backup / marker
    known = known_files(own, accepted)
    rest = []
    for path in [path for path in backup.iterdir() if path != own]:
        if is_system_file(path) or is_as_written(path, known):
            path.unlink()
        elif not known or os.path.lexists(place / path.name):
            rest.append(path)
        else:
            path.rename(place / path.name)
            text = f"{path.name} was added while the result was replaced; it is in the new one."
            _LOG.warning(text)
    if not rest and is_as_written(own, known):
        own.unlink()
    if any(backup.iterdir()):
        names = (place.with_name(f"{place.name}.kept-{number}") for number in count(1))
        kept = next(path for path in names if not os.path.lexists(path))
        backup.rename(kept)
        text = f"{kept}: files of the earlier result that were changed while it was replaced."
        _LOG.warning(text)
    else:
        backup.rmdir()


@contextmanager
def _as_input_error(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise not_written(folder, error) from error
