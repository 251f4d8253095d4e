"""Charts: a plot with its words, as data for the page's script and as a figure for paper."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.plots import plot as go

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Trace = dict[str, Any]
NO_COLOUR = "rgba(0, 0, 0, 0)"
SHADES = {"--ring": "0, 114, 178", "--fitted": "213, 94, 0"}  # what bands are filled with
GAP = 0.06  # between panels, as a share of the height


@dataclass(frozen=True)
class Chart:
    """A figure that zooms and shows values on the page, and is drawn for paper."""

    name: str  # unique in the page, for anchors and file names: letters and hyphens
    plot: go.Plot  # the page shows one panel, or several over one x axis
    # what the chart shows, for readers who cannot see it, with its main finding
    alternative: str = ""
    caption: str = ""  # what to look for
    wide: bool = False  # whether it needs the full width of the page
    height_px: int = 340

    def printed(self) -> tuple[Chart, ...]:
        """The chart in print."""
        return (self,)

    def draw(self) -> Figure:
        """The chart as a figure of matplotlib."""
        # A page on a screen does not wait for matplotlib.
        from pipelines.plots.draw import draw_plot

        return draw_plot(self.plot)

    @property
    def data(self) -> list[Trace]:
        """Traces as Plotly's JSON describes them."""
        return [
            {"yaxis": left} | trace
            for panel, (left, _) in zip(self.plot.panels, _vertical(self.plot), strict=True)
            for series in panel.series
            for trace in _traces(series, panel)
        ]

    @property
    def layout(self) -> dict[str, Any]:
        """Layout in the same form; fonts and margins come from the page."""
        panels, axes = self.plot.panels, _vertical(self.plot)
        mode = "x" if self.plot.together else "closest"
        layout: dict[str, Any] = {"hovermode": mode, "shapes": [], "annotations": []}
        for panel, (left, right) in zip(panels, axes, strict=True):
            layout[left.replace("y", "yaxis")] = _axis(panel.y, panel)
            if panel.right is not None:
                layout["yaxis2"] |= {"side": "left", "overlaying": right}
                layout["yaxis"] = _axis(panel.right, panel) | {"side": "right", "showgrid": False}
            for series in panel.series:
                shapes, annotations = _marks(series, left)
                layout["shapes"] += shapes
                layout["annotations"] += annotations
        last = panels[-1]
        layout["xaxis"] = _axis(last.x, last)
        if len(panels) > 1:
            layout["xaxis"]["anchor"] = axes[-1][0]
            for (left, _), domain in zip(axes, _domains(self.plot), strict=True):
                layout[left.replace("y", "yaxis")]["domain"] = domain
        if last.equal:
            layout["xaxis"]["constrain"] = "domain"
            layout["yaxis"] |= {"scaleanchor": "x", "constrain": "domain"}
        if last.bare:
            layout["margin"] = {"l": 4, "r": 4, "t": 26, "b": 4}
            layout["legend"] = {"yref": "paper", "y": -0.01, "yanchor": "top"}
        return {key: value for key, value in layout.items() if value != []}


@runtime_checkable
class Drawn(Protocol):
    """A block that moves on the page and is drawn for paper."""

    def printed(self) -> tuple[Chart, ...]:
        """The block in print."""


def packed(values: ArrayLike) -> dict[str, str]:
    """Numbers for a chart: single precision, base64; `shape` for a matrix."""
    array = np.ascontiguousarray(values, dtype="<f4")
    found = {"dtype": "f4", "bdata": b64encode(array.tobytes()).decode("ascii")}
    if array.ndim > 1:
        found["shape"] = ",".join(map(str, array.shape))
    return found


def _text(text: str) -> str:
    """A text from a file as it is: nothing in it is taken for markup."""
    return escape(text, quote=False)


def _numbers(values: ArrayLike) -> Any:
    array = np.asarray(values)
    whole = array.size == 0 or np.issubdtype(array.dtype, np.integer)
    return array.tolist() if whole else packed(array)


def _named(values: ArrayLike, axis: go.Axis) -> Any:
    """Values along an axis: where it has categories, their names."""
    if not axis.names:
        return _numbers(values)
    return [_text(axis.names[index]) for index in np.asarray(values, dtype=int)]


def _along(x: NDArray[Any]) -> Trace:
    """The x values of a line; evenly spaced ones are given by start and step."""
    if x.size > 2:
        step = (x[-1] - x[0]) / (x.size - 1)
        if np.allclose(np.diff(x), step, rtol=1e-6, atol=0):
            return {"x0": float(x[0]), "dx": float(step)}
    return {"x": _numbers(x)}


def _hover(template: str) -> Trace:
    if not template:
        return {"hoverinfo": "skip"}
    box = "" if "<extra>" in template else "<extra></extra>"
    return {"hovertemplate": template + box}


def _vertical(plot: go.Plot) -> list[tuple[str, str]]:
    """Names of the left and the right axis of each panel; the right one is at the back."""
    if plot.panels[0].right is not None:
        return [("y2", "y")]
    return [("y" if k == 0 else f"y{k + 1}",) * 2 for k in range(len(plot.panels))]


def _domains(plot: go.Plot) -> list[list[float]]:
    """Ends of each panel, as shares of the height from below."""
    shares = np.array(plot.heights or [1.0] * len(plot.panels))
    low = 1 - np.cumsum(shares / shares.sum())
    high = [1.0, *(low[:-1] - GAP)]
    return [
        [round(max(0.0, float(a)), 3), round(float(b), 3)] for a, b in zip(low, high, strict=True)
    ]


def _traces(series: Any, panel: go.Panel) -> Iterator[Trace]:
    match series:
        case go.Curve():
            yield _curve(series, panel)
        case go.Band(x, low, high, colour, name, opacity):
            line = {"type": "scatter", "mode": "lines", "x": _numbers(x), "hoverinfo": "skip"}
            edge = {"line": {"color": NO_COLOUR, "width": 0}, "showlegend": False}
            yield {**line, **edge, "name": "", "y": _numbers(low)}
            fill = {"fill": "tonexty", "fillcolor": f"rgba({SHADES[colour]}, {opacity})"}
            shown = {"showlegend": bool(name), "name": _text(name)}
            yield {**line, **edge, **fill, **shown, "y": _numbers(high)}
        case go.Bars(x, y, colour, width, half, hover):
            bars: Trace = {"type": "bar", "x": _numbers(x), "y": _numbers(y), "width": width}
            if half is not None:
                bars["error_y"] = _error(half) | {"color": "--measured"}
            yield bars | {"marker": {"color": colour}, "showlegend": False} | _hover(hover)
        case go.Map():
            yield _map(series, panel)


def _curve(curve: go.Curve, panel: go.Panel) -> Trace:
    modes = (("lines", curve.width), ("markers", curve.marker), ("text", curve.labelled))
    line: Trace = {"color": curve.colour, "width": curve.width}
    if curve.dash != "solid":
        line["dash"] = curve.dash
    marker: Trace = {"color": curve.colour, "size": curve.size, "symbol": curve.marker}
    if curve.marker.endswith("-open"):
        marker["line"] = {"width": 1 if "thin" in curve.marker else 1.5}
    x = np.asarray(curve.x)
    trace: Trace = {
        "type": "scatter",
        "mode": "+".join(name for name, there in modes if there),
        "name": _text(curve.name),
        "showlegend": bool(curve.listed and curve.name),
        **({"x": _named(x, panel.x)} if curve.marker or panel.x.names else _along(x)),
        "y": _numbers(curve.y),
        **_hover(curve.hover),
        "line": line if curve.width else None,
        "marker": marker if curve.marker else None,
        "opacity": curve.opacity if curve.opacity != 1 else None,
        "legendgroup": _text(curve.group) or None,
        "text": list(map(_text, curve.texts)) or None,
        "textposition": "top left" if curve.labelled else None,
        "customdata": None if curve.values is None else _numbers(curve.values),
        "error_x": None if curve.x_bars is None else _error(curve.x_bars),
        "error_y": None if curve.y_bars is None else _error(curve.y_bars),
        "yaxis": "y" if curve.right else None,
    }
    return {key: value for key, value in trace.items() if value is not None}


def _error(half: NDArray[np.float64]) -> Trace:
    """Error bars; none where the uncertainty is unknown."""
    return {"type": "data", "array": np.nan_to_num(half, nan=0.0).tolist(), "thickness": 1.5}


def _map(shown: go.Map, panel: go.Panel) -> Trace:
    rows, columns = (np.arange(size) for size in shown.z.shape)
    title = {"title": {"text": shown.label, "side": "right"}} if shown.label else {}
    trace: Trace = {
        "type": "heatmap",
        "x": _named(columns, panel.x) if shown.x is None else packed(shown.x),
        "y": _named(rows, panel.y),
        "z": packed(shown.z),
        "zmin": shown.low,
        "zmax": shown.high,
        "colorscale": go.SCALES[shown.scale],
        "colorbar": {**title, "thickness": 12},
        **_hover(shown.hover),
    }
    if shown.x is None:
        trace |= {"xgap": 1, "ygap": 1}
    if shown.cells:
        trace |= {"text": [list(row) for row in shown.cells], "texttemplate": "%{text}"}
    return trace


def _axis(axis: go.Axis, panel: go.Panel) -> dict[str, Any]:
    found: dict[str, Any] = {"title": {"text": _text(axis.title)}}
    if panel.bare:
        found["visible"] = False
    if axis.log:
        # Ticks at 1, 10, …, and at 2 and 5 as well where the range is small.
        many = axis.range is None or axis.range[1] / axis.range[0] > 50
        found |= {"type": "log", "tickformat": "~g", "dtick": 1 if many else "D2"}
    if axis.range is not None:
        found["range"] = [float(np.log10(end)) if axis.log else float(end) for end in axis.range]
    if axis.names:
        names = list(map(_text, axis.names))
        in_order = {"categoryorder": "array", "categoryarray": names}
        found |= {"type": "category", "tick0": 0, "dtick": axis.every, **in_order}
        if any(isinstance(each, go.Map) for each in panel.series):
            found["showgrid"] = False
    if len(axis.ticks):
        found |= {"tickvals": list(axis.ticks), "zeroline": False}
    if len(axis.labels):
        found["ticktext"] = list(map(_text, axis.labels))
    if axis.reverse:
        found["autorange"] = "reversed"
    if axis.from_zero:
        found["rangemode"] = "tozero"
    return found


def _marks(series: Any, left: str) -> tuple[list[Trace], list[Trace]]:
    """Shapes and annotations: lines, shaded ranges and texts, which have no values of their own."""
    match series:
        case go.Rule():
            line = {"color": series.colour, "width": series.width, "dash": series.dash}
            ends = {"x0": 0, "x1": 1, "y0": series.at, "y1": series.at, "xref": "paper"}
            if series.upright:
                ends = {"x0": series.at, "x1": series.at, "y0": 0, "y1": 1}
            yref = f"{left} domain" if series.upright else left
            return [{"type": "line", "yref": yref, **ends, "line": line}], []
        case go.Span(start, stop):
            ends = {"x0": start, "x1": stop, "y0": 0, "y1": 1, "yref": f"{left} domain"}
            look = {"fillcolor": "--faint", "opacity": 0.12, "line": {"width": 0}}
            return [{"type": "rect", "xref": "x", **ends, **look, "layer": "below"}], []
        case go.Note(x, y, text, colour, align, upward):
            place = {"x": x, "y": y, "xref": "x", "yref": left, "xanchor": align}
            turned = {"textangle": -90, "yanchor": "bottom"} if upward else {}
            look = {"showarrow": False, "font": {"color": colour}}
            return [], [{**place, "text": _text(text), **look, **turned}]
    return [], []
