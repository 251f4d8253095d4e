"""The tables of a result folder, column by column as other programs rely on them."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ema.core.frf import FRF
from ema.core.modes import MODE_COLUMNS, OrderReport
from ema.poles.stability import StabilityDiagram
from pipelines.results.result import Result, Validation

#: Columns of ``modes.csv``.
MODES = ("mode", *MODE_COLUMNS)
_ORDERS = (
    "order",
    "verdict",
    "chance",
    "frequency_hz",
    "frequency_std_hz",
    "damping_ratio",
    "damping_ratio_std",
    "evidence",
)
_VALIDATION = (
    "order",
    "measured_hz",
    "model_hz",
    "error_percent",
    "measured_damping",
    "model_damping",
    "mac",
)


def csv_tables(result: Result) -> dict[str, pd.DataFrame]:
    """Tables of a result folder that are CSV, by file name."""
    return {
        "modes.csv": result.modal_model.to_frame(),
        "shapes.csv": shapes(result),
        "orders.csv": orders(result.modal_model.orders),
        "quality.csv": result.to_frame(),
        "validation.csv": validation(result.validation),
    }


def shapes(result: Result) -> pd.DataFrame:
    """``shapes.csv``: a row for each mode and position (on a circle) or node (elsewhere)."""
    frf, modes = result.frf, result.modal_model.modes
    place = "position_deg" if np.all(np.isfinite(frf.position_deg)) else "node"
    shape = np.concatenate([np.zeros(0), *(mode.shape for mode in modes)])
    columns = {
        "mode": np.repeat(np.arange(1, len(modes) + 1), frf.n_positions),
        place: np.tile(getattr(frf, place), len(modes)),
        "real": shape.real,
        "imag": shape.imag,
    }
    return pd.DataFrame(columns)


def orders(reports: tuple[OrderReport, ...]) -> pd.DataFrame:
    """``orders.csv``: each order by itself, and the verdict on its pair."""
    rows = [
        (
            report.order,
            report.pair.verdict,
            report.pair.chance,
            report.frequency_hz,
            report.frequency_std_hz,
            report.damping_ratio,
            report.damping_std,
            report.pair.evidence,
        )
        for report in reports
    ]
    return pd.DataFrame(rows, columns=list(_ORDERS))


def validation(found: Validation | None) -> pd.DataFrame:
    """``validation.csv``: a row for each order; none where the ring steps were left out."""
    if found is None:
        return pd.DataFrame(columns=list(_VALIDATION))
    columns = {name: getattr(found, name) for name in _VALIDATION}
    return pd.DataFrame({**columns, "mac": np.diag(found.mac)})


def frfs(frf: FRF) -> pd.DataFrame:
    """``frf.parquet`` and ``reference.parquet``, position by position."""
    long = frf.to_frame()
    inertance = long["inertance"].to_numpy()
    columns = {
        "position_deg": long["position_deg"],
        "node": long["node"],
        "frequency_hz": long["frequency_hz"],
        "real": inertance.real,
        "imag": inertance.imag,
        "coherence": long["coherence"].astype(np.float32),
        "std": long["std"].astype(np.float32),
        "row": np.repeat(np.arange(frf.n_positions, dtype=np.int32), frf.frequency_hz.size),
        "run": long["run"].astype("category"),
        "channel": long["channel"].astype("category"),
    }
    return pd.DataFrame(columns)


def poles(diagram: StabilityDiagram) -> pd.DataFrame:
    """``poles.parquet``: every pole of every model order, in the order it was found."""
    return diagram.to_frame().assign(row=np.arange(diagram.cluster.size))
