"""Read MATLAB files: channels as vectors, or as a matrix with their names beside it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.units import is_stated, parse_axis
from ema.io.columns import Column, content_of_columns, is_time, label_of_axis, rises_evenly
from ema.io.content import FileContent, left_out, states_scale, states_treatment
from ema.io.frf_table import (
    are_lines,
    frf_content,
    has_frequency,
    unit_of_lines,
    with_frequency_first,
)
from ema.io.matlab_variables import LeftOut, flat, is_complex, texts, variables_of
from ema.io.testlab import is_function, of_functions
from ema.io.variables import (
    are_slow,
    matrix_columns,
    plain_name,
    stated_rate,
    stated_start_s,
    states_rate,
    states_start,
    unit_of_each,
    without_complex,
)

_NAMES = {"names", "channels", "channelnames", "labels", "channellabels"}
_UNITS = {"units", "unit", "channelunits", "yunit", "yunits"}
_UNITS_OF_X = {"xunit", "xunits", "timeunit", "timeunits"}
_X = {"x", "xdata", "xvalues", "abscissa"}
# Fields of a struct for each channel: its name, and what its vector is called if not that.
_NAME = {"name", "signalname", "channelname", "label", "channel"}
_VALUES = {"data", "values", "value", "y", "ydata", "signal", "samples", "amplitude", "h", "frf"}
# Single numbers that only spectra have.
_OF_SPECTRA = {"df", "deltaf", "fstart", "freqstep", "frequencystep"}
_SETTINGS = re.compile("header|info|settings|setup|param|acquisition|meta", re.IGNORECASE)
_LAYOUTS = (
    "a file must contain a vector for each channel, or one matrix and the channel names, plus "
    "fs, dt or t; or a struct of those"
)
_SAVE_AGAIN = "Save it in one of these layouts"
_KINDS = {np.ndarray: "a single number", str: "text", list: "a cell array"}


@dataclass(frozen=True, eq=False)
class _Signals:
    """Vectors of one struct: those of a time or frequency, and those of channels."""

    place: str
    fields: Mapping[str, Any]
    axes: dict[str, NDArray[Any]]
    signals: dict[str, NDArray[Any]]

    @property
    def texts(self) -> dict[str, str]:
        """Its texts by plain name."""
        return {plain_name(k): v.strip() for k, v in self.fields.items() if isinstance(v, str)}

    @property
    def unit(self) -> str:
        """The unit that it states, empty without one."""
        return next((text for key, text in self.texts.items() if key in _UNITS), "")

    @property
    def unit_of_x(self) -> str:
        """The unit that it states of its axis, empty without one."""
        return next((text for key, text in self.texts.items() if key in _UNITS_OF_X), "")

    @property
    def starts(self) -> dict[str, Any]:
        """What it states of the first sample, by place."""
        return {f"{self.place}/{k}": v for k, v in self.fields.items() if states_start(k)}


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
    of_structs: list[_Signals] = field(default_factory=list)


def read(path: Path) -> FileContent:
    """Read the time series of a MATLAB file, level 5 or 7.3: layouts are in docs/recordings.md.

    Variables of other kinds are left out with a finding. `RecordingFormatError` if the file is
    missing, damaged or of level 4, claims to be far larger than it is, or its variables can be
    understood in more than one way.
    """
    variables = variables_of(path)
    functions = {name: each for name, each in variables.items() if is_function(each)}
    if functions:
        return of_functions(path, functions, [each for each in variables if each not in functions])
    found = _sorted(_unwrapped(_with_headers(variables)))
    _check_scaled(path.name, found.left_out, found.vectors | found.matrices)
    columns = _columns(path, found)
    findings = left_out(path, found.left_out)
    if (of_frfs := with_frequency_first(path, columns)) is not None:
        return frf_content(path, of_frfs, findings, found.treatment)
    columns, more = without_complex(path, columns)
    findings += more
    rate = stated_rate(path, found.rates)
    return content_of_columns(
        path, columns, rate=rate, findings=findings, statements=found.treatment
    )


def _unwrapped(variables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Fields of the only struct, where the file has no samples beside it."""
    structs = [name for name, value in variables.items() if isinstance(value, dict)]
    structs = [name for name in structs if plain_name(name) not in _UNITS]
    has_series = any(isinstance(v, np.ndarray) and v.size > 1 for v in variables.values())
    if len(structs) != 1 or has_series:
        return variables
    beside = {name: value for name, value in variables.items() if name not in structs}
    return _unwrapped(beside | variables[structs[0]])


def _sorted(variables: Mapping[str, Any]) -> _Variables:
    found = _Variables()
    for name, value in variables.items():
        if plain_name(name) in _NAMES and texts(value):
            found.names = texts(value)
        elif plain_name(name) in _UNITS and not isinstance(value, np.ndarray):
            found.units = value if isinstance(value, dict) else texts(value)
        elif is_complex(value) and value.size > 1:
            _sort_array(name, value, found)
        elif is_complex(value):
            found.left_out[name] = "a complex number"
        elif states_rate(name) and not isinstance(value, LeftOut):
            found.rates[name] = value
        elif states_treatment(name, value):
            found.treatment |= flat({name: value}, separator=" ")
        elif isinstance(value, np.ndarray) and value.size != 1:
            _sort_array(name, value, found)
        elif structs := _structs(name, value):
            for place in structs:
                _sort_struct(place, structs[place], found, {})
        else:
            found.left_out[name] = value.why if isinstance(value, LeftOut) else _KINDS[type(value)]
    _leave_out_slow(found)
    return found


def _structs(name: str, value: Any) -> dict[str, Mapping[str, Any]]:
    """A struct, or those of an array or of cells, by name."""
    if isinstance(value, dict):
        return {name: value}
    structs = value if isinstance(value, list) and all(isinstance(v, dict) for v in value) else []
    return {f"{name}({n})": each for n, each in enumerate(structs, 1)}


def _sort_struct(place: str, fields: Mapping[str, Any], found: _Variables, above: Any) -> None:
    """Channels of a struct and of those in it, for which its axes hold too; rates of settings."""
    arrays = {k: v for k, v in fields.items() if isinstance(v, np.ndarray) and v.size > 1}
    vectors = {k: v.reshape(-1, order="F") for k, v in arrays.items() if v.size in v.shape}
    axes = {k: v for k, v in vectors.items() if is_time(k, "") or are_lines(_bare(k, v))}
    if not axes and len(vectors) == 2:  # x and y
        axes = {k: v for k, v in vectors.items() if plain_name(k) in _X and rises_evenly(v)}
    axes = axes or above
    signals = {name: each for name, each in vectors.items() if name not in axes}
    nested = [_structs(f"{place}.{name}", value) for name, value in fields.items()]
    for name, inner in (item for each in nested for item in each.items()):
        _sort_struct(name, inner, found, axes)
    odd = [name for name in arrays if name not in vectors]
    found.left_out |= {f"{place}.{name}": "not a vector" for name in odd}
    rates = {f"{place}/{name}": value for name, value in fields.items() if states_rate(name)}
    rates = rates if signals or _SETTINGS.search(place) else {}
    found.rates |= {each: rate for each, rate in rates.items() if not isinstance(rate, LeftOut)}
    if signals:
        found.of_structs.append(_Signals(place, fields, axes, signals))
        found.treatment |= flat({k: v for k, v in fields.items() if states_treatment(k, v)})
    elif not (odd or rates or any(nested)):
        found.left_out[place] = "a struct"


def _sort_array(name: str, value: NDArray[Any], found: _Variables) -> None:
    sides = [side for side in value.shape if side != 1]
    if len(sides) == 1 and value.size:
        found.vectors[name] = value.reshape(-1, order="F")
    elif len(sides) == 2 and value.size:
        found.matrices[name] = value.reshape(sides, order="F")
    else:
        found.left_out[name] = f"an array of {' × '.join(map(str, value.shape))}"


def _columns(path: Path, found: _Variables) -> list[Column]:
    times = [
        name
        for name in found.vectors
        if is_time(name, "")
        or (found.matrices and has_frequency([_bare(name, found.vectors[name])]))
    ]
    others = [name for name in found.vectors if name not in times]
    are_frfs = any(has_frequency([_bare(name, found.vectors[name])]) for name in times)
    beside = [*others, *(each.place for each in found.of_structs)]
    if (len(found.matrices) > 1 and not are_frfs) or (found.matrices and beside):
        what = f"matrices {', '.join(found.matrices)}"
        what += f" and vectors {', '.join(beside)}" if beside else ""
        raise RecordingFormatError(path.name, what, _LAYOUTS, _SAVE_AGAIN)
    spectral = ", ".join(sorted(n for n in found.left_out if plain_name(n) in _OF_SPECTRA))
    if spectral and not (found.rates or times):
        what = f"{spectral} and neither a rate nor frequencies"
        rule = "FRFs need the vector of their frequencies, and time series fs, dt or t"
        raise RecordingFormatError(path.name, what, rule, "Save it beside them")
    if not (found.matrices or others or found.of_structs):
        held = ", ".join(f"{name} ({why})" for name, why in found.left_out.items())
        what = f"no vectors or matrices of numbers beside {held or 'time'}"
        raise RecordingFormatError(path.name, what, _LAYOUTS, _SAVE_AGAIN)
    of_axes = found.units if isinstance(found.units, dict) else {}
    columns = [_axis(name, found.vectors[name], of_axes.get(name)) for name in times]
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
    columns += [Column(name, unit_of[name], found.vectors[name]) for name in _paired(others)]
    return columns + _columns_of_structs(path, found.of_structs)


def _leave_out_slow(found: _Variables) -> None:
    """Leave out slow channels and a few values beside a recording, with the rates of their own."""
    series = {each.place: each for each in found.of_structs}
    lengths = {name: len(samples) for name, samples in found.vectors.items()}
    lengths |= {place: max(map(len, each.signals.values())) for place, each in series.items()}
    of_vectors = found.units if isinstance(found.units, dict) else {}
    units = [series[name].unit if name in series else str(of_vectors.get(name)) for name in lengths]
    for name, is_slow in zip(lengths, are_slow([*lengths.values()], units), strict=True):
        if is_slow:
            found.left_out[name] = f"{lengths[name]} values beside {max(lengths.values())}"
            found.vectors.pop(name, None)
    found.of_structs = [each for each in found.of_structs if each.place not in found.left_out]
    slow = tuple(f"{place}/" for place in series if place in found.left_out)
    found.rates = {name: rate for name, rate in found.rates.items() if not name.startswith(slow)}


def _bare(name: str, samples: NDArray[Any]) -> Column:
    return Column(name, "", samples)


def _columns_of_structs(path: Path, structs: Sequence[_Signals]) -> list[Column]:
    """Channels of structs, each behind the time of its own."""
    several = Counter(name for each in structs if len(each.signals) > 1 for name in each.signals)
    if several and max(several.values()) > 1:
        what = f"the same channels in structs {', '.join(each.place for each in structs)}"
        raise RecordingFormatError(path.name, what, _LAYOUTS, "Save a file for each recording")
    same_start = len({str(each.starts.values()) for each in structs}) < 2
    columns = []
    for each in structs:
        columns += [_axis(name, samples, each.unit_of_x) for name, samples in each.axes.items()]
        start_s = 0.0 if same_start else stated_start_s(path, each.starts)
        is_one, texts = len(each.signals) == 1, each.texts
        _check_scaled(f"{path.name}, {each.place}", each.fields, each.signals)
        unit = each.unit if is_one else ""
        for name, samples in each.signals.items():
            own = each.place if is_one and plain_name(name) in _VALUES else name
            stated = [texts[key] for key in texts if is_one and key in _NAME and texts[key]]
            place = f"{each.place}.{name}"
            columns.append(Column([*stated, own][0], unit, samples, place, start_s))
    return columns


def _check_scaled(where: str, names: Iterable[str], signals: Mapping[str, NDArray[Any]]) -> None:
    """Refuse integers beside a number that may scale them, in no convention that is known."""
    scales = [name for name in names if states_scale(name)]
    if scales and any(samples.dtype.kind in "iu" for samples in signals.values()):
        rule = "integers must be in the unit they state"
        raise RecordingFormatError(where, f"{scales[0]} of integers", rule, "Save them scaled")


def _axis(name: str, samples: NDArray[Any], stated: Any = None) -> Column:
    """A time or frequencies, with the unit that is stated or in the name."""
    column = _bare(name, samples)
    if isinstance(stated, str) and is_stated(stated):
        return replace(column, unit=stated.strip())
    unit = label_of_axis(name)[1] or "s" if is_time(name, "") else unit_of_lines(column)
    unit = unit if parse_axis(unit) else ""
    return replace(column, unit=unit)


def _with_headers(variables: Mapping[str, Any]) -> dict[str, Any]:
    """Vectors such as Channel_1_Data in one struct with what Channel_1_Header states of them."""
    joined = dict(variables)
    for name, header in variables.items():
        data = re.sub("Header$", "Data", name)
        if data != name and isinstance(header, dict) and isinstance(joined.get(data), np.ndarray):
            joined[name.removesuffix("_Header")] = {**header, "Data": joined.pop(data)}
            del joined[name]
    return joined


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
