"""Unit of an axis of a dataset 58: from its label, its type of data, and dataset 164."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ema.io.uff58_header import (
    DATA_ACCELERATION,
    DATA_DISPLACEMENT,
    DATA_FORCE,
    DATA_VELOCITY,
    GENERAL_TYPES,
    Axis,
)
from ema.io.units import is_stated, parse_unit
from ema.recording import ACCELERATION, DISPLACEMENT, FORCE, UNKNOWN, VELOCITY

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
            contradiction = f"type {axis.data_type} means {typed}, the unit {text!r} decides"
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
