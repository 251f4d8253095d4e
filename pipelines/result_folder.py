"""The place of a result: a kill at any moment leaves the old one there or the new one, complete.

A result is written into a hidden folder beside its place. Where Linux or macOS can, it then changes
places with an earlier result in one step. Elsewhere (Windows, some network and USB drives) the
earlier one steps aside as ``.NAME.old`` for an instant; a kill right then leaves the place empty
until the next access puts it back.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ema.errors import InputError
from pipelines.exchange import exchange
from pipelines.partial import discard, partial_folder

MARKER = "provenance.json"  # every result folder has it, no other folder of a user's should
FILES = "files"  # its key for the names of all files of the result

_OF_THE_SYSTEM = ("Thumbs.db", "desktop.ini")  # left by file managers, as hidden files are
_PROBE_BYTES = 2**20
_ATTEMPTS = 3  # another process may be replacing the same result


def require_free(folder: Path, *, force: bool, marker: str | None = MARKER) -> None:
    """Refuse a place where a result may not or cannot be written, before anything is computed.

    Parameters
    ----------
    folder : Path
    force : bool
        Whether an earlier result may be replaced.
    marker : str, optional
        File by which an earlier result is known; None where none may be replaced.

    Raises
    ------
    InputError
        For a file, a folder with other files, an earlier result without `force` or with files that
        are not its own, and a place that is read-only, full or not there.
    """
    with _as_input_error(folder):
        place = _resolved(folder)
        recover(place)
        _refuse_occupied(folder, place, force=force, marker=marker)
        existing = next((path for path in place.parents if path.exists()), place.parent)
        with partial_folder(existing / place.name) as probe:
            (probe / "probe").write_bytes(bytes(_PROBE_BYTES))


@contextmanager
def written_whole(
    folder: Path, *, force: bool = False, marker: str | None = MARKER
) -> Iterator[Path]:
    """Yield a folder beside the wanted one, put into its place only when all is written.

    Of two processes that write to the same place, the last one wins with `force`, and the first one
    without.

    Parameters
    ----------
    folder : Path
        Missing folders above it are made.
    force, marker
        As for `require_free`.

    Raises
    ------
    InputError
        If the folder may not or cannot be written; nothing is left behind.
    """
    require_free(folder, force=force, marker=marker)
    with _as_input_error(folder):
        place = _resolved(folder)
        with _folders_above(place), partial_folder(place) as partial:
            yield partial
            _to_disk(partial)
            try:
                partial.rename(place)
            except OSError:
                if not place.exists():
                    raise
                _refuse_occupied(folder, place, force=force, marker=marker)
                _replace(partial, place)
            discard(_aside(place), place)  # ours, or what a killed process left


def recover(folder: Path) -> None:
    """Put an earlier result back that a killed process had moved aside; see this module's text."""
    place = _resolved(folder)
    aside = _aside(place)
    if aside.is_dir() and not place.exists():
        with suppress(OSError):  # another process did, or the drive is read-only
            aside.rename(place)


def _resolved(folder: Path) -> Path:
    """The folder itself, where `folder` is a link to it: the link is to stay."""
    return Path(os.path.realpath(folder))


def _aside(place: Path) -> Path:
    return place.with_name(f".{place.name}.old")


def _refuse_occupied(folder: Path, place: Path, *, force: bool, marker: str | None) -> None:
    remedy = "Choose another folder"
    if not place.exists():
        return
    if not place.is_dir():
        raise InputError(str(folder), "a file", "a result is a folder", remedy)
    if os.path.ismount(place):
        remedy = f"Choose a folder in it, such as {folder / 'result'}"
        raise InputError(
            str(folder), "a drive", "a result is renamed to its place, a drive cannot be", remedy
        )
    if not any(place.iterdir()):
        return
    if marker is None or not (place / marker).is_file():
        rule = "a result needs a folder of its own"
        raise InputError(str(folder), "a folder with other files", rule, remedy)
    if not force:
        remedy = "Choose another folder, or replace it with --force"
        raise InputError(str(folder), "an earlier result", "it is not overwritten unasked", remedy)
    if not os.access(place, os.W_OK):
        raise InputError(
            str(folder), "a read-only folder", "it is protected from being replaced", remedy
        )
    foreign = _foreign(place, marker)
    if foreign:
        more = f" and {len(foreign) - 1} more" if foreign[1:] else ""
        rule = "this is no part of the earlier result and would be lost with it"
        raise InputError(str(folder), f"{foreign[0]}{more}", rule, "Move it elsewhere")


def _foreign(place: Path, marker: str) -> list[str]:
    """What somebody else put into a result; nothing where the result does not tell its files."""
    try:
        own = set(json.loads((place / marker).read_text(encoding="utf-8"))[FILES])
    except (OSError, ValueError, LookupError, TypeError):
        return []
    others = {path.name for path in place.iterdir() if not path.name.startswith(".")}
    return sorted(others - own - set(_OF_THE_SYSTEM))


@contextmanager
def _folders_above(place: Path) -> Iterator[None]:
    """Make the folders above `place`, and remove them again if nothing comes of it."""
    missing = [path for path in place.parents if not path.exists()]
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for path in missing:
            with suppress(OSError):  # not made, or somebody uses it by now
                path.rmdir()
        raise


def _to_disk(folder: Path) -> None:
    """Wait until all is on the disk: a full or vanished drive may only now say so."""
    for path in folder.rglob("*"):
        if path.is_file():
            with path.open("rb+") as file:
                os.fsync(file.fileno())


def _replace(partial: Path, place: Path) -> None:
    """Put `partial` in place of a folder; what was there ends as `partial` or aside."""
    if exchange(partial, place):
        return
    aside = _aside(place)
    for attempts_left in reversed(range(_ATTEMPTS)):
        try:
            recover(place)
            discard(aside, place)
            place.rename(aside)
            partial.rename(place)
            return
        except OSError:
            if not attempts_left:
                raise
        finally:
            recover(place)


@contextmanager
def _as_input_error(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(
            str(folder),
            os.strerror(error.errno) if error.errno else str(error),
            "the result could not be written and nothing was left behind",
            "Check free space and permissions, or choose another folder",
        ) from error
