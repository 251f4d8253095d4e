"""Charts of the data's quality: coherence everywhere, the reference sensor run by run."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.frf import FRF
from ema.quality import ReferenceCheck
from pipelines.charts_basis import (
    FREQUENCY,
    INERTANCE,
    MAP_SCALE,
    as_text,
    axis,
    log_axis,
    printed,
)
from pipelines.figures_labels import apart, sparse_labels
from pipelines.figures_values import CoherenceMap, coherence_map
from pipelines.report.chart import SERIES, Chart, packed

MOST_CELLS = 120_000  # of a map: more would only make the page heavy
DASHES = ("solid", "dash", "dot", "dashdot")


def coherence_chart(frf: FRF, band_hz: tuple[float, float]) -> Chart:
    """Map of the coherence, position by position over frequency.

    Parameters
    ----------
    frf : FRF
        Its coherence is known somewhere in the band.
    band_hz : tuple of float
    """
    shown = coherence_map(frf, band_hz, max(1, MOST_CELLS // frf.n_positions))
    medians = _medians(shown.values)
    middle = float(np.median(shown.values[np.isfinite(shown.values)]))
    worst = shown.names[int(np.argmin(medians))]
    averaged = f" Each cell is the mean of {shown.averaged} lines." if shown.averaged > 1 else ""
    what = "position" if np.isfinite(frf.position_deg).all() else "node"
    return Chart(
        "coherence",
        (_map(shown, what),),
        _map_layout(shown, what),
        f"Map of the coherence over positions and frequency; median {middle:.3f}, lowest median "
        f"of a {what} {medians.min():.3f} at {worst}.",
        f"Coherence γ², {what} by {what}; the median over the band is {middle:.3f}, the lowest "
        f"median of a {what} is {medians.min():.3f} at {worst}. Dark rows are sensors that did "
        "not follow the force, dark columns are frequencies without excitation; dark spots along "
        f"the nodal lines of a mode are natural.{averaged}",
        printed(
            lambda figures, frf, ax: figures.plot_coherence(frf, ax, band_hz),
            frf,
            size_cm=(17.5, 9),
            right=0.9,
        ),
        wide=True,
        height_px=400,
    )


def _map(shown: CoherenceMap, what: str) -> dict[str, Any]:
    return {
        "type": "heatmap",
        "x": packed(shown.frequency_hz),
        "y": list(shown.names),
        "z": packed(shown.values),
        "zmin": 0,
        "zmax": 1,
        "colorscale": MAP_SCALE,
        "colorbar": {"title": {"text": "γ²"}, "thickness": 12},
        "hovertemplate": f"{what} %{{y}}, %{{x:.2f}} Hz<br>coherence %{{z:.3f}}<extra></extra>",
    }


def _map_layout(shown: CoherenceMap, what: str) -> dict[str, Any]:
    indices, _ = sparse_labels(shown.names)
    step = indices[1] if len(indices) > 1 else 1
    return {
        "xaxis": axis(FREQUENCY),
        "yaxis": axis(what, type="category", tick0=0, dtick=step, showgrid=False),
    }


def reference_chart(check: ReferenceCheck) -> Chart:
    """The reference sensor's inertances of all runs, one over the other.

    Parameters
    ----------
    check : ReferenceCheck
    """
    lines = check.frequency_hz
    start, step = float(lines[0]), float(np.mean(np.diff(lines))) if lines.size > 1 else 1.0
    traces = tuple(
        {
            "type": "scatter",
            "mode": "lines",
            "name": as_text(name),
            "x0": start,
            "dx": step,
            "y": packed(np.abs(values)),
            "line": _line(index),
            "hovertemplate": "%{x:.2f} Hz<br>%{y:.3g} (m/s²)/N<extra>%{fullData.name}</extra>",
        }
        for index, (name, values) in enumerate(zip(apart(check.run), check.values, strict=True))
    )
    return Chart(
        "reference",
        traces,
        {"xaxis": axis(FREQUENCY), "yaxis": log_axis(INERTANCE)},
        f"Inertance at the reference sensor of {len(check.run)} runs, one over the other; "
        f"{reference_verdict(check)}.",
        "Inertance at the sensor that stayed in place, run by run. The curves should coincide; "
        "peaks that move point to a tyre that warmed up, lost pressure or was remounted.",
        printed(lambda figures, *data: figures.plot_reference(*data), check, size_cm=(10, 8)),
        height_px=400,
    )


def reference_verdict(check: ReferenceCheck) -> str:
    """Verdict of the check in a few words."""
    if not np.isfinite(check.ratio):
        return "whether they differ by more than noise is unknown"
    if check.consistent:
        return f"they differ {check.ratio:.2f} times as much as noise explains: one tyre"
    return f"they differ {check.ratio:.2f} times as much as noise explains: the runs differ"


def _medians(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Median of each row; infinite where nothing is known."""
    known = [row[np.isfinite(row)] for row in values]
    return np.array([np.median(row) if row.size else np.inf for row in known])


def _line(index: int) -> dict[str, Any]:
    """Colour of the run; from the eighth run on the colours come again, dashed."""
    dash = DASHES[index // len(SERIES) % len(DASHES)]
    return {"color": SERIES[index % len(SERIES)], "width": 1.3, "dash": dash}
