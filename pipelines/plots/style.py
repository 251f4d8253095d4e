"""One style for every figure: colours for all eyes, legible on paper, no global state."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

# Okabe & Ito (2008): told apart with any colour vision, and in grey by their brightness.
MEASURED = "#000000"
FITTED = "#D55E00"
RING = "#0072B2"
KEPT = "#009E73"
DROPPED = "#B5651D"
FAINT = "#8C8C8C"
SERIES = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000")
DOTS_PER_INCH = 150
MARKERS = ("o", "s", "^", "D", "v", "P", "X")

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "lines.linewidth": 1.2,
    "lines.markersize": 4.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "savefig.facecolor": "white",
}


@dataclass(frozen=True)
class Margins:
    """Room around and between axes in cm, for tick labels, axis labels and titles."""

    left: float = 1.6
    right: float = 0.3
    bottom: float = 1.15
    top: float = 0.55
    between_columns: float = 1.0
    between_rows: float = 0.5


@contextmanager
def styled_figure(
    width_cm: float,
    height_cm: float,
    rows: int = 1,
    columns: int = 1,
    margins: Margins | None = None,
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
    room = margins or Margins()
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


def svg(figure: Figure) -> bytes:
    """The figure as SVG whose texts stay texts; the same figure gives the same bytes."""
    buffer = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "ringmodal", "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def png_uri(figure: Figure) -> str:
    """The figure as a data URI that stands in an HTML file."""
    return data_uri(png(figure))


def data_uri(picture: bytes) -> str:
    """A picture in PNG as a data URI."""
    return "data:image/png;base64," + b64encode(picture).decode("ascii")


def log_axis(ax: Axes, decades: float = 4.0) -> None:
    """Make the y axis logarithmic with plain numbers, at most `decades` below its largest value."""
    ax.set_yscale("log")
    bottom, top = ax.get_ylim()
    bottom = max(bottom, top / 10**decades)
    ax.set_ylim(bottom, top)
    steps = (1.0,) if top / bottom > 50 else (1.0, 2.0, 5.0)
    ax.yaxis.set_major_locator(LogLocator(subs=steps))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ax.yaxis.set_minor_locator(NullLocator())


def phase_axes(ax: Axes) -> None:
    """Name the axes of a phase over frequency, from −180° to 180°."""
    ax.set_ylim(-190, 190)
    ax.set_yticks([-180, -90, 0, 90, 180])
    ax.set_xlabel("frequency / Hz")
    ax.set_ylabel("phase / °")


def series_style(index: int) -> dict[str, Any]:
    """Colour and marker of the `index`-th of several like things."""
    return {
        "color": SERIES[index % len(SERIES)],
        "marker": MARKERS[index % len(MARKERS)],
    }


def shades(count: int) -> list[Any]:
    """Colours from dark to light for a sequence, all visible on white."""
    return [mpl.colormaps["viridis"](share) for share in np.linspace(0.0, 0.92, count)]


FILE_DOTS_PER_INCH = 300  # what printers ask for; a screen gets half


def figure_bytes(figure: Figure, file_format: str) -> bytes:
    """A figure as the bytes of a file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : Figure
    file_format : {"png", "svg"}
    """
    return png(figure, FILE_DOTS_PER_INCH) if file_format == "png" else svg(figure)
