"""The tables of a result folder, column by column as other programs rely on them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.frf import FRF
from ema.poles.stability import StabilityDiagram
from pipelines.results.result import Result
from pipelines.storage.tables import Row

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
