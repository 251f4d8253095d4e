"""Plots of many FRFs: their sum against the synthesis, positions overlaid, and the Nyquist plot."""

from __future__ import annotations

import numpy as np

from ema.core.frf import FRF
from ema.core.modes import ModalModel
from pipelines.plots import plot as go
from pipelines.plots.chart import Chart
from pipelines.plots.modes import fitted_curves, position_names, shown_band_hz
from pipelines.results.labels import in_band

_OVERLAID = 7  # as many colours as can be told apart


def sum_chart(frf: FRF, model: ModalModel) -> Chart:
    """Sum of the magnitudes of all FRFs, measured and synthesised from the modes."""
    lines = in_band(frf.frequency_hz, model.fit_band_hz)
    frequency_hz = frf.frequency_hz[lines]
    measured = np.abs(frf.values[:, lines]).sum(axis=0)
    fitted = np.abs(model.synthesise(frequency_hz, frf.run)).sum(axis=0)
    hover = "%{x:.2f} Hz<br>%{y:.4~g} (m/s²)/N"
    series = (
        go.Curve(frequency_hz, fitted, go.FITTED, "synthesised", 3.0, hover=hover),
        go.Curve(frequency_hz, measured, go.MEASURED, "measured", 1.0, hover=hover),
    )
    unit = "Σ |inertance| / ((m/s²)/N)"
    panel = go.Panel(series, go.Axis(go.FREQUENCY), go.log_axis(unit, measured, fitted))
    off = float(np.median(np.abs(fitted / np.where(measured > 0, measured, np.nan) - 1)))
    finding = f"they differ by {100 * off:.2g} % at half of the lines"
    return Chart(
        "frf-sum",
        go.Plot((panel,), (10.5, 7.5)),
        f"Sum of the magnitudes of {frf.n_positions} FRFs, measured and synthesised; {finding}.",
        f"Sum of the magnitudes of all FRFs, measured and synthesised from the modes; {finding}. A "
        "peak of the measured curve that the synthesis lacks is a missing mode.",
    )


def nyquist_chart(frf: FRF, model: ModalModel, row: int) -> Chart:
    """Real against imaginary part of one FRF in the band; the page follows the position chosen."""
    curves = fitted_curves(frf, model, row)
    series = []
    for name, (colour, width, marker) in {
        "fitted": (go.FITTED, 2.0, ""),
        "measured": (go.MEASURED, 0.0, "circle"),
    }.items():
        frequency_hz, values = curves[name]
        inside = in_band(frequency_hz, model.band_hz)
        at = values.real[inside], values.imag[inside]
        series.append(go.Curve(*at, colour, name, width, marker=marker, size=3))
    unit = "inertance / ((m/s²)/N)"
    panel = go.Panel(
        tuple(series),
        go.Axis(f"real part of {unit}"),
        go.Axis(f"imaginary part of {unit}"),
        equal=True,
    )
    return Chart(
        "nyquist",
        go.Plot((panel,), (9.5, 9)),
        f"Nyquist plot of the inertance at {position_names(frf)[row]}, measured and fitted.",
        "Nyquist plot of the position chosen, in the band. Every mode is a circle; measured points "
        "that leave the fitted circle on one side mean damping or phase that the fit has not.",
        height_px=420,
    )


def overlay_chart(frf: FRF, model: ModalModel) -> Chart:
    """Measured magnitudes at several positions around the tyre, overlaid."""
    lines = in_band(frf.frequency_hz, shown_band_hz(model))
    frequency_hz, names = frf.frequency_hz[lines], position_names(frf)
    order = np.argsort(frf.position_deg, kind="stable")
    count = min(_OVERLAID, frf.n_positions)
    rows = order[np.linspace(0, frf.n_positions, count, endpoint=False).astype(int)]
    levels, hover = np.abs(frf.values[rows][:, lines]), "%{x:.2f} Hz<br>%{y:.4~g} (m/s²)/N"
    series = tuple(
        go.Curve(frequency_hz, level, go.SERIES[k], names[row], 1.2, hover=hover)
        for k, (row, level) in enumerate(zip(rows, levels, strict=True))
    )
    panel = go.Panel(series, go.Axis(go.FREQUENCY), go.log_axis(go.INERTANCE, levels))
    return Chart(
        "frf-overlay",
        go.Plot((panel,), (13, 8)),
        f"Measured inertance at {count} positions, overlaid: {', '.join(names[r] for r in rows)}.",
        f"Measured inertance at {count} of {frf.n_positions} positions. Peaks are at the same "
        "frequencies everywhere; one that moves from position to position is a drift between runs.",
        wide=True,
        height_px=330,
    )
