"""The sketch of the set-up: measured positions by run, force and reference sensor."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, inf, pi, radians, sin
from typing import TYPE_CHECKING

import numpy as np

from pipelines.plots.chart import FITTED, MEASURED, SERIES, Drawing
from pipelines.report.blocks import Mark, Sketch
from pipelines.results.labels import short
from pipelines.results.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_NAMED_RUNS = 14
SMALLEST_MARK, LARGEST_MARK = 0.016, 0.04  # half a mark's size in radii
REFERENCE_RADIUS = 0.87
FORCE_TAIL, FORCE_TIP = 1.42, 1.07
# Corners, turn in degrees and size: circle, square, triangle, diamond, triangle upside down.
SYMBOLS = ((16, 0, 1.0), (4, 45, 1.2), (3, 90, 1.3), (4, 0, 1.3), (3, 270, 1.3))
CAPTION = (
    "Measured positions by run, seen from the side; angles run counter-clockwise. Look for gaps: "
    "they lower the highest order that can be told from lower ones, which has fewer than half as "
    "many waves as there are positions."
)

Point = tuple[float, float]


def setup_sketch(result: Result) -> Sketch:
    """Draw the tyre from the side, as a sketch that follows the page's colours."""
    frf = result.frf
    runs = list(dict.fromkeys(frf.run))
    size = max(SMALLEST_MARK, min(LARGEST_MARK, 0.4 * 2 * pi / frf.n_positions))
    marks = tuple(
        Mark(
            short(run) or "positions",
            "".join(
                _symbol(index)(_on_circle(1.0, angle), size)
                for angle, name in zip(frf.position_deg, frf.run, strict=True)
                if name == run and np.isfinite(angle)
            ),
            SERIES[index % len(SERIES)],
            _symbol(index)((0.0, 0.0), LARGEST_MARK),
        )
        for index, run in enumerate(runs)
    )
    alternative = (
        f"Circle with {frf.n_positions} measured positions of {len(runs)} runs"
        f"{_at(', the force', result.excitation_deg)}"
        f"{_at(', the reference sensor', result.reference_deg)}."
    )
    unnamed = max(0, len(marks) - MOST_NAMED_RUNS)
    more = f" {unnamed} further runs are drawn, but not named." if unnamed else ""
    return Sketch(
        "setup",
        _box(result.excitation_deg),
        marks + _fixed_marks(result),
        marks[:MOST_NAMED_RUNS] + _fixed_marks(result),
        tuple((f"{angle}°", *_on_circle(0.7, angle)) for angle in (0, 90, 180, 270)),
        alternative,
        CAPTION + more,
        (Drawing("setup", alternative, CAPTION, lambda: _draw(result)),),
    )


def _fixed_marks(result: Result) -> tuple[Mark, ...]:
    """Force and reference sensor, as far as they are known."""
    found = []
    if result.excitation_deg is not None:
        at = _arrow(result.excitation_deg)
        found.append(Mark("force", at, FITTED, "M-0.06-0.012H0V-0.04L0.06 0L0 0.04V0.012H-0.06Z"))
    if result.reference_deg is not None:
        place = _on_circle(REFERENCE_RADIUS, result.reference_deg)
        found.append(
            Mark("reference", _star(place, 0.085), MEASURED, _star((0.0, 0.0), LARGEST_MARK + 0.02))
        )
    return tuple(found)


def _box(force_deg: float | None) -> str:
    """The part of the plane that is shown: the circle, and the force outside it."""
    x, y = (0.0, 0.0) if force_deg is None else _on_circle(FORCE_TAIL + 0.05, force_deg)
    left, right = min(-1.12, x), max(1.12, x)
    top, bottom = min(-1.12, y), max(1.12, y)
    return f"{left:.3f} {top:.3f} {right - left:.3f} {bottom - top:.3f}"


def _at(what: str, angle_deg: float | None) -> str:
    return "" if angle_deg is None else f"{what} at {angle_deg:g}°"


def _on_circle(radius: float, angle_deg: float) -> Point:
    """A point of the drawing, whose y axis runs down."""
    return radius * cos(radians(angle_deg)), -radius * sin(radians(angle_deg))


def _path(points: list[Point]) -> str:
    return "M" + "L".join(f"{x:.4f} {y:.4f}" for x, y in points) + "Z"


def _polygon(at: Point, size: float, corners: int, turn_deg: float, inner: float = inf) -> str:
    """A regular polygon around a point; a star where the corners have an `inner` radius."""
    radii = (size,) if inner == inf else (size, inner * size)
    count = corners * len(radii)
    offsets = (
        _on_circle(radii[k % len(radii)], turn_deg + 360.0 * k / count) for k in range(count)
    )
    return _path([(at[0] + x, at[1] + y) for x, y in offsets])


def _symbol(index: int) -> Callable[[Point, float], str]:
    """Runs differ by their symbol as well as by their colour."""
    corners, turn_deg, scale = SYMBOLS[index % len(SYMBOLS)]
    return lambda at, size: _polygon(at, scale * size, corners, turn_deg)


def _star(at: Point, size: float) -> str:
    return _polygon(at, size, 5, 90.0, inner=0.4)


def _arrow(angle_deg: float) -> str:
    """An arrow from outside onto the tread."""
    across = radians(angle_deg + 90)

    def beside(radius: float, offset: float) -> Point:
        x, y = _on_circle(radius, angle_deg)
        return x + offset * cos(across), y - offset * sin(across)

    half, head, neck = 0.018, 0.07, FORCE_TIP + 0.13
    outline = [(FORCE_TAIL, half), (neck, half), (neck, head), (FORCE_TIP, 0.0)]
    back = [(radius, -offset) for radius, offset in reversed(outline[:-1])]
    return _path([beside(radius, offset) for radius, offset in outline + back])


def _draw(result: Result) -> Figure:
    # Loads matplotlib, which the page on a screen does without.
    from pipelines.plots import figures

    margins = figures.Margins(0.1, 0.1, 0.1, 0.1)
    with figures.styled_figure(11.5, 9.5, margins=margins) as (figure, ax):
        figures.plot_setup(result.frf, ax, result.excitation_deg, result.reference_deg)
    return figure
