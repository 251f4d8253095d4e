"""Small HTML tables for notebooks: texts escaped, no colours set.

`ema` has the same functions, because the two packages do not import each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import Decimal
from html import escape
from math import isfinite

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def table(
    caption: str, head: Sequence[str], rows: Iterable[Sequence[str]], words: Sequence[int] = (0,)
) -> str:
    """A table with a caption; the columns in `words` to the left, numbers to the right."""
    columns = ["left" if column in words else "right" for column in range(len(head))]
    body = "".join(_row("td", row, columns) for row in rows)
    style = "text-align:left;font-weight:bold;color:inherit"
    titled = f'<caption style="{style}">{escape(caption)}</caption>'
    return f"<table>{titled}<thead>{_row('th', head, columns)}</thead><tbody>{body}</tbody></table>"


def number(value: float) -> str:
    """Value with four significant digits, a dash where there is none."""
    if not isfinite(value):
        return "–"
    if value == 0:
        return "0"
    exponent = _exponent(value, 4)
    shift = _common_power(exponent)
    return _times_ten(_fixed(value, shift, min(0, exponent - shift - 3)), shift)


def value_with_std(value: float, std: float | None) -> str:
    """Value ± standard deviation, both rounded by it, exactly as in the report."""
    if std is None or not isfinite(std) or std <= 0 or not isfinite(value):
        return number(value)
    shift = _common_power(_exponent(max(abs(value), std)))
    first, _, exponent = f"{std:.2e}".partition("e")
    end = int(exponent) - (float(first) <= 3.54) - shift  # rule of the Particle Data Group
    text = f"{_fixed(value, shift, end)} ± {_fixed(std, shift, end)}"
    return _times_ten(f"({text})", shift) if shift else text


def _row(tag: str, cells: Iterable[str], columns: Sequence[str]) -> str:
    written = (
        f'<{tag} style="text-align:{column};padding:0.1em 0.6em">{escape(cell)}</{tag}>'
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
