"""Figures as files: pictures for pages and screens, drawings for print."""

from __future__ import annotations

from matplotlib.figure import Figure

from pipelines.figures_style import png, svg

DOTS_PER_INCH = 300  # what printers ask for; a screen gets half


def figure_bytes(figure: Figure, file_format: str) -> bytes:
    """A figure as the bytes of a file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : Figure
    file_format : {"png", "svg"}
    """
    return png(figure, DOTS_PER_INCH) if file_format == "png" else svg(figure)
