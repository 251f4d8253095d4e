"""The variables of a MATLAB file of level 7.3, which is HDF5 inside, as plain Python values."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ema.io.hdf5 import Memory, address_of, opened, unreadable
from ema.io.matlab.mat5 import LeftOut

if TYPE_CHECKING:
    import h5py

_LONGEST_TEXT = 4096
_MOST_CELLS = 10_000


def read_variables(path: Path) -> dict[str, Any]:
    """Variables by name, of the same kinds as those of `ema.io.matlab.mat5`; cells are texts.

    Raises
    ------
    RecordingFormatError
        If h5py is not installed, or the file is damaged or claims to be far larger than it is.
    """
    with opened(path, "a MATLAB file of level 7.3") as file:
        return _fields(file, Memory(path), set())


def _fields(group: h5py.Group, memory: Memory, seen: set[Any]) -> dict[str, Any]:
    """Fields of a struct; a group that contains itself is not read again."""
    # Optional: installed with an extra.
    import h5py

    found: dict[str, Any] = {}
    for name in group:
        if name.startswith("#"):  # MATLAB's own: what cells refer to
            continue
        item = group[name] if _is_here(group, name) else None
        address = None if item is None else address_of(item)
        if item is None or address in seen:
            found[name] = LeftOut("a link to another place")
            continue
        seen.add(address)
        is_group = isinstance(item, h5py.Group)
        found[name] = _fields(item, memory, seen) if is_group else _value(item, memory)
    return found


def _is_here(group: h5py.Group, name: str) -> bool:
    # Optional: installed with an extra.
    import h5py

    return isinstance(group.get(name, getlink=True), h5py.HardLink)


def _value(item: Any, memory: Memory) -> Any:
    # Optional: installed with an extra.
    import h5py

    if not isinstance(item, h5py.Dataset):
        return LeftOut("no array")
    kind = _class_of(item)
    if item.shape is None or "MATLAB_empty" in item.attrs:
        return LeftOut("empty")
    if kind == "cell":
        return _cells(item, memory)
    why = unreadable(item)
    if why or kind in ("logical", "function_handle") or "MATLAB_object_decode" in item.attrs:
        return LeftOut(why or f"of class {kind}")
    return _text(item, memory) if kind == "char" else memory.samples(item).T  # columns come first


def _class_of(item: h5py.Group | h5py.Dataset) -> str:
    name = item.attrs.get("MATLAB_class", b"")
    return name.decode("latin-1") if isinstance(name, bytes) else str(name)


def _text(item: h5py.Dataset, memory: Memory) -> Any:
    """One text, or one for each row of a character matrix."""
    if item.size > _LONGEST_TEXT:
        return LeftOut("a long text")
    codes = np.atleast_2d(memory.samples(item).astype("<u2").T)
    rows = [row.tobytes().decode("utf-16-le", "replace") for row in codes]
    return rows[0] if len(rows) == 1 else [row.rstrip() for row in rows]


def _cells(item: h5py.Dataset, memory: Memory) -> Any:
    """Texts of a cell array; references to regions are no cells."""
    # Optional: installed with an extra.
    import h5py

    if h5py.check_ref_dtype(item.dtype) is not h5py.Reference or item.size > _MOST_CELLS:
        return LeftOut("a cell array of unknown type")
    cells = [item.file[reference] for reference in np.ravel(item[()], order="F") if reference]
    if len(cells) < item.size or any(_class_of(cell) != "char" for cell in cells):
        return LeftOut("a cell array of non-text values")
    return [_value(cell, memory) for cell in cells]
