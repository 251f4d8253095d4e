"""The tables of a result folder, column by column as other programs rely on them."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.frf import FRF
from ema.stability import StabilityDiagram
from ema.visible import inert
from pipelines.result import Result

Row = tuple[Any, ...]

MODES = (
    "mode",
    "order",
    "member",
    "frequency_hz",
    "frequency_std_hz",
    "damping_ratio",
    "damping_ratio_std",
    "mpc",
    "mpd_deg",
    "order_purity",
    "status",
    "frequency_band_shift_hz",
    "damping_ratio_band_shift",
)
QUALITY = ("run", "channel", "position_deg", "check", "verdict", "detail")
VALIDATION = (
    "order",
    "measured_hz",
    "model_hz",
    "error_percent",
    "measured_damping",
    "model_damping",
    "mac",
)
ORDERS = (
    "order",
    "verdict",
    "chance",
    "frequency_hz",
    "frequency_std_hz",
    "damping_ratio",
    "damping_ratio_std",
    "evidence",
)


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Row]) -> None:
    """Write a table; None and NaN become empty cells, floats keep every digit.

    Texts are inert: none is taken for a formula, and nothing in them acts on a terminal.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([inert(column) for column in columns])
        writer.writerows([_cell(value) for value in row] for row in rows)


def modes_rows(result: Result) -> list[Row]:
    """Rows of ``modes.csv``."""
    return [
        (
            number,
            mode.order,
            mode.member,
            mode.frequency_hz,
            mode.frequency_std_hz,
            mode.damping_ratio,
            mode.damping_std,
            mode.mpc,
            mode.mpd_deg,
            mode.order_purity,
            mode.status,
            mode.frequency_band_shift_hz,
            mode.damping_band_shift,
        )
        for number, mode in enumerate(result.modal_model.modes, start=1)
    ]


def shapes_columns(result: Result) -> tuple[str, ...]:
    """Columns of ``shapes.csv``: positions on a circle, nodes elsewhere."""
    return ("mode", "position_deg" if _on_circle(result.frf) else "node", "real", "imag")


def shapes_rows(result: Result) -> list[Row]:
    """Rows of ``shapes.csv``."""
    place = result.frf.position_deg if _on_circle(result.frf) else result.frf.node
    return [
        (number, where, value.real, value.imag)
        for number, mode in enumerate(result.modal_model.modes, start=1)
        for where, value in zip(place, mode.shape, strict=True)
    ]


def orders_rows(result: Result) -> list[Row]:
    """Rows of ``orders.csv``: each order by itself, and the verdict on its pair."""
    return [
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
        for report in result.modal_model.orders
    ]


def quality_rows(result: Result) -> list[Row]:
    """Rows of ``quality.csv``."""
    return [
        (f.run, f.channel, f.position_deg, f.check, f.verdict, f.detail) for f in result.findings
    ]


def validation_rows(result: Result) -> list[Row]:
    """Rows of ``validation.csv``; none where the ring steps were left out."""
    found = result.validation
    if found is None:
        return []
    return list(
        zip(
            found.order,
            found.measured_hz,
            found.model_hz,
            found.error_percent,
            found.measured_damping,
            found.model_damping,
            np.diag(found.mac),
            strict=True,
        )
    )


def frf_columns(frf: FRF) -> dict[str, NDArray[Any]]:
    """Columns of ``frf.parquet``, position by position."""
    n_lines = frf.frequency_hz.size
    return {
        "position_deg": np.repeat(frf.position_deg, n_lines),
        "node": np.repeat(frf.node, n_lines),
        "frequency_hz": np.tile(frf.frequency_hz, frf.n_positions),
        "real": frf.values.real.ravel(),
        "imag": frf.values.imag.ravel(),
        "coherence": frf.coherence.ravel().astype(np.float32),
        "std": frf.std.ravel().astype(np.float32),
        "row": np.repeat(np.arange(frf.n_positions, dtype=np.int32), n_lines),
    }


def poles_columns(diagram: StabilityDiagram) -> dict[str, NDArray[Any]]:
    """Columns of ``poles.parquet``."""
    return {
        "order": diagram.model_order,
        "frequency_hz": diagram.frequency_hz,
        "damping_ratio": diagram.damping_ratio,
        "stable_frequency": diagram.stable_frequency,
        "stable_damping": diagram.stable_damping,
        "cluster": diagram.cluster,
        "row": np.arange(diagram.cluster.size),
    }


def _on_circle(frf: FRF) -> bool:
    return bool(np.all(np.isfinite(frf.position_deg)))


def _cell(value: Any) -> Any:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    return repr(float(value)) if isinstance(value, float) else inert(value)
