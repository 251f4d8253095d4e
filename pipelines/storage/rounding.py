"""Numbers as a report prints them: rounded by their uncertainty, a dash where unknown."""

from __future__ import annotations

from math import isfinite

from ema.core.display import DASH, number, value_with_std

__all__ = ["DASH", "chance_text", "number", "plain", "signed", "value_with_std"]


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
