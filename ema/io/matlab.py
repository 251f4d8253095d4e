"""Read MATLAB files: channels as vectors, or as a matrix with their names beside it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.units import FREQUENCY, TIME, AxisUnit, parse_axis
from ema.io.columns import (
    Column,
    content_of_columns,
    is_time,
    label_of_axis,
    matrix_columns,
    unit_of_each,
    without_complex,
)
from ema.io.content import FileContent, left_out, reading, states_treatment
from ema.io.frf_table import frf_content, has_frequency, unit_of_lines, with_frequency_first
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
# What Testlab puts before the ends of a function.
_KIND = re.compile(r"^\s*(?:(?:ordinary|multiple)?\s*coherence|FRF|frequency response)\s+", re.I)
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
    treatment: dict[str, Any] = field(default_factory=dict)  # windows and triggers


def read(path: Path) -> FileContent:
    """Read the time series of a MATLAB file, level 5 or 7.3: layouts are in docs/recordings.md.

    Variables of other kinds are left out with a finding. `RecordingFormatError` if the file is
    missing, damaged or of level 4, claims to be far larger than it is, or its variables can be
    understood in more than one way.
    """
    variables = _variables(path)
    functions = {name: each for name, each in variables.items() if _is_function(each)}
    if functions:
        return _of_functions(path, functions, [each for each in variables if each not in functions])
    found = _sorted(path, _unwrapped(variables))
    columns = _columns(path, found)
    findings = left_out(path, found.left_out)
    if (of_frfs := with_frequency_first(path, columns)) is not None:
        return frf_content(path, of_frfs, findings)
    columns, more = without_complex(path, columns)
    findings += more
    rate = stated_rate(path, found.rates)
    return content_of_columns(
        path, columns, rate=rate, findings=findings, statements=found.treatment
    )


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


def _is_function(value: Any) -> bool:
    """Whether a struct is a function as Testlab exports it."""
    parts = (
        [value.get(name) for name in ("x_values", "y_values")] if isinstance(value, dict) else []
    )
    return bool(parts) and all(isinstance(part, dict) for part in parts)


@dataclass(frozen=True, eq=False)
class _Function:
    """A function of Testlab, or several with one axis."""

    name: str  # of the variable
    kind: str  # of its axis: TIME or FREQUENCY
    start: float  # s or Hz
    step: float
    columns: list[Column]

    @property
    def values(self) -> NDArray[Any]:
        """Those of the first; all are of one length and type."""
        return self.columns[0].samples


def _of_functions(path: Path, structs: Mapping[str, Any], others: Sequence[str]) -> FileContent:
    """Channels or FRFs of Testlab: a struct of x_values, y_values and function_record for each."""
    functions = [_function(path, name, each) for name, each in structs.items()]
    findings = left_out(path, dict.fromkeys(others, "beside functions of Testlab"))
    spectra = [each for each in functions if each.kind == FREQUENCY]
    frfs = [each for each in spectra if _is_complex(each.values)]
    if not spectra:
        rate = stated_rate(path, {f"{each.name}/dt": each.step for each in functions})
        columns, treatment = [row for each in functions for row in each.columns], _flat(structs)
        return content_of_columns(path, columns, rate=rate, findings=findings, statements=treatment)
    if not frfs:
        rule = "over frequency, FRFs are read, with real and imaginary part"
        raise RecordingFormatError(path.name, "no complex values", rule, "Export complex FRFs")
    used = [each for each in spectra if each in frfs or _is_coherence(structs[each.name])]
    unused = [each.name for each in functions if each not in used]
    findings += left_out(path, dict.fromkeys(unused, "neither FRF nor coherence"))
    axes = {(each.start, each.step, len(each.values)) for each in used}
    if len(axes) > 1:
        found = f"{len(axes)} resolutions, starts or numbers of lines"
        rule, remedy = "all FRFs must have the same frequency lines", "Export them separately"
        raise RecordingFormatError(path.name, found, rule, remedy)
    ((start, step, n_lines),) = axes
    columns = [Column("frequency", "Hz", start + step * np.arange(n_lines))]
    for each in sorted(used, key=lambda each: each not in frfs):
        part = "" if each in frfs else " coherence"
        columns += [replace(row, name=_KIND.sub("", row.name) + part) for row in each.columns]
    ordered = with_frequency_first(path, columns)
    assert ordered is not None
    return frf_content(path, ordered, findings)


def _is_coherence(struct: Mapping[str, Any]) -> bool:
    return "coherence" in str(struct.get("function_record", "")).lower()


def _function(path: Path, variable: str, struct: Mapping[str, Any]) -> _Function:
    where = f"{path.name}, {variable}"
    axis, ordinate = struct["x_values"], struct["y_values"]
    label, values = _label(axis), ordinate.get("values")
    unit = parse_axis(label) if label else AxisUnit(TIME, 1.0)
    is_signal = isinstance(values, np.ndarray) and values.size > 1
    if unit is None or not is_signal or (unit.kind == TIME and _is_complex(values)):
        rule = "functions of Testlab must be real over time, or over frequency"
        raise RecordingFormatError(where, f"x_values in {label!r}", rule, _SAVE_AGAIN)
    factor = _number(where, ordinate.get("quantity", {}), "unit_transformation/factor", 1.0)
    if factor != 1.0:
        found, rule = f"factor {factor:g}", "the values must be in the unit that is stated"
        raise RecordingFormatError(where, found, rule, "Export in SI units")
    step = _number(where, axis, "increment", np.nan) * unit.factor
    start = _number(where, axis, "start_value", 0.0) * unit.factor
    names = _texts(struct.get("function_record", {}).get("name")) or [variable]
    signals = np.atleast_2d(np.squeeze(values).T)
    if len(names) != len(signals):
        names = [f"{variable} {row}" for row in range(1, len(signals) + 1)]
    start_s = start if unit.kind == TIME else 0.0
    columns = [
        Column(name, _label(ordinate), samples, f"{variable}/{name}", start_s)
        for name, samples in zip(names, signals, strict=True)
    ]
    return _Function(variable, unit.kind, start, step, columns)


def _flat(values: Mapping[str, Any], place: str = "", separator: str = "/") -> dict[str, Any]:
    """Texts and numbers of nested structs by their place."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        where = f"{place}{name}"
        nested = isinstance(value, dict)
        found |= _flat(value, where + separator, separator) if nested else {where: value}
    return found


def _label(values: Mapping[str, Any]) -> str:
    """Unit of an axis of Testlab."""
    quantity = values.get("quantity")
    texts = _texts(quantity.get("label")) if isinstance(quantity, dict) else []
    return texts[0] if texts else ""


def _number(where: str, values: Any, place: str, usual: float) -> float:
    """A number in nested structs; `usual` where there is none."""
    for name in place.split("/"):
        values = values.get(name) if isinstance(values, dict) else None
    if values is None:
        return usual
    if not isinstance(values, np.ndarray) or values.size != 1 or _is_complex(values):
        rule = "it must be one number"
        raise RecordingFormatError(where, f"{place}: another value", rule, _SAVE_AGAIN)
    return float(values.ravel()[0])


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
        elif _is_complex(value) and value.size > 1:
            _sort_array(name, value, found)
        elif _is_complex(value):
            found.left_out[name] = "a complex number"
        elif states_rate(name) and not isinstance(value, LeftOut):
            found.rates[name] = value
        elif states_treatment(name, value):
            found.treatment |= _flat({name: value}, separator=" ")
        elif isinstance(value, np.ndarray) and value.size != 1:
            _sort_array(name, value, found)
        else:
            found.left_out[name] = value.why if isinstance(value, LeftOut) else _KINDS[type(value)]
    structs = [name for name in found.left_out if isinstance(variables[name], dict)]
    if len(structs) > 1 and not found.vectors and not found.matrices:
        held = f"structs {', '.join(structs)}"
        raise RecordingFormatError(path.name, held, _LAYOUTS, _SAVE_AGAIN)
    return found


def _is_complex(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind == "c"


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
    times = [
        name
        for name in found.vectors
        if is_time(name, "") or (found.matrices and has_frequency([_bare(name, found)]))
    ]
    others = [name for name in found.vectors if name not in times]
    are_frfs = any(has_frequency([_bare(name, found)]) for name in times)
    if (len(found.matrices) > 1 and not are_frfs) or (found.matrices and others):
        what = f"matrices {', '.join(found.matrices)}"
        what += f" and vectors {', '.join(others)}" if others else ""
        raise RecordingFormatError(path.name, what, _LAYOUTS, _SAVE_AGAIN)
    if not found.matrices and not others:
        held = ", ".join(f"{name} ({why})" for name, why in found.left_out.items())
        what = f"no vectors or matrices of numbers beside {held or 'time'}"
        raise RecordingFormatError(path.name, what, _LAYOUTS, _SAVE_AGAIN)
    columns = [
        replace(_bare(name, found), unit=label_of_axis(name)[1] or "s")
        if is_time(name, "")
        else replace(_bare(name, found), unit=unit_of_lines(_bare(name, found)))
        for name in times
    ]
    if found.matrices:
        units = _units(found, found.names)
        for name, matrix in found.matrices.items():
            columns += matrix_columns(f"{path.name}, {name}", matrix, found.names, units)
        return columns
    if found.names:
        found.left_out["names"] = "names but no matrix"
    if isinstance(found.units, list) and len(found.units) > 1:
        # The order of variables in a file is not always that in which they were saved.
        what = f"a list of {len(found.units)} units beside the vectors {', '.join(others)}"
        remedy = "Save a struct with the unit of each channel under its name"
        raise RecordingFormatError(path.name, what, "a list is only allowed with a matrix", remedy)
    units = unit_of_each(path.name, len(others), _units(found, others))
    unit_of = dict(zip(others, units, strict=True))
    return columns + [Column(name, unit_of[name], found.vectors[name]) for name in _paired(others)]


def _bare(name: str, found: _Variables) -> Column:
    return Column(name, "", found.vectors[name])


def _paired(names: Sequence[str]) -> list[str]:
    """Vectors with the time of each channel in front of it, as DEWESoft calls them.

    The time of ``Data1_AI_1`` is ``Data1_time_AI_1``.
    """
    time_of = {name.replace("time_", "", 1): name for name in names if "time_" in name}
    times = set(time_of.values()) if set(time_of) & set(names) else set()
    return [
        each
        for name in names
        if name not in times or name.replace("time_", "", 1) not in names
        for each in ([time_of[name], name] if time_of.get(name) in times else [name])
    ]


def _units(found: _Variables, channels: list[str]) -> list[str]:
    """Units as a list, also where the file gives them in a struct by channel."""
    if isinstance(found.units, dict):
        stated = [found.units.get(name) for name in channels]
        return [unit.strip() if isinstance(unit, str) else "" for unit in stated]
    return found.units
