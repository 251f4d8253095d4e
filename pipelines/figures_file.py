"""Figures as files: pictures for pages and screens, drawings for print."""

from __future__ import annotations

from io import BytesIO

import matplotlib as mpl
from matplotlib.figure import Figure

from pipelines.figures_style import png


def figure_bytes(figure: Figure, file_format: str) -> bytes:
    """A figure as the bytes of a file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : Figure
    file_format : {"png", "svg"}
    """
    if file_format == "png":
        return png(figure)
    buffer = BytesIO()
    with mpl.rc_context({"svg.hashsalt": "ringmodal"}):
        figure.savefig(buffer, format=file_format, metadata={"Date": None, "Creator": None})
    return buffer.getvalue()
