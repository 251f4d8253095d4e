"""The tables of a result folder, column by column as other programs rely on them."""

from __future__ import annotations

from dataclasses import fields
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ema.checks.corrections import Correction
from ema.core.arrays import frame_of
from ema.core.frf import FRF
from ema.core.modes import MODE_COLUMNS, OrderReport
from ema.io.uff.write import write_frfs as write_universal
from ema.poles.stability import StabilityDiagram
from pipelines.results.result import OtherMode, Result, Validation
from pipelines.storage.tables import Table, write_parquet

#: Columns of ``modes.csv``.
MODES = ("mode", *MODE_COLUMNS)
# Columns of ``orders.csv``, and where an `OrderReport` has them.
_ORDERS = {
    **{"order": "order", "verdict": "pair.verdict", "chance": "pair.chance"},
    **{"frequency_hz": "frequency_hz", "frequency_std_hz": "frequency_std_hz"},
    **{"damping_ratio": "damping_ratio", "damping_ratio_std": "damping_std"},
    "evidence": "pair.evidence",
}
# Columns of ``other_modes.csv``, and where an `OtherMode` has them.
_OTHER = {
    **{name: name for name in ("direction", "force_direction", "order", "name")},
    **{name: name for name in ("frequency_hz", "frequency_std_hz", "damping_ratio")},
    **{"damping_ratio_std": "damping_std"},
    **{name: name for name in ("order_purity", "n_positions")},
}
_VALIDATION = (
    *("order", "measured_hz", "model_hz", "error_percent"),
    *("measured_damping", "model_damping", "mac"),
)


_OF_FORCE = ("force_node", "force_axis")  # in the metadata of Parquet files


def csv_tables(result: Result) -> dict[str, pd.DataFrame]:
    """Tables of a result folder that are CSV, by file name."""
    return {
        "modes.csv": result.modal_model.to_frame(),
        "shapes.csv": shapes(result),
        "orders.csv": orders(result.modal_model.orders),
        "quality.csv": result.to_frame(),
        "corrections.csv": corrections(result.corrections),
        "other_modes.csv": other_modes(result.other_modes),
        "validation.csv": validation(result.validation),
    }


def shapes(result: Result) -> pd.DataFrame:
    """``shapes.csv``: a row for each mode and position (on a circle) or node (elsewhere)."""
    frf, modes = result.frf, result.modal_model.modes
    place = "position_deg" if np.all(np.isfinite(frf.position_deg)) else "node"
    shape = np.concatenate([np.zeros(0), *(mode.shape for mode in modes)])
    directions = np.array(["", "X", "Y", "Z"])[frf.axis.clip(0, 3)]
    several = {"direction": np.tile(directions, len(modes))} if len(set(frf.axis)) > 1 else {}
    columns = {
        "mode": np.repeat(np.arange(1, len(modes) + 1), frf.n_positions),
        place: np.tile(getattr(frf, place), len(modes)),
        "real": shape.real,
        "imag": shape.imag,
        **several,
    }
    return pd.DataFrame(columns)


def orders(reports: tuple[OrderReport, ...]) -> pd.DataFrame:
    """``orders.csv``: each order by itself, and the verdict on its pair."""
    return pd.DataFrame({name: map(attrgetter(part), reports) for name, part in _ORDERS.items()})


def corrections(changes: tuple[Correction, ...]) -> pd.DataFrame:
    """``corrections.csv``: a row for each FRF that is not fitted as measured."""
    names = [each.name for each in fields(Correction)]
    return pd.DataFrame({name: [getattr(each, name) for each in changes] for name in names})


def other_modes(found: tuple[OtherMode, ...]) -> pd.DataFrame:
    """``other_modes.csv``: a row for each mode that tangential or axial sensors show."""
    columns = {name: [getattr(mode, part) for mode in found] for name, part in _OTHER.items()}
    return frame_of(columns, whole=("order",))


def validation(found: Validation | None) -> pd.DataFrame:
    """``validation.csv``: a row for each order; none where the ring steps were left out."""
    if found is None:
        return pd.DataFrame(columns=list(_VALIDATION))
    columns = {name: getattr(found, name) for name in _VALIDATION}
    return pd.DataFrame({**columns, "mac": np.diag(found.mac)})


def poles(diagram: StabilityDiagram) -> pd.DataFrame:
    """``poles.parquet``: every pole of every model order, in the order it was found."""
    return diagram.to_frame().assign(row=np.arange(diagram.cluster.size))


def frfs(frf: FRF) -> pd.DataFrame:
    """``frf.parquet`` and ``reference.parquet``, position by position."""
    long = frf.to_frame()
    inertance = long["inertance"].to_numpy()
    row = np.repeat(np.arange(frf.n_positions, dtype=np.int32), frf.frequency_hz.size)
    columns = {
        **{name: long[name] for name in ("position_deg", "node", "frequency_hz")},
        **{"real": inertance.real, "imag": inertance.imag},
        **{name: long[name].astype(np.float32) for name in ("coherence", "std")},
        "axis": np.repeat(frf.axis.astype(np.int8), frf.frequency_hz.size),
        **{"row": row, **{name: long[name].astype("category") for name in ("run", "channel")}},
    }
    return pd.DataFrame(columns)


def write_frfs(frf: FRF, folder: Path) -> None:
    """Write the FRFs of all positions, and those of the reference sensor if there are any."""
    write_universal(folder / "frf.uff", frf)
    for name, rows in (("frf", frf), ("reference", frf.reference)):
        if rows is not None:
            metadata = {"n_positions": str(rows.n_positions)}
            metadata |= {name: str(getattr(frf, name)) for name in _OF_FORCE}
            write_parquet(folder / f"{name}.parquet", frfs(rows), metadata)


def read_frf(path: Path) -> FRF:
    """Read the FRFs of ``frf.parquet`` (or ``reference.parquet``), their rows in any order.

    Raises
    ------
    InputError
        If it is not what was written.
    """
    table = Table(path)
    frequency_hz = table.numbers("frequency_hz")
    row = table.numbers("row").astype(int)
    if np.any(row < 0) or np.any(row >= max(table.n_rows, 1)):
        raise table.unusable(f"row {row.min()} to {row.max()}", "they count from 0")
    order = np.lexsort((frequency_hz, row))
    row, lines = row[order], frequency_hz[order]
    n_rows = int(row[-1]) + 1 if row.size else 0
    n_lines = row.size // max(n_rows, 1)
    if not n_rows or row.size % n_rows or np.any(row != np.arange(row.size) // n_lines):
        rule = "each FRF must have the same lines"
        raise table.unusable("rows missing, doubled or misnumbered", rule)

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

    by_row = lines.reshape(n_rows, -1)
    if n_lines < 2 or np.any(by_row != by_row[0]):
        rule = "all must have the same two or more"
        raise table.unusable("frequencies differ between FRFs", rule)
    if by_row[0, 0] < 0 or np.any(np.diff(by_row[0]) <= 0):
        raise table.unusable("negative or repeated frequencies", "must be ≥ 0 and rise")
    return FRF(
        frequency_hz=lines[:n_lines],
        values=grid(table.numbers("real")) + 1j * grid(table.numbers("imag")),
        coherence=grid(table.numbers("coherence", unknown=True)),
        std=grid(table.numbers("std", unknown=True)),
        node=of_row("node", table.numbers("node")),
        position_deg=of_row("position_deg", table.numbers("position_deg", unknown=True)),
        run=words("run"),
        channel=words("channel"),
        axis=of_row("axis", table.numbers("axis")).astype(int),
        force_node=table.stated("force_node"),
        force_axis=table.stated("force_axis"),
    )
