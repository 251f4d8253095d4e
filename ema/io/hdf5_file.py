"""What HDF5 files hold, read without leaving the file or trusting the sizes it claims."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.io.claims import check_expansion, check_stored
from ema.io.extras import reading, require
from ema.io.hdf5_heaps import check_heaps

if TYPE_CHECKING:
    import h5py

_DEEPEST = 32


@dataclass(frozen=True, eq=False)
class StoredArray:
    """A dataset of numbers.

    Parameters
    ----------
    path : str
        Where it is in the file, e.g. ``"/run 1/A01"``.
    samples : ndarray
        A memory map where the dataset is stored in one piece, else in memory.
    attributes : dict
        Of the dataset.
    """

    path: str
    samples: NDArray[Any]
    attributes: dict[str, Any]

    @property
    def name(self) -> str:
        """Last part of the path."""
        return self.path.rpartition("/")[2]


@dataclass(frozen=True, eq=False)
class Hdf5Content:
    """Arrays of a file, attributes of its groups, and what is neither.

    Parameters
    ----------
    arrays : tuple of StoredArray
        In the order of the file's names.
    groups : dict of str to dict
        Attributes of each group by its path, ``"/"`` for the file itself.
    left_out : dict of str to str
        Why a part of the file was not read, by its path.
    """

    arrays: tuple[StoredArray, ...]
    groups: dict[str, dict[str, Any]]
    left_out: dict[str, str]


@contextmanager
def opened(path: Path, kind: str = "an HDF5 file") -> Iterator[h5py.File]:
    """Open a file for reading; whatever the library then raises is a fault of the file.

    Raises
    ------
    RecordingFormatError
        If h5py is not installed or the file cannot be read.
    """
    library = require("h5py", "hdf5", path)
    with reading(path, kind):
        check_heaps(path)
        with library.File(path, "r", locking="best-effort") as file:
            yield file


def read_content(path: Path) -> Hdf5Content:
    """Read all datasets of numbers of a file.

    Links that lead to other places, virtual datasets and data kept in other files are not
    followed.

    Raises
    ------
    RecordingFormatError
        If the file is damaged, or claims to be far larger than it is.
    """
    arrays: list[StoredArray] = []
    groups: dict[str, dict[str, Any]] = {}
    left_out: dict[str, str] = {}
    memory = Memory(path)
    with opened(path) as file:
        groups["/"] = attributes_of(file)
        for place, item in _items(file, "", {address_of(file)}, left_out):
            if not hasattr(item, "shape"):
                groups[place] = attributes_of(item)
                continue
            why = unreadable(item)
            if why:
                left_out[place] = why
            else:
                arrays.append(StoredArray(place, memory.samples(item), attributes_of(item)))
    return Hdf5Content(tuple(arrays), groups, left_out)


def _items(
    group: h5py.Group, prefix: str, seen: set[Any], left_out: dict[str, str]
) -> Iterator[tuple[str, Any]]:
    """Groups and datasets below a group, each of them once."""
    import h5py

    for name in group:
        place = f"{prefix}/{name}"
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            left_out[place] = "a link to another place"
            continue
        item = group[name]
        address = address_of(item)
        if address in seen or place.count("/") > _DEEPEST:
            left_out[place] = "a second name of something else, or nested too deep"
            continue
        seen.add(address)
        if isinstance(item, h5py.Group):
            yield place, item
            yield from _items(item, place, seen, left_out)
        elif isinstance(item, h5py.Dataset):
            yield place, item


def address_of(item: h5py.HLObject) -> Any:
    """What tells objects apart that have several names."""
    import h5py

    return h5py.h5o.get_info(item.id).addr


def unreadable(dataset: h5py.Dataset) -> str:
    """Why a dataset holds no numbers that may be read; empty where it does."""
    if dataset.is_virtual:
        return "a virtual dataset, whose numbers are elsewhere"
    if dataset.external:
        return "numbers kept in another file"
    if dataset.dtype.kind not in "iuf":
        return "something other than real numbers"
    if dataset.shape is None:
        return "empty"
    return ""


def attributes_of(item: h5py.HLObject) -> dict[str, Any]:
    """Attributes by name; those of types that numpy does not have are passed over."""
    found = {}
    for name in item.attrs:
        try:
            found[name] = item.attrs[name]
        except (OSError, TypeError):
            continue
    return found


class Memory:
    """Arrays of one file, within the memory that its size justifies.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._n_bytes = 0

    def samples(self, dataset: h5py.Dataset) -> NDArray[Any]:
        """Numbers of a dataset: mapped where they lie in one piece, else read.

        Raises
        ------
        RecordingFormatError
            If the dataset claims more numbers than it can hold.
        """
        where = f"{self.path.name}, {dataset.name}"
        n_bytes = int(np.prod(dataset.shape, dtype=object)) * dataset.dtype.itemsize
        if dataset.chunks is None:
            check_stored(where, n_bytes, dataset.id.get_storage_size())
            if n_bytes and _is_plain(dataset):
                offset = dataset.id.get_offset()
                return np.asarray(np.memmap(self.path, dataset.dtype, "r", offset, dataset.shape))
        # Numbers are unpacked by whole chunks, however few of them belong to the dataset.
        chunk = int(np.prod(dataset.chunks or (0,), dtype=object)) * dataset.dtype.itemsize
        self._n_bytes += n_bytes
        check_expansion(where, self.path, max(self._n_bytes, chunk))
        return np.asarray(dataset[()])


def _is_plain(dataset: h5py.Dataset) -> bool:
    """Whether the bytes in the file are those of a numpy array."""
    import h5py

    same_type = h5py.h5t.py_create(dataset.dtype).equal(dataset.id.get_type())
    return bool(same_type) and dataset.id.get_offset() is not None
