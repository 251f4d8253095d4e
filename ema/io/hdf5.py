"""Read HDF5 files: a dataset for each channel, or a matrix with the names of the channels."""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.files import mapped
from ema.core.finding import Check, Finding
from ema.io import content
from ema.io.columns import Column, content_of_columns, is_time, name_and_unit
from ema.io.content import (
    COPY_AGAIN,
    FileContent,
    check_expansion,
    check_stored,
    reading,
    require,
    states_scale,
)
from ema.io.frf_table import frf_content, with_frequency_first
from ema.io.variables import (
    are_slow,
    matrix_columns,
    stated_rate,
    stated_start_s,
    states_rate,
    states_start,
    without_complex,
)

_NAMES = ("names", "channels", "labels")
_UNITS = ("unit", "units")
# Of stored numbers, after the CF conventions.
_SCALES, _MISSING = ("scale_factor", "add_offset"), ("_FillValue", "missing_value")
_PICKLED_TEXT = re.compile(rb"V([^\n]*)\np[0-9]+\na")
_PICKLED_TEXTS = re.compile(rb"\(lp[0-9]+\n(?:V[^\n]*\np[0-9]+\na)+\.")
_SLOW = "slower than the other channels"
_DEEPEST = 32  # groups in groups
_HEAP = b"GCOL\x01\0\0\0"
_HEADER_BYTES = 16  # of a heap and of each object in it


def read(path: Path) -> FileContent:
    """Read the time series of an HDF5 file: layouts are in docs/recordings.md.

    Datasets stored in one piece stay on disk; others (compressed, in chunks) are read.
    `RecordingFormatError` if h5py is not installed, the file is missing or damaged, claims to be
    far larger than it is, or its datasets do not belong together.
    """
    skipped: dict[str, str] = {}
    with opened(path, "an HDF5 file") as file:
        arrays = list(_arrays(file, file.root, "", {}, skipped))
    series = [each for each in arrays if each.samples.size > 1 and each.n_sides <= 2]
    slow = are_slow([max(each.samples.shape) for each in series], [each.unit for each in series])
    skipped |= {each.path: _SLOW for each, is_slow in zip(series, slow, strict=True) if is_slow}
    series = [each for each in series if each.path not in skipped]
    kept = {each.path for each in series}
    stated: dict[str, Any] = {}
    for array in arrays:
        if array.samples.size == 1 and array.samples.dtype.kind != "c":
            stated |= {array.path: array.samples, f"{array.path}_unit": array.unit}
        elif array.path in kept:
            stated |= array.stated
        if not (array.path in kept or array.path in skipped or states_rate(array.name)):
            skipped[array.path] = f"array of shape {array.samples.shape}"
    of_slow = {each.rpartition("/")[0] for each in skipped} - {each.group for each in series} - {""}
    stated = {place: v for place, v in stated.items() if place.rpartition("/")[0] not in of_slow}
    if not series:
        held = "; ".join(f"{place}: {why}" for place, why in skipped.items()) or "nothing"
        rule = "a channel is a dataset of one dimension, or a row or column of a matrix"
        raise RecordingFormatError(path.name, held, rule, "Export the samples in this layout")
    ordered = _behind_their_times(series)
    starts = [each.starts for each in series if not is_time(each.name, "")]
    same_start = len({str(each.values()) for each in starts}) < 2
    columns = [
        column
        for array in ordered
        for column in _columns(path, _scaled(path, array), same_start=same_start)
    ]
    findings = (*content.left_out(path, skipped), *_not_applied(path, series))
    if (of_frfs := with_frequency_first(path, columns)) is not None:
        return frf_content(path, of_frfs, findings, stated)
    columns, more = without_complex(path, columns)
    findings += more
    rate = stated_rate(path, stated)
    return content_of_columns(path, columns, rate=rate, findings=findings, statements=stated)


@dataclass(frozen=True, eq=False)
class _Array:
    """A dataset of numbers with its attributes; samples are a memory map where possible."""

    path: str
    name: str
    samples: NDArray[Any]
    attributes: dict[str, Any]
    stated: dict[str, Any]  # attributes of its groups and its own, by their place

    @property
    def n_sides(self) -> int:
        """Number of dimensions with more than one element."""
        return np.squeeze(self.samples).ndim

    @property
    def unit(self) -> str:
        """The first unit that its attributes state; empty without one."""
        return [*_texts(self, _UNITS), ""][0]

    @property
    def starts(self) -> dict[str, Any]:
        """What its attributes state of the first sample, by place."""
        return {f"{self.path}/{k}": v for k, v in self.attributes.items() if states_start(k)}

    @property
    def group(self) -> str:
        """Place of the group that it is in."""
        return self.path.rpartition("/")[0]


def _arrays(
    file: Hdf5File, group: Any, prefix: str, above: dict[str, Any], skipped: dict[str, str]
) -> Iterator[_Array]:
    """Arrays below a group; what is `skipped` comes with the reason."""
    above = above | {f"{prefix}/{name}": value for name, value in _attributes(group).items()}
    is_frame = "pandas_type" in group.attrs
    for place, item in file.members(group, prefix):
        if is_frame and place.endswith(("_items", "/axis0", "/_i_table")):
            continue  # names of columns, read with their values; an index of PyTables
        if file.is_group(item):
            yield from _arrays(file, item, place, above, skipped)
        elif table := file.table(item):
            own = _attributes(item)
            stated = above | {f"{place}/{name}": value for name, value in own.items()}
            for name, samples in table.items():
                yield _Array(f"{place}/{name}", name, samples, {}, stated)
        elif why := file.unreadable(item):
            skipped[place] = why
        else:
            own = _attributes(item)
            stated = above | {f"{place}/{name}": value for name, value in own.items()}
            if is_frame and (items := group.get(f"{place[len(prefix) + 1 : -6]}items")):
                own["names"] = items[()]
            yield _Array(place, place.rpartition("/")[2], file.samples(item), own, stated)


def _behind_their_times(arrays: Sequence[_Array]) -> list[_Array]:
    """Arrays group by group, each group behind its time or that of the group around it."""
    times = {each.group: each for each in arrays if is_time(each.name, "")}
    if len(times) < 2:
        return list(arrays)
    ordered = []
    for group in dict.fromkeys(each.group for each in arrays if each not in times.values()):
        around = [place for place in times if f"{group}/".startswith(f"{place}/")]
        ordered += [times[max(around, key=len)]] if around else []
        ordered += [each for each in arrays if each.group == group and each not in times.values()]
    return ordered


def _attributes(item: Any) -> dict[str, Any]:
    """Attributes by name, without those of types that numpy does not have."""
    found = {}
    for name in item.attrs:
        try:
            found[name] = item.attrs[name]
        except (OSError, TypeError):
            continue
    return found


def _scaled(path: Path, array: _Array) -> _Array:
    """Samples as their attributes say: missing ones, and stored · scale_factor + add_offset."""
    missing = [np.ravel(array.attributes.get(name, ())) for name in _MISSING]
    absent = [each[0] for each in missing if each.size == 1 and each.dtype.kind in "iuf"]
    if absent and (gaps := np.isin(array.samples, absent)).any():
        array = replace(array, samples=np.where(gaps, np.nan, array.samples))
    stated = [np.ravel(array.attributes.get(name, ())) for name in _SCALES]
    if not any(each.size for each in stated):
        return array
    if any(each.size > 1 or each.dtype.kind not in "iuf" for each in stated):
        rule = "scale_factor and add_offset must be one number each"
        where = f"{path.name}, {array.path}"
        raise RecordingFormatError(where, "other attributes", rule, content.EXPORT_AGAIN)
    factor, offset = (
        float(each[0]) if each.size else usual
        for each, usual in zip(stated, (1.0, 0.0), strict=True)
    )
    return replace(array, samples=array.samples * factor + offset)


def _not_applied(path: Path, series: Sequence[_Array]) -> Iterator[Finding]:
    """Warnings about integers whose attributes may scale them, in no convention that is known."""
    for array in series:
        stated = [name for name in array.attributes if states_scale(name)]
        if stated and array.samples.dtype.kind in "iu":
            what = f"integers with {', '.join(stated)}, not applied: give their sensitivity or unit"
            yield content.remark(path, array.name, Check.UNIT, f"{what}, or export floats")


def _columns(path: Path, array: _Array, *, same_start: bool) -> list[Column]:
    samples = np.squeeze(array.samples)
    units = _texts(array, _UNITS)
    if samples.ndim == 2:
        return matrix_columns(f"{path.name}, {array.path}", samples, _texts(array, _NAMES), units)
    name, unit = name_and_unit(array.name)
    start_s = 0.0 if same_start else stated_start_s(path, array.starts)
    return [Column(name, units[0] if units else unit, samples, array.path.strip("/"), start_s)]


def _texts(array: _Array, names: tuple[str, ...]) -> list[str]:
    """Texts of the first of these attributes that there is."""
    value = next((array.attributes[name] for name in names if name in array.attributes), None)
    values = value.ravel().tolist() if isinstance(value, np.ndarray) else [value]
    return [
        each.decode("utf-8", "replace") if isinstance(each, bytes) else each
        for each in values
        if isinstance(each, str | bytes)
    ]


def _is_complex(dtype: np.dtype[Any]) -> bool:
    """Whether numbers are complex as h5py or MATLAB stores them."""
    parts = {dtype[name].kind for name in dtype.names or ()}
    return dtype.kind == "c" or (dtype.names == ("real", "imag") and parts == {"f"})


def _names_of_block(stored: object) -> list[str]:
    """Names of the columns in one field of a table of pandas.

    PyTables pickles the list; it is matched as text, and no pickle is loaded.
    """
    pickled = bytes(stored) if isinstance(stored, bytes) else b""
    if not _PICKLED_TEXTS.fullmatch(pickled):
        return []
    return [each.decode("raw_unicode_escape") for each in _PICKLED_TEXT.findall(pickled)]


class Hdf5File:
    """An open file, whose arrays stay within the memory that its size justifies."""

    def __init__(self, path: Path, h5py: Any, root: Any) -> None:
        self.path, self.h5py, self.root = path, h5py, root
        self._seen = {self._address(root)}
        self._n_bytes = 0

    def members(self, group: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
        """Path and object of each member; None for links to other places and second names."""
        for name in group:
            place = f"{prefix}/{name}"
            item = None
            if isinstance(group.get(name, getlink=True), self.h5py.HardLink):
                item = group[name]
                address = self._address(item)
                item = None if address in self._seen or place.count("/") > _DEEPEST else item
                self._seen.add(address)
            yield place, item

    def _address(self, item: Any) -> Any:
        """What identifies an object that has several names."""
        return self.h5py.h5o.get_info(item.id).addr

    def is_group(self, item: Any) -> bool:
        """Whether a member is a group."""
        return isinstance(item, self.h5py.Group)

    def table(self, item: Any) -> dict[str, NDArray[Any]]:
        """Fields with numbers of a dataset of a compound type; empty for any other."""
        if not isinstance(item, self.h5py.Dataset) or item.dtype.names is None or item.ndim != 1:
            return {}
        if item.is_virtual or item.external or _is_complex(item.dtype):
            return {}
        kinds = {name: kind for name, (kind, *_) in item.dtype.fields.items()}
        kinds = {name: kind for name, kind in kinds.items() if kind.base.kind in "iuf"}
        names = {
            name: _names_of_block(item.attrs.get(f"{name}_kind")) if kind.shape else [name]
            for name, kind in kinds.items()
        }
        if any(kind.shape not in ((), (len(names[name]),)) for name, kind in kinds.items()):
            return {}
        n_bytes = int(np.prod(item.shape, dtype=object)) * item.dtype.itemsize
        self._n_bytes += n_bytes
        check_expansion(f"{self.path.name}, {item.name}", self.path, self._n_bytes)
        rows = np.asarray(item[()])
        return {
            column: samples
            for name in kinds
            for column, samples in zip(names[name], np.atleast_2d(rows[name].T), strict=True)
        }

    def unreadable(self, item: Any) -> str:
        """Why a member is not an array of numbers that may be read; empty where it is."""
        if item is None:
            return "a link to another place, a second name, or nested too deep"
        if not isinstance(item, self.h5py.Dataset):
            return "not an array"
        if item.is_virtual:
            return "a virtual dataset, with its data elsewhere"
        if item.external:
            return "data stored in another file"
        if item.dtype.kind not in "iuf" and not _is_complex(item.dtype):
            return "not numbers"
        return "empty" if item.shape is None else ""

    def samples(self, dataset: Any) -> NDArray[Any]:
        """Numbers of a dataset: mapped where they are stored in one piece, else read."""
        where = f"{self.path.name}, {dataset.name}"
        n_bytes = int(np.prod(dataset.shape, dtype=object)) * dataset.dtype.itemsize
        if dataset.chunks is None and not _is_complex(dataset.dtype):
            check_stored(where, n_bytes, dataset.id.get_storage_size())
            offset = dataset.id.get_offset()
            same_type = self.h5py.h5t.py_create(dataset.dtype).equal(dataset.id.get_type())
            if n_bytes and same_type and offset is not None:
                return np.asarray(mapped(self.path, dataset.dtype, offset, dataset.shape))
        # Numbers are unpacked by whole chunks, however few of them belong to the dataset.
        chunk = int(np.prod(dataset.chunks or (0,), dtype=object)) * dataset.dtype.itemsize
        self._n_bytes += n_bytes
        check_expansion(where, self.path, max(self._n_bytes, chunk))
        read = np.asarray(dataset[()])
        return read if read.dtype.names is None else np.asarray(read["real"] + 1j * read["imag"])


@contextmanager
def opened(path: Path, kind: str) -> Iterator[Hdf5File]:
    """Open a file for reading; whatever h5py then raises is a fault of the file."""
    library = require("h5py", path)
    with reading(path, kind):
        _check_heaps(path)
        with library.File(path, "r", locking="best-effort") as root:
            yield Hdf5File(path, library, root)


def _check_heaps(path: Path) -> None:
    """Refuse a file with a heap whose objects do not lead to its end (HDF5 specification, III.E).

    The library would follow free space of size zero for ever.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        start = data.find(_HEAP)
        while start >= 0:
            if not _adds_up(data, start):
                found = f"texts at byte {start} whose lengths do not add up"
                raise RecordingFormatError(path.name, found, "the file is damaged", COPY_AGAIN)
            start = data.find(_HEAP, start + 1)


def _adds_up(data: mmap.mmap, start: int) -> bool:
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
