"""The FRFs of a result: ``frf.parquet``, ``reference.parquet`` and the universal file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.frf import FRF
from ema.io.uff.write import write_frfs as write_universal
from pipelines.results import tables
from pipelines.storage.tables import Table, write_parquet


def write_frfs(frf: FRF, folder: Path) -> None:
    """Write the FRFs of all positions, and those of the reference sensor where there are any."""
    write_universal(folder / "frf.uff", frf)
    for name, rows in (("frf", frf), ("reference", frf.reference)):
        if rows is None:
            continue
        metadata = {"n_positions": str(rows.n_positions)}
        write_parquet(folder / f"{name}.parquet", tables.frfs(rows), metadata)


def read_frf(path: Path) -> FRF:
    """Read the FRFs of ``frf.parquet`` (or ``reference.parquet``), in whatever order its rows are.

    Raises
    ------
    InputError
        If it is not what was written.
    """
    table = Table(path)
    frequency_hz = table.numbers("frequency_hz")
    row = _row_numbers(table, frequency_hz)
    order = np.lexsort((frequency_hz, row))
    row, lines = row[order], frequency_hz[order]
    n_rows = int(row[-1]) + 1 if row.size else 0
    if (
        not n_rows
        or row.size % n_rows
        or np.any(row != np.arange(row.size) // (row.size // n_rows))
    ):
        raise table.unusable("rows missing, doubled or misnumbered", "each FRF has the same lines")

    def grid(values: NDArray[Any]) -> NDArray[Any]:
        return values[order].reshape(n_rows, -1)

    def of_row(name: str, values: NDArray[Any]) -> NDArray[Any]:
        by_line = grid(values)
        same = (by_line == by_line[:, :1]) | (np.isnan(by_line) & np.isnan(by_line[:, :1]))
        if not np.all(same):
            raise table.unusable(f"several values of {name}", "an FRF has one")
        return np.asarray(by_line[:, 0])

    def words(name: str) -> tuple[str, ...]:
        index, texts = table.texts(name)
        return tuple(texts[at] for at in of_row(name, index))

    _require_lines(table, lines.reshape(n_rows, -1))
    return FRF(
        frequency_hz=lines[: row.size // n_rows],
        values=grid(table.numbers("real")) + 1j * grid(table.numbers("imag")),
        coherence=grid(table.numbers("coherence", unknown=True)),
        std=grid(table.numbers("std", unknown=True)),
        node=of_row("node", table.numbers("node")),
        position_deg=of_row("position_deg", table.numbers("position_deg", unknown=True)),
        run=words("run"),
        channel=words("channel"),
    )


def _row_numbers(table: Table, frequency_hz: NDArray[np.float64]) -> NDArray[np.int_]:
    """Which FRF each row belongs to; in version 0.1.0 a new one began where frequencies fell."""
    if "row" in table.names:
        numbers = table.numbers("row").astype(int)
        if np.any(numbers < 0) or np.any(numbers >= max(table.n_rows, 1)):
            raise table.unusable(f"row {numbers.min()} to {numbers.max()}", "they count from 0")
        return numbers
    return np.concatenate([[0], np.cumsum(np.diff(frequency_hz) <= 0)])[: table.n_rows]


def _require_lines(table: Table, lines: NDArray[np.float64]) -> None:
    if lines.shape[1] < 2 or np.any(lines != lines[0]):
        raise table.unusable("other frequencies in one FRF than in another", "they share the lines")
    if lines[0, 0] < 0 or np.any(np.diff(lines[0]) <= 0):
        found = "a frequency that is negative or comes twice"
        raise table.unusable(found, "frequencies start at 0 or above and rise")
