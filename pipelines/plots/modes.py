"""Plots of modes: shapes, MAC, damping, measured and fitted responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.poles.stability import StabilityDiagram
from pipelines.plots import plot as go
from pipelines.plots.chart import Chart
from pipelines.plots.measurement import on_circle
from pipelines.results.result import DrivenMode
from pipelines.results.tables import (
    in_band,
    mode_name,
    place_name,
    pole_marks,
    row_names,
    signed_cell,
    sparse_labels,
    spread,
)

NAMES_ACROSS = 40  # names of modes that fit side by side
HIGHEST = 0.82  # share of the stability diagram below the frequencies of the modes
LOWEST_FRAC = 0.9
DEFLECTION = 0.3  # largest drawn deflection, in radii
WRITTEN_CELLS = 15  # rows and columns up to which every number has room in its cell
FEW_CELLS = 9  # rows and columns up to which small numbers of a MAC are written too
#: Drawn in this order: the thin curve stays visible on the thick one.
FRF_LOOKS = {
    "fitted": (go.FITTED, 3.0, "solid"),
    "ring": (go.RING, 1.6, "dash"),
    "measured": (go.MEASURED, 1.0, "solid"),
}
POLE_LOOKS = {
    "not stable": ("cross-thin-open", go.FAINT, 5),
    "stable, not in a mode": ("x-thin-open", go.DROPPED, 6),
    "in a mode, not stable": ("circle-open", go.KEPT, 6),
    "in a mode": ("circle", go.KEPT, 6),
}


_INDICATORS = {
    False: "RMS inertance of all positions (line)",
    True: "complex mode indicator function of all forces (lines: as many peak as there are modes)",
}
_OVERLAID = 7  # as many colours as can be told apart


def stability_chart(diagram: StabilityDiagram) -> Chart:
    """Poles over frequency and model order, in front of the mode indicator."""
    low, high = diagram.band_hz
    kept = sorted(
        c.frequency_hz for c in diagram.clusters if c.kept and low <= c.frequency_hz <= high
    )
    names = [f"{frequency:.1f}" for frequency in kept]
    places = spread(kept, gap=(high - low) / NAMES_ACROSS).tolist()
    inside = in_band(diagram.indicator_hz, diagram.band_hz)
    several = len(diagram.cmif)
    kind = "CMIF" if several else "RMS inertance"
    unit, hover = f"{kind} / ((m/s²)/N)", f"%{{x:.2f}} Hz<br>{kind} %{{y:.3g}} (m/s²)/N"
    levels = diagram.cmif[:, inside] if several else diagram.indicator[None, inside]
    indicators = [
        go.Curve(
            *(diagram.indicator_hz[inside], level, go.FAINT),
            *("" if several and k else kind, 1.5 / (1 + k)),
            opacity=0.8,
            hover=hover,
            right=True,
        )
        for k, level in enumerate(levels)
    ]
    # The curve stays below the names of the modes.
    low_end, high_end = go.log_axis(unit, levels.ravel()).range or (0.1, 10.0)
    highest = float(diagram.model_order.max(initial=1)) / HIGHEST
    every = 10 * max(1, round(highest / 100))
    panel = go.Panel(
        (*indicators, *_flags(kept, names, places, highest), *_pole_curves(diagram)),
        go.Axis(go.FREQUENCY, diagram.band_hz),
        go.Axis("model order", (0, highest), ticks=range(0, int(highest * HIGHEST) + 1, every)),
        go.Axis(unit, (low_end, low_end * (high_end / low_end) ** (1 / HIGHEST)), log=True),
        legend="below",
    )
    found = f", at {', '.join(names)} Hz" if names else ""
    return Chart(
        "stability",
        go.Plot((panel,), (17.5, 9.5), margins=go.Margins(right=1.6, bottom=1.7)),
        f"Stability diagram with {diagram.poles.size} poles; {len(kept)} columns were taken for "
        f"modes{found}.",
        f"Poles of all model orders over the {_INDICATORS[bool(several)]}. A mode is a "
        "straight column of stable poles, best at a peak; the frequencies in Hz at the top are "
        "the clusters taken for modes. Columns that lean or break off are not modes.",
        wide=True,
        height_px=540,
    )


def _flags(
    kept_hz: Sequence[float], names: Sequence[str], places: Sequence[float], top: float
) -> list[go.Curve | go.Note]:
    """Lines at the frequencies of modes, and their names above the poles, side by side."""
    bend, end = (HIGHEST + 0.03) * top, (HIGHEST + 0.06) * top
    x = [x for at, place in zip(kept_hz, places, strict=True) for x in (at, at, place, np.nan)]
    lines = go.Curve(x, [0.0, bend, end, np.nan] * len(names), go.KEPT, width=0.8, opacity=0.6)
    notes = zip(places, names, strict=True)
    return [lines, *(go.Note(place, end, name, go.MEASURED, upward=True) for place, name in notes)]


def _pole_curves(diagram: StabilityDiagram) -> list[go.Curve]:
    """One series for each mark, so that the legend hides and shows it."""
    reasons = {-1: "in no cluster", **{c.label: c.reason for c in diagram.clusters}}
    return [
        go.Curve(
            diagram.frequency_hz[chosen],
            diagram.model_order[chosen],
            POLE_LOOKS[name][1],
            name,
            marker=POLE_LOOKS[name][0],
            size=POLE_LOOKS[name][2],
            hover="%{x:.2f} Hz, damping %{customdata:.2f} %<br>model order %{y}, "
            f"{name}<br>%{{text}}",
            texts=[reasons.get(int(label), "") for label in diagram.cluster[chosen]],
            values=100 * diagram.damping_ratio[chosen],
        )
        for name, chosen in pole_marks(diagram).items()
    ]


def shown_band_hz(model: ModalModel) -> tuple[float, float]:
    """The band of interest and what was fitted."""
    low, high = zip(model.band_hz, model.fit_band_hz, strict=True)
    return min(low), max(high)


def fitted_curves(
    frf: FRF, model: ModalModel, row: int
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.complex128]]]:
    """Frequencies and inertances of one FRF: what was fitted, and what was measured."""
    inside = in_band(frf.frequency_hz, model.fit_band_hz)
    shown = in_band(frf.frequency_hz, shown_band_hz(model))
    fitted_hz = frf.frequency_hz[inside]
    return {
        "fitted": (fitted_hz, model.synthesise(fitted_hz, frf.run, slice(row, row + 1))[0]),
        "measured": (frf.frequency_hz[shown], frf.values[row, shown]),
    }


def frf_plot(
    frf: FRF,
    model: ModalModel,
    curves: Mapping[str, tuple[NDArray[np.float64], NDArray[np.complex128]]],
    title: str = "",
) -> go.Plot:
    """Magnitude and phase of one FRF; grey is what was fitted outside the band of interest.

    `curves` has frequencies in Hz and inertances by the names of `FRF_LOOKS`; the page fills in
    what is empty. The levels of all FRFs give the range of the axis: positions can be compared.
    """
    low, high = shown_band_hz(model)
    level = np.abs(frf.values[:, in_band(frf.frequency_hz, (low, high))])
    top = 1.25 * float(np.max(level, initial=1e-12, where=np.isfinite(level)))
    sides = ((low, model.band_hz[0]), (model.band_hz[1], high))
    shaded = tuple(go.Span(start, stop) for start, stop in sides if stop > start)
    pairs = [
        go.magnitude_and_phase(*curves[name], colour, name, width=width, dash=dash, at="")
        for name, (colour, width, dash) in FRF_LOOKS.items()
        if name in curves
    ]
    levels = go.Axis(go.INERTANCE, (top / 10**go.SHOWN_DECADES, top), log=True)
    magnitude, phase = zip(*pairs, strict=True)
    axes = go.Axis(range=(low, high)), levels
    upper = go.Panel((*shaded, *magnitude), *axes, title=title, legend="lower right")
    lower = go.Panel((*shaded, *phase), go.Axis(go.FREQUENCY, (low, high)), go.PHASE)
    return go.Plot((upper, lower), (13, 10), heights=(3, 2), together=True)


def position_names(of: FRF | ModalModel) -> list[str]:
    """Names of the positions as a sentence needs them."""
    names = row_names(of, np.arange(of.position_deg.size))
    on_circle = np.isfinite(of.position_deg)
    return [n if known else f"node {n}" for n, known in zip(names, on_circle, strict=True)]


def drive_chart(driven: Sequence[DrivenMode], model: ModalModel) -> Chart:
    """How strongly each of several forces drives each mode."""
    series, looks = list[go.Curve](), ("circle", "square-open", "diamond-open", "x-thin-open")
    names = forces(driven)
    for number, name in names.items():
        own = [each for each in driven if each.reference == number]
        series.append(
            go.Curve(
                [model.modes[each.mode - 1].frequency_hz for each in own],
                [each.drive for each in own],
                (go.MEASURED, go.FITTED, go.RING, go.FAINT)[(number - 1) % 4],
                name,
                marker=looks[(number - 1) % 4],
                size=9,
                hover="%{text}<br>drive %{y:.3f}",
                texts=[mode_name(model.modes[each.mode - 1]) for each in own],
            )
        )
    panel = go.Panel(
        tuple(series), go.Axis(go.FREQUENCY), go.Axis("drive", (-0.03, 1.06)), legend="lower right"
    )
    return Chart(
        "references",
        go.Plot((panel,), (17.5, 7)),
        f"How strongly each of {len(names)} forces drives each mode.",
        "Drive of each mode by each force, 1 for the force that drives it most. A mode that only "
        "one force drives is known from that one alone; a place where all drives are low shows "
        "where a further force is needed.",
        wide=True,
        height_px=300,
    )


def mif_chart(diagram: StabilityDiagram) -> Chart:
    """Multivariate mode indicator function of several forces."""
    inside = in_band(diagram.indicator_hz, diagram.band_hz)
    colours = go.MEASURED, go.FITTED, go.RING, go.FAINT
    curves = tuple(
        go.Curve(
            *(diagram.indicator_hz[inside], level[inside], colours[k % 4], f"curve {k + 1}", 1.2),
            hover="%{x:.2f} Hz<br>MIF %{y:.3f}",
        )
        for k, level in enumerate(diagram.mif)
    )
    axes = go.Axis(go.FREQUENCY, diagram.band_hz), go.Axis("MIF", (-0.03, 1.06))
    panel = go.Panel(curves, *axes, legend="lower right")
    return Chart(
        "mif",
        go.Plot((panel,), (17.5, 6)),
        f"Multivariate mode indicator function of {len(diagram.mif)} forces.",
        "It falls towards 0 where a combination of the forces makes the structure answer as at a "
        "resonance; where a second curve falls too, two modes have nearly the same frequency.",
        wide=True,
        height_px=260,
    )


def forces(driven: Sequence[DrivenMode]) -> dict[int, str]:
    """Names of several forces, by number: where they act."""
    return {
        each.reference: f"force {each.reference}, {place_name(each.node or -1, each.position_deg)}"
        for each in driven
    }


def frac_chart(model: ModalModel) -> Chart:
    """FRAC of every position; a click on one shows its FRFs above."""
    names = position_names(model)
    worst = int(np.argmin(model.frac))
    lowest = f"{model.frac[worst]:.4f} at {names[worst]}"
    on_circle = bool(np.isfinite(model.position_deg).all())
    ticks, labels = sparse_labels(row_names(model, np.arange(model.frac.size)))
    places = model.position_deg if on_circle else np.arange(1.0, model.frac.size + 1)
    look, hover = (0.8, "solid", "circle"), "%{text}<br>FRAC %{y:.4f}"
    size = 7 if model.frac.size <= 150 else 4
    series = (
        go.Curve(places, model.frac, go.RING, "", *look, size, hover=hover, texts=names),
        # The page fills it in when a position is chosen.
        go.Curve([], [], go.FITTED, "shown above", marker="circle-open", size=13),
        go.Rule(LOWEST_FRAC, go.FITTED, "dash"),
    )
    across = go.Axis("node", ticks=[tick + 1 for tick in ticks], labels=labels)
    if on_circle:
        across = go.Axis("position / °", (-5, 365), ticks=range(0, 361, 60))
    floor = max(0.0, min(float(model.frac.min()) - 0.03, 0.85))
    return Chart(
        "frac",
        go.Plot((go.Panel(series, across, go.Axis("FRAC", (floor, 1.01)), legend=""),), (13, 6)),
        f"FRAC of all positions; the lowest is {lowest}.",
        f"FRAC, measured against fitted, at every position; the lowest is {lowest} (dashed: "
        f"{LOWEST_FRAC}). Click a point to see its FRFs above. A single low value points to a "
        "faulty sensor, many of them to missing modes.",
        wide=True,
        height_px=260,
    )


def shape_panel(mode: Mode, position_deg: ArrayLike) -> go.Panel:
    """A shape on the circle: undeformed (grey), deformed, half a period later (dotted)."""
    angles = np.asarray(position_deg, dtype=float)
    rows = np.argsort(angles)
    closed = np.append(rows, rows[0])
    deflection = DEFLECTION * mode.shape.real
    series = (
        go.Curve(*on_circle(np.linspace(0, 360, 181), 1.0), go.FAINT, width=1.1),
        *(
            go.Curve(*on_circle(angles[closed], 1 + part[closed]), go.RING, width=width, dash=dash)
            for part, width, dash in ((-deflection, 1.3, "dot"), (deflection, 2.0, "solid"))
        ),
        go.Curve(*on_circle(angles, 1 + deflection), go.RING, marker="circle", size=3),
    )
    limits = go.Axis(range=(-1.05 - DEFLECTION, 1.05 + DEFLECTION))
    return go.Panel(series, limits, limits, title=mode_name(mode), equal=True, bare=True)


def shape_by_node_panel(mode: Mode, names: Sequence[str]) -> go.Panel:
    """A shape as bars over the names of its nodes, where there is no circle to draw it on."""
    indices, _ = sparse_labels(names)
    every = indices[1] if len(indices) > 1 else 1
    bars = go.Bars(np.arange(len(names)), mode.shape.real, go.RING, width=0.7)
    across, up = go.Axis(names=names, every=every), go.Axis(range=(-1.1, 1.1), ticks=(-1, 0, 1))
    return go.Panel((bars, go.Rule(0, go.MEASURED)), across, up, title=mode_name(mode))


def shapes_plot(model: ModalModel) -> go.Plot:
    """All shapes, on the circle where the positions have angles."""
    columns = min(4, len(model.modes))
    rows = -(-len(model.modes) // columns)
    if np.isfinite(model.position_deg).all():
        margins = go.Margins(0.1, 0.1, 0.1, 0.6, between_columns=0.2, between_rows=0.6)
        circles = tuple(shape_panel(mode, model.position_deg) for mode in model.modes)
        return go.Plot(circles, (17.5, 4.6 * rows), columns, margins=margins)
    margins = go.Margins(0.8, 0.1, 0.6, 0.6, between_columns=0.8, between_rows=1.2)
    names = row_names(model, np.arange(model.node.size))
    bars = tuple(shape_by_node_panel(mode, names) for mode in model.modes)
    return go.Plot(bars, (17.5, 3.6 * rows), columns, margins=margins)


def matrix_chart(
    values: ArrayLike,
    rows: Sequence[str],
    columns: Sequence[str],
    *,
    name: str = "mac",
    titles: tuple[str, str] = ("", ""),
    alternative: str = "",
    caption: str = "",
    signed: str = "",
) -> Chart:
    """A MAC matrix, 0 (pale) to 1 (dark); names of rows and of columns are used once.

    `titles` are those of the vertical and of the horizontal axis. If the values are a `signed`
    quantity instead, they are blue above zero and orange below.
    """
    matrix = np.asarray(values, dtype=float)
    size = max(matrix.shape, default=0)
    # In large matrices the small values would only be noise to the eye.
    least = 0.0 if size <= FEW_CELLS else 0.1

    def cell(value: float) -> str:
        return signed_cell(value) if signed else f"{value:.2f}" if value >= least else ""

    largest, scale, hover = 1.0, "share", "MAC %{z:.3f}"
    if signed:
        largest = max(float(np.abs(matrix).max(initial=0.0)), 1e-3)
        scale, hover = "signed", f"{signed} %{{z:+.3f}}"
    shown = go.Map(
        matrix,
        -largest if signed else 0.0,
        largest,
        scale,
        f"{escape(titles[0])}: %{{y}}<br>{escape(titles[1])}: %{{x}}<br>{hover}",
        label="" if signed else "MAC",
        cells=[[cell(value) for value in row] for row in matrix] if size <= WRITTEN_CELLS else (),
    )
    axes = go.Axis(titles[1], names=columns), go.Axis(titles[0], names=rows, reverse=True)
    plot = go.Plot((go.Panel((shown,), *axes),), (9.5, 9))
    return Chart(name, plot, alternative, caption, height_px=420)


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
    finding = f"their median difference is {100 * off:.2g} %"
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
        "that leave the fitted circle on one side mean damping or phase that the fit lacks.",
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
        go.Plot((panel,), (13, 7)),
        f"Measured inertance at {count} positions, overlaid: {', '.join(names[r] for r in rows)}.",
        f"Measured inertance at {count} of {frf.n_positions} positions. Peaks are at the same "
        "frequencies everywhere; one that moves from position to position is a drift between runs.",
        wide=True,
        height_px=330,
    )
