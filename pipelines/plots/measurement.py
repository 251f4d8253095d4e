"""Plots of the measurement: set-up, coherence, reference sensor, FRF at the force."""

from __future__ import annotations

from typing import Any

import numpy as np

from ema.checks.quality import ReferenceCheck
from ema.core.display import number
from ema.core.finding import Finding
from ema.core.frf import FRF
from pipelines.plots import plot as go
from pipelines.plots.chart import Chart
from pipelines.results.tables import apart, coherence_map, in_band, place_name, sparse_labels

MOST_CELLS = 120_000  # of a map: more would only make the page heavy
MOST_NAMED_RUNS = 14
#: A sensor that far from the force counts as being at the force.
FARTHEST_DEG = 5.0
CLEAR = 2.0  # standard deviations below zero that are not noise
SYMBOLS = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross", "x")


def setup_chart(
    frf: FRF, excitation_deg: float | None = None, reference_deg: float | None = None
) -> Chart:
    """The tyre from the side: measured positions by run, the force and the reference sensor."""
    runs = list(dict.fromkeys(frf.run))
    at = np.asarray(frf.position_deg, dtype=float)
    circle = np.linspace(0, 360, 181)
    series: list[Any] = [
        go.Curve(*on_circle(circle, 1.0), go.FAINT, width=3.0),
        go.Curve(*on_circle(circle, 0.55), go.FAINT, width=1.0),
    ]
    for index, (run, name) in enumerate(zip(runs, apart(runs), strict=True)):
        x, y = on_circle(at[np.array([each == run for each in frf.run])], 1.0)
        look = SYMBOLS[index % len(SYMBOLS)]
        size = 9 if frf.n_positions <= 150 else 5
        colour, listed = go.SERIES[index % len(go.SERIES)], index < MOST_NAMED_RUNS
        name = name if run else "positions"
        series.append(go.Curve(x, y, colour, name, marker=look, size=size, listed=listed))
    series += [go.Note(*on_circle(angle, 0.72), f"{angle}°") for angle in (0, 90, 180, 270)]
    x, y = 0.0, 0.0
    if excitation_deg is not None:
        series += _force(excitation_deg)
        x, y = on_circle(excitation_deg, 1.6)
    if reference_deg is not None:
        place = on_circle([reference_deg], 0.87)
        series.append(go.Curve(*place, go.MEASURED, "reference", marker="star", size=17))
    unnamed = max(0, len(runs) - MOST_NAMED_RUNS)
    more = f" {unnamed} further runs are drawn, but not named." if unnamed else ""
    across, up = (go.Axis(range=(min(-1.12, end), max(1.12, end))) for end in (x, y))
    panel = go.Panel(tuple(series), across, up, legend="center", equal=True, bare=True)
    return Chart(
        "setup",
        go.Plot((panel,), (11.5, 9.5), margins=go.Margins(0.1, 0.1, 0.1, 0.1)),
        f"Circle with {frf.n_positions} measured positions of {len(runs)} runs"
        f"{_at(', the force', excitation_deg)}{_at(', the reference sensor', reference_deg)}.",
        "Measured positions by run, seen from the side; angles run counter-clockwise. Look for "
        "gaps: they lower the highest order that can be distinguished from lower ones, which has "
        f"fewer than half as many waves as there are positions.{more}",
        height_px=430,
    )


def coherence_chart(frf: FRF, band_hz: tuple[float, float]) -> Chart:
    """Map of the coherence, position by position over frequency."""
    shown = coherence_map(frf, band_hz, max(1, MOST_CELLS // frf.n_positions))
    known = [row[np.isfinite(row)] for row in shown.values]
    medians = np.array([np.median(row) if row.size else np.inf for row in known])
    indices, _ = sparse_labels(shown.names)
    what = "position" if np.isfinite(frf.position_deg).all() else "node"
    hover = f"{what} %{{y}}, %{{x:.2f}} Hz<br>coherence %{{z:.3f}}"
    series: list[Any] = [go.Map(shown.values, 0, 1, "map", hover, shown.frequency_hz, "γ²")]
    words = "Map of the coherence; it is unknown.", "The coherence is unknown."
    if np.isfinite(medians).any():
        middle = float(np.median(np.concatenate(known)))
        lowest = f"{medians.min():.3f} at {shown.names[int(np.argmin(medians))]}"
        width = shown.averaged
        averaged = f" Each cell is the mean of {width} lines." if width > 1 else ""
        words = (
            f"Map of the coherence over positions and frequency; median {middle:.3f}, lowest "
            f"median of a {what} {lowest}.",
            f"Coherence γ², {what} by {what}; the median over the band is {middle:.3f}, the lowest "
            f"median of a {what} is {lowest}. Dark rows are sensors that did not follow the force, "
            "dark columns are frequencies without excitation; dark spots along the nodal lines of "
            f"a mode are natural.{averaged}",
        )
    else:
        series.append(go.Note(float(np.mean(band_hz)), len(shown.names) / 2, "coherence unknown"))
    up = go.Axis(what, names=shown.names, every=indices[1] if len(indices) > 1 else 1)
    panel = go.Panel(tuple(series), go.Axis(go.FREQUENCY), up)
    plot = go.Plot((panel,), (17.5, 8), margins=go.Margins(right=0.9))
    return Chart("coherence", plot, *words, wide=True, height_px=400)


def reference_chart(check: ReferenceCheck, band_hz: tuple[float, float] | None = None) -> Chart:
    """The reference sensor's inertances of all runs, one over the other."""
    band = band_hz or (check.frequency_hz[0], check.frequency_hz[-1])
    inside = in_band(check.frequency_hz, band)
    hover = "%{x:.2f} Hz<br>%{y:.3g} (m/s²)/N<extra>%{fullData.name}</extra>"
    frequency_hz, levels = check.frequency_hz[inside], np.abs(check.values[:, inside])
    curves = []
    for index, (name, level) in enumerate(zip(apart(check.run), levels, strict=True)):
        repeats, index = divmod(index, len(go.SERIES))  # the colours come again, dashed
        dash = go.DASHES[repeats % len(go.DASHES)]
        look = go.SERIES[index], name, 1.3, dash
        curves.append(go.Curve(frequency_hz, level, *look, hover=hover))
    axes = go.Axis(go.FREQUENCY, band), go.log_axis(go.INERTANCE, levels)
    return Chart(
        "reference",
        go.Plot((go.Panel(tuple(curves), *axes, legend="lower right"),)),
        f"Inertance at the reference sensor of {len(check.run)} runs, one over the other; "
        f"{reference_verdict(check)}.",
        "Inertance at the sensor that stayed in place, run by run. The curves should coincide; "
        "peaks that move point to a tyre that warmed up, lost pressure or was remounted.",
        height_px=400,
    )


def reference_verdict(check: ReferenceCheck) -> str:
    """Verdict of the check in a few words."""
    if not np.isfinite(check.ratio):
        return "not assessed, its noise is unknown"
    verdict = "the same tyre in all runs" if check.consistent else "the runs differ"
    return f"{verdict} ({number(check.ratio, 3)} times the noise)"


def drive_point_row(frf: FRF, excitation_deg: float | None) -> int | None:
    """Row of the FRF at the force; None where no sensor was there."""
    if excitation_deg is None or not np.isfinite(frf.position_deg).any():
        return None
    distance = np.abs((frf.position_deg - excitation_deg + 180) % 360 - 180)
    nearest = int(np.nanargmin(distance))
    return nearest if distance[nearest] <= FARTHEST_DEG else None


def share_taken_out(frf: FRF, row: int, band_hz: tuple[float, float]) -> float:
    """Share of the lines at which the structure would feed power into the shaker.

    At the force the real part of the mobility, hence the imaginary part of the inertance, is not
    negative. Counted are lines where it is, by more than two standard deviations.
    """
    lines = in_band(frf.frequency_hz, band_hz)
    noise = np.nan_to_num(frf.std[row, lines], nan=0.0)
    return float(np.mean(frf.values[row, lines].imag < -CLEAR * noise))


def drive_point_chart(
    frf: FRF, row: int, band_hz: tuple[float, float], finding: Finding | None = None
) -> Chart:
    """Magnitude and phase of the FRF at the force; `finding` is of the check of its place."""
    lines = in_band(frf.frequency_hz, band_hz)
    top, low = go.magnitude_and_phase(frf.frequency_hz[lines], frf.values[row, lines], go.MEASURED)
    limits = tuple(go.Rule(limit, go.MEASURED, "dot") for limit in (0, 180))
    panels = (
        go.Panel((top,), go.Axis(range=band_hz), go.log_axis(go.INERTANCE, top.y)),
        go.Panel((low, *limits), go.Axis(go.FREQUENCY, band_hz), go.PHASE),
    )
    name = place_name(int(frf.node[row]), float(frf.position_deg[row]))
    outside = f"{100 * share_taken_out(frf, row, band_hz):.1f} %"
    verdict = f" Verdict: {finding.verdict}, {finding.detail}." if finding is not None else ""
    return Chart(
        "drive-point",
        go.Plot(panels, heights=(3, 2)),
        f"Magnitude and phase of the inertance at the force ({name}); at {outside} of the lines "
        "the phase leaves 0° to 180° by more than noise.",
        f"Inertance at the force ({name}). Its phase has to stay between 0° and 180° (dotted), "
        "and an antiresonance has to lie between any two resonances; a phase outside means a "
        f"wrong sign or another place. At {outside} of the lines it is outside by more than "
        f"noise.{verdict}",
        height_px=400,
    )


def on_circle(angle_deg: Any, radius: Any) -> tuple[Any, Any]:
    """Points of a circle around the origin; angles run counter-clockwise from the right."""
    angle = np.deg2rad(angle_deg)
    return radius * np.cos(angle), radius * np.sin(angle)


def _force(angle_deg: float) -> list[Any]:
    """An arrow from outside onto the tread."""
    tip, tail = on_circle(angle_deg, 1.06), on_circle(angle_deg, 1.42)
    middle, side = np.array(on_circle(angle_deg, 1.17)), on_circle(angle_deg + 90, 0.045)
    x, y = np.array([tail, tip, middle + side, tip, middle - side]).T
    arrow = go.Curve(x, y, go.FITTED, "force", width=3)
    return [arrow, go.Note(*on_circle(angle_deg, 1.5), "F", go.MEASURED)]


def _at(what: str, angle_deg: float | None) -> str:
    return "" if angle_deg is None else f"{what} at {angle_deg:g}°"
