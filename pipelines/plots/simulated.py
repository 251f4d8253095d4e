"""Plots of what the ring model predicts: free waves, inertance, cleat test, hub, road."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import Bifurcation, HubResponse
from pipelines.plots import plot as go
from pipelines.plots.measurement import on_circle
from pipelines.results.labels import wrapped_phase_deg
from pipelines.simulate.responses import CleatResponse, LoadedSweep, SimulatedInertance

DEFLECTION = 0.25  # drawn deflection of a wave of unit amplitude, in radii
#: Colours from dark to light for a sequence, all visible on white: viridis in ten steps.
SHADES = (
    "#440154", "#482475", "#414487", "#355f8d", "#2a788e",
    "#21918c", "#22a884", "#44bf70", "#7ad151", "#bddf26",
)  # fmt: skip


def waves_over_speed(found: Bifurcation, title: str = "", marked: float | None = None) -> go.Panel:
    """Frequencies over speed: regressive waves solid, progressive ones dashed.

    A line marks the speed `marked`, rad/s.
    """
    series: list[Any] = [] if marked is None else [go.Rule(marked, upright=True)]
    for row, order in enumerate(found.orders):
        colour = go.SERIES[row % len(go.SERIES)]
        for values, dash in ((found.regressive_hz, "solid"), (found.progressive_hz, "dash")):
            series.append(go.Curve(found.speed_rad_s, values[row], colour, width=1.7, dash=dash))
        known = np.flatnonzero(np.isfinite(found.regressive_hz[row]))
        if known.size:
            end = float(found.speed_rad_s[known[-1]]), float(found.standing_hz[row, known[-1]])
            series.append(go.Note(*end, f"  n = {order}", colour, align="left"))
    series += [
        go.Curve([], [], go.MEASURED, name, width=1.7, dash=dash)
        for name, dash in (("regressive", "solid"), ("progressive", "dash"))
    ]
    across, up = go.Axis("speed Ω / (rad/s)"), go.Axis(go.FREQUENCY)
    return go.Panel(tuple(series), across, up, title=title, legend="upper left")


def frequencies_plot(found: Bifurcation) -> go.Plot:
    """Frequencies over speed, or over the order where there is one speed only."""
    room = go.Margins(right=1.3)
    if found.speed_rad_s.size > 1:
        return go.Plot((waves_over_speed(found),), (14, 10), margins=room)
    series = tuple(
        go.Curve(found.orders, values[:, 0], colour, name, width=1.7, dash=dash, marker=marker)
        for values, colour, name, dash, marker in (
            (found.regressive_hz, go.RING, "regressive", "solid", "circle"),
            (found.progressive_hz, go.FITTED, "progressive", "dash", "square"),
        )
    )
    axes = go.Axis(go.ORDER, ticks=found.orders.tolist()), go.Axis(go.FREQUENCY)
    title = f"Ω = {found.speed_rad_s[0]:g} rad/s"
    panel = go.Panel(series, *axes, title=title, legend="upper left")
    return go.Plot((panel,), (14, 10), margins=room)


def waves_plot(angles_rad: ArrayLike, times_s: ArrayLike, field: NDArray[np.float64]) -> go.Plot:
    """The ring at both ends of a cycle, and its radial displacement at every instant.

    `field`, shape (n_angles, n_times), is the radial displacement, the largest value being 1; the
    angles are a closed turn.
    """
    angles, times_ms = np.rad2deg(np.asarray(angles_rad)), 1e3 * np.asarray(times_s)
    ring = [go.Curve(*on_circle(angles, 1.0), go.FAINT, width=1)]
    for index, places, colour, dash in ((0, 0, go.MEASURED, "solid"), (-1, 2, go.FITTED, "dash")):
        curve = on_circle(angles, 1.0 + DEFLECTION * field[:, index])
        name = f"{times_ms[index]:.{places}f} ms"
        ring.append(go.Curve(*curve, colour, name, width=2.0, dash=dash))
    unrolled = tuple(
        go.Curve(angles, curve, shade, f"{time:.1f} ms", width=1.4)
        for shade, time, curve in zip(_shades(times_ms.size), times_ms, field.T, strict=True)
    )
    across = go.Axis("angle / °", (0, 360), ticks=range(0, 361, 60))
    up = go.Axis("radial displacement / its maximum")
    panels = (
        go.Panel(tuple(ring), legend="center", equal=True, bare=True),
        go.Panel(unrolled, across, up, legend="beside"),
    )
    room = go.Margins(left=0.2, right=2.4, between_columns=1.8)
    return go.Plot(panels, (20, 8), 2, widths=(1, 1.5), margins=room)


def inertances(
    curves: Mapping[str, SimulatedInertance],
    looks: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    title: str = "",
    across: str = go.FREQUENCY,
) -> go.Panel:
    """Magnitudes of inertances in one unit on a logarithmic axis.

    `looks` are properties of a `Curve` by name, in place of the usual ones; `across` is empty
    where a panel below has the title of the frequency axis.
    """
    series = []
    for index, (name, curve) in enumerate(curves.items()):
        colour, dash = go.SERIES[index % len(go.SERIES)], go.DASHES[index % len(go.DASHES)]
        look: dict[str, Any] = {"colour": colour, "name": name, "width": 1.7, "dash": dash}
        look |= {"listed": len(curves) > 1, **(looks or {}).get(name, {})}
        series.append(go.Curve(curve.frequency_hz, curve.magnitude, **look))
    unit = next(iter(curves.values())).unit
    levels = go.log_axis(f"|inertance| / ({unit})", *(curve.y for curve in series))
    return go.Panel(tuple(series), go.Axis(across), levels, title=title, legend="lower right")


def inertance_plot(found: SimulatedInertance) -> go.Plot:
    """Magnitude and phase of an inertance."""
    phase = go.Curve(found.frequency_hz, wrapped_phase_deg(found.values), go.RING, width=1.7)
    low = go.Panel((phase,), go.Axis(go.FREQUENCY), go.PHASE)
    return go.Plot((inertances({"inertance": found}, across=""), low), (15, 11), heights=(3, 2))


def cleat_plot(found: CleatResponse) -> go.Plot:
    """The response of a point after the blow, over time and over frequency."""
    quantity, unit = found.observer.quantity, found.observer.unit
    time = go.Curve(1e3 * found.time_s, found.response, go.RING, width=1.7)
    spectrum = go.Curve(found.frequency_hz, np.abs(found.spectrum), go.RING, width=1.7)
    levels = go.log_axis(f"|spectrum| / ({unit}·s)", spectrum.y)
    panels = (
        go.Panel((time,), go.Axis("time / ms"), go.Axis(f"{quantity} / ({unit})")),
        go.Panel((spectrum,), go.Axis(go.FREQUENCY), levels),
    )
    return go.Plot(panels, (15, 12), margins=go.Margins(between_rows=1.4))


def hub_plot(found: HubResponse) -> go.Plot:
    """Forces and moment on the hub per unit of force on the belt."""
    series = tuple(
        go.Curve(found.frequency_hz, np.abs(values), colour, name, width=1.7, dash=dash)
        for values, name, colour, dash in (
            (found.force_x, "force x / N", go.RING, "solid"),
            (found.force_z, "force z / N", go.FITTED, "dash"),
            (found.moment_m, "moment / (N m)", go.KEPT, "dashdot"),
        )
        if np.abs(values).max() > 0
    )
    levels = go.log_axis("at the hub per N on the belt", *(curve.y for curve in series))
    return go.Plot((go.Panel(series, go.Axis(go.FREQUENCY), levels),), (15, 9))


def loaded_plot(found: LoadedSweep) -> go.Plot:
    """Change of each frequency with the load, and the deflection by the largest load."""
    rising = np.argsort(found.load_n)
    orders = found.dominant_order[rising[-1]]
    shades = _shades(int(orders.max()) + 1)
    changes = []
    for mode, order in enumerate(orders):
        second = bool(np.any(orders[:mode] == order))
        frequency_hz = found.frequency_hz[rising, mode]
        if frequency_hz[0] < 1.0:  # the rigid tyre off the road
            continue
        percent = 100.0 * (frequency_hz / frequency_hz[0] - 1.0)
        look = 1.7, "dash" if second else "solid", "circle", 4.0
        name, listed = f"n = {order}", not second
        curve = go.Curve(found.load_n[rising], percent, shades[order], name, *look, listed=listed)
        changes.append(curve)
    deflection = go.Curve(found.angle_deg, 1e3 * found.deflection_m, go.RING, width=1.7)
    around = go.Axis("angle from the contact / °", (-180, 180), ticks=range(-180, 181, 60))
    load, change = go.Axis("vertical load / N"), go.Axis("change of frequency / %")
    title = f"load {found.load_n.max():g} N"
    panels = [
        go.Panel(tuple(changes), load, change, legend="beside"),
        go.Panel((deflection,), around, go.Axis("radial deflection / mm"), title=title),
    ]
    if found.static is not None:
        deflection_mm = 1e3 * found.static.deflection_m[rising]
        curve = go.Curve(
            deflection_mm, found.load_n[rising], go.RING, "", 1.7, "solid", "circle", 4.0
        )
        panels.append(go.Panel((curve,), go.Axis("deflection / mm"), load))
    return go.Plot(
        tuple(panels), (15, 7 * len(panels)), margins=go.Margins(right=2.2, between_rows=1.9)
    )


def _shades(count: int) -> Sequence[str]:
    places = np.linspace(0, len(SHADES) - 1, count).round().astype(int)
    return [SHADES[place] for place in places]
