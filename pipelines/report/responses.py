"""The section on FRFs: measured, fitted and of the ring, at any position, and FRAC."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ema.core.modes import ModalModel
from pipelines.plots.chart import (
    FAINT,
    FITTED,
    MEASURED,
    RING,
    Chart,
    Drawing,
    as_text,
    axis,
    packed,
    printed,
)
from pipelines.plots.charts_data import frf_axes
from pipelines.report.blocks import Block, Chooser, Paragraph, Section
from pipelines.report.responses_data import (
    MOST_VALUES,
    fitted_data,
    kept_lines,
    kept_positions,
    measured_data,
    ring_data,
)
from pipelines.results.labels import row_names, short, sparse_labels
from pipelines.results.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NO_MODE = "No mode was found in the band."
SHOWN_ANGLE_DEG = 100.0  # the angle from the force that the literature on this test shows
LOWEST_FRAC = 0.9
LEVEL, PHASE = "%{y:.4~g} (m/s²)/N", "%{y:.1f}°"
SHOWN_DECADES = 4.0  # below the largest value in the band
# Drawn one over the other, in this order: the thin one stays visible on the thick one.
LINES: dict[str, dict[str, Any]] = {
    "fitted": {"color": FITTED, "width": 3},
    "ring": {"color": RING, "width": 1.6, "dash": "dash"},
    "measured": {"color": MEASURED, "width": 1},
}


def responses(result: Result) -> Section:
    """Show measured, fitted and the ring's FRFs of any position, and how alike they are."""
    title = "Measured and fitted FRFs"
    if not result.modal_model.modes:
        return Section("frf", title, (Paragraph(NO_MODE),))
    blocks: list[Block] = [_chooser(result)]
    if (why := _why_no_ring(result)) is not None:
        blocks.append(Paragraph(why))
    if result.frf.n_positions > 1:
        blocks.append(frac_chart(result))
    return Section("frf", title, tuple(blocks))


def shown_rows(result: Result) -> tuple[int, ...]:
    """Rows of the FRFs worth showing: at the force, at 100° from it, and the worst fitted.

    Without a circle of sensors the first row stands for the first two.
    """
    angles = result.frf.position_deg
    rows = [0]
    if np.isfinite(angles).all():
        start = result.excitation_deg or 0.0
        rows = [_nearest(angles, start), _nearest(angles, start + SHOWN_ANGLE_DEG)]
    return tuple(dict.fromkeys([*rows, int(np.argmin(result.modal_model.frac))]))


def frac_chart(result: Result) -> Chart:
    """FRAC of every position; a click on one shows its FRFs above."""
    model = result.modal_model
    names = _position_names(result)
    worst = int(np.argmin(model.frac))
    lowest = f"{model.frac[worst]:.4f} at {names[worst]}"
    floor = max(0.0, min(float(model.frac.min()) - 0.03, 0.85))
    return Chart(
        "frac",
        (_frac_dots(model, names), _FRAC_CHOSEN),
        {
            "xaxis": _position_axis(result),
            "yaxis": axis("FRAC", range=[floor, 1.01]),
            "shapes": [_line_at(LOWEST_FRAC)],
            "hovermode": "closest",
        },
        f"FRAC of all positions; the lowest is {lowest}.",
        f"FRAC, measured against fitted, at every position; the lowest is {lowest} (dashed: "
        f"{LOWEST_FRAC}). Click a point to see its FRFs above. A single low value points to a "
        "faulty sensor, many of them to missing modes.",
        printed(_draw_frac, model, size_cm=(13, 7)),
        wide=True,
        height_px=260,
    )


#: The page fills it in when a position is chosen.
_FRAC_CHOSEN: dict[str, Any] = {
    "type": "scatter",
    "mode": "markers",
    "x": [],
    "y": [],
    "marker": {"color": FITTED, "size": 13, "symbol": "circle-open", "line": {"width": 2.5}},
    "hoverinfo": "skip",
    "name": "shown above",
    "showlegend": True,
}


def _frac_dots(model: ModalModel, names: Sequence[str]) -> dict[str, Any]:
    on_circle = bool(np.isfinite(model.position_deg).all())
    where = model.position_deg if on_circle else np.arange(1, model.frac.size + 1)
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": packed(where),
        "y": packed(model.frac),
        "text": list(map(as_text, names)),
        "line": {"color": RING, "width": 0.8},
        "marker": {"color": RING, "size": 7 if model.frac.size <= 150 else 4},
        "hovertemplate": "%{text}<br>FRAC %{y:.4f}<extra></extra>",
        "showlegend": False,
    }


def _chooser(result: Result) -> Chooser:
    frf, model = result.frf, result.modal_model
    rows = kept_positions(frf.n_positions, shown_rows(result))
    low = min(model.band_hz[0], model.fit_band_hz[0])
    high = max(model.band_hz[1], model.fit_band_hz[1])
    band = np.flatnonzero((frf.frequency_hz >= low) & (frf.frequency_hz <= high))
    poles = np.array([mode.pole for mode in model.modes])
    lines = band[kept_lines(frf.frequency_hz[band], poles, MOST_VALUES // rows.size)]
    ring = ring_data(result, rows)
    names = _position_names(result)
    options = tuple(_option(result, names[row], int(row)) for row in rows)
    first = shown_rows(result)[:2][-1]
    content = {
        "rows": rows.tolist(),
        "frequency_hz": packed(frf.frequency_hz[lines]),
        "measured": measured_data(frf.values[np.ix_(rows, lines)]),
        "fitted": fitted_data(frf, model, rows),
        "ring": ring,
    }
    left_out = _left_out(lines.size, band.size, rows.size, frf.n_positions)
    chart = _response_chart(result, ring is not None, left_out)
    drawings = tuple(_drawing(result, row) for row in shown_rows(result))
    return Chooser(chart, "Position", options, int(np.searchsorted(rows, first)), content, drawings)


def _response_chart(result: Result, with_ring: bool, left_out: str) -> Chart:
    model = result.modal_model
    names = [name for name in LINES if with_ring or name != "ring"]
    first = tuple(_curve(name, "y", LEVEL) for name in names)
    second = tuple(_curve(name, "y2", PHASE) for name in names)
    ring = " Dashed: the tuned ring, radial force and response." if with_ring else ""
    shaded = " Shaded: fitted, but outside the band of interest." if _outside(model) else ""
    axes = frf_axes(phase_share=0.3)
    axes["xaxis"]["range"], axes["yaxis"]["range"] = _frequency_range(model), _level_range(result)
    return Chart(
        "frf",
        first + second,
        {
            **axes,
            "shapes": _outside(model),
            "hovermode": "x",
        },
        "Magnitude and phase of the inertance, measured and fitted.",
        "Inertance of the position chosen. The fitted curve should pass through the measured one "
        "at peaks and between them; a shift between peaks points to a missing mode."
        f"{shaded}{ring}{left_out}",
        lambda: _draw_response(result, shown_rows(result)[0]),
        wide=True,
        height_px=470,
    )


def _curve(name: str, y_axis: str, hover: str) -> dict[str, Any]:
    """A curve that the page fills in; the legend switches magnitude and phase together."""
    return {
        "type": "scatter",
        "mode": "lines",
        "x": [],
        "y": [],
        "yaxis": y_axis,
        "name": name,
        "legendgroup": name,
        "showlegend": y_axis == "y",
        "line": LINES[name] | {"simplify": False},
        "hovertemplate": f"{hover}<extra>{name}</extra>",
    }


def _frequency_range(model: ModalModel) -> list[float]:
    return [
        min(model.band_hz[0], model.fit_band_hz[0]),
        max(model.band_hz[1], model.fit_band_hz[1]),
    ]


def _level_range(result: Result) -> list[float]:
    """Decades shown, the same for all positions so that they can be compared."""
    low, high = _frequency_range(result.modal_model)
    inside = (result.frf.frequency_hz >= low) & (result.frf.frequency_hz <= high)
    levels = np.abs(result.frf.values[:, inside])
    top = float(np.log10(np.max(levels, initial=1e-12, where=np.isfinite(levels)))) + 0.1
    return [top - SHOWN_DECADES, top]


def _outside(model: ModalModel) -> list[dict[str, Any]]:
    """Shade what was fitted for the sake of the band only."""
    low, high = _frequency_range(model)
    sides = ((low, model.band_hz[0]), (model.band_hz[1], high))
    return [
        {
            "type": "rect",
            "xref": "x",
            "yref": "paper",
            "x0": start,
            "x1": stop,
            "y0": 0,
            "y1": 1,
            "fillcolor": FAINT,
            "opacity": 0.12,
            "line": {"width": 0},
            "layer": "below",
        }
        for start, stop in sides
        if stop > start
    ]


def _line_at(value: float) -> dict[str, Any]:
    line = {"color": FITTED, "width": 1, "dash": "dash"}
    return {
        "type": "line",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "y0": value,
        "y1": value,
        "line": line,
    }


def _position_axis(result: Result) -> dict[str, Any]:
    if np.isfinite(result.frf.position_deg).all():
        return axis("position / °", range=[-5, 365], dtick=60)
    ticks, labels = sparse_labels(row_names(result.frf, np.arange(result.frf.n_positions)))
    return axis("node", tickvals=[tick + 1 for tick in ticks], ticktext=labels)


def _option(result: Result, name: str, row: int) -> str:
    """What identifies a position to who mounted the sensors."""
    frf = result.frf
    parts = (name, short(frf.run[row]), short(frf.channel[row]))
    return " · ".join([*filter(None, parts), f"FRAC {result.modal_model.frac[row]:.4f}"])


def _position_names(result: Result) -> list[str]:
    """Names of the positions as a sentence needs them."""
    names = row_names(result.frf, np.arange(result.frf.n_positions))
    on_circle = np.isfinite(result.frf.position_deg)
    return [n if known else f"node {n}" for n, known in zip(names, on_circle, strict=True)]


def _left_out(n_lines: int, all_lines: int, n_positions: int, all_positions: int) -> str:
    """Say what does not fit in the page; the files of the result hold everything."""
    parts = []
    if n_positions < all_positions:
        parts.append(f"{n_positions} of {all_positions} positions")
    if n_lines < all_lines:
        parts.append(f"{n_lines} of {all_lines} lines, closest around the modes")
    if not parts:
        return ""
    return f" The page holds {' and '.join(parts)}; frf.parquet holds all."


def _why_no_ring(result: Result) -> str | None:
    """Why the ring has no curve, where there is a ring."""
    if result.tuning is None:
        return None
    if result.damping is None:
        return "The ring has no curve: its damping is not known."
    if result.tuning.ring.belt_width_m is None:
        return (
            "The ring has no curve: absolute amplitudes need the belt's width. Add belt_width_m "
            "to [tyre] in the manifest."
        )
    return None


def _draw_frac(figures: Any, model: ModalModel, ax: Any) -> None:
    figures.plot_frac(model, ax)


def _nearest(angles: np.ndarray, angle: float) -> int:
    return int(np.argmin(np.abs((angles - angle + 180) % 360 - 180)))


def _drawing(result: Result, row: int) -> Drawing:
    name = _position_names(result)[row]
    return Drawing(
        f"frf-{row + 1}",
        f"Magnitude and phase of the inertance at {name}, measured and fitted.",
        f"Inertance at {name}, FRAC {result.modal_model.frac[row]:.4f}. The fitted curve should "
        "pass through the measured one at peaks and between them; a shift between peaks points to "
        "a missing mode. Grey: fitted, but outside the band of interest.",
        lambda: _draw_response(result, row),
    )


def _draw_response(result: Result, row: int) -> Figure:
    # Loads matplotlib, which the page on a screen does without.
    from pipelines.plots import figures

    frf, model = result.frf, result.modal_model
    with figures.styled_figure(13, 10, 2, sharex=True, height_ratios=(3, 2)) as (
        figure,
        (top, low),
    ):
        figures.plot_frf_magnitude(frf, model, row, top)
        figures.plot_frf_phase(frf, model, row, low)
    return figure
