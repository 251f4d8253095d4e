"""Unit of an axis of a dataset 58: from its label, its type of data, and dataset 164."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ema.core.recording import ACCELERATION, DISPLACEMENT, FORCE, UNKNOWN, VELOCITY
from ema.core.units import is_stated, parse_unit
from ema.io.uff.dataset58_header import (
    DATA_ACCELERATION,
    DATA_DISPLACEMENT,
    DATA_FORCE,
    DATA_VELOCITY,
    FREQUENCY_RESPONSE,
    GENERAL_TYPES,
    TIME_RESPONSE,
    Axis,
)
from ema.io.uff.scan import Dataset

QUANTITY = {
    DATA_DISPLACEMENT: DISPLACEMENT,
    DATA_VELOCITY: VELOCITY,
    DATA_ACCELERATION: ACCELERATION,
    DATA_FORCE: FORCE,
}


@dataclass(frozen=True)
class UnitSystem:
    """Factors of dataset 164: values in the file's units divided by them are SI."""

    length: float = 1.0
    force: float = 1.0

    @property
    def is_valid(self) -> bool:
        """Whether both factors are positive numbers."""
        return 0.0 < self.length < math.inf and 0.0 < self.force < math.inf


@dataclass(frozen=True)
class AxisUnit:
    """What an axis measures: quantity, unit as stated, factor to SI, and what is odd about it."""

    quantity: str
    text: str
    factor: float
    remark: str = ""


def ordinate_unit(axis: Axis, system: UnitSystem) -> AxisUnit:
    """Find quantity and SI factor of an axis.

    A label that is understood decides. Else the type of data decides, in the units of dataset
    164. Unit exponents are looked at for general types only.
    """
    typed = QUANTITY.get(axis.data_type)
    text = axis.unit if is_stated(axis.unit) else ""
    label = parse_unit(text)
    if label is not None and label.quantity == UNKNOWN:
        return AxisUnit(UNKNOWN, text, 1.0)
    if label is not None:
        contradiction = ""
        if typed not in (None, label.quantity):
            contradiction = (
                f"type {axis.data_type} means {typed}, but the unit is {text!r}; the unit is used"
            )
        return AxisUnit(label.quantity, text, label.factor, contradiction)
    if typed is not None:
        factor = 1.0 / (system.force if typed == FORCE else system.length)
        doubt = f"unit {text!r} is not known; taken as SI (dataset 164)" if text else ""
        return AxisUnit(typed, text, factor, doubt)
    if axis.data_type in GENERAL_TYPES:
        return _general_unit(axis, text, system)
    return AxisUnit(UNKNOWN, text, 1.0)


def _general_unit(axis: Axis, text: str, system: UnitSystem) -> AxisUnit:
    exponents = (axis.length_exponent, axis.force_exponent)
    quantity = FORCE if exponents == (0, 1) else UNKNOWN
    try:
        factor = system.length ** -exponents[0] * system.force ** -exponents[1]
    except OverflowError:
        factor = math.inf
    if not 0.0 < factor < math.inf:
        doubt = f"unit exponents {exponents} make no sense and are not used"
        return AxisUnit(quantity, text, 1.0, doubt)
    return AxisUnit(quantity, text, factor)


SHAPES = (55, 2414)
_AROUND = (15, 18, 82, 151, 164, 1858, 2400, 2411, 2412, 2420)  # say nothing by themselves
_DATASETS = {
    15: "nodes",
    18: "coordinate systems",
    55: "data at nodes",
    56: "data at elements",
    57: "data at nodes of elements",
    82: "trace lines",
    151: "file header",
    164: "units",
    1858: "qualifiers of functions",
    2400: "model header",
    2411: "nodes",
    2412: "elements",
    2414: "analysis data",
    2420: "coordinate systems",
    2429: "groups",
    2467: "groups",
}
_FUNCTIONS = {
    0: "general or unknown",
    1: "time response",
    2: "auto spectrum",
    3: "cross spectrum",
    4: "frequency response",
    5: "transmissibility",
    6: "coherence",
    7: "auto correlation",
    8: "cross correlation",
    9: "power spectral density",
    10: "energy spectral density",
    11: "probability density",
    12: "spectrum",
    13: "cumulative frequency distribution",
    17: "orbit",
    18: "mode indicator function",
    19: "force pattern",
    20: "partial power",
    21: "partial coherence",
    24: "shock response spectrum",
    26: "multiple coherence",
    27: "order function",
}


def describe_left_out(datasets: Sequence[Dataset]) -> str:
    """Name what a file holds besides time series and FRFs; empty where nothing is lost by it.

    Geometry, units and headers are named only in a file that holds nothing else of use.
    """
    read = [each for each in datasets if _function(each) in (TIME_RESPONSE, FREQUENCY_RESPONSE)]
    left = [each for each in datasets if _function(each) not in (TIME_RESPONSE, FREQUENCY_RESPONSE)]
    if read:
        left = [each for each in left if each.number not in _AROUND]
    shapes = dict.fromkeys(_name(each) for each in left if each.number in SHAPES)
    others = dict.fromkeys(_name(each) for each in left if each.number not in SHAPES)
    parts = [f"{', '.join(others)}: nothing in it for this tool, left out"] if others else []
    if shapes:
        parts.append(f"{', '.join(shapes)}: left out; mode shapes are read by ema.read_shapes")
    return "; ".join(parts)


def _function(dataset: Dataset) -> int | None:
    return None if dataset.header is None else dataset.header.function_type


def _name(dataset: Dataset) -> str:
    function = _function(dataset)
    if function is not None:
        return f"function type {function} ({_FUNCTIONS.get(function, 'unknown')})"
    return f"dataset {dataset.number} ({_DATASETS.get(dataset.number, 'unknown')})"
