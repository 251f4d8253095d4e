"""What ``.plot()`` of a result draws: FRFs, stability diagrams, modes and tuned rings.

`ema.core.display` and `model.display` load this module by its name.
"""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from ema.core.errors import InputError
from ema.core.frf import FRF
from ema.core.modes import ModalModel
from ema.poles.stability import StabilityDiagram
from model.tuning import TuningResult
from pipelines.plots import plot as go
from pipelines.plots.draw import draw
from pipelines.plots.modes import shapes_plot, stability_chart
from pipelines.plots.style import STYLE
from pipelines.results.labels import in_band, place_name

_Ends = tuple[float, float]
_ANGLES = "angles_deg"


@singledispatch
def plot(shown: Any, ax: Axes | None, **options: Any) -> Any:
    """Draw something on axes, on new ones of pyplot where none are given; return the axes."""
    raise InputError("plot", type(shown).__name__, "there is no plot of it", "Plot its parts")


@plot.register
def _(frf: FRF, ax: Axes | None, *, angles_deg: ArrayLike | None, band_hz: _Ends) -> Axes:
    lines = in_band(frf.frequency_hz, band_hz)
    if not np.any(lines):
        found = f"{band_hz[0]:g} to {band_hz[1]:g} Hz"
        rule = f"the lines are from {frf.frequency_hz[0]:g} to {frf.frequency_hz[-1]:g} Hz"
        raise InputError("plot, band_hz", found, rule, "Choose a band with lines")
    level = np.abs(frf.values[:, lines])
    x = frf.frequency_hz[lines]
    if angles_deg is None:
        rms = np.sqrt(np.mean(level**2, axis=0))
        curves = [go.Curve(x, row, go.FAINT, width=0.8, opacity=0.5) for row in level]
        curves.append(go.Curve(x, rms, go.RING, "RMS of all positions", width=2.5))
    else:
        curves = [
            go.Curve(x, level[row], go.SERIES[k % len(go.SERIES)], _name(frf, row), width=1.6)
            for k, row in enumerate(_nearest(frf, angles_deg))
        ]
    shown = level if angles_deg is None else np.concatenate([curve.y for curve in curves])
    across = go.Axis(go.FREQUENCY, (float(x[0]), float(x[-1])))
    return _on(ax, go.Panel(tuple(curves), across, go.log_axis(go.INERTANCE, shown)))


@plot.register
def _(diagram: StabilityDiagram, ax: Axes | None) -> Axes:
    return _on(ax, stability_chart(diagram).plot.panels[0], size=(8.0, 5.0))


@plot.register
def _(model: ModalModel, ax: Any, *, mode: int | None) -> Any:
    panels = shapes_plot(model).panels
    numbers = range(1, len(panels) + 1)
    if mode is not None:
        if mode not in numbers:
            rule = f"modes are numbered from 1 to {len(panels)}, as in the table"
            raise InputError("plot, mode", repr(mode), rule, "Choose one of them")
        return _on(ax, panels[int(mode) - 1], size=(4.0, 4.0))
    if ax is not None:
        given = np.ravel(ax)
        if given.size < len(panels):
            rule = f"{len(panels)} modes need an axis each"
            raise InputError("plot, ax", f"{given.size} axes", rule, "Choose a mode with mode=")
    else:
        columns = min(4, len(panels))
        rows = -(-len(panels) // columns)
        figsize = (2.6 * columns, 2.8 * rows)
        _, grid = pyplot.subplots(rows, columns, figsize=figsize, squeeze=False)
        given = grid.ravel()
        for unused in given[len(panels) :]:
            unused.set_axis_off()
    pairs = zip(panels, given, strict=False)
    return np.array([_on(axes, panel) for panel, axes in pairs], dtype=object)


@plot.register
def _(found: TuningResult, ax: Axes | None) -> Axes:
    order = np.argsort(found.orders)
    orders = found.orders[order]
    look: dict[str, Any] = {"width": 2, "marker": "circle", "size": 5}
    half = 2 * found.relative_std * found.measured_hz
    curves = (
        go.Curve(orders, found.model_hz[order], go.RING, "ring model", **look),
        go.Curve(
            orders,
            found.measured_hz[order],
            go.MEASURED,
            "measured, ± 2 std with that of the model form",
            marker="circle-open",
            size=10,
            y_bars=half[order],
        ),
    )
    across = go.Axis(go.ORDER, ticks=orders.tolist())
    return _on(ax, go.Panel(curves, across, go.Axis(go.FREQUENCY), legend="upper left"))


def _on(ax: Any, panel: go.Panel, size: tuple[float, float] = (7.0, 4.0)) -> Axes:
    """Draw a panel in the style of the report."""
    if ax is not None and not isinstance(ax, Axes):
        rule = "it must be axes of matplotlib"
        raise InputError("plot, ax", type(ax).__name__, rule, "Pass pyplot.subplots()[1]")
    with mpl.rc_context(STYLE):
        return draw(panel, pyplot.subplots(figsize=size)[1] if ax is None else ax)


def _name(frf: FRF, row: int) -> str:
    return place_name(int(frf.node[row]), float(frf.position_deg[row]))


def _nearest(frf: FRF, angles_deg: ArrayLike) -> NDArray[np.int_]:
    """Rows nearest to some angles."""
    try:
        wanted = np.atleast_1d(np.asarray(angles_deg, dtype=float))
    except (TypeError, ValueError) as error:
        rule = "it must be numbers in degrees"
        raise InputError(f"plot, {_ANGLES}", repr(angles_deg), rule, "Write [0, 90]") from error
    if not np.all(np.isfinite(frf.position_deg)):
        rule, remedy = "these FRFs have no angles", "Choose rows with frf.rows([0, 1])"
        raise InputError(f"plot, {_ANGLES}", repr(angles_deg), rule, remedy)
    apart = np.abs((frf.position_deg - wanted[:, None] + 180) % 360 - 180)
    return np.asarray(np.argmin(apart, axis=1))
