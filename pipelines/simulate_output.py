"""Where simulated numbers go: files by their ending, the screen, or a program."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines import console
from pipelines.console_tables import Column, print_table
from pipelines.whole_file import file_written_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Columns = Mapping[str, NDArray[Any]]


def write_columns(path: Path, columns: Columns, note: str = "") -> None:
    """Write a table as CSV or Parquet, by the ending of `path`; whole or not at all.

    Parameters
    ----------
    path : Path
    columns : mapping of str to ndarray
        Columns of equal length.
    note : str
        What a reader must know; a Parquet file carries it as its metadata.
    """
    from pipelines import tables

    with file_written_whole(path) as partial:
        if path.suffix.lower() == ".csv":
            rows = zip(*(values.tolist() for values in columns.values()), strict=True)
            tables.write_csv(partial, tuple(columns), rows)
        else:
            _write_parquet(partial, columns, note)


def write_figure(path: Path, figure: Figure) -> None:
    """Write a figure as PNG or SVG, by the ending of `path`; whole or not at all."""
    from pipelines.figures_file import figure_bytes  # drawing takes a second to load

    content = figure_bytes(figure, path.suffix.lower().lstrip("."))
    with file_written_whole(path) as partial:
        partial.write_bytes(content)


def print_json(content: Mapping[str, Any]) -> None:
    """Print arrays, numbers and texts as JSON; numbers that are none become null."""
    listed = {name: _listed(value) for name, value in content.items()}
    print(json.dumps(listed, allow_nan=False))  # noqa: T201


def print_rows(title: str, columns: Mapping[str, ArrayLike], places: Mapping[str, int]) -> None:
    """Print a table for people, each column with its number of digits after the point."""
    shown = [
        Column(name, [_cell(value, places.get(name, 0)) for value in np.asarray(values)])
        for name, values in columns.items()
    ]
    print_table(console.screen(), title, shown)


def _write_parquet(path: Path, columns: Columns, note: str) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({name: np.asarray(values) for name, values in columns.items()})
    pq.write_table(table.replace_schema_metadata({"note": note} if note else None), path)


def _listed(value: Any) -> Any:
    if isinstance(value, str):
        return value
    array = np.asarray(value)
    plain = array.astype(object)
    plain[~np.isfinite(array)] = None
    return plain.tolist()


def _cell(value: Any, places: int) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.{places}f}" if np.isfinite(value) else "–"
