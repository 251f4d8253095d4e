"""Read MATLAB files: channels as vectors, or as a matrix with their names beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.io.columns import Column, content_of_columns, is_time, matrix_columns, unit_of_each
from ema.io.content import FileContent, left_out, reading
from ema.io.hdf5 import Hdf5File, opened
from ema.io.mat5 import COPY_AGAIN, HEADER_BYTES, LeftOut, Mat5Reader
from ema.io.rates import plain_name, stated_rate, states_rate

SUFFIXES = (".mat",)
_NAMES = {"names", "channels", "channelnames", "labels", "channellabels"}
_UNITS = {"units", "unit", "channelunits"}
_HDF5 = b"\x89HDF\r\n\x1a\n"
_LAYOUTS = (
    "a file must contain a vector for each channel, or one matrix and the channel names, plus "
    "fs, dt or t; or a struct of those"
)
_SAVE_AGAIN = "Save it in one of these layouts"
_KINDS = {np.ndarray: "a single number", str: "text", list: "a cell array", dict: "a struct"}
# Larger texts and cell arrays in files of level 7.3 are left out.
_LONGEST_TEXT = 4096
_MOST_CELLS = 10_000


@dataclass
class _Variables:
    """Variables sorted by what they are for."""

    vectors: dict[str, NDArray[Any]] = field(default_factory=dict)
    matrices: dict[str, NDArray[Any]] = field(default_factory=dict)
    rates: dict[str, Any] = field(default_factory=dict)
    names: list[str] = field(default_factory=list)
    units: list[str] | dict[str, Any] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)


def read(path: Path) -> FileContent:
    """Read the time series of a MATLAB file, level 5 or 7.3: layouts are in docs/recordings.md.

    Variables of other kinds are left out with a finding. `RecordingFormatError` if the file is
    missing, damaged or of level 4, claims to be far larger than it is, or its variables can be
    understood in more than one way.
    """
    found = _sorted(path, _unwrapped(_variables(path)))
    columns = _columns(path, found)
    rate = stated_rate(path, found.rates)
    findings = left_out(path, found.left_out)
    return content_of_columns(path, columns, rate=rate, findings=findings)


def _variables(path: Path) -> Mapping[str, Any]:
    with reading(path, "a MATLAB file"), path.open("rb") as file:
        start = file.read(4 * HEADER_BYTES + len(_HDF5))
    if start.startswith(_HDF5) or start.endswith(_HDF5):
        with opened(path, "a MATLAB file of level 7.3") as hdf5:
            return _fields(hdf5, hdf5.root)
    if len(start) < HEADER_BYTES or start[126:128] not in (b"IM", b"MI"):
        rule = "it must be a MATLAB file of level 5 or 7.3"
        raise RecordingFormatError(path.name, f"it begins with {start[:16]!r}", rule, COPY_AGAIN)
    return Mat5Reader(path).variables()


def _fields(file: Hdf5File, group: Any, prefix: str = "") -> dict[str, Any]:
    """Fields of a struct in a file of level 7.3, of the same kinds as `Mat5Reader` returns."""
    found: dict[str, Any] = {}
    for place, item in file.members(group, prefix):
        name = place.rpartition("/")[2]
        if not name.startswith("#"):  # MATLAB's own: what cells refer to
            is_group = file.is_group(item)
            found[name] = _fields(file, item, place) if is_group else _value(file, item)
    return found


def _value(file: Hdf5File, item: Any) -> Any:
    kind = "" if item is None else _class_of(item)
    if kind == "cell" and file.h5py.check_ref_dtype(item.dtype) is file.h5py.Reference:
        return _cells(file, item)
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


def _cells(file: Hdf5File, item: Any) -> Any:
    """Texts of a cell array."""
    if item.size > _MOST_CELLS:
        return LeftOut("a large cell array")
    cells = [file.root[reference] for reference in np.ravel(item[()], order="F") if reference]
    if len(cells) < item.size or any(_class_of(cell) != "char" for cell in cells):
        return LeftOut("a cell array of non-text values")
    return [_value(file, cell) for cell in cells]


def _unwrapped(variables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Fields of the only struct, where the file has no samples beside it."""
    structs = [name for name, value in variables.items() if isinstance(value, dict)]
    structs = [name for name in structs if plain_name(name) not in _UNITS]
    has_series = any(isinstance(v, np.ndarray) and v.size > 1 for v in variables.values())
    if len(structs) != 1 or has_series:
        return variables
    beside = {name: value for name, value in variables.items() if name not in structs}
    return _unwrapped(beside | variables[structs[0]])


def _sorted(path: Path, variables: Mapping[str, Any]) -> _Variables:
    found = _Variables()
    for name, value in variables.items():
        if plain_name(name) in _NAMES and _texts(value):
            found.names = _texts(value)
        elif plain_name(name) in _UNITS and not isinstance(value, np.ndarray):
            found.units = value if isinstance(value, dict) else _texts(value)
        elif states_rate(name) and not isinstance(value, LeftOut):
            found.rates[name] = value
        elif isinstance(value, np.ndarray) and value.size != 1:
            _sort_array(name, value, found)
        else:
            found.left_out[name] = value.why if isinstance(value, LeftOut) else _KINDS[type(value)]
    structs = [name for name in found.left_out if isinstance(variables[name], dict)]
    if len(structs) > 1 and not found.vectors and not found.matrices:
        held = f"structs {', '.join(structs)}"
        raise RecordingFormatError(path.name, held, _LAYOUTS, _SAVE_AGAIN)
    return found


def _sort_array(name: str, value: NDArray[Any], found: _Variables) -> None:
    sides = [side for side in value.shape if side != 1]
    if len(sides) == 1 and value.size:
        found.vectors[name] = value.reshape(-1, order="F")
    elif len(sides) == 2 and value.size:
        found.matrices[name] = value.reshape(sides, order="F")
    else:
        found.left_out[name] = f"an array of {' × '.join(map(str, value.shape))}"


def _texts(value: Any) -> list[str]:
    """Texts of a cell array, a character matrix or a single text; none where there are others."""
    values = [value] if isinstance(value, str) else value
    if isinstance(values, list) and all(isinstance(each, str) for each in values):
        return [each.strip() for each in values]
    return []


def _columns(path: Path, found: _Variables) -> list[Column]:
    times = [name for name in found.vectors if is_time(name, "")]
    others = [name for name in found.vectors if name not in times]
    if len(found.matrices) > 1 or (found.matrices and others):
        what = f"matrices {', '.join(found.matrices)}"
        what += f" and vectors {', '.join(others)}" if others else ""
        raise RecordingFormatError(path.name, what, _LAYOUTS, _SAVE_AGAIN)
    if not found.matrices and not others:
        held = ", ".join(f"{name} ({why})" for name, why in found.left_out.items())
        what = f"no vectors or matrices of numbers beside {held or 'time'}"
        raise RecordingFormatError(path.name, what, _LAYOUTS, _SAVE_AGAIN)
    columns = [Column(name, "s", found.vectors[name]) for name in times]
    if found.matrices:
        name, matrix = next(iter(found.matrices.items()))
        units = _units(found, found.names)
        return columns + matrix_columns(f"{path.name}, {name}", matrix, found.names, units)
    if found.names:
        found.left_out["names"] = "names but no matrix"
    if isinstance(found.units, list) and len(found.units) > 1:
        # The order of variables in a file is not always that in which they were saved.
        what = f"a list of {len(found.units)} units beside the vectors {', '.join(others)}"
        remedy = "Save a struct with the unit of each channel under its name"
        raise RecordingFormatError(path.name, what, "a list is only allowed with a matrix", remedy)
    units = unit_of_each(path.name, len(others), _units(found, others))
    return columns + [
        Column(name, unit, found.vectors[name]) for name, unit in zip(others, units, strict=True)
    ]


def _units(found: _Variables, channels: list[str]) -> list[str]:
    """Units as a list, also where the file gives them in a struct by channel."""
    if isinstance(found.units, dict):
        stated = [found.units.get(name) for name in channels]
        return [unit.strip() if isinstance(unit, str) else "" for unit in stated]
    return found.units
