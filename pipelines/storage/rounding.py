"""Numbers as a report prints them, rounded by their uncertainty; values as JSON has them."""

from __future__ import annotations

from math import isfinite
from typing import Any

from ema.core.display import DASH, number, value_with_std

__all__ = ["DASH", "chance_text", "jsonable", "number", "plain", "signed", "value_with_std"]


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
