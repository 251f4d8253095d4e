"""Units of a tyre property file and conversion to SI."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ema.core.errors import InputError, unknown
from pipelines.export.tir_file import TirFile

_POUND_KG, _FOOT_M, _GRAVITY = 0.45359237, 0.3048, 9.80665

#: Sizes of units in SI by quantity and names; the first name is shown.
UNITS: dict[str, dict[tuple[str, ...], float]] = {
    "LENGTH": {
        ("m", "meter", "metre", "meters"): 1.0,
        ("mm", "millimeter", "millimetre", "millimeters"): 1e-3,
        ("cm", "centimeter", "centimetre", "centimeters"): 1e-2,
        ("km", "kilometer", "kilometre", "kilometers"): 1e3,
        ("in", "inch", "inches"): _FOOT_M / 12.0,
        ("ft", "foot", "feet"): _FOOT_M,
    },
    "FORCE": {
        ("N", "newton", "newtons"): 1.0,
        ("kN", "kilonewton", "knewton", "kilo_newton"): 1e3,
        ("meganewton", "mega_newton"): 1e6,  # MN and mN would differ in their case only
        ("dyne", "dyn"): 1e-5,
        ("kgf", "kg_force", "kilogram_force"): _GRAVITY,
        ("lbf", "pound_force", "pound"): _POUND_KG * _GRAVITY,
        ("klbf", "kpound_force", "kilo_pound_force", "kip"): 1e3 * _POUND_KG * _GRAVITY,
    },
    "MASS": {
        ("kg", "kilogram", "kilograms"): 1.0,
        ("g", "gram", "grams"): 1e-3,
        ("t", "tonne", "ton", "megagram"): 1e3,
        ("lb", "lbm", "pound_mass", "pound"): _POUND_KG,
        ("slug",): _POUND_KG * _GRAVITY / _FOOT_M,
    },
    "TIME": {
        ("s", "second", "seconds", "sec"): 1.0,
        ("ms", "millisecond", "milliseconds"): 1e-3,
        ("min", "minute", "minutes"): 60.0,
        ("h", "hour", "hours"): 3600.0,
    },
    "ANGLE": {("rad", "radians", "radian"): 1.0, ("deg", "degrees", "degree"): math.pi / 180.0},
    "PRESSURE": {
        ("Pa", "pascal"): 1.0,
        ("kPa", "kilopascal"): 1e3,
        ("MPa", "megapascal"): 1e6,
        ("bar",): 1e5,
        ("psi",): _POUND_KG * _GRAVITY / (_FOOT_M / 12.0) ** 2,
    },
}
# Limits of values in SI, far beyond those of a tyre: products of several do not overflow.
_LARGEST_SI, _SMALLEST_SI = 1e15, 1e-12
_LENGTH, _MASS = {"LENGTH": 1}, {"MASS": 1}
_INERTIA = {"MASS": 1, "LENGTH": 2}
_PRESSURE = {"FORCE": 1, "LENGTH": -2}
_STIFFNESS = {"FORCE": 1, "LENGTH": -1}
_NONE: dict[str, int] = {}

#: Dimension of each key as powers of the file's units. Natural frequencies are in Hz in any file.
QUANTITIES: dict[str, Mapping[str, int]] = {
    **dict.fromkeys(("UNLOADED_RADIUS", "WIDTH", "RIM_RADIUS", "RIM_WIDTH"), _LENGTH),
    **dict.fromkeys(("MASS", "BELT_MASS"), _MASS),
    **dict.fromkeys(("IXX", "IYY", "BELT_IXX", "BELT_IYY"), _INERTIA),
    **dict.fromkeys(("INFLPRES", "NOMPRES", "PRESMIN", "PRESMAX"), _PRESSURE),
    **{key: {"FORCE": 1} for key in ("FNOMIN", "FZMIN", "FZMAX")},
    **{key: {"ANGLE": 1} for key in ("ALPMIN", "ALPMAX", "CAMMIN", "CAMMAX")},
    **dict.fromkeys(
        ("VERTICAL_STIFFNESS", "LONGITUDINAL_STIFFNESS", "LATERAL_STIFFNESS"), _STIFFNESS
    ),
    "VERTICAL_DAMPING": {"FORCE": 1, "TIME": 1, "LENGTH": -1},
    "YAW_STIFFNESS": {"FORCE": 1, "LENGTH": 1, "ANGLE": -1},
    "LONGVL": {"LENGTH": 1, "TIME": -1},
    "GRAVITY": {"LENGTH": 1, "TIME": -2},
    **dict.fromkeys((f"FREQ_{mode}" for mode in ("LONG", "LAT", "YAW", "WINDUP")), _NONE),
    **dict.fromkeys((f"DAMP_{mode}" for mode in ("LONG", "LAT", "YAW", "WINDUP")), _NONE),
}


@dataclass(frozen=True)
class TirUnits:
    """The units of a file."""

    # unit of each quantity in `UNITS`; PRESSURE only where the file states one
    names: dict[str, str]
    sizes: dict[str, float]  # their sizes in SI
    assumed: tuple[str, ...]  # quantities without a unit in the file; the SI unit is assumed

    def size(self, key: str) -> float:
        """SI value of one unit of a key in `QUANTITIES`."""
        powers = self._powers(key)
        return math.prod(self.sizes[name] ** power for name, power in powers.items())

    def unit(self, key: str) -> str:
        """Unit of a key, e.g. ``kg mm²``; ``1`` for a ratio."""
        if key.startswith("FREQ_"):
            return "Hz"
        powers = self._powers(key)
        units = {
            name: self.names[name] + ("²" if abs(p) == 2 else "") for name, p in powers.items()
        }
        over = " ".join(units[name] for name, power in powers.items() if power > 0)
        under = [units[name] for name, power in powers.items() if power < 0]
        unit = "/".join([over, *under]) or "1"
        return "Pa" if unit == "N/m²" else unit

    def _powers(self, key: str) -> Mapping[str, int]:
        powers = QUANTITIES[key]
        named = powers == _PRESSURE and "PRESSURE" in self.names
        return {"PRESSURE": 1} if named else powers


def units_of(tir: TirFile) -> TirUnits:
    """The units that a file states; SI where it states none. `InputError` for an unknown unit."""
    names, sizes, assumed = {}, {}, []
    for quantity in UNITS:
        entry = tir.find(quantity, "UNITS")
        if entry is None and quantity == "PRESSURE":
            continue
        if entry is None:
            assumed.append(quantity)
        text = entry.text.strip() if entry else next(iter(UNITS[quantity]))[0]
        sizes_of = UNITS[quantity].items()
        known = {name.casefold(): (each[0], size) for each, size in sizes_of for name in each}
        if text.casefold() not in known:
            where = f"{tir.name}, line {entry.line}, {quantity}" if entry else quantity
            every = (name for each in UNITS[quantity] for name in each)
            raise unknown(where, text, f"unknown unit of {quantity.lower()}", every)
        names[quantity], sizes[quantity] = known[text.casefold()]
    return TirUnits(names, sizes, tuple(assumed))


def si_value(tir: TirFile, units: TirUnits, key: str) -> float | None:
    """Value of a key in SI; None where the file does not have it."""
    if key.upper() not in QUANTITIES:
        raise unknown(tir.name, key, "the unit of this key is unknown", QUANTITIES)
    number = tir.number(key)
    if number is None:
        return None
    value = number * units.size(key.upper())
    if abs(value) > _LARGEST_SI:
        rule = f"values in SI must be below {_LARGEST_SI:g}"
        raise InputError(f"{tir.name}, {key}", f"{number:g}", rule, "Correct the value or its unit")
    return value


def clear_si_value(tir: TirFile, units: TirUnits, key: str) -> float | None:
    """Value of a key in SI; None where the key is missing or given more than once."""
    given = sum(entry.key == key and entry.is_in(None) for entry in tir.entries)
    return si_value(tir, units, key) if given == 1 else None


def positive_si_value(tir: TirFile, units: TirUnits, key: str) -> float:
    """Value of a key in SI; `InputError` if it is missing or not greater than zero."""
    value = si_value(tir, units, key)
    if value is None or value < _SMALLEST_SI:
        found = "not given" if value is None else f"{value:g}"
        rule, unit = f"a value of at least {_SMALLEST_SI:g} is needed", units.unit(key)
        raise InputError(f"{tir.name}, {key}", found, rule, f"Give {key} in {unit}")
    return value
