"""Figures of matrices, each cell with its number."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from pipelines.results.labels import signed_cell

WRITTEN_CELLS = 9  # rows and columns up to which every number has room in its cell


def plot_mac(
    values: ArrayLike, row_names: Sequence[str], column_names: Sequence[str], ax: Axes
) -> Axes:
    """Show a MAC matrix with its values.

    Parameters
    ----------
    values : array_like, shape (n_rows, n_columns)
        Between 0 and 1.
    row_names, column_names : sequence of str
    ax : Axes

    Returns
    -------
    Axes
    """
    matrix = np.asarray(values, dtype=float)
    ax.imshow(matrix, vmin=0, vmax=1, cmap="Blues", aspect="equal")
    # In large matrices the small values would only be noise to the eye.
    written = matrix >= (0.0 if max(matrix.shape) <= WRITTEN_CELLS else 0.1)
    _write_cells(matrix, written, matrix > 0.55, "{:.2f}".format, ax)
    return _name_cells(row_names, column_names, ax)


def plot_signed_matrix(
    values: ArrayLike, row_names: Sequence[str], column_names: Sequence[str], ax: Axes
) -> Axes:
    """Show a matrix whose values have a sign: blue above zero, red below.

    Parameters
    ----------
    values : array_like, shape (n_rows, n_columns)
    row_names, column_names : sequence of str
    ax : Axes

    Returns
    -------
    Axes
    """
    matrix = np.asarray(values, dtype=float)
    largest = max(float(np.abs(matrix).max(initial=0.0)), 1e-3)
    ax.imshow(matrix, vmin=-largest, vmax=largest, cmap="RdBu", aspect="auto")
    dark = np.abs(matrix) > 0.7 * largest
    _write_cells(matrix, np.isfinite(matrix), dark, signed_cell, ax)
    return _name_cells(row_names, column_names, ax)


def _write_cells(
    matrix: NDArray[np.float64],
    written: NDArray[np.bool_],
    dark: NDArray[np.bool_],
    form: Callable[[float], str],
    ax: Axes,
) -> None:
    size = 7.5 if max(matrix.shape) <= WRITTEN_CELLS else 5.5
    for row, column in np.argwhere(written):
        ax.text(
            column,
            row,
            form(matrix[row, column]),
            ha="center",
            va="center",
            fontsize=size,
            color="white" if dark[row, column] else "black",
        )


def _name_cells(row_names: Sequence[str], column_names: Sequence[str], ax: Axes) -> Axes:
    ax.grid(visible=False)
    turned = 90 if sum(map(len, column_names)) > 34 else 0
    ax.set_xticks(range(len(column_names)), column_names, rotation=turned)
    ax.set_yticks(range(len(row_names)), row_names)
    return ax
