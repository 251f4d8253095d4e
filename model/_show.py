"""How rings show themselves: one line in a terminal, a table in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from model._html import number, table, value_with_std
from model.identifiability import GIVEN, IDENTIFIED
from model.parameter_names import RING_NAMES

if TYPE_CHECKING:
    from model.parameters import RingParameters
    from model.tuning_result import TuningResult


def ring_html(ring: RingParameters) -> str:
    """Every parameter with its symbol and unit."""
    rows = [
        (name, symbol, _typed(value), unit) for _, name, symbol, value, unit in _parameters(ring)
    ]
    return table("Ring", ("parameter", "symbol", "value", "unit"), rows, words=(0, 1, 3))


def tuning_line(tuning: TuningResult) -> str:
    """Orders, largest deviation and what was identified."""
    identified = [RING_NAMES[name][1] for name, how in tuning.how.items() if how == IDENTIFIED]
    orders = ", ".join(str(order) for order in tuning.orders)
    worst = float(np.max(np.abs(tuning.error_percent)))
    return (
        f"<TuningResult: orders {orders}, largest deviation {worst:.2f} %, "
        f"identified {', '.join(identified) or 'nothing'}>"
    )


def tuning_html(tuning: TuningResult) -> str:
    """Every parameter with ± and how it was obtained, then the frequencies order by order."""
    rows = [
        (name, symbol, _value(tuning, key, value), unit, tuning.how.get(key, "–"))
        for key, name, symbol, value, unit in _parameters(tuning.ring)
    ]
    head = ("parameter", "symbol", "value", "unit", "how obtained")
    return table("Tuned ring", head, rows, words=(0, 1, 3, 4)) + _frequencies(tuning)


def _value(tuning: TuningResult, key: str, value: float) -> str:
    given = tuning.how.get(key) == GIVEN
    return _typed(value) if given else value_with_std(value, tuning.std.get(key))


def _typed(value: float) -> str:
    """A value as a person would have typed it, four digits of one that no one would type."""
    text = f"{value:.10g}"
    return text if len(text) <= len("220000") else number(value)


def _frequencies(tuning: TuningResult) -> str:
    columns = zip(
        tuning.orders, tuning.measured_hz, tuning.model_hz, tuning.error_percent, strict=True
    )
    rows = [
        (str(order), f"{measured:.2f}", f"{ring:.2f}", f"{error:+.2f}".replace("-", "−"))
        for order, measured, ring, error in columns
    ]
    head = ("order n", "measured / Hz", "ring / Hz", "deviation / %")
    return table("Frequencies it was tuned to", head, rows, words=())


def _parameters(ring: RingParameters) -> list[tuple[str, str, str, float, str]]:
    """Field, name, symbol, value and unit of every parameter that is there."""
    return [
        (key, name, symbol, getattr(ring, key), unit)
        for key, (name, symbol, unit) in RING_NAMES.items()
        if getattr(ring, key) is not None
    ]
