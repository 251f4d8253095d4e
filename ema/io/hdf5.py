"""Read HDF5 files: a dataset for each channel, or a matrix with the channels' names."""

from __future__ import annotations

import mmap
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.io.columns import Column, content_of_columns, is_time, matrix_columns, name_and_unit
from ema.io.content import FileContent, check_expansion, check_stored, reading, remark, require
from ema.io.sampling import stated_rate, states_rate

if TYPE_CHECKING:
    import h5py

SUFFIXES = (".h5", ".hdf5")
_NAMES = ("names", "channels", "labels")
_UNITS = ("unit", "units")


def read(path: Path) -> FileContent:
    """Read the time series of an HDF5 file.

    A dataset of one dimension is a channel, named by the last part of its path (by all of it
    where names repeat); one of two dimensions holds several, named in its attribute ``names``,
    ``channels`` or ``labels``. The unit stands in the attribute ``unit`` or ``units``, or in
    square brackets behind the name. The rate follows from a dataset ``time`` or ``t``, or from
    ``sampling_rate_hz``, ``fs``, ``sample_rate``, ``dt`` and the like: attributes of the dataset,
    its groups or the file, or datasets of one number. Datasets stored in one piece stay on disk;
    others (compressed, in chunks) are read.

    Raises
    ------
    RecordingFormatError
        If h5py is not installed, the file is missing or damaged, claims to be far larger than it
        is, or its datasets do not belong together.
    """
    content = read_content(path)
    left_out = dict(content.left_out)
    series = []
    for array in content.arrays:
        if array.samples.size > 1 and np.squeeze(array.samples).ndim <= 2:
            series.append(array)
        elif not states_rate(array.name):
            left_out[array.path] = f"array of shape {array.samples.shape}"
    if not series:
        held = "; ".join(f"{place}: {why}" for place, why in left_out.items()) or "nothing"
        rule = "a channel is a dataset of one dimension, or a row or column of a matrix"
        raise RecordingFormatError(path.name, held, rule, "Export the samples in this layout")
    repeated = Counter(array.name for array in series)
    columns = [column for array in series for column in _columns(path, array, repeated)]
    read_in = content_of_columns(path, columns, rate_hz=stated_rate(path, _rates(content, series)))
    notes = tuple(
        remark(path, place, "content", f"{why}, left out") for place, why in left_out.items()
    )
    return replace(read_in, findings=notes + read_in.findings)


def _columns(path: Path, array: StoredArray, repeated: Counter[str]) -> list[Column]:
    samples = np.squeeze(array.samples)
    units = _texts(array, _UNITS)
    if samples.ndim == 2:
        return matrix_columns(f"{path.name}, {array.path}", samples, _texts(array, _NAMES), units)
    name, unit = name_and_unit(array.name)
    unit = units[0] if units else unit
    alone = repeated[array.name] == 1 or is_time(name, unit)
    return [Column(name if alone else array.path.strip("/"), unit, samples)]


def _rates(content: Hdf5Content, series: list[StoredArray]) -> dict[str, object]:
    """All that is said about rates: on the series, on what they are in, and beside them."""
    found: dict[str, object] = {}
    for array in series:
        found |= {f"{array.path}/{name}": value for name, value in array.attributes.items()}
        group = array.path
        while group:
            group = group.rpartition("/")[0]
            held = content.groups[group or "/"]
            found |= {f"{group}/{name}": value for name, value in held.items()}
    beside = [array for array in content.arrays if array.samples.size == 1]
    return found | {array.path: array.samples for array in beside}


def _texts(array: StoredArray, names: tuple[str, ...]) -> list[str]:
    """Texts of the first of these attributes that there is."""
    value = next((array.attributes[name] for name in names if name in array.attributes), None)
    values = value.ravel().tolist() if isinstance(value, np.ndarray) else [value]
    return [_text(each) for each in values if isinstance(each, str | bytes)]


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


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
    # Optional: installed with an extra.
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
    # Optional: installed with an extra.
    import h5py

    return h5py.h5o.get_info(item.id).addr


def unreadable(dataset: h5py.Dataset) -> str:
    """Why a dataset holds no numbers that may be read; empty where it does."""
    if dataset.is_virtual:
        return "a virtual dataset, with its data elsewhere"
    if dataset.external:
        return "data stored in another file"
    if dataset.dtype.kind not in "iuf":
        return "not real numbers"
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
    # Optional: installed with an extra.
    import h5py

    same_type = h5py.h5t.py_create(dataset.dtype).equal(dataset.id.get_type())
    return bool(same_type) and dataset.id.get_offset() is not None


_SIGNATURE = b"GCOL\x01\0\0\0"
_HEADER_BYTES = 16  # of a heap and of each object in it


def check_heaps(path: Path) -> None:
    """Refuse a file with a heap whose objects do not lead to its end.

    After "HDF5 File Format Specification", III.E (The HDF Group). The library follows free space
    of size zero for ever.

    Raises
    ------
    RecordingFormatError
        If a heap is damaged.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        start = data.find(_SIGNATURE)
        while start >= 0:
            if not _is_whole(data, start):
                found = f"texts at byte {start} whose lengths do not add up"
                rule = "the file is damaged"
                raise RecordingFormatError(path.name, found, rule, "Copy or export it again")
            start = data.find(_SIGNATURE, start + 1)


def _is_whole(data: mmap.mmap, start: int) -> bool:
    place = start + _HEADER_BYTES
    if place > len(data):
        return True  # the signature by chance, in the last samples
    stop = start + struct.unpack("<Q", data[place - 8 : place])[0]
    while place + _HEADER_BYTES <= min(stop, len(data)):
        index, size = struct.unpack("<H6xQ", data[place : place + _HEADER_BYTES])
        if index == 0:  # free space, which counts its header
            return bool(size > 0)
        place += _HEADER_BYTES + -(-size // 8) * 8
    return True
