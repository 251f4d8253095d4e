"""Functions of Testlab in MATLAB files: structs of x_values, y_values and function_record."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.units import FREQUENCY, TIME, AxisUnit, parse_axis
from ema.io.columns import Column, content_of_columns
from ema.io.content import FileContent, left_out
from ema.io.frf_table import frf_content, with_frequency_first
from ema.io.matlab_variables import flat, is_complex, texts
from ema.io.variables import stated_rate

_SAVE_AGAIN = "Export it again, or as a universal file"
# What Testlab puts before the ends of a function.
_KIND = re.compile(r"^\s*(?:(?:ordinary|multiple)?\s*coherence|FRF|frequency response)\s+", re.I)


def is_function(value: Any) -> bool:
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


def of_functions(path: Path, structs: Mapping[str, Any], others: Sequence[str]) -> FileContent:
    """Channels or FRFs of Testlab: a struct of x_values, y_values and function_record for each."""
    functions = [_function(path, name, each) for name, each in structs.items()]
    findings = left_out(path, dict.fromkeys(others, "beside functions of Testlab"))
    spectra = [each for each in functions if each.kind == FREQUENCY]
    frfs = [each for each in spectra if is_complex(each.values)]
    if not spectra:
        rate = stated_rate(path, {f"{each.name}/dt": each.step for each in functions})
        columns, treatment = [row for each in functions for row in each.columns], flat(structs)
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
    rows = [replace(row, name=_KIND.sub("", row.name)) for each in frfs for row in each.columns]
    names = {row.name for row in rows}
    for each in used:
        shares = [_KIND.sub("", row.name) for row in each.columns if each not in frfs]
        if len(names) > 1 and not names.issuperset(shares):  # one of several forces together
            findings += left_out(path, {each.name: "a coherence of no FRF here"})
        else:
            shared = zip(each.columns, shares, strict=False)
            rows += [replace(row, name=f"{name} coherence") for row, name in shared]
    columns = [Column("frequency", "Hz", start + step * np.arange(n_lines)), *rows]
    ordered = with_frequency_first(path, columns)
    assert ordered is not None
    return frf_content(path, ordered, findings, flat(structs))


def _is_coherence(struct: Mapping[str, Any]) -> bool:
    return "coherence" in str(struct.get("function_record", "")).lower()


def _function(path: Path, variable: str, struct: Mapping[str, Any]) -> _Function:
    where = f"{path.name}, {variable}"
    axis, ordinate = struct["x_values"], struct["y_values"]
    label, values = _label(axis), ordinate.get("values")
    unit = parse_axis(label) if label else AxisUnit(TIME, 1.0)
    is_signal = isinstance(values, np.ndarray) and values.size > 1
    if unit is None or not is_signal or (unit.kind == TIME and is_complex(values)):
        rule = "functions of Testlab must be real over time, or over frequency"
        raise RecordingFormatError(where, f"x_values in {label!r}", rule, _SAVE_AGAIN)
    factor = _number(where, ordinate.get("quantity", {}), "unit_transformation/factor", 1.0)
    if factor != 1.0:
        found, rule = f"factor {factor:g}", "the values must be in the unit that is stated"
        raise RecordingFormatError(where, found, rule, "Export in SI units")
    step = _number(where, axis, "increment", np.nan) * unit.factor
    start = _number(where, axis, "start_value", 0.0) * unit.factor
    names = texts(struct.get("function_record", {}).get("name")) or [variable]
    signals = np.atleast_2d(np.squeeze(values).T)
    if len(names) != len(signals):
        names = [f"{variable} {row}" for row in range(1, len(signals) + 1)]
    start_s = start if unit.kind == TIME else 0.0
    columns = [
        Column(name, _label(ordinate), samples, f"{variable}/{name}", start_s)
        for name, samples in zip(names, signals, strict=True)
    ]
    return _Function(variable, unit.kind, start, step, columns)


def _label(values: Mapping[str, Any]) -> str:
    """Unit of an axis of Testlab."""
    quantity = values.get("quantity")
    labels = texts(quantity.get("label")) if isinstance(quantity, dict) else []
    return labels[0] if labels else ""


def _number(where: str, values: Any, place: str, usual: float) -> float:
    """A number in nested structs; `usual` where there is none."""
    for name in place.split("/"):
        values = values.get(name) if isinstance(values, dict) else None
    if values is None:
        return usual
    if not isinstance(values, np.ndarray) or values.size != 1 or is_complex(values):
        rule = "it must be one number"
        raise RecordingFormatError(where, f"{place}: another value", rule, _SAVE_AGAIN)
    return float(values.ravel()[0])
