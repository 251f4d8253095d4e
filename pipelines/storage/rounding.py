"""Numbers as a report prints them: rounded by their uncertainty, a dash where unknown."""

from __future__ import annotations

from decimal import Decimal
from math import isfinite

DASH = "–"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def value_with_std(value: float, std: float | None, digits: int = 4) -> str:
    """Value and standard deviation, both rounded where the standard deviation ends to say anything.

    The standard deviation keeps two digits below 3, one from 3 on; the value ends at the same
    place. Large and small numbers get a common power of ten.

    Parameters
    ----------
    value : float
        The number; a dash stands for a number that is not finite.
    std : float or None
        Its standard deviation; unknown where None, not finite or not positive.
    digits : int
        Significant digits of a value without a standard deviation.

    Returns
    -------
    str
        For example ``"100.31 ± 0.02"`` or ``"(8.27 ± 0.08) × 10⁶"``.
    """
    if std is None or not isfinite(std) or std <= 0 or not isfinite(value):
        return number(value, digits)
    exponent = _exponent(max(abs(value), std))
    shift = exponent if exponent >= 5 or exponent < -3 else 0
    end = _last_place(std) - shift
    text = f"{_fixed(value, shift, end)} ± {_fixed(std, shift, end)}"
    return f"({text}) × 10{str(shift).translate(_SUPERSCRIPT)}" if shift else text


def number(value: float | None, digits: int = 4) -> str:
    """Value with `digits` significant digits; whole digits are never cut off below 10⁵."""
    if value is None or not isfinite(value):
        return DASH
    if value == 0:
        return "0"
    exponent = _exponent(value, digits)
    if exponent >= 5 or exponent < -3:
        mantissa = _fixed(value, exponent, min(0, 1 - digits))
        return f"{mantissa} × 10{str(exponent).translate(_SUPERSCRIPT)}"
    return _fixed(value, 0, min(0, exponent + 1 - digits))


def plain(value: float | None) -> str:
    """Value as a person would have typed it, a dash where there is none."""
    return DASH if value is None or not isfinite(value) else f"{value:.10g}"


def signed(value: float, places: int) -> str:
    """Value with its sign and `places` digits after the point; what rounds to zero has no sign."""
    if not isfinite(value):
        return DASH
    text = f"{value:+.{places}f}"
    return text[1:] if float(text) == 0 else text.replace("-", "−")


def chance_text(chance: float) -> str:
    """A probability with two digits, down to a thousandth."""
    return "< 0.001" if chance < 0.001 else number(chance, 2)


def _exponent(value: float, digits: int = 16) -> int:
    """Power of ten of the first digit of `value`, rounded to `digits` digits."""
    return int(f"{value:.{digits - 1}e}".partition("e")[2])


def _last_place(std: float) -> int:
    """Power of ten of the last digit that `std` leaves worth printing."""
    exponent = _exponent(std)
    return exponent - 1 if std / 10.0**exponent < 2.95 else exponent


def _fixed(value: float, shift: int, end: int) -> str:
    """Value in units of 10^shift, ending at 10^end; zeros, not digits, left of the point."""
    rounded = Decimal(value).scaleb(-shift).quantize(Decimal(1).scaleb(end))
    # A value that rounds to zero keeps no sign.
    return f"{abs(rounded) if rounded == 0 else rounded:f}".replace("-", "−")
