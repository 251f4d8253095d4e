"""Values as texts, rounded by their uncertainty, as JSON and as small HTML tables for notebooks.

`ema` and `model` do not know each other: `model/display.py` has what it needs of this file, and a
test keeps the two alike.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import Decimal
from html import escape
from math import isfinite
from typing import Any

from ema.core.errors import visible

DASH = "–"
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def table(
    caption: str, head: Sequence[str], rows: Iterable[Sequence[str]], words: Sequence[int] = (0,)
) -> str:
    """A table with a caption; the columns in `words` to the left, numbers to the right."""
    columns = ["left" if column in words else "right" for column in range(len(head))]
    body = "".join(_row("td", row, columns) for row in rows)
    return _captioned(caption, f"<thead>{_row('th', head, columns)}</thead><tbody>{body}</tbody>")


def facts(caption: str, pairs: Iterable[tuple[str, str]]) -> str:
    """A table of names and what belongs to them, without a head."""
    body = "".join(_row("td", pair, ("left", "left")) for pair in pairs)
    return _captioned(caption, f"<tbody>{body}</tbody>")


def number(value: float | None, digits: int = 4) -> str:
    """Value with `digits` significant digits, whole digits always below 10⁵; a dash if unknown."""
    if value is None or not isfinite(value):
        return DASH
    if value == 0:
        return "0"
    exponent = _exponent(value, digits)
    shift = _common_power(exponent)
    return _times_ten(_fixed(value, shift, min(0, exponent - shift + 1 - digits)), shift)


def value_with_std(value: float, std: float | None, digits: int = 4) -> str:
    """Value ± standard deviation, such as ``"100.31 ± 0.04"`` or ``"(8.27 ± 0.08) × 10⁶"``.

    Rounded by the rule of the Particle Data Group: two digits of the standard deviation up to 354,
    one up to 949, and 1000 above, for its first three digits; the value ends at the same place. A
    value whose standard deviation is not finite and positive has `digits` significant digits.
    """
    if std is None or not isfinite(std) or std <= 0 or not isfinite(value):
        return number(value, digits)
    shift = _common_power(_exponent(max(abs(value), std)))
    first, _, exponent = f"{std:.2e}".partition("e")
    end = int(exponent) - (float(first) <= 3.54) - shift
    text = f"{_fixed(value, shift, end)} ± {_fixed(std, shift, end)}"
    return _times_ten(f"({text})", shift) if shift else text


def _captioned(caption: str, rows: str) -> str:
    style = "text-align:left;font-weight:bold;color:inherit"
    return f'<table><caption style="{style}">{escape(visible(caption))}</caption>{rows}</table>'


def _row(tag: str, cells: Iterable[str], columns: Sequence[str]) -> str:
    written = (
        f'<{tag} style="text-align:{column};padding:0.1em 0.6em">{escape(visible(cell))}</{tag}>'
        for cell, column in zip(cells, columns, strict=True)
    )
    return f"<tr>{''.join(written)}</tr>"


def _common_power(exponent: int) -> int:
    """Power of ten in front of which large and small numbers are written."""
    return exponent if exponent >= 5 or exponent < -3 else 0


def _times_ten(text: str, power: int) -> str:
    return f"{text} × 10{str(power).translate(_SUPERSCRIPT)}" if power else text


def _exponent(value: float, digits: int = 16) -> int:
    """Power of ten of the first digit of `value`, rounded to `digits` digits."""
    return int(f"{value:.{digits - 1}e}".partition("e")[2])


def _fixed(value: float, shift: int, end: int) -> str:
    """Value in units of 10^shift, ending at 10^end."""
    rounded = Decimal(value).scaleb(-shift).quantize(Decimal(1).scaleb(end))
    return f"{abs(rounded) if rounded == 0 else rounded:f}".replace("-", "−")


def band_text(band_hz: tuple[float, float]) -> str:
    """A frequency band with its unit."""
    return f"{band_hz[0]:g} to {band_hz[1]:g} Hz"


def as_typed(value: float | None, unit: str) -> str:
    """A value as a person would type it."""
    space = "" if unit == "°" else " "
    return DASH if value is None else f"{value:.10g}{space}{unit}"


def counted(how_many: int, noun: str) -> str:
    """A number and a noun, in the plural where there are several."""
    return f"{how_many} {noun}" if how_many == 1 else f"{how_many} {noun}s"


def jsonable(value: Any) -> Any:
    """Values as JSON has them: without NaN, infinity, dates and numpy's numbers."""
    if isinstance(value, dict):
        return {key: jsonable(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [jsonable(entry) for entry in value]
    if hasattr(value, "isoformat"):  # a date or time in TOML
        return value.isoformat()
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not isfinite(value) else value


def plain(value: float | None) -> str:
    """Value as a person would type it, to six digits, a dash if unknown."""
    if value is None or not isfinite(value):
        return DASH
    return f"{float(f'{value:.6g}'):.10g}"


def signed(value: float, places: int) -> str:
    """Value with its sign and `places` digits after the point; what rounds to zero has no sign."""
    if not isfinite(value):
        return DASH
    text = f"{value:+.{places}f}"
    return text[1:] if float(text) == 0 else text.replace("-", "−")


def chance_text(chance: float) -> str:
    """A probability with two digits, down to a thousandth."""
    return "< 0.001" if chance < 0.001 else number(chance, 2)
