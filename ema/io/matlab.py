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
from ema.core.units import FREQUENCY, TIME, AxisUnit, parse_axis
from ema.io.arrays import are_slow, matrix_columns, unit_of_each, without_complex
from ema.io.columns import Column, content_of_columns, is_time, label_of_axis
from ema.io.content import FileContent, left_out, states_scale, states_treatment
from ema.io.frf_table import (
    are_lines,
    frf_content,
    has_frequency,
    unit_of_lines,
    with_frequency_first,
)
from ema.io.matlab_variables import LeftOut, variables_of
from ema.io.rates import plain_name, stated_rate, stated_start_s, states_rate, states_start

SUFFIXES = (".mat",)
_NAMES = {"names", "channels", "channelnames", "labels", "channellabels"}
_UNITS = {"units", "unit", "channelunits"}
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
# What Testlab puts before the ends of a function.
_KIND = re.compile(r"^\s*(?:(?:ordinary|multiple)?\s*coherence|FRF|frequency response)\s+", re.I)
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
    functions = {name: each for name, each in variables.items() if _is_function(each)}
    if functions:
        return _of_functions(path, functions, [each for each in variables if each not in functions])
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
    return frf_content(path, ordered, findings, _flat(structs))


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


def _sorted(variables: Mapping[str, Any]) -> _Variables:
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
    axes = {k: v for k, v in vectors.items() if is_time(k, "") or are_lines(_bare(k, v))} or above
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
        found.treatment |= _flat({k: v for k, v in fields.items() if states_treatment(k, v)})
    elif not (odd or rates or any(nested)):
        found.left_out[place] = "a struct"


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
    columns = [_axis(name, found.vectors[name]) for name in times]
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
        columns += [_axis(name, samples) for name, samples in each.axes.items()]
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


def _axis(name: str, samples: NDArray[Any]) -> Column:
    """A time or frequencies, with the unit in the name."""
    column = _bare(name, samples)
    unit = label_of_axis(name)[1] or "s" if is_time(name, "") else unit_of_lines(column)
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
