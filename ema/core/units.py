"""Units: quantity and SI factor of unit texts."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from math import pi

from ema.core.recording import ACCELERATION, DISPLACEMENT, FORCE, UNKNOWN, VELOCITY, VOLTAGE

STANDARD_GRAVITY_M_S2 = 9.80665  # exact, CGPM 1901
POUND_FORCE_N = 4.4482216152605  # exact, pound × standard gravity
TIME, FREQUENCY = "time", "frequency"
NAMES_KEPT = 1024  # names of channels, the same in all runs, that are understood once
SI_UNIT = {ACCELERATION: "m/s^2", VELOCITY: "m/s", DISPLACEMENT: "m", FORCE: "N", VOLTAGE: "V"}

_LENGTH_M = {
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "micron": 1e-6,
    "nm": 1e-9,
    "in": 0.0254,
    "inch": 0.0254,
    "mil": 2.54e-5,
    "ft": 0.3048,
}
_FORCE_N = {
    "N": 1.0,
    "newton": 1.0,
    "newtons": 1.0,
    "mN": 1e-3,
    "daN": 10.0,
    "kN": 1e3,
    "MN": 1e6,
    "lbf": POUND_FORCE_N,
    "kip": 1e3 * POUND_FORCE_N,
    "kgf": STANDARD_GRAVITY_M_S2,
    "kp": STANDARD_GRAVITY_M_S2,
}
_GRAVITY_M_S2 = {
    "g": STANDARD_GRAVITY_M_S2,
    "gn": STANDARD_GRAVITY_M_S2,
    "g_n": STANDARD_GRAVITY_M_S2,
    "g0": STANDARD_GRAVITY_M_S2,
    "mg": 1e-3 * STANDARD_GRAVITY_M_S2,
    "Gal": 1e-2,
}
_PER_SECOND = ("/s", "/sec", "s^-1")
_PER_SECOND_SQUARED = ("/s^2", "/s2", "/s/s", "/sec^2", "/sec2", "s^-2", "s-2")
_VOLT = {"V": 1.0, "volt": 1.0, "volts": 1.0, "mV": 1e-3, "uV": 1e-6, "kV": 1e3}
_TIME_S = {"s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "sekunden": 1.0}
_TIME_S |= {"ms": 1e-3, "msec": 1e-3, "milliseconds": 1e-3, "us": 1e-6, "usec": 1e-6, "ns": 1e-9}
_TIME_S |= {"millis": 1e-3, "micros": 1e-6, "microseconds": 1e-6, "nanoseconds": 1e-9, "nsec": 1e-9}
_TIME_S |= {"min": 60.0, "minutes": 60.0, "h": 3600.0, "hr": 3600.0, "hours": 3600.0}
_FREQUENCY_HZ = {"Hz": 1.0, "mHz": 1e-3, "kHz": 1e3, "MHz": 1e6, "1/s": 1.0, "s^-1": 1.0}
_FREQUENCY_HZ |= {"cps": 1.0, "hertz": 1.0, "rev/s": 1.0, "cycles/s": 1.0}
_FREQUENCY_HZ |= dict.fromkeys(("rad/s", "rad/sec", "r/s", "radians/s"), 0.5 / pi)
_FREQUENCY_HZ |= dict.fromkeys(("rpm", "cpm", "1/min", "min^-1", "rev/min", "U/min"), 1.0 / 60.0)
_ELECTRIC = ("A", "mA", "C", "pC")  # no channel of these can be calibrated here
_NOTHING = {"", "none", "-", "n/a", "unknown"}
_SPELLINGS = {
    "⁻²": "^-2",
    "⁻¹": "^-1",
    "²": "^2",
    "⁻": "-",
    "μ": "u",
    "µ": "u",
    "**": "^",
    "·": "",
    "*": "",
    " ": "",
}


@dataclass(frozen=True)
class Unit:
    """A unit that is understood."""

    quantity: str  # as in `ema.core.recording.Channel`; ``"unknown"`` for charge and current
    factor: float  # to SI


def _known_units() -> dict[str, Unit]:
    """Table of all spellings, after `_normalise`."""
    table = {text: Unit(FORCE, factor) for text, factor in _FORCE_N.items()}
    table |= {text: Unit(ACCELERATION, factor) for text, factor in _GRAVITY_M_S2.items()}
    table |= {text: Unit(VOLTAGE, factor) for text, factor in _VOLT.items()}
    table |= {text: Unit(UNKNOWN, 1.0) for text in _ELECTRIC}
    for length, factor in _LENGTH_M.items():
        table[length] = Unit(DISPLACEMENT, factor)
        table |= {length + per: Unit(VELOCITY, factor) for per in _PER_SECOND}
        table |= {length + per: Unit(ACCELERATION, factor) for per in _PER_SECOND_SQUARED}
    return table


@lru_cache(NAMES_KEPT)
def _normalise(text: str) -> str:
    for spelling, plain in _SPELLINGS.items():
        text = text.replace(spelling, plain)
    while text.startswith("(") and text.endswith(")") and ")" not in text[:-1]:
        text = text[1:-1]
    return text


_KNOWN = _known_units()
_KNOWN_LOWER: dict[str, Unit | None] = {}
for _text, _unit in _KNOWN.items():
    # Two units that differ by case alone (mN, MN) cannot be told apart in another case.
    _KNOWN_LOWER[_text.lower()] = None if _text.lower() in _KNOWN_LOWER else _unit


@lru_cache(NAMES_KEPT)
def is_stated(text: str) -> bool:
    """Whether `text` states a unit at all (not empty, ``NONE`` or a dash)."""
    return _normalise(text).lower() not in _NOTHING


@lru_cache(NAMES_KEPT)
def parse_unit(text: str) -> Unit | None:
    """Quantity and SI factor of a unit such as ``"mm/s2"``; None where it is empty or not known."""
    plain = _normalise(text)
    return _KNOWN.get(plain) or _KNOWN_LOWER.get(plain.lower())


# A unit that ends a name: acc_g, Force_N, A01_m_s2, Kraft in kN, AccG.
_UNIT_BEHIND = re.compile(
    r"(?P<stem>.+?)(?:[\s_.,/:-]+(?:in[\s_]+)?|(?<=[a-z])(?=[A-Z]))"
    r"(?P<unit>[A-Za-zµμ]+(?:[/_]s(?:ec)?(?:\^?-?2|²)?|\^?-?2|²)?)"
)
_BARE_SQUARE = re.compile(r"(m|mm|cm)p?s(?:\^?-?2|²)")  # ms2, mps2
# Words that a name has for what it measures; single letters may have a number.
_QUANTITY_IN_NAME = {
    ACCELERATION: r"acc\w*|beschl\w*|a[xyz]?[0-9]*",
    FORCE: r"force|kraft|f[xyz]?[0-9]*|load\w*|hammer|shaker|hit|impact",
    VELOCITY: r"vel\w*|geschw\w*|schnelle|v[0-9]*",
    DISPLACEMENT: r"disp\w*|weg|auslenk\w*",
    VOLTAGE: r"volt\w*|spannung|u[0-9]*",
}
# Units that mean nothing else at the end of a name, whatever it calls the channel.
_CLEAR_UNITS = {"kN", "daN", "mN", "lbf", "kgf", "mg", "Gal", "mm", "um", "mV"}


@lru_cache(NAMES_KEPT)
def unit_in_name(name: str, *, guess: bool = False) -> str:
    """Unit at the end of a name such as ``"acc_g"`` or ``"A01_m_s2"``; empty without one.

    A letter alone is a unit only where the name also speaks of its quantity, or as a `guess`.
    """
    match = _UNIT_BEHIND.fullmatch(name.strip())
    if match is None:
        return ""
    text = _BARE_SQUARE.sub(r"\1/s^2", match["unit"].replace("_", "/"))
    unit = parse_unit(text)
    if unit is None or unit.quantity == UNKNOWN:
        return ""
    if re.search(r"(?:^|[\s_.,/:-])[0-9]+$", match["stem"]):
        return text if guess else ""  # perhaps of that number: the sensor at 120 mm
    word = _QUANTITY_IN_NAME[unit.quantity]
    said = re.search(rf"(?:^|[^a-z])(?:{word})(?:[^a-z]|$)", match["stem"].lower())
    return text if guess or said or "/" in text or _normalise(text) in _CLEAR_UNITS else ""


@lru_cache(NAMES_KEPT)
def parse_ratio(text: str) -> tuple[Unit, Unit] | None:
    """Numerator and denominator of a unit of motion over force, e.g. ``"(m/s^2)/N"``."""
    numerator, slash, denominator = _normalise(text).rpartition("/")
    motion, force = parse_unit(numerator), parse_unit(denominator)
    if not slash or motion is None or force is None or force.quantity != FORCE:
        return None
    return motion, force


@dataclass(frozen=True)
class AxisUnit:
    """A unit of an axis that is understood."""

    kind: str  # `TIME` or `FREQUENCY`
    factor: float  # to s or Hz


_AXES = {text: AxisUnit(TIME, factor) for text, factor in _TIME_S.items()}
_AXES |= {text: AxisUnit(FREQUENCY, factor) for text, factor in _FREQUENCY_HZ.items()}
_AXES_LOWER = {text.lower(): unit for text, unit in _AXES.items() if text not in ("mHz", "MHz")}


@lru_cache(NAMES_KEPT)
def parse_axis(text: str) -> AxisUnit | None:
    """Kind and factor of a unit such as ``"ms"`` or ``"rad/s"``; None where it is not known."""
    plain = _normalise(text)
    return _AXES.get(plain) or _AXES_LOWER.get(plain.lower())


_AMOUNTS: dict[str, dict[str, float]] = {  # by the SI unit at the end of a key
    "pa": {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "mbar": 1e2, "psi": 6894.757},
    "m": _LENGTH_M,
    "kg": {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "lb": 0.45359237, "oz": 0.028349523125},
    "s": _TIME_S,
    "hz": _FREQUENCY_HZ,
    "deg": {"deg": 1.0, "\N{DEGREE SIGN}": 1.0, "rad": 180.0 / pi},
}
_AMOUNT = re.compile(r"\s*([+-]?[0-9]+(?:[.,][0-9]+)?(?:[eE][+-]?[0-9]+)?)\s*(\S+)\s*")


def amount(text: str, unit: str) -> float:
    """Number in SI of a text such as ``"2.4 bar"``; `unit` is that of the key, such as ``"pa"``.

    ValueError for other texts.
    """
    known = _AMOUNTS[unit]
    match = _AMOUNT.fullmatch(text.replace("\N{NO-BREAK SPACE}", " "))
    factor = known.get(_normalise(match[2])) if match else None
    if match is None or factor is None:
        raise ValueError(f"it must be a number with one of the units {', '.join(known)}")
    return float(match[1].replace(",", ".")) * factor


def unit_of_key(key: str) -> str | None:
    """The unit at the end of a key such as ``mean_radius_m``, if `amount` knows it."""
    unit = key.rpartition("_")[2]
    return unit if unit in _AMOUNTS and unit != key else None
