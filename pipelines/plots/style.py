"""The style of figures on paper, and figures as bytes."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from pipelines.plots import plot as go
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
