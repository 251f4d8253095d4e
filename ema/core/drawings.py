"""Small drawings for notebooks in the colour of the text, and plots by the package of plots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ema.core.errors import visible

_MOST_ACROSS = 8
BACKEND = "pipelines.plots.figures"


def picture(label: str, width: int, height: int, paths: Iterable[tuple[str, float]]) -> str:
    """A small drawing in the colour of the text; each path has a width of its line."""
    drawn = "".join(f'<path d="{path}" stroke-width="{line:g}"></path>' for path, line in paths)
    look = 'fill="none" stroke="currentColor" stroke-linecap="round" stroke-linejoin="round"'
    size = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
    name = f'role="img" aria-label="{escape(visible(label))}"'
    title = f"<figcaption>{escape(visible(label))}</figcaption>"
    return f'<figure style="margin:0.5em 0"><svg {name} {size} {look}>{drawn}</svg>{title}</figure>'


def path_of(x: ArrayLike, y: ArrayLike, *, dots: bool = False, closed: bool = False) -> str:
    """Points in pixels as the path of a drawing: joined, or each a dot."""
    points = np.round(np.column_stack([x, y]), 1)
    if dots:
        return "".join(f"M{a:g} {b:g}h0" for a, b in points)
    return "M" + "L".join(f"{a:g} {b:g}" for a, b in points) + ("Z" if closed else "")


def scaled(values: ArrayLike, ends: tuple[float, float], start: float, stop: float) -> Any:
    """Values between two ends as pixels from `start` to `stop`."""
    share = (np.asarray(values) - ends[0]) / ((ends[1] - ends[0]) or 1.0)
    return start + np.clip(share, 0, 1) * (stop - start)


def level_path(frequency_hz: Any, level: Any, width: int, height: int, decades: float = 4.0) -> str:
    """Path of a magnitude over frequency, logarithmic, the largest of the lines of each pixel."""
    pieces = np.array_split(np.arange(len(level)), min(width, len(level)))
    tops = np.log10([max(float(np.max(level[piece])), 1e-300) for piece in pieces])
    ends = max(float(tops.min()), float(tops.max()) - decades), float(tops.max())
    x = [float(frequency_hz[piece[0]]) for piece in pieces]
    return path_of(scaled(x, (x[0], x[-1]), 2, width - 2), scaled(tops, ends, height - 3, 3))


_RADIUS_PX, _DEFLECTION = 22, 0.35  # of a shape; its largest deflection in radii


def shapes_picture(position_deg: ArrayLike, shapes: Sequence[Any]) -> str:
    """Real shapes on a circle, side by side; the largest part of each is 1."""
    rows = np.argsort(position_deg)
    angle, around = np.deg2rad(position_deg)[rows], np.linspace(0, 2 * np.pi, 61)
    cell, across, paths = 4 * _RADIUS_PX, min(len(shapes), _MOST_ACROSS), []
    for k, shape in enumerate(shapes):
        x, y = (k % across + 0.5) * cell, (k // across + 0.5) * cell
        deflected = _RADIUS_PX * (1 + _DEFLECTION * shape[rows])
        for turn, radius, line in ((around, _RADIUS_PX, 0.4), (angle, deflected, 1.6)):
            ring = path_of(x + radius * np.cos(turn), y - radius * np.sin(turn), closed=True)
            paths.append((ring, line))
    label = "Shapes in the order of the table"
    return picture(label, cell * across, cell * -(-len(shapes) // across), paths)


def poles_picture(
    band_hz: tuple[float, float],
    frequency_hz: Any,
    model_order: Any,
    indicator_hz: Any,
    indicator: Any,
) -> str:
    """Poles over frequency and model order, before an indicator function."""
    low, high = band_hz
    shown = (frequency_hz >= low) & (frequency_hz <= high)
    inside = (indicator_hz >= low) & (indicator_hz <= high)
    highest = int(model_order.max(initial=1))
    x = scaled(frequency_hz[shown], band_hz, 3, 477)
    y = scaled(model_order[shown], (0, highest), 137, 3)
    curve = level_path(indicator_hz[inside], indicator[inside], 480, 140)
    label = f"Poles in clusters up to model order {highest}, over the RMS inertance"
    return picture(label, 480, 140, [(curve, 0.6), (path_of(x, y, dots=True), 3.0)])


def plot(shown: Any, ax: Any, **options: Any) -> Any:
    """Draw an FRF, a stability diagram or modes on axes; on new ones of pyplot without any."""
    return import_module(BACKEND).plot(shown, ax, **options)
