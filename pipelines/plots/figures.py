"""Figures of results: those of the report on an axis of your own, and what ``.plot()`` draws."""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw  # matplotlib requires it

from ema.checks.quality import ReferenceCheck
from ema.core.errors import InputError
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.poles.stability import StabilityDiagram
from model.tuning import TuningResult
from pipelines.plots import measurement, modes, ring
from pipelines.plots import plot as go
from pipelines.plots.chart import Chart
from pipelines.plots.draw import PAPER, STYLE, draw
from pipelines.plots.draw import png as png
from pipelines.plots.draw import styled_figure as styled_figure
from pipelines.plots.draw import write_figure as write_figure
from pipelines.plots.modes import shapes_plot, stability_chart
from pipelines.plots.plot import Margins as Margins
from pipelines.plots.plot import Plot
from pipelines.results.result import Validation
from pipelines.results.tables import in_band, place_name

Ends = tuple[float, float]
Stds = NDArray[np.float64]
_AMPLITUDE = 0.3  # largest deflection, in radii
_ANGLES = "angles_deg"


def plot_setup(
    frf: FRF, ax: Axes, excitation_deg: float | None = None, reference_deg: float | None = None
) -> Axes:
    """The tyre with its measured positions by run, the force and the reference sensor."""
    return _only(measurement.setup_chart(frf, excitation_deg, reference_deg), ax)


def plot_coherence(frf: FRF, ax: Axes, band_hz: Ends | None = None) -> Axes:
    """Map of the coherence, position by position over frequency; grey where it is unknown."""
    band = band_hz or (float(frf.frequency_hz[0]), float(frf.frequency_hz[-1]))
    return _only(measurement.coherence_chart(frf, band), ax)


def plot_reference(reference: ReferenceCheck, ax: Axes, band_hz: Ends | None = None) -> Axes:
    """The reference sensor's inertances of all runs, one over the other."""
    return _only(measurement.reference_chart(reference, band_hz), ax)


def plot_stability(diagram: StabilityDiagram, ax: Axes) -> Axes:
    """The stability diagram; the mode indicator has its own axis behind."""
    return _only(modes.stability_chart(diagram), ax)


def plot_frf_magnitude(frf: FRF, model: ModalModel, row: int, ax: Axes) -> Axes:
    """Magnitude of one FRF, measured (thin) and fitted (thick); `row` is one of `frf`."""
    return draw(_frf(frf, model, row).panels[0], ax)


def plot_frf_phase(frf: FRF, model: ModalModel, row: int, ax: Axes) -> Axes:
    """Phase of one FRF, measured (thin) and fitted (thick), between −180° and 180°."""
    return draw(_frf(frf, model, row).panels[1], ax)


def plot_shape_on_circle(mode: Mode, position_deg: ArrayLike, ax: Axes) -> Axes:
    """A shape on the circle: undeformed (grey), deformed, half a period later (dotted)."""
    return draw(modes.shape_panel(mode, position_deg), ax)


def plot_shape_by_node(mode: Mode, names: Sequence[str], ax: Axes) -> Axes:
    """A shape as bars over the names of its nodes, where there is no circle."""
    return draw(modes.shape_by_node_panel(mode, names), ax)


def plot_mac(
    values: ArrayLike, row_names: Sequence[str], column_names: Sequence[str], ax: Axes
) -> Axes:
    """A MAC matrix with its values."""
    return _only(modes.matrix_chart(values, row_names, column_names), ax)


def plot_frac(model: ModalModel, ax: Axes) -> Axes:
    """FRAC of measured against fitted FRFs, position by position."""
    return _only(modes.frac_chart(model), ax)


def plot_frequency_scatter(validation: Validation, ax: Axes, std_hz: Stds | None = None) -> Axes:
    """Model against measured frequencies, with the ±1 % band; bars of 2 `std_hz`."""
    return _only(ring.scatter_chart(validation, std_hz), ax)


def plot_frequency_error(validation: Validation, ax: Axes, std_hz: Stds | None = None) -> Axes:
    """Deviation of the model's frequencies, order by order; bars of 2 `std_hz`."""
    return _only(ring.deviation_chart(validation, std_hz), ax)


def plot_dispersion(
    validation: Validation, orders: ArrayLike, ring_hz: ArrayLike, ax: Axes
) -> Axes:
    """Frequency over order, measured and of the ring, also at orders that were not measured."""
    return _only(ring.dispersion_chart(validation, orders, ring_hz), ax)


def plot_damping(validation: Validation, ax: Axes, std: Stds | None = None) -> Axes:
    """Damping ratio over order, measured and of the ring; bars of 2 `std`."""
    return _only(ring.damping_chart(validation, std), ax)


def _frf(frf: FRF, model: ModalModel, row: int) -> Plot:
    title = place_name(int(frf.node[row]), float(frf.position_deg[row]))
    return modes.frf_plot(frf, model, modes.fitted_curves(frf, model, row), title)


def _only(chart: Chart, ax: Axes) -> Axes:
    return draw(chart.plot.panels[0], ax)


_AROUND, _ACROSS = 96, 14  # quads around the tyre and around its section
_SECTION, _WIDTH = 0.3, 1.25  # radius of the section in radii of the belt, and how it is widened
_TURN, _TILT, _DISTANCE = 0.62, 0.3, 7.0  # view in rad, and distance of the eye
_FRAMES, _FRAME_MS = 24, 80
_SIZE_PX, _OVERSAMPLED = 420, 2

Real = NDArray[np.float64]


def write_shape_gif(mode: Mode, position_deg: Real, path: Path) -> None:
    """Write one period of a mode on a closed circle of positions, which repeats for ever."""
    order = np.argsort(position_deg)
    even_deg = np.arange(_AROUND) * 360 / _AROUND
    shape = np.interp(even_deg, position_deg[order], mode.shape[order], period=360)
    phases = np.exp(2j * np.pi * np.arange(_FRAMES) / _FRAMES)
    frames = [_frame(_AMPLITUDE * (shape * phase).real) for phase in phases]
    more = {"save_all": True, "append_images": frames[1:], "duration": _FRAME_MS, "loop": 0}
    frames[0].save(path, format="gif", **more)


def _frame(deflection: Real) -> Image.Image:
    """The tyre with a deflection at even angles, seen from the side."""
    corners, share = _quads(deflection)
    across = corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]
    facing = across[0][:, 0] * across[1][:, 1] - across[0][:, 1] * across[1][:, 0]
    sizes = np.linalg.norm(across[0], axis=1) * np.linalg.norm(across[1], axis=1)
    light = np.clip(1.3 * facing / sizes, 0, 1)
    rubber, above, below = (_rgb(PAPER[name]) for name in ("--faint", "--ring", "--fitted"))
    part = np.clip(share / _AMPLITUDE, -1, 1)[:, None]
    tone = rubber + np.abs(part) * (np.where(part > 0, above, below) - rubber)
    shaded = 0.3 * tone + 0.7 * 0.45 * rubber
    colours = np.rint(shaded + light[:, None] * (tone - shaded)).astype(int)
    size = _SIZE_PX * _OVERSAMPLED
    picture = Image.new("RGB", (size, size), "white")
    pen, half = ImageDraw.Draw(picture), size / 2
    points = half + half / 1.55 * corners[:, :, :2]
    for k in np.argsort(corners[:, :, 2].sum(axis=1)):
        if facing[k] > 0:  # what faces away is hidden
            pen.polygon([tuple(p) for p in points[k].tolist()], fill=tuple(colours[k].tolist()))
    return picture.resize((_SIZE_PX, _SIZE_PX), Image.Resampling.LANCZOS)


def _quads(deflection: Real) -> tuple[Real, Real]:
    """Corners as seen, (n_quads, 4, 3) with the depth last, and the deflection of each quad."""
    around = 2 * np.pi * np.arange(_AROUND)[:, None] / _AROUND
    section = 2 * np.pi * np.arange(_ACROSS) / _ACROSS
    crown = (1 + np.cos(section)) / 2  # the tread moves, the rim does not
    radius = 1 - _SECTION + _SECTION * np.cos(section) + crown * deflection[:, None]
    x, y = radius * np.cos(around), radius * np.sin(around)
    z = np.broadcast_to(_WIDTH * _SECTION * np.sin(section), x.shape)
    right = x * np.cos(_TURN) + z * np.sin(_TURN)
    back = z * np.cos(_TURN) - x * np.sin(_TURN)
    up, near = y * np.cos(_TILT) - back * np.sin(_TILT), y * np.sin(_TILT) + back * np.cos(_TILT)
    scale = _DISTANCE / (_DISTANCE - near)
    seen = np.stack([right * scale, -up * scale, near], axis=-1)
    ahead = np.roll(seen, -1, axis=0)
    corners = np.stack([seen, ahead, np.roll(ahead, -1, axis=1), np.roll(seen, -1, axis=1)], axis=2)
    share = (deflection + np.roll(deflection, -1))[:, None] / 2 * crown
    return corners.reshape(-1, 4, 3), share.ravel()


def _rgb(colour: str) -> Real:
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)], dtype=float)


_Ends = tuple[float, float]


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
