"""Plots of a comparison: changes over the modes, shapes, and FRFs of both results overlaid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipelines.compare.compare import Comparison, common_positions
from pipelines.compare.modes import MatchedMode, mode_name
from pipelines.compare.significance import Difference
from pipelines.plots import plot as go
from pipelines.plots.chart import Chart
from pipelines.plots.measurement import SYMBOLS, drive_point_row
from pipelines.plots.modes import matrix_chart
from pipelines.results.tables import each_once, in_band, short

BARS = "Bars: ± 2 standard deviations of the difference"


def change_chart(
    name: str, quantity: str, modes: Sequence[MatchedMode], differences: Sequence[Difference]
) -> Chart:
    """Relative change of a `quantity`, one for each mode; filled where it is significant."""
    significant = np.array([each.is_significant for each in differences])
    percent = np.array([each.percent for each in differences])
    std = np.array([each.percent_std for each in differences])
    look: dict[str, Any] = {"size": 9, "hover": "%{x}<br>%{y:+.3f} %"}
    series = []
    for label, chosen, colour, marker in (
        ("significant", significant, go.RING, "circle"),
        ("not significant or σ unknown", ~significant, go.FAINT, "circle-open"),
    ):
        if chosen.any():
            points = np.flatnonzero(chosen), percent[chosen], colour, label
            series.append(go.Curve(*points, marker=marker, y_bars=2 * std[chosen], **look))
    across = go.Axis("mode", names=each_once([mode.name for mode in modes]))
    panel = go.Panel((*series, go.Rule(0)), across, go.Axis(f"change of {quantity} / %"))
    count = int(significant.sum())
    return Chart(
        name,
        go.Plot((panel,), (10.5, 7.5), margins=go.Margins(bottom=1.3)),
        f"Change of the {quantity} of {len(modes)} modes in percent; {count} are significant.",
        f"Change of the {quantity}, second against first; {count} of {len(modes)} are significant. "
        f"A change that is the same for all modes has one cause; one that grows or falls over the "
        f"order tells belt from sidewall. Filled: significant. {BARS}.",
        height_px=380,
    )


def several_changes_chart(
    name: str,
    quantity: str,
    modes: Sequence[str],
    results: Sequence[str],
    changes: Sequence[Sequence[Difference | None]],
) -> Chart:
    """Relative changes of a `quantity` over the modes, a curve for each result."""
    series = []
    for k, (result, differences) in enumerate(zip(results, changes, strict=True)):
        values = [
            (np.nan, np.nan) if d is None else (d.percent, d.percent_std) for d in differences
        ]
        percent, std = np.reshape(values, (-1, 2)).T
        colour, marker = go.SERIES[k % len(go.SERIES)], SYMBOLS[k % len(SYMBOLS)]
        look: dict[str, Any] = {"size": 8, "hover": "%{x}<br>%{y:+.3f} %", "y_bars": 2 * std}
        places = np.arange(len(modes))
        series.append(go.Curve(places, percent, colour, short(result), 1.2, marker=marker, **look))
    across = go.Axis("mode", names=each_once(modes))
    panel = go.Panel((*series, go.Rule(0)), across, go.Axis(f"change of {quantity} / %"))
    return Chart(
        name,
        go.Plot((panel,), (13, 7.5), margins=go.Margins(bottom=1.3)),
        f"Change of the {quantity} of {len(modes)} modes in {len(results)} results, in percent.",
        f"Change of the {quantity} against the first result. Curves of one form and different "
        f"size show one cause of different strength, such as pressure or temperature. {BARS}.",
        wide=True,
        height_px=380,
    )


def cross_mac_chart(comparison: Comparison) -> Chart | None:
    """MAC of all shapes of the first against all of the second; None where they are unknown."""
    if comparison.mac.size == 0 or not np.isfinite(comparison.mac).all():
        return None
    rows, columns = (
        each_once([mode_name(k, mode) for k, mode in enumerate(result.modal_model.modes, start=1)])
        for result in (comparison.first, comparison.second)
    )
    first, second = comparison.names
    return matrix_chart(
        comparison.mac,
        rows,
        columns,
        name="mac-between",
        titles=(short(first), short(second)),
        alternative=f"MAC of {len(rows)} shapes of {first} against {len(columns)} of {second}.",
        caption=f"MAC of the shapes of both results. {comparison.shapes_note} Matched modes should "
        "be close to 1, and the only large value in their row; large values elsewhere mean shapes "
        "that the positions cannot tell apart.",
    )


def frf_charts(comparison: Comparison, angles_deg: Sequence[float]) -> tuple[Chart, ...]:
    """FRFs of both results overlaid at the common positions nearest to angles from the force."""
    first, second = comparison.first, comparison.second
    here, there = common_positions(first.frf.position_deg, second.frf.position_deg)
    force_deg = first.excitation_deg
    if here.size == 0 or force_deg is None:
        return ()
    from_force = (first.frf.position_deg[here] - force_deg + 180) % 360 - 180
    chosen = {int(np.argmin(np.abs(from_force - wanted))) for wanted in angles_deg}
    return tuple(_frf_chart(comparison, int(here[k]), int(there[k])) for k in sorted(chosen))


def _frf_chart(comparison: Comparison, here: int, there: int) -> Chart:
    first, second = comparison.first, comparison.second
    where = f"{float(first.frf.position_deg[here]):g}°"
    if here == drive_point_row(first.frf, first.excitation_deg):
        where += ", at the force"
    pairs = []
    for name, result, row, colour, dash in (
        (comparison.names[0], first, here, go.SERIES[0], "solid"),
        (comparison.names[1], second, there, go.SERIES[5], "dash"),
    ):
        lines = in_band(result.frf.frequency_hz, result.modal_model.band_hz)
        curve = result.frf.frequency_hz[lines], result.frf.values[row, lines]
        pairs.append(go.magnitude_and_phase(*curve, colour, short(name), width=1.5, dash=dash))
    levels, phases = zip(*pairs, strict=True)
    axis = go.log_axis(go.INERTANCE, *(curve.y for curve in levels))
    upper = go.Panel(levels, y=axis, legend="lower right")
    lower = go.Panel(phases, go.Axis(go.FREQUENCY), go.PHASE)
    return Chart(
        f"frf-{here}",
        go.Plot((upper, lower), (13, 9), heights=(3, 2)),
        f"Measured inertance of both results at {where}, magnitude and phase.",
        f"Measured inertance of both results at {where}. Peaks that move apart are the change of "
        "frequency, peaks of another height that of damping or of modal mass. A constant factor "
        "between the two is a calibration, not the tyre.",
        wide=True,
        height_px=460,
    )
