"""Figures as files: pictures for pages and screens, drawings for print."""

from __future__ import annotations

from matplotlib.figure import Figure

from pipelines.figures_style import png, svg

#: What writes each format, by the end of the file's name.
FORMATS = {"png": png, "svg": svg}


def figure_bytes(figure: Figure, file_format: str) -> bytes:
    """A figure as the bytes of a file; the same figure gives the same bytes.

    Parameters
    ----------
    figure : Figure
    file_format : {"png", "svg"}
    """
    return FORMATS[file_format](figure)
