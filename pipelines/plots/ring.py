"""Plots of the ring: the tuned one beside the measurement, and what a ring predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.display import signed
from model.identifiability import Correlation, Sensitivity
from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.plots import plot as go
from pipelines.plots.chart import Chart
from pipelines.plots.measurement import on_circle
from pipelines.plots.modes import matrix_chart
from pipelines.results.options import UNITS_PA
from pipelines.results.result import Validation
from pipelines.results.tables import wrapped_phase_deg

if TYPE_CHECKING:  # a report shows none of these
    from model import Bifurcation, HubResponse
    from pipelines.library.history import Series, Trend
    from pipelines.simulate.responses import CleatResponse, LoadedSweep, SimulatedInertance

TOLERANCE_PERCENT = 1.0
TOLERANCE = f"±{TOLERANCE_PERCENT:g} %"
WITH_BARS = "Bars: ± 2 standard deviations of the measurement"
WEAK = 0.02  # % change of frequency for 1 % of a parameter that hardly moves anything
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
DEFLECTION = 0.25  # drawn deflection of a wave of unit amplitude, in radii
#: Colours from dark to light for a sequence, all visible on white: viridis in ten steps.
SHADES = (
    "#440154", "#482475", "#414487", "#355f8d", "#2a788e",
    "#21918c", "#22a884", "#44bf70", "#7ad151", "#bddf26",
)  # fmt: skip


def scatter_chart(found: Validation, std_hz: go.Floats | None = None) -> Chart:
    """Frequencies of the ring over the measured ones, with bars of 2 `std_hz` (NaN: unknown)."""
    every = np.concatenate([found.measured_hz, found.model_hz])
    margin = 0.08 * (every.max() - every.min()) + 1.0
    ends = np.array([every.min() - margin, every.max() + margin])
    half = TOLERANCE_PERCENT / 100 * ends
    orders = go.Curve(
        found.measured_hz,
        found.model_hz,
        go.RING,
        "orders",
        marker="circle",
        size=9,
        hover="n = %{text}<br>measured %{x:.2f} Hz<br>ring %{y:.2f} Hz (%{customdata:+.2f} %)",
        texts=[f"{order}" for order in found.order],
        labelled=True,
        values=found.error_percent,
        x_bars=None if std_hz is None else 2 * std_hz,
        listed=False,
    )
    band = go.Band(ends, ends - half, ends + half, go.RING, TOLERANCE)
    limits = (float(ends[0]), float(ends[1]))
    axes = go.Axis("measured / Hz", limits), go.Axis("ring model / Hz", limits)
    series = band, go.Curve(ends, ends, go.FAINT, width=1), orders
    panel = go.Panel(series, *axes, legend="lower right", equal=True)
    within = int(np.sum(np.abs(found.error_percent) <= TOLERANCE_PERCENT))
    return Chart(
        "frequency-scatter",
        go.Plot((panel,), (9.5, 9)),
        f"Frequencies of the ring against measured ones; {within} of {found.order.size} orders "
        f"lie within {TOLERANCE}.",
        f"Frequencies of the ring over measured ones, labelled by order; {within} of "
        f"{found.order.size} lie in the {TOLERANCE} band. The lowest order leaves it first where "
        f"the foundation is not well determined. {WITH_BARS}.",
        height_px=420,
    )


def deviation_chart(found: Validation, std_hz: go.Floats | None = None) -> Chart:
    """Deviation of the ring's frequencies over the order, with bars of 2 `std_hz`."""
    error = found.error_percent
    ends = np.array([found.order.min() - 0.5, found.order.max() + 0.5])
    half = np.full(2, TOLERANCE_PERCENT)
    bars = go.Bars(
        found.order,
        error,
        go.RING,
        y_bars=None if std_hz is None else 200 * std_hz / found.measured_hz,
        hover="n = %{x}<br>deviation %{y:+.2f} %",
    )
    limit = 1.3 * max(TOLERANCE_PERCENT, float(np.abs(error).max()))
    panel = go.Panel(
        (go.Band(ends, -half, half, go.RING, TOLERANCE), go.Rule(0), bars),
        go.Axis(go.ORDER, (ends[0], ends[1]), ticks=found.order.tolist()),
        go.Axis("deviation / %", (-limit, limit)),
        legend="upper right",
    )
    worst = int(np.argmax(np.abs(error)))
    largest = f"{signed(error[worst], 2)} % at n = {found.order[worst]}"
    return Chart(
        "frequency-deviation",
        go.Plot((panel,), (9.5, 7.5)),
        f"Deviation of the ring's frequencies by order; the largest is {largest}.",
        f"Deviation of the ring's frequencies with the {TOLERANCE} band; the largest is {largest}. "
        "Deviations that alternate in sign are scatter, a trend over the order is the model. "
        f"{WITH_BARS}: deviations well beyond them are not noise.",
        height_px=420,
    )


def dispersion_chart(
    found: Validation, orders: ArrayLike, ring_hz: ArrayLike, std_hz: go.Floats | None = None
) -> Chart:
    """Frequency over order: the measured modes and the ring's dispersion curve.

    The ring's frequencies `ring_hz` are known at `orders`, also at such that were not measured.
    """
    measured = _measured(found, found.measured_hz, std_hz, "Hz")
    shown, up = np.asarray(orders, dtype=int), go.Axis(go.FREQUENCY)
    return Chart(
        "dispersion",
        go.Plot((_over_order(shown, ring_hz, measured, up, "upper left"),), (17.5, 7.5)),
        f"Frequency over order: {found.order.size} measured modes, {found.measured_hz.min():.1f} "
        f"to {found.measured_hz.max():.1f} Hz, and the dispersion curve of the ring.",
        "Frequency over order. The measured modes should follow the ring's dispersion curve; one "
        "far from it has a wrong order or is not a mode of the belt (cavity, wheel, rig). "
        f"{WITH_BARS}, mostly smaller than the marks.",
        wide=True,
        height_px=380,
    )


def damping_chart(found: Validation, std: go.Floats | None = None) -> Chart:
    """Damping ratio over order, measured and of the ring, with bars of 2 `std`."""
    apart = np.abs(found.model_damping / found.measured_damping - 1)
    worst = int(np.nanargmax(apart))
    largest = f"{100 * apart[worst]:.0f} % of the measured value at n = {found.order[worst]}"
    std_percent = None if std is None else 100 * std
    measured = _measured(found, 100 * found.measured_damping, std_percent, "%")
    ring, up = 100 * found.model_damping, go.Axis("damping ratio / %", from_zero=True)
    return Chart(
        "damping",
        go.Plot((_over_order(found.order, ring, measured, up, "lower left"),), (9.5, 7.5)),
        f"Damping ratio over order, measured and of the ring; they differ most, by {largest}.",
        "Damping ratio over order, measured and of the ring; the largest difference is "
        f"{largest}. The ring has three damping parameters for all orders: an order far from its "
        f"curve loses more or less energy than belt and sidewall explain. {WITH_BARS}.",
        height_px=420,
    )


def _measured(found: Validation, values: go.Floats, std: go.Floats | None, unit: str) -> go.Curve:
    half, hover = None if std is None else 2 * std, f"n = %{{x}}<br>measured %{{y:.2f}} {unit}"
    look: dict[str, Any] = {"marker": "circle-open", "size": 10, "y_bars": half}
    return go.Curve(found.order, values, go.MEASURED, "measured", hover=hover, **look)


def _over_order(
    orders: NDArray[np.int_], ring: ArrayLike, measured: go.Curve, up: go.Axis, legend: str
) -> go.Panel:
    """Measured values, and those of the ring at `orders`, joined to guide the eye."""
    look: dict[str, Any] = {"width": 2, "marker": "circle", "size": 5}
    hover = measured.hover.replace("measured", "ring")
    curve = go.Curve(orders, ring, go.RING, "ring model", hover=hover, **look)
    return go.Panel((curve, measured), go.Axis(go.ORDER, ticks=orders.tolist()), up, legend=legend)


def sensitivity_chart(found: Sensitivity, symbols: Mapping[str, str]) -> Chart:
    """Change of each frequency in percent for one percent of each parameter."""
    names = [symbols[name] for name in found.parameters]
    strongest = np.max(np.abs(found.values), axis=0)
    weak = [name for name, most in zip(names, strongest, strict=True) if most < WEAK]
    moves = "moves" if len(weak) == 1 else "move"
    finding = f"{' and '.join(weak)} hardly {moves} any frequency" if weak else "all move some"
    return matrix_chart(
        found.values,
        [f"{order}" for order in found.orders],
        names,
        name="sensitivity",
        titles=(go.ORDER, "parameter"),
        signed="d ln f / d ln p",
        alternative=f"Sensitivity of {found.orders.size} frequencies to {len(names)} parameters; "
        f"{finding}.",
        caption="Sensitivity d ln f / d ln p: change of a frequency in % for 1 % of a parameter, "
        "the others held. A pale column is a parameter that these frequencies cannot determine "
        f"({finding}); columns alike in all orders cannot be distinguished.",
    )


def correlation_chart(found: Correlation, symbols: Mapping[str, str]) -> Chart:
    """Correlation coefficients, all finite, of two or more identified parameters."""
    names = [symbols[name] for name in found.parameters]
    beside = np.abs(found.values - np.diag(np.diag(found.values)))
    row, column = np.unravel_index(int(np.argmax(beside)), beside.shape)
    strongest = f"{names[row]} with {names[column]}, {signed(found.values[row, column], 2)}"
    return matrix_chart(
        found.values,
        names,
        names,
        name="parameter-correlation",
        titles=("parameter", "parameter"),
        signed="correlation",
        alternative=f"Correlation of {len(names)} parameters; the strongest is {strongest}.",
        caption=f"Correlation of the parameters; the strongest is {strongest}. Near ±1 the "
        "measurement fixes a combination of two parameters much better than each by itself: give "
        "one of them to sharpen the other.",
    )


def pressure_plot(series: Series, unit: str) -> go.Plot:
    """Every parameter of a series over pressure in `unit`, two beside each other."""
    columns = min(2, len(series.trends))
    rows = -(-len(series.trends) // columns)
    room = go.Margins(1.7, 0.35, 1.15, 0.75, between_columns=1.7, between_rows=1.9)
    panels = tuple(_trend(trend, unit) for trend in series.trends)
    return go.Plot(panels, (8.2 * columns, 5.6 * rows), columns, margins=room)


def _trend(trend: Trend, unit: str) -> go.Panel:
    name, symbol, value_unit = (RING_NAMES | DAMPING_NAMES)[trend.name]
    power = _power(trend)
    scale, per_unit = 10.0**-power, 1 / UNITS_PA[unit]
    ends = np.array([trend.pressure_pa.min(), trend.pressure_pa.max()])
    margin = 0.12 * (ends[1] - ends[0])
    across = np.linspace(ends[0] - margin, ends[1] + margin, 60)
    line, std = scale * trend.line.at(across), scale * trend.line.std_at(across)
    shown, values = trend.pressure_pa * per_unit, scale * trend.value
    band = (go.Band(across * per_unit, line - std, line + std, go.FITTED, opacity=0.15),)
    points = go.Curve(shown, values, go.MEASURED, marker="circle", size=8, y_bars=scale * trend.std)
    factor = f"10{str(power).translate(SUPERSCRIPTS)}" if power else ""
    of = " ".join(part for part in (factor, "" if value_unit == "1" else value_unit) if part)
    drawn = band if isfinite(trend.line.slope_std) else ()
    series = go.Curve(across * per_unit, line, go.FITTED, width=1.7), *drawn, points
    axes = go.Axis(f"inflation pressure / {unit}"), go.Axis(f"{symbol} / ({of})" if of else symbol)
    return go.Panel(series, *axes, title=name)


def _power(trend: Trend) -> int:
    """Power of ten, a multiple of three, that leaves readable numbers on the axis."""
    largest = float(np.abs(trend.value).max())
    exponent = int(np.floor(np.log10(largest))) if largest else 0
    return 0 if -2 <= exponent <= 3 else 3 * (exponent // 3)


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
