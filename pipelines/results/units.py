"""Units that results are shown in: one notation of pressure and length everywhere."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any

from ema.core.display import DASH, plain, value_with_std


class Units(StrEnum):
    """Units that results are shown in."""

    LAB = "lab"  # bar and mm, the default
    SI = "si"


# What an SI unit is shown as, and its factor; others are shown as they are.
_SHOWN = {Units.SI: {"Pa": ("kPa", 1e-3)}, Units.LAB: {"Pa": ("bar", 1e-5), "m": ("mm", 1e3)}}


def with_unit(
    value: float, std: float | None, unit: str, units: Units
) -> tuple[float, float | None, str]:
    """A value in SI and its standard deviation as they are shown, and the unit."""
    shown, factor = _SHOWN[units].get(unit, (unit, 1.0))
    return value * factor, None if std is None else std * factor, shown


def quantity(value: float, unit: str, units: Units) -> str:
    """A given value in SI as it is shown, such as "2.2 bar"."""
    value, _, unit = with_unit(value, None, unit, units)
    return f"{plain(value)} {unit}"


def parameter_rows(
    values: Any, found: Any, names: Mapping[str, tuple[str, str, str]], units: Units
) -> list[tuple[str, str, str, str, str]]:
    """Name, symbol, value with ±, unit and how obtained of each parameter that `values` has.

    `found` has the standard deviations `std` in SI and `how` each was obtained.
    """
    rows = []
    for field, (title, symbol, si_unit) in names.items():
        if (si_value := getattr(values, field)) is not None:
            value, std, unit = with_unit(si_value, found.std.get(field), si_unit, units)
            text = value_with_std(value, std)
            rows.append((title, symbol, text, unit, found.how.get(field, DASH)))
    return rows
