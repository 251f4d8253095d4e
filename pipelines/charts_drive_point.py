"""The FRF at the force as a chart: where force and sign are wrong, it shows here first."""

from __future__ import annotations

from typing import Any

import numpy as np

from ema.frf import FRF
from ema.quality import Finding
from pipelines.charts_basis import printed
from pipelines.charts_frf import frf_axes, magnitude_and_phase
from pipelines.figures_labels import place_name
from pipelines.figures_values import in_band
from pipelines.report.chart import MEASURED, Chart

FARTHEST_DEG = 5.0  # a sensor that far from the force still stands for the place of the force
CLEAR = 2.0  # standard deviations below zero that are not noise


def drive_point_row(frf: FRF, excitation_deg: float | None) -> int | None:
    """Row of the FRF at the force; None where no sensor sat there."""
    if excitation_deg is None or not np.isfinite(frf.position_deg).any():
        return None
    distance = np.abs((frf.position_deg - excitation_deg + 180) % 360 - 180)
    nearest = int(np.nanargmin(distance))
    return nearest if distance[nearest] <= FARTHEST_DEG else None


def share_taken_out(frf: FRF, row: int, band_hz: tuple[float, float]) -> float:
    """Share of the lines at which the structure would feed power into the shaker.

    At the force the real part of the mobility, hence the imaginary part of the inertance, is not
    negative. Counted are lines where it is, by more than two standard deviations.

    Parameters
    ----------
    frf : FRF
    row : int
        From `drive_point_row`.
    band_hz : tuple of float
    """
    lines = in_band(frf.frequency_hz, band_hz)
    noise = np.nan_to_num(frf.std[row, lines], nan=0.0)
    return float(np.mean(frf.values[row, lines].imag < -CLEAR * noise))


def drive_point_chart(
    frf: FRF, row: int, band_hz: tuple[float, float], finding: Finding | None = None
) -> Chart:
    """Magnitude and phase of the FRF at the force.

    Parameters
    ----------
    frf : FRF
    row : int
        From `drive_point_row`.
    band_hz : tuple of float
        Band shown.
    finding : Finding, optional
        What the shapes say about the place of the force.
    """
    name = place_name(int(frf.node[row]), float(frf.position_deg[row]))
    outside = f"{100 * share_taken_out(frf, row, band_hz):.1f} %"
    verdict = f" Verdict: {finding.verdict}, {finding.detail}." if finding is not None else ""
    return Chart(
        "drive-point",
        _traces(frf, row, band_hz),
        _layout(),
        f"Magnitude and phase of the inertance at the force ({name}); at {outside} of the lines "
        "the phase leaves 0° to 180° by more than noise.",
        f"Inertance at the force ({name}). Its phase has to stay between 0° and 180° (dotted), "
        "and an antiresonance has to lie between each two resonances; a phase outside means a "
        f"wrong sign or another place. By more than noise it is outside at {outside} of the "
        f"lines.{verdict}",
        _printed(frf, row, band_hz),
        height_px=400,
    )


def _traces(frf: FRF, row: int, band_hz: tuple[float, float]) -> tuple[dict[str, Any], ...]:
    lines = in_band(frf.frequency_hz, band_hz)
    style = {"name": "", "line": {"color": MEASURED, "width": 1.3}, "showlegend": False}
    return magnitude_and_phase(frf.frequency_hz[lines], frf.values[row, lines], style)


def _layout() -> dict[str, Any]:
    limits = [
        {
            "type": "line",
            "xref": "paper",
            "yref": "y2",
            "x0": 0,
            "x1": 1,
            "y0": limit,
            "y1": limit,
            "line": {"color": MEASURED, "width": 1, "dash": "dot"},
        }
        for limit in (0, 180)
    ]
    return {**frf_axes(), "shapes": limits}


def _printed(frf: FRF, row: int, band_hz: tuple[float, float]) -> Any:
    return printed(
        lambda figures, *data: figures.plot_drive_point(*data),
        frf,
        row,
        band_hz,
        size_cm=(10, 8),
        rows=2,
    )
