"""Sampling rates stated in the lines above a table."""

from __future__ import annotations

import math
import re

from ema.io.sampling import step_and_inverse
from ema.io.text_cells import may_hold_thousands

_RATE = (
    r"sampl\w*[\s_-]*(?:rate|freq\w*)|scan[\s_-]*rate|abtast(?:rate|frequenz)|fs|f_s|"
    r"samples[\s_-]*(?:per|/)[\s_-]*s(?:ec\w*)?"
)
_STEP = (
    r"dt|delta[\s_-]*[tx]|abtast(?:intervall|zeit|schritt)|"
    r"(?:sampl\w*|scan|time)[\s_-]*(?:interval|period|step|increment|spacing)"
)
_STATEMENT = re.compile(
    rf"[\s#%!/;'\"*]*(?:(?P<rate>{_RATE})|(?P<step>{_STEP}))\s*(?:[\[(](?P<unit>[^\])]*)[\])])?"
    r"[\s\"]*[:=;,|\s][\s:=\"]*(?P<value>[0-9](?:[0-9.,]*[0-9])?\.?(?:e[+-]?[0-9]+)?)"
    r"(?:[\s;,|\"]*[\[(]?(?P<behind>[a-zµμ]+(?:/s)?|\b1/s)[\])]?)?[\s;,|\"]*",
    re.IGNORECASE,
)
_HERTZ = {"": 1.0, "hz": 1.0, "khz": 1e3, "mhz": 1e6, "1/s": 1.0, "s/s": 1.0, "ks/s": 1e3}
_PER_SECOND = {"": 1.0, "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e3, "us": 1e6}
_LONGEST = 200


def stated_rate_hz(line: str, decimal: str) -> float | None:
    """Sampling rate that a line such as ``Sampling rate [Hz]; 2000`` or ``dt = 0.0005`` states.

    Parameters
    ----------
    line : str
        A line above the table.
    decimal : str
        The table's decimal sign. Another one is understood too, unless it could as well separate
        thousands: then nothing counts as stated.

    Returns
    -------
    float or None
        None where the line states no rate, or not clearly.
    """
    match = _STATEMENT.fullmatch(line) if len(line) <= _LONGEST else None
    if match is None:
        return None
    value = _plain(match["value"], decimal)
    unit = (match["unit"] or match["behind"] or "").strip().lower()
    unit = unit.replace("µ", "u").replace("μ", "u")
    factor = (_HERTZ if match["rate"] else _PER_SECOND).get(unit)
    if value is None or factor is None:
        return None
    try:
        step, inverse = step_and_inverse(value)
    except ValueError:
        return None
    rate_hz = float(value) * factor if match["rate"] else inverse * factor
    return rate_hz if step > 0.0 and math.isfinite(rate_hz) else None


def _plain(value: str, decimal: str) -> str | None:
    """Write a number with a decimal point; None where that is not clear."""
    other = "," if decimal == "." else "."
    if other in value and may_hold_thousands(value):
        return None
    plain = value.replace(",", ".")
    return plain if plain.count(".") <= 1 else None
