"""Samples that stay on disk, piece by piece, and the files that a manifest names."""

from __future__ import annotations

import mmap
import stat
import unicodedata
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import InputError, ManifestError, RecordingFormatError

USE_SLASHES = "a file in a folder is written with /, as in runs/config_1.uff"


def piece(samples: NDArray[Any], start: int, stop: int) -> NDArray[Any]:
    """Samples `start` to `stop`; those of a memory map are read from its file instead.

    What was read through a map stays in the program's memory for as long as the map is there, and a
    file that vanishes under it ends the program without a word. `RecordingFormatError` if the file
    became shorter or cannot be read any more.
    """
    if not isinstance(samples, np.memmap) or not _is_whole(samples):
        return samples[start:stop]
    start, stop, _ = slice(start, stop).indices(len(samples))
    found = np.empty(max(stop - start, 0), samples.dtype)
    _read(samples, start, found)
    return found


def fill(samples: NDArray[Any], start: int, into: NDArray[np.float64]) -> None:
    """Put samples from `start` on into an array, as `piece` reads them."""
    if (
        isinstance(samples, np.memmap)
        and samples.dtype == into.dtype
        and into.flags.c_contiguous
        and _is_whole(samples)
    ):
        _read(samples, start, into)
    else:
        into[:] = piece(samples, start, start + into.size)


def part(samples: NDArray[Any], start: int, stop: int) -> NDArray[Any]:
    """Samples `start` to `stop`; those of a memory map stay on disk, as a map of their own."""
    if not isinstance(samples, np.memmap) or not _is_whole(samples):
        return samples[start:stop]
    place, path = samples.offset + start * samples.itemsize, str(samples.filename)
    cut: NDArray[Any] = np.memmap(path, samples.dtype, "r", place, (stop - start,))
    return cut


def _read(samples: np.memmap[Any, Any], start: int, into: NDArray[Any]) -> None:
    """Read from the file of a map, without fresh memory."""
    path = Path(str(samples.filename))
    try:
        with path.open("rb") as file:
            file.seek(samples.offset + start * samples.itemsize)
            n_bytes = file.readinto(into.view(np.uint8).data)
    except OSError as error:
        raise _gone(path, error.strerror or str(error)) from error
    if n_bytes < into.nbytes:
        count = n_bytes // samples.itemsize
        raise _gone(path, f"{count} of {into.size} samples from sample {start + 1} on")


def _is_whole(samples: np.memmap[Any, Any]) -> bool:
    """Whether it is a whole memory map: views of one do not know their place in the file."""
    is_own = isinstance(samples.base, mmap.mmap) and samples.flags.c_contiguous
    return is_own and samples.filename is not None


def _gone(path: Path, found: str) -> RecordingFormatError:
    rule = "the file was longer when it was opened"
    remedy = "Check the drive or the network and process it again"
    return RecordingFormatError(str(path), found, rule, remedy)


def require_regular(path: Path) -> Path:
    """Refuse a pipe, a socket or a device before it is opened; returns `path`.

    What is not there, or is a folder, is left to whoever opens it.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # opening it says what is wrong
        return path
    if stat.S_ISREG(mode) or stat.S_ISDIR(mode):
        return path
    rule = "only regular files are read: nobody knows when a pipe or device ends"
    raise InputError(str(path), "not a regular file", rule, "Write it to a file first")


def resolve(manifest: Path, file: str) -> Path:
    """Path of a file that a manifest names; it may not leave the folder, not even by a link."""
    folder = manifest.parent.resolve()
    try:
        target = _as_stored(folder / file).resolve()
        # From Python 3.13 on a loop of links is handed back as it is.
        is_loop = any(part.is_symlink() for part in (target, *target.parents))
        # Absolute, or with a drive or a share, on any system.
        elsewhere = PureWindowsPath(file).anchor or PurePosixPath(file).is_absolute()
        inside = not (elsewhere or is_loop) and target.is_relative_to(folder)
    except (OSError, ValueError, RuntimeError):  # a NUL in the name, a loop of links
        inside = False
    if not inside:
        rule = "paths are relative to the manifest and must stay within its folder"
        remedy = "Put the recordings beside the manifest"
        raise ManifestError(f"{manifest.name}, runs", f"file {file!r}", rule, remedy)
    return target


def _as_stored(path: Path) -> Path:
    """The file whose name looks the same: an umlaut is stored as one character or as two."""
    wanted = unicodedata.normalize("NFC", path.name)
    if wanted.isascii() or path.exists() or not path.parent.is_dir():
        return path
    alike = (p for p in path.parent.iterdir() if unicodedata.normalize("NFC", p.name) == wanted)
    return next(alike, path)
