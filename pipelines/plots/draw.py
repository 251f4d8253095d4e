"""Drawing with matplotlib: the style on paper, and a described plot as a figure."""

from __future__ import annotations

import re
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from pipelines.plots import plot as go
from pipelines.results.tables import literal
from pipelines.storage.atomic import file_written_whole

DOTS_PER_INCH = 150
FILE_DOTS_PER_INCH = 300  # what printers ask for; a screen gets half
#: The page's colours in print. Okabe & Ito (2008): distinct for any colour vision, and in grey
#: by their brightness.
PAPER = {
    "--measured": "#000000",
    "--fitted": "#D55E00",
    "--ring": "#0072B2",
    "--kept": "#009E73",
    "--dropped": "#B5651D",
    "--faint": "#8C8C8C",
    "--soft": "#55616B",
    "--paper": "#FFFFFF",
    "--cell-above": "#8CC4EA",
    "--cell-below": "#F5B183",
    **{"--series-1": "#0072B2", "--series-2": "#E69F00", "--series-3": "#009E73"},
    **{"--series-4": "#CC79A7", "--series-5": "#56B4E9", "--series-6": "#D55E00"},
    **{"--series-7": "#000000"},
}

STYLE: dict[Any, Any] = {
    **{"font.size": 9.0, "xtick.labelsize": 8.0, "ytick.labelsize": 8.0, "legend.fontsize": 8.0},
    **{"axes.titlesize": 9.5, "axes.titleweight": "bold", "axes.titlelocation": "left"},
    **{"axes.labelsize": 9.0, "axes.spines.top": False, "axes.spines.right": False},
    **{"axes.linewidth": 0.7, "axes.grid": True, "axes.axisbelow": True},
    **{"grid.color": "#DDDDDD", "grid.linewidth": 0.5, "legend.frameon": False},
    **{"lines.linewidth": 1.2, "lines.markersize": 4.0, "savefig.facecolor": "white"},
}
POINTS_PER_PX = 0.7  # of a line: thinner in print than on the screen
MARKER_POINTS_PER_PX = 0.55
DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-."}
#: Plotly's symbols → matplotlib's.
MARKERS = {
    **{"circle": "o", "circle-open": "o", "cross-thin-open": "+", "x-thin-open": "x"},
    **{"square": "s", "triangle-up": "^", "diamond": "D", "triangle-down": "v"},
    **{"cross": "P", "x": "X", "star": "*"},
}
UNKNOWN = "#C8C8C8"  # cells of a map without a value
BARS: dict[str, Any] = {"fmt": "none", "elinewidth": 1.0, "capsize": 2.0}
LONG_NAMES = 34  # letters of all names together that fit side by side


@contextmanager
def styled_figure(
    width_cm: float,
    height_cm: float,
    rows: int = 1,
    columns: int = 1,
    margins: go.Margins | None = None,
    **options: Any,
) -> Iterator[tuple[Figure, Any]]:
    """A figure in the common style and its axes; what is drawn inside the block gets the style.

    Parameters
    ----------
    width_cm, height_cm : float
        Size on paper.
    rows, columns : int
        Grid of axes; one axis comes as itself, several as an array.
    margins : Margins, optional
        Set by hand: a layout engine would take longer than all the drawing.
    options
        Passed on to `matplotlib.figure.Figure.subplots`.

    Yields
    ------
    Figure, Axes or ndarray of Axes
    """
    room = margins or go.Margins()
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width_cm / 2.54, height_cm / 2.54), dpi=DOTS_PER_INCH)
        axis_width = (width_cm - room.left - room.right + room.between_columns) / columns
        axis_height = (height_cm - room.bottom - room.top + room.between_rows) / rows
        figure.subplots_adjust(
            left=room.left / width_cm,
            right=1 - room.right / width_cm,
            bottom=room.bottom / height_cm,
            top=1 - room.top / height_cm,
            wspace=room.between_columns / (axis_width - room.between_columns),
            hspace=room.between_rows / (axis_height - room.between_rows),
        )
        yield figure, figure.subplots(rows, columns, **options)


def png(figure: Figure, dots_per_inch: float = DOTS_PER_INCH) -> bytes:
    """The figure as PNG."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=dots_per_inch, metadata={"Software": None})
    return buffer.getvalue()


def data_uri(picture: bytes) -> str:
    """A picture in PNG as a data URI, which is part of an HTML file."""
    return "data:image/png;base64," + b64encode(picture).decode("ascii")


def write_figure(path: Path, figure: Figure) -> None:
    """Write a figure atomically as PNG or SVG, by the ending of `path`.

    Texts in SVG stay texts; the same figure gives the same bytes.
    """
    with (
        file_written_whole(path) as partial,
        mpl.rc_context({"svg.hashsalt": "ringmodal", "svg.fonttype": "none"}),
    ):
        if path.suffix.lower() == ".png":
            partial.write_bytes(png(figure, FILE_DOTS_PER_INCH))
        else:
            figure.savefig(partial, format="svg", metadata={"Date": None, "Creator": None})


def draw_plot(plot: go.Plot) -> Figure:
    """Draw all panels of a plot as a new figure in the common style."""
    rows = -(-len(plot.panels) // plot.columns)
    grid: dict[str, Any] = {"height_ratios": plot.heights or None, "squeeze": False}
    grid["width_ratios"] = plot.widths or None
    # Panels one below the other share an axis that only the last one names.
    grid["sharex"] = plot.columns == 1 and not plot.panels[0].x.title and rows > 1
    size = (*plot.size_cm, rows, plot.columns, plot.margins)
    with styled_figure(*size, **grid) as (figure, axes):
        for ax in axes.flat[len(plot.panels) :]:
            ax.set_axis_off()
        for panel, ax in zip(plot.panels, axes.flat, strict=False):
            draw(panel, ax)
    return figure


def draw(panel: go.Panel, ax: Axes) -> Axes:
    """Draw a panel on an axis of matplotlib and return it."""
    behind = _axis_behind(panel.right, ax) if panel.right is not None else ax
    for each in panel.series:
        _draw(each, behind if isinstance(each, go.Curve) and each.right else ax)
    if panel.bare:
        ax.set_axis_off()
    if any(isinstance(each, go.Map) for each in panel.series):
        ax.grid(visible=False)
    _set_axis(panel.x, ax, "x")
    _set_axis(panel.y, ax, "y")
    if panel.right is not None:
        _set_axis(panel.right, behind, "y")
    if panel.equal:
        ax.set_aspect("equal")
    if panel.title:
        where: dict[str, Any] = {"loc": "center", "pad": 2} if panel.bare else {}
        ax.set_title(literal(panel.title), **where)
    _set_legend(panel, ax)
    return ax


def _draw(series: Any, ax: Axes) -> None:
    match series:
        case go.Curve():
            _draw_curve(series, ax)
        case go.Band(x, low, high, colour, name, opacity):
            filled: dict[str, Any] = {"color": _hex(colour), "alpha": opacity, "linewidth": 0}
            ax.fill_between(np.asarray(x), low, high, label=_label(name), **filled)
        case go.Bars(x, y, colour, width, half):
            ax.bar(x, y, color=_hex(colour), width=width)
            if half is not None:
                ax.errorbar(x, y, yerr=np.nan_to_num(half), color=_hex(go.MEASURED), **BARS)
        case go.Rule():
            line = ax.axvline if series.upright else ax.axhline
            width = POINTS_PER_PX * series.width
            line(series.at, color=_hex(series.colour), lw=width, ls=DASHES[series.dash], zorder=1)
        case go.Span(start, stop):
            ax.axvspan(start, stop, color="#EEEEEE", linewidth=0, zorder=0)
        case go.Note(x, y, text, colour, align, upward):
            up: dict[str, Any] = {"rotation": 90, "va": "bottom", "fontsize": 7.5}
            look = up if upward else {"va": "center"}
            ax.text(x, y, literal(text), color=_hex(colour), ha=align, **look)
        case go.Map():
            _draw_map(series, ax)


def _draw_curve(curve: go.Curve, ax: Axes) -> None:
    colour = _hex(curve.colour)
    x, y = np.asarray(curve.x), np.asarray(curve.y, dtype=float)
    (line,) = ax.plot(
        x,
        y,
        color=colour,
        alpha=None if curve.opacity == 1 else curve.opacity,
        linewidth=POINTS_PER_PX * curve.width,
        linestyle=DASHES[curve.dash] if curve.width else "none",
        marker=MARKERS[curve.marker] if curve.marker else "",
        markersize=MARKER_POINTS_PER_PX * curve.size,
        label=_label(curve.name if curve.listed else ""),
    )
    if curve.marker.endswith("-open"):
        line.set(markerfacecolor="none", markeredgewidth=0.8)
    elif curve.opacity < 1:
        line.set(markeredgewidth=0)
    for error, half in (("xerr", curve.x_bars), ("yerr", curve.y_bars)):
        if half is not None:
            bars: dict[str, Any] = {error: np.nan_to_num(half), "color": colour}
            ax.errorbar(x, y, **bars, **BARS)
    for left, up, text in zip(x, y, curve.texts, strict=True) if curve.labelled else ():
        offset = (-6, 4)  # points
        ax.annotate(literal(text), (left, up), offset, textcoords="offset points", ha="right")


def _draw_map(shown: go.Map, ax: Axes) -> None:
    n_rows, n_columns = shown.z.shape
    left, right = -0.5, n_columns - 0.5
    if shown.x is not None:
        half = (shown.x[-1] - shown.x[0]) / max(2 * (n_columns - 1), 1)
        left, right = shown.x[0] - half, shown.x[-1] + half
    image = ax.imshow(
        np.ma.masked_invalid(shown.z),
        aspect="auto",
        origin="lower",
        vmin=shown.low,
        vmax=shown.high,
        cmap=_colours(shown.scale).with_extremes(bad=UNKNOWN),
        interpolation="none",
        extent=(left, right, -0.5, n_rows - 0.5),
    )
    if not shown.cells:
        ax.figure.colorbar(image, ax=ax, label=shown.label, pad=0.02)
    size = 7.5 if max(shown.z.shape) <= 9 else 5.5
    for row, cells in enumerate(shown.cells):
        for column, text in enumerate(cells):
            if text:
                ax.text(column, row, text, ha="center", va="center", fontsize=size)


def _colours(scale: str) -> Colormap:
    found = go.SCALES[scale]
    if isinstance(found, str):
        return colormaps[found.lower()]
    return LinearSegmentedColormap.from_list(scale, [(at, _hex(name)) for at, name in found])


def _axis_behind(right: go.Axis, ax: Axes) -> Axes:
    """A second axis at the back, with its labels on the right."""
    behind = ax.twinx()
    behind.tick_params(axis="y", colors=_hex("--soft"), which="both")
    behind.grid(visible=False)
    behind.spines["right"].set_visible(True)
    ax.set_zorder(behind.get_zorder() + 1)
    ax.patch.set_visible(False)
    return behind


def _set_axis(axis: go.Axis, ax: Axes, which: str) -> None:
    own = ax.xaxis if which == "x" else ax.yaxis
    ends = ax.set_xlim if which == "x" else ax.set_ylim
    if axis.title:
        own.set_label_text(_typeset(axis.title))
    if axis.log:
        _set_log(axis, ax)
    if axis.range is not None:
        ends(*axis.range)
    elif which == "x" and not axis.names and not axis.ticks:
        ax.margins(x=0.02)
    if axis.from_zero:
        ends(0, 1.15 * ax.dataLim.max[1])
    if axis.names:
        shown = range(0, len(axis.names), axis.every)
        names = [literal(axis.names[k]) for k in shown]
        own.set_ticks(list(shown), names)
        if which == "x" and sum(map(len, names)) > LONG_NAMES:
            ax.tick_params(axis="x", rotation=90)
    elif len(axis.ticks):
        own.set_ticks(list(axis.ticks), list(axis.labels) or None)
    if axis.reverse:
        own.set_inverted(True)


def _set_log(axis: go.Axis, ax: Axes) -> None:
    """Plain numbers at 1, 10, …, and at 2 and 5 as well where the range is small."""
    ax.set_yscale("log")
    low, high = axis.range or ax.get_ylim()
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0,) if high / low > 50 else (1.0, 2.0, 5.0)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_locator(NullLocator())


def _set_legend(panel: go.Panel, ax: Axes) -> None:
    handles, _ = ax.get_legend_handles_labels()
    if not handles or not panel.legend:
        return
    place: dict[str, Any] = {"loc": panel.legend}
    if panel.legend == "below":
        anchor = (0.5, -0.14)
        place = {"loc": "upper center", "bbox_to_anchor": anchor, "ncols": 4, "handletextpad": 0.2}
    elif panel.legend == "beside":
        place = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "handlelength": 1.2}
    elif panel.legend == "center":
        place |= {"bbox_to_anchor": (0, 0), "bbox_transform": ax.transData, "labelspacing": 0.3}
    elif len(handles) > 4:
        place["ncols"] = 2 if len(handles) <= 8 else 4
    ax.legend(**place)


def _hex(colour: str) -> str:
    """A colour of the page in print; any other colour as it is."""
    return PAPER.get(colour, colour)


def _label(name: str) -> str | None:
    return literal(name) or None


def _typeset(title: str) -> str:
    """A title in which the index of a symbol such as k_θ is set low."""
    return re.sub(r"(?<!\w)([^\W\d_])_([^\W\d_])(?!\w)", r"\1$_{\2}$", literal(title))
