"""Charts of matrices: MAC, sensitivities and correlations, each cell with its number."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.plots.chart import SHARE_SCALE, SIGNED_SCALE, Chart, as_text, axis, packed, printed
from pipelines.results.labels import signed_cell

SIZE_CM, HEIGHT_PX = (9.5, 9), 420


WRITTEN_CELLS = 15  # rows and columns up to which every number has room in its cell


def mac_chart(
    values: ArrayLike,
    rows: Sequence[str],
    columns: Sequence[str],
    *,
    name: str,
    titles: tuple[str, str],
    alternative: str,
    caption: str,
) -> Chart:
    """A MAC matrix, 0 (pale) to 1 (dark).

    Parameters
    ----------
    values : array_like, shape (n_rows, n_columns)
        Between 0 and 1.
    rows, columns : sequence of str
        Names; each is used once.
    name : str
        Of the chart, unique in the page.
    titles : tuple of str
        What rows and columns are: titles of the vertical and of the horizontal axis.
    alternative, caption : str
        What it shows, for who cannot see it; and what to look for.
    """
    matrix = np.asarray(values, dtype=float)
    trace = _cells(matrix, rows, columns, "{:.2f}".format, "MAC %{z:.3f}", titles) | {
        "colorscale": SHARE_SCALE,
        "zmin": 0,
        "zmax": 1,
        "colorbar": {"title": {"text": "MAC"}, "thickness": 12},
    }
    drawn = printed(_draw, "plot_mac", matrix, rows, columns, titles, size_cm=SIZE_CM)
    layout = _layout(rows, columns, titles)
    return Chart(name, (trace,), layout, alternative, caption, drawn, height_px=HEIGHT_PX)


def signed_chart(
    values: ArrayLike,
    rows: Sequence[str],
    columns: Sequence[str],
    *,
    name: str,
    titles: tuple[str, str],
    quantity: str,
    alternative: str,
    caption: str,
) -> Chart:
    """A matrix whose values have a sign: blue above zero, orange below.

    Parameters
    ----------
    values : array_like, shape (n_rows, n_columns)
    rows, columns, name, titles, alternative, caption
        As for `mac_chart`.
    quantity : str
        What a value is.
    """
    matrix = np.asarray(values, dtype=float)
    largest = max(float(np.abs(matrix).max(initial=0.0)), 1e-3)
    trace = _cells(matrix, rows, columns, signed_cell, f"{quantity} %{{z:+.3f}}", titles) | {
        "colorscale": SIGNED_SCALE,
        "zmin": -largest,
        "zmax": largest,
        "colorbar": {"thickness": 12},
    }
    drawn = printed(_draw, "plot_signed_matrix", matrix, rows, columns, titles, size_cm=SIZE_CM)
    layout = _layout(rows, columns, titles)
    return Chart(name, (trace,), layout, alternative, caption, drawn, height_px=HEIGHT_PX)


def _cells(
    matrix: NDArray[np.float64],
    rows: Sequence[str],
    columns: Sequence[str],
    cell: Callable[[float], str],
    hover: str,
    titles: tuple[str, str],
) -> dict[str, Any]:
    """A heat map with the value in each cell, as far as there is room."""
    trace: dict[str, Any] = {
        "type": "heatmap",
        "x": list(map(as_text, columns)),
        "y": list(map(as_text, rows)),
        "z": packed(matrix),
        "xgap": 1,
        "ygap": 1,
        "hovertemplate": f"{titles[0]}: %{{y}}<br>{titles[1]}: %{{x}}<br>{hover}<extra></extra>",
    }
    if max(matrix.shape, default=0) <= WRITTEN_CELLS:
        trace["text"] = [[cell(value) for value in row] for row in matrix]
        trace["texttemplate"] = "%{text}"
    return trace


def _layout(rows: Sequence[str], columns: Sequence[str], titles: tuple[str, str]) -> dict[str, Any]:
    """Rows from the top, as in a table; names stay names where they look like numbers."""
    return {
        "xaxis": axis(titles[1], type="category", showgrid=False, nticks=len(columns)),
        "yaxis": axis(
            titles[0], type="category", autorange="reversed", showgrid=False, nticks=len(rows)
        ),
    }


def _draw(
    figures: Any,
    plot: str,
    matrix: NDArray[np.float64],
    rows: Sequence[str],
    columns: Sequence[str],
    titles: tuple[str, str],
    ax: Any,
) -> None:
    """Draw with the function of `pipelines.plots.figures` that `plot` names."""
    getattr(figures, plot)(matrix, rows, columns, ax)
    ax.set(xlabel=titles[1], ylabel=titles[0])
