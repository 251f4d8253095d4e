"""Charts of the data's quality: coherence everywhere, the reference sensor run by run."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.checks.quality import ReferenceCheck
from ema.core.finding import Finding
from ema.core.frf import FRF
from pipelines.plots.chart import (
    FREQUENCY,
    INERTANCE,
    MAP_SCALE,
    MEASURED,
    SERIES,
    Chart,
    as_text,
    axis,
    log_axis,
    packed,
    printed,
)
from pipelines.results.labels import (
    CoherenceMap,
    apart,
    coherence_map,
    in_band,
    place_name,
    sparse_labels,
    wrapped_phase_deg,
)

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


Trace = dict[str, Any]


def magnitude_and_phase(
    frequency_hz: NDArray[np.float64], inertance: NDArray[np.complex128], style: Trace
) -> tuple[Trace, Trace]:
    """Two lines of one FRF, for the axes of `frf_axes`.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
    inertance : ndarray, shape (n_frequencies,)
        In (m/s²)/N.
    style : dict
        Name and line of both, as Plotly names them.
    """
    common = {"type": "scatter", "mode": "lines", "x": packed(frequency_hz), **style}
    magnitude = {
        "y": packed(np.abs(inertance)),
        "hovertemplate": "%{x:.2f} Hz<br>%{y:.3g} (m/s²)/N",
    }
    phase = {
        "yaxis": "y2",
        "y": packed(wrapped_phase_deg(inertance)),
        "hovertemplate": "%{x:.2f} Hz<br>phase %{y:.0f}°",
        "showlegend": False,
    }
    return common | magnitude, common | phase


def frf_axes(phase_share: float = 0.4) -> dict[str, Any]:
    """Axes of magnitude and phase, which share their frequency.

    Parameters
    ----------
    phase_share : float
        Share of the chart's height for the phase.
    """
    return {
        "xaxis": axis(FREQUENCY, anchor="y2"),
        "yaxis": log_axis(INERTANCE, domain=[round(phase_share + 0.06, 3), 1]),
        "yaxis2": axis(
            "phase / °",
            domain=[0, phase_share],
            range=[-190, 190],
            tickvals=[-180, -90, 0, 90, 180],
        ),
    }
