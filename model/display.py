"""Small HTML tables for notebooks: texts escaped, no colours set; plots by the package of plots.

`ema` has the same functions, because the two packages do not import each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import Decimal
from html import escape
from importlib import import_module
from math import isfinite
from typing import Any

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


BACKEND = "pipelines.plots.figures"  # loaded when something is drawn: physics knows no plots


def plot(shown: Any, ax: Any) -> Any:
    """Draw on axes of matplotlib; on new ones of pyplot without any."""
    return import_module(BACKEND).plot(shown, ax)


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
    if value == 0:
        return "0"
    if not isfinite(value):
        return "–"
    exponent = int(f"{value:.3e}".partition("e")[2])
    return _written(exponent, exponent - 3 if exponent >= 5 else min(0, exponent - 3), value)


def value_with_std(value: float, std: float | None) -> str:
    """Value ± standard deviation, both rounded by it, exactly as in the report."""
    if std is None or not isfinite(std) or std <= 0 or not isfinite(value):
        return number(value)
    first, _, exponent = f"{std:.2e}".partition("e")
    end = int(exponent) - (float(first) <= 3.54)  # rule of the Particle Data Group
    return _written(int(f"{max(abs(value), std):.15e}".partition("e")[2]), end, value, std)


def _written(exponent: int, end: int, *values: float) -> str:
    """Values that end at 10^end; large and small ones are written over a power of ten."""
    power = exponent if exponent >= 5 or exponent < -3 else 0
    unit = Decimal(1).scaleb(end - power)
    rounded = (Decimal(value).scaleb(-power).quantize(unit) + 0 for value in values)  # no −0
    text = " ± ".join(f"{each:f}".replace("-", "−") for each in rounded)
    if not power:
        return text
    raised = str(power).translate(_SUPERSCRIPT)
    return f"{f'({text})' if len(values) > 1 else text} × 10{raised}"


def _row(tag: str, cells: Iterable[str], columns: Sequence[str]) -> str:
    written = (
        f'<{tag} style="text-align:{column};padding:0.1em 0.6em">{escape(cell)}</{tag}>'
        for cell, column in zip(cells, columns, strict=True)
    )
    return f"<tr>{''.join(written)}</tr>"
