"""Variables of a MATLAB file of level 5 (saved with -v6 or -v7) or 7.3, as plain Python values.

After "MAT-File Format" (The MathWorks). Numbers stay views of the file, or of what was unpacked
from it; nothing that MATLAB would execute (objects, function handles) is read. `scipy.io.loadmat`
trusts the sizes in a damaged file (see the architecture page).
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.files import mapped
from ema.io.content import check_expansion, reading
from ema.io.hdf5 import Hdf5File, opened

_COPY_AGAIN = "Copy the file again or save it again with -v7"
_HEADER_BYTES = 128
_HDF5 = b"\x89HDF\r\n\x1a\n"
# Larger texts and cell arrays in files of level 7.3 are left out.
_LONGEST_TEXT = 4096
_MOST_CELLS = 10_000
# Types of data in elements.
_INTEGERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 12: "i8", 13: "u8"}
_NUMBERS = _INTEGERS | {7: "f4", 9: "f8"}
_TEXTS = dict.fromkeys((1, 2), "latin-1") | dict.fromkeys((3, 4, 17), "utf-16")
_TEXTS |= {16: "utf-8", 18: "utf-32"}
_MATRIX, _COMPRESSED = 14, 15
# Classes of arrays, and marks of numeric ones.
_CELL, _STRUCT, _CHAR = 1, 2, 4
_NUMERIC = range(6, 16)
_OTHERS = {3: "an object", 5: "a sparse matrix", 16: "a function", 17: "an object, table or string"}
_COMPLEX, _LOGICAL = 0x0800, 0x0200
_DEEPEST = 16  # cells and structs in each other


@dataclass(frozen=True)
class LeftOut:
    """A variable that cannot be used, and what it is, e.g. ``"a function"``."""

    why: str


def variables_of(path: Path) -> Mapping[str, Any]:
    """Variables of a file of level 5 or 7.3 by name; kinds as in `Mat5Reader.variables`."""
    with reading(path, "a MATLAB file"), path.open("rb") as file:
        start = file.read(4 * _HEADER_BYTES + len(_HDF5))
    if start.startswith(_HDF5) or start.endswith(_HDF5):
        with opened(path, "a MATLAB file of level 7.3") as hdf5:
            return _fields(hdf5, hdf5.root)
    if len(start) < _HEADER_BYTES or start[126:128] not in (b"IM", b"MI"):
        rule = "it must be a MATLAB file of level 5 or 7.3"
        raise RecordingFormatError(path.name, f"it begins with {start[:16]!r}", rule, _COPY_AGAIN)
    return Mat5Reader(path).variables()


def _fields(file: Hdf5File, group: Any, prefix: str = "") -> dict[str, Any]:
    """Fields of a struct in a file of level 7.3, of the same kinds as `Mat5Reader` returns."""
    found: dict[str, Any] = {}
    for place, item in file.members(group, prefix):
        name = place.rpartition("/")[2]
        if not name.startswith("#"):  # MATLAB's own: what cells refer to
            is_group = file.is_group(item)
            found[name] = _struct(file, item, place) if is_group else _value(file, item)
    return found


def _struct(file: Hdf5File, group: Any, place: str) -> Any:
    """A struct, or the list of structs of an array, each of whose fields is a list."""
    fields = _fields(file, group, place)
    counts = {len(each) if isinstance(each, _Elements) else 0 for each in fields.values()}
    if 0 in counts or len(counts) != 1:
        return fields
    return [dict(zip(fields, row, strict=True)) for row in zip(*fields.values(), strict=True)]


class _Elements(list[Any]):
    """Values of one field of an array of structs."""


def _value(file: Hdf5File, item: Any) -> Any:
    kind = "" if item is None else _class_of(item)
    if item is not None and file.h5py.check_ref_dtype(item.dtype) is file.h5py.Reference:
        return _cells(file, item, of_texts=kind == "cell")
    if item is not None and "MATLAB_empty" in item.attrs:
        return LeftOut("empty")
    if why := file.unreadable(item):
        return LeftOut(why)
    if kind in ("logical", "function_handle") or "MATLAB_object_decode" in item.attrs:
        return LeftOut(f"of class {kind}")
    return _text(file, item) if kind == "char" else file.samples(item).T  # columns come first


def _class_of(item: Any) -> str:
    name = item.attrs.get("MATLAB_class", b"")
    return name.decode("latin-1") if isinstance(name, bytes) else str(name)


def _text(file: Hdf5File, item: Any) -> Any:
    """One text, or one for each row of a character matrix."""
    if item.size > _LONGEST_TEXT:
        return LeftOut("a long text")
    codes = np.atleast_2d(file.samples(item).astype("<u2").T)
    rows = [row.tobytes().decode("utf-16-le", "replace") for row in codes]
    return rows[0] if len(rows) == 1 else [row.rstrip() for row in rows]


def _cells(file: Hdf5File, item: Any, *, of_texts: bool) -> Any:
    """Texts of a cell array, or numbers and texts of a field of an array of structs."""
    if item.size > _MOST_CELLS:
        return LeftOut("a large cell array")
    cells = [file.root[reference] for reference in np.ravel(item[()], order="F") if reference]
    if len(cells) < item.size or (of_texts and any(_class_of(each) != "char" for each in cells)):
        return LeftOut("a cell array of non-text values")
    if any(file.is_group(cell) or cell.dtype.kind == "O" for cell in cells):
        return LeftOut("an array of nested structs")
    values = [_value(file, cell) for cell in cells]
    return values if of_texts else _Elements(values)


class _Element(NamedTuple):
    """A tagged piece of the file: its data type and its bytes."""

    kind: int
    data: memoryview


class Mat5Reader:
    """Walks through the tagged elements of the file at `path`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._bytes = mapped(path).data
        self._order = "<" if bytes(self._bytes[126:128]) == b"IM" else ">"
        self._tag = struct.Struct(f"{self._order}II")
        self._unpacked_bytes = 0

    def variables(self) -> dict[str, Any]:
        """Variables by name, in the order of the file.

        Numbers come as ndarray in the precision they are stored in, texts as str, cell arrays as
        list, structs as dict, arrays of structs as list of those, everything else as
        `LeftOut`. `RecordingFormatError` if the file is damaged or truncated, or claims to be far
        larger than it is.
        """
        found: dict[str, Any] = {}
        for kind, content in self._elements(self._bytes[_HEADER_BYTES:]):
            if kind == _COMPRESSED:
                kind, content = self._unpacked(content)
            name, value = self._matrix(_Element(kind, content), 0)
            if name in found:
                raise self._damaged(f"two variables {name!r}")
            if name:  # MATLAB keeps what belongs to objects in a variable without a name
                found[name] = value
        return found

    def _damaged(self, found: str) -> RecordingFormatError:
        rule = "variables follow MATLAB's format of level 5; the file is damaged or cut short"
        return RecordingFormatError(self.path.name, found, rule, _COPY_AGAIN)

    def _elements(self, data: memoryview) -> Iterator[_Element]:
        while len(data):
            element, data = self._first(data)
            yield element

    def _first(self, data: memoryview) -> tuple[_Element, memoryview]:
        """First element of `data`, and what follows it."""
        if len(data) < 8:
            raise self._damaged(f"{len(data)} bytes left where an element begins")
        kind, size = self._tag.unpack_from(data)
        if kind >> 16:  # up to four bytes are kept beside their tag
            kind, size = kind & 0xFFFF, kind >> 16
            if size > 4:
                raise self._damaged(f"a short element of {size} bytes")
            return _Element(kind, data[4 : 4 + size]), data[8:]
        if size > len(data) - 8:
            raise self._damaged(f"{len(data) - 8} of {size} bytes of an element")
        padded = size if kind == _COMPRESSED else -(-size // 8) * 8
        return _Element(kind, data[8 : 8 + size]), data[8 + padded :]

    def _unpacked(self, packed: memoryview) -> _Element:
        """Element that was compressed; its claimed size is checked before it is unpacked."""
        stream = zlib.decompressobj()
        try:
            tag = stream.decompress(packed, 8)
            if len(tag) < 8:
                raise self._damaged("a compressed variable without content")
            kind, size = self._tag.unpack(tag)
            self._unpacked_bytes += size
            check_expansion(self.path.name, self.path, self._unpacked_bytes)
            content = stream.decompress(stream.unconsumed_tail, size) if size else b""
            surplus = stream.decompress(stream.unconsumed_tail, 1)
        except zlib.error as error:
            raise self._damaged(f"a compressed variable: {error}") from error
        if len(content) != size or surplus or not stream.eof:
            raise self._damaged(f"{len(content)} of {size} bytes of a compressed variable")
        return _Element(kind, memoryview(content))

    def _matrix(self, element: _Element, depth: int) -> tuple[str, Any]:
        """Name and value of an array of any class."""
        if element.kind != _MATRIX:
            raise self._damaged(f"an element of type {element.kind} where an array is expected")
        if not len(element.data):
            return "", LeftOut("empty")
        if depth > _DEEPEST:
            raise self._damaged(f"arrays nested more than {_DEEPEST} deep")
        flags, rest = self._first(element.data)
        marks = next(iter(self._integers(flags)), 0)
        kind = marks & 0xFF
        if kind in _OTHERS:
            texts = (each for each in self._elements(rest) if each.kind == 1)
            return next(map(self._text, texts), ""), LeftOut(_OTHERS[kind])
        shape, rest = self._first(rest)
        name, rest = self._first(rest)
        dimensions = tuple(self._integers(shape))
        if len(dimensions) < 2 or min(dimensions) < 0:
            raise self._damaged(f"an array of dimensions {dimensions}")
        return self._text(name), self._value(kind, marks, dimensions, rest, depth)

    def _value(
        self, kind: int, marks: int, shape: tuple[int, ...], rest: memoryview, depth: int
    ) -> Any:
        if kind == _CELL:
            return self._cells(math.prod(shape), rest, depth)
        if kind == _STRUCT:
            return self._struct(math.prod(shape), rest, depth)
        if kind == _CHAR:
            return self._rows_of_text(shape, self._first(rest)[0])
        if kind not in _NUMERIC:
            raise self._damaged(f"an array of class {kind}")
        if marks & _LOGICAL:
            return LeftOut("logical values")
        element, rest = self._first(rest)
        values = self._numbers(element)
        if marks & _COMPLEX:
            imaginary = self._numbers(self._first(rest)[0])
            if imaginary.size != values.size:
                raise self._damaged(f"{values.size} real and {imaginary.size} imaginary parts")
            values = values + 1j * imaginary
        if values.size != math.prod(shape):
            raise self._damaged(f"{values.size} numbers in an array of {shape}")
        return values.reshape(shape, order="F")

    def _cells(self, count: int, rest: memoryview, depth: int) -> list[Any]:
        values = [self._matrix(element, depth + 1)[1] for element in self._elements(rest)]
        if len(values) != count:
            raise self._damaged(f"{len(values)} of {count} cells")
        return values

    def _struct(self, count: int, rest: memoryview, depth: int) -> Any:
        length, rest = self._first(rest)
        names, rest = self._first(rest)
        width = next(iter(self._integers(length)), 0)
        if width < 1 or len(names.data) % width:
            raise self._damaged(f"field names of {width} bytes")
        fields = [
            bytes(names.data[start : start + width]).split(b"\0")[0].decode("latin-1")
            for start in range(0, len(names.data), width)
        ]
        if not fields:
            return {}
        values = self._cells(count * len(fields), rest, depth)
        rows = [values[start : start + len(fields)] for start in range(0, len(values), len(fields))]
        structs = [dict(zip(fields, row, strict=True)) for row in rows]
        return structs[0] if count == 1 else structs

    def _numbers(self, element: _Element) -> NDArray[Any]:
        if element.kind not in _NUMBERS:
            raise self._damaged(f"an element of type {element.kind} where numbers are expected")
        dtype = np.dtype(self._order + _NUMBERS[element.kind])
        if len(element.data) % dtype.itemsize:
            raise self._damaged(f"{len(element.data)} bytes of numbers of {dtype.itemsize}")
        return np.frombuffer(element.data, dtype)

    def _integers(self, element: _Element) -> list[int]:
        if element.kind not in _INTEGERS:
            raise self._damaged(f"an element of type {element.kind} where integers are expected")
        values: list[int] = self._numbers(element).tolist()
        return values

    def _text(self, element: _Element) -> str:
        encoding = _TEXTS.get(element.kind)
        if encoding is None:
            raise self._damaged(f"an element of type {element.kind} where text is expected")
        if encoding in ("utf-16", "utf-32"):
            encoding += "-le" if self._order == "<" else "-be"
        return bytes(element.data).decode(encoding, "replace").rstrip("\0")

    def _rows_of_text(self, shape: tuple[int, ...], element: _Element) -> str | list[str]:
        """One text, or one for each row of a character matrix."""
        text = self._text(element)
        if shape[0] <= 1 or len(text) != math.prod(shape):
            return text
        return [text[row :: shape[0]].rstrip() for row in range(shape[0])]


def flat(values: Mapping[str, Any], place: str = "", separator: str = "/") -> dict[str, Any]:
    """Texts and numbers of nested structs by their place."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        where = f"{place}{name}"
        nested = isinstance(value, dict)
        found |= flat(value, where + separator, separator) if nested else {where: value}
    return found


def is_complex(value: Any) -> bool:
    """Whether a value is an array of complex numbers."""
    return isinstance(value, np.ndarray) and value.dtype.kind == "c"


def texts(value: Any) -> list[str]:
    """Texts of a cell array, a character matrix or a single text; none where there are others."""
    values = [value] if isinstance(value, str) else value
    if isinstance(values, list) and all(isinstance(each, str) for each in values):
        return [each.strip() for each in values]
    return []
