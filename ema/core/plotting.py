"""Plots of results, drawn by the package of plots.

It is loaded by its name when something is drawn, as pandas does with its backends: measurement does
not depend on plots, and nobody who draws nothing waits for matplotlib.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

BACKEND = "pipelines.plots.quick"


def plot(shown: Any, ax: Any, **options: Any) -> Any:
    """Draw an FRF, a stability diagram or modes on axes; on new ones of pyplot without any."""
    return import_module(BACKEND).plot(shown, ax, **options)
