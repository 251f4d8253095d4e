"""Samples that stay on disk, piece by piece, and the files that a manifest names."""

from __future__ import annotations

import math
import mmap
import os
import stat
import unicodedata
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import InputError, ManifestError, RecordingFormatError

Stamp = tuple[int, int]

_CHANGED = "changed since it was opened"
_PIECE_BYTES, _MOST_PIECES = 1 << 20, 64  # of files with channels side by side, kept in memory

USE_SLASHES = "a file in a folder is written with /, as in runs/config_1.uff"


class FileMap(np.memmap[Any, Any]):
    """A map of a file as it was when it was opened."""

    stamp: Stamp  # of the file then
    _mmap: mmap.mmap

    @classmethod
    def of(cls, path: Path) -> FileMap:
        """The bytes of a file; numpy would look up every folder of its path for links."""
        with path.open("rb") as file:
            stored = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            status = os.fstat(file.fileno())
        whole = np.ndarray.__new__(cls, (len(stored),), np.uint8, stored)
        whole._mmap, whole.filename = stored, str(path.absolute())
        whole.offset, whole.mode, whole.stamp = 0, "r", stamp_of(status)
        return whole


def stamp_of(status: os.stat_result) -> Stamp:
    """Size and time of the last change, by which a file is known to be another one."""
    return status.st_size, status.st_mtime_ns


_MAPS: WeakValueDictionary[tuple[Path, int, Stamp], FileMap] = WeakValueDictionary()


def mapped(
    path: Path,
    dtype: np.dtype[Any] | type = np.uint8,
    offset: int = 0,
    shape: tuple[int, ...] | None = None,
) -> NDArray[Any]:
    """Numbers of a file that stay on disk; `piece` and `fill` read them and views of them.

    All arrays of a file are views of one map: systems allow few open files, 256 on some.
    """
    status = path.stat()
    key = (path, status.st_ino, stamp_of(status))
    whole = _MAPS.get(key)
    if whole is None:
        whole = _MAPS[key] = FileMap.of(path)
    if shape is None:
        return whole
    n_bytes = math.prod(shape) * np.dtype(dtype).itemsize
    return whole[offset : offset + n_bytes].view(dtype).reshape(shape)


def piece(samples: NDArray[Any], start: int, stop: int) -> NDArray[Any]:
    """Samples `start` to `stop`; those of a memory map are read from its file instead.

    What was read through a map stays in the program's memory for as long as the map is there, and a
    file that vanishes under it ends the program without a word. `RecordingFormatError` if the file
    changed or cannot be read any more.
    """
    origin = _origin(samples)
    if origin is None:
        return samples[start:stop]
    start, stop, _ = slice(start, stop).indices(len(samples))
    found = np.empty(max(stop - start, 0), samples.dtype)
    _read(samples, origin, start, found)
    return found


def fill(samples: NDArray[Any], start: int, into: NDArray[np.float64]) -> None:
    """Put samples from `start` on into an array, as `piece` reads them."""
    origin = _origin(samples)
    if origin is not None and samples.dtype == into.dtype and into.flags.c_contiguous:
        _read(samples, origin, start, into)
    else:
        into[:] = piece(samples, start, start + into.size)


def side_by_side(arrays: Sequence[NDArray[Any]]) -> list[tuple[list[int], NDArray[Any]]]:
    """Arrays as columns of matrices, with the places of these: those that alternate in memory.

    An array that alternates with none of the others is a matrix of its own.
    """
    addresses = [_address(array) for array in arrays]
    groups: list[list[int]] = []
    for place in sorted(range(len(arrays)), key=addresses.__getitem__):
        if groups and _is_next(arrays, addresses, groups[-1], place):
            groups[-1].append(place)
        else:
            groups.append([place])
    return [(group, _matrix(arrays[group[0]], len(group))) for group in groups]


def _is_next(
    arrays: Sequence[NDArray[Any]], addresses: Sequence[int], group: Sequence[int], place: int
) -> bool:
    """Whether each sample of an array lies behind that of the last of a group, in the same row."""
    first, array = arrays[group[0]], arrays[place]
    behind = len(group) * first.itemsize
    return addresses[place] - addresses[group[0]] == behind < first.strides[0] and (
        array.dtype,
        array.shape,
        array.strides,
    ) == (first.dtype, first.shape, first.strides)


def _matrix(first: NDArray[Any], count: int) -> NDArray[Any]:
    if count == 1:
        return first[:, np.newaxis]
    shape, strides = (len(first), count), (first.strides[0], first.itemsize)
    return np.lib.stride_tricks.as_strided(first, shape, strides, writeable=False)


def read_rows(columns: NDArray[Any], start: int, room: NDArray[Any]) -> NDArray[Any]:
    """Rows of a matrix of `side_by_side` from `start` on, in `room` where they are on disk."""
    origin = _origin(columns)
    if origin is None:
        return columns[start : start + len(room)]
    step = columns.strides[0]
    if step == columns.shape[1] * columns.itemsize:
        row = np.dtype((np.void, step))
        _read(columns.reshape(-1).view(row), origin, start, room.reshape(-1).view(row))
    else:
        for number, column in enumerate(columns.T):
            room[:, number] = piece(column, start, start + len(room))
    return room


def _origin(samples: NDArray[Any]) -> np.memmap[Any, Any] | None:
    """The whole map of a file that samples are a view of, perhaps as bytes; None for no map."""
    holder: Any = samples
    while holder is not None and not isinstance(getattr(holder, "base", None), mmap.mmap):
        holder = holder.obj if isinstance(holder, memoryview) else getattr(holder, "base", None)
    is_known = isinstance(holder, np.memmap) and holder.filename is not None
    return holder if is_known and samples.strides[0] > 0 else None


def _read(
    samples: NDArray[Any], origin: np.memmap[Any, Any], start: int, into: NDArray[Any]
) -> None:
    """Read from the file of a map, without fresh memory where samples lie side by side."""
    (step,), path = samples.strides, str(origin.filename)
    place = origin.offset + _address(samples) - _address(origin) + start * step
    try:
        if step == samples.itemsize:
            with open(path, "rb", buffering=0) as file:  # noqa: PTH123 - a Path takes longer than the bytes
                file.seek(place)
                n_read = file.readinto(into.view(np.uint8).data) // step
                now = stamp_of(os.fstat(file.fileno()))
        else:
            now = stamp_of(os.stat(path))  # noqa: PTH116 - the same
            n_read = _read_apart(path, now, place, step, into)
    except OSError as error:
        raise _gone(path, error.strerror or str(error)) from error
    if n_read < into.size:
        raise _gone(path, f"{n_read} of {into.size} samples from sample {start + 1} on")
    if now != getattr(origin, "stamp", now):
        raise _gone(path, _CHANGED)


def _read_apart(path: str, stamp: Stamp, place: int, step: int, into: NDArray[Any]) -> int:
    """Read samples that are `step` bytes apart, with those of other channels between them.

    Whole pieces of the file are kept a while, as the other channels are read next. Returns how many
    there are.
    """
    n_rows, done = max(_PIECE_BYTES // step, 1), 0
    while done < into.size:
        number, begin = divmod(place + done * step, n_rows * step)
        held = _piece(path, stamp, number * n_rows * step, (n_rows + 1) * step)
        n_held = (len(held) - begin - into.itemsize) // step + 1
        count = min(into.size - done, n_rows - begin // step, n_held)
        if count < 1:
            break
        apart = np.ndarray((count,), into.dtype, held, begin, (step,))
        into[done : done + count] = apart
        done += count
    return done


@lru_cache(maxsize=_MOST_PIECES)
def _piece(path: str, stamp: Stamp, start: int, n_bytes: int) -> bytes:
    """Bytes of a file as it was at that time."""
    with open(path, "rb", buffering=0) as file:  # noqa: PTH123 - a Path takes longer than the bytes
        file.seek(start)
        found = file.read(n_bytes)
        if stamp_of(os.fstat(file.fileno())) != stamp:
            raise _gone(path, _CHANGED)
    return found


def _address(array: NDArray[Any]) -> int:
    return int(array.__array_interface__["data"][0])


def _gone(path: str, found: str) -> RecordingFormatError:
    rule = "a recording stays as it is while it is read"
    remedy = "Process it again once nobody writes to it; check the drive or the network"
    return RecordingFormatError(path, found, rule, remedy)


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
