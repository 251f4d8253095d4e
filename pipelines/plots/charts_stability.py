"""The stability diagram as a chart: every pole, what it belongs to, and why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.poles.stability import Cluster, StabilityDiagram
from pipelines.plots.chart import (
    DROPPED,
    FAINT,
    FREQUENCY,
    KEPT,
    Chart,
    as_text,
    axis,
    log_axis,
    packed,
    printed,
)
from pipelines.results.labels import in_band, pole_marks, spread

HIGHEST = 0.82  # of the height: above it stand the frequencies of the modes
MOST_DECADES = 4
LABELS_ACROSS = 38  # labels that fit side by side
THIN = {"width": 1}
MARKERS: Mapping[str, Mapping[str, Any]] = {
    "not stable": {"symbol": "cross-thin-open", "line": THIN, "color": FAINT, "size": 5},
    "stable, not in a mode": {"symbol": "x-thin-open", "line": THIN, "color": DROPPED, "size": 6},
    "in a mode, not stable": {"symbol": "circle-open", "line": THIN, "color": KEPT, "size": 6},
    "in a mode": {"symbol": "circle", "color": KEPT, "size": 6},
}


def stability_chart(diagram: StabilityDiagram) -> Chart:
    """Poles over frequency and model order, in front of the mode indicator.

    Parameters
    ----------
    diagram : StabilityDiagram
    """
    kept = _kept_in_band(diagram)
    found = ", ".join(f"{cluster.frequency_hz:.1f}" for cluster in kept)
    return Chart(
        "stability",
        (_indicator(diagram), *_poles(diagram, _reasons(diagram))),
        _layout(diagram, kept),
        f"Stability diagram with {diagram.poles.size} poles; {len(kept)} columns were taken for "
        f"modes{f', at {found} Hz' if kept else ''}.",
        "Poles of all model orders over the RMS inertance of all positions (line). A mode is a "
        "straight column of stable poles, best at a peak; the frequencies in Hz at the top are "
        "the clusters taken for modes. Columns that lean or break off are not modes.",
        printed(
            lambda figures, *data: figures.plot_stability(*data),
            diagram,
            size_cm=(17.5, 10.5),
            right=1.6,
            bottom=1.7,
            top=1.4,
        ),
        wide=True,
        height_px=540,
    )


def _layout(diagram: StabilityDiagram, kept: list[Cluster]) -> dict[str, Any]:
    highest = float(diagram.model_order.max(initial=1)) / HIGHEST
    return {
        "xaxis": axis(FREQUENCY, range=list(diagram.band_hz)),
        # The indicator has the axis at the back: what overlays it is drawn in front.
        "yaxis": log_axis(
            "RMS inertance / ((m/s²)/N)", side="right", showgrid=False, range=_below(diagram)
        ),
        "yaxis2": axis(
            "model order", side="left", overlaying="y", range=[0, highest], tick0=0, dtick=10
        ),
        "shapes": [_line(cluster) for cluster in kept],
        "annotations": _names(kept, diagram.band_hz, highest),
        "hovermode": "closest",
    }


def _kept_in_band(diagram: StabilityDiagram) -> list[Cluster]:
    low, high = diagram.band_hz
    kept = [c for c in diagram.clusters if c.kept and low <= c.frequency_hz <= high]
    return sorted(kept, key=lambda cluster: cluster.frequency_hz)


def _reasons(diagram: StabilityDiagram) -> dict[int, str]:
    """What is said about a pole, by the cluster it belongs to."""
    says = {cluster.label: as_text(cluster.reason) for cluster in diagram.clusters}
    return {**says, -1: "in no cluster"}


def _indicator(diagram: StabilityDiagram) -> dict[str, Any]:
    inside = in_band(diagram.indicator_hz, diagram.band_hz)
    return {
        "type": "scatter",
        "mode": "lines",
        "name": "RMS inertance",
        "x": packed(diagram.indicator_hz[inside]),
        "y": packed(diagram.indicator[inside]),
        "line": {"color": FAINT, "width": 1.5},
        "opacity": 0.8,
        "hovertemplate": "%{x:.2f} Hz<br>RMS inertance %{y:.3g} (m/s²)/N<extra></extra>",
    }


def _below(diagram: StabilityDiagram) -> list[float]:
    """Ends of the indicator's axis, as powers of ten, that keep it below the mode's names."""
    shown = diagram.indicator[in_band(diagram.indicator_hz, diagram.band_hz)]
    powers = np.log10(shown[shown > 0])
    if powers.size == 0:
        return [-1.0, 1.0]
    low = float(max(powers.min(), powers.max() - MOST_DECADES)) - 0.1
    return [low, low + max(float(powers.max()) - low, 0.5) / HIGHEST]


def _poles(diagram: StabilityDiagram, reasons: Mapping[int, str]) -> list[dict[str, Any]]:
    """One trace for each mark, so that the legend hides and shows it."""
    return [
        {
            "type": "scatter",
            "mode": "markers",
            "name": name,
            "yaxis": "y2",
            "x": packed(diagram.frequency_hz[chosen]),
            "y": packed(diagram.model_order[chosen]),
            "customdata": packed(100 * diagram.damping_ratio[chosen]),
            "text": _reasons_of(diagram.cluster[chosen], reasons),
            "marker": MARKERS[name],
            "hovertemplate": "%{x:.2f} Hz, damping %{customdata:.2f} %<br>model order %{y}, "
            f"{name}<br>%{{text}}<extra></extra>",
        }
        for name, chosen in pole_marks(diagram).items()
    ]


def _reasons_of(labels: NDArray[np.int_], reasons: Mapping[int, str]) -> list[str]:
    return [reasons.get(int(label), "") for label in labels]


def _line(cluster: Cluster) -> dict[str, Any]:
    """A thin line from the axis up, where a cluster was kept."""
    return {
        "type": "line",
        "xref": "x",
        "yref": "y2 domain",
        "x0": cluster.frequency_hz,
        "x1": cluster.frequency_hz,
        "y0": 0,
        "y1": HIGHEST + 0.03,
        "line": {"color": KEPT, "width": 0.8},
        "layer": "below",
    }


def _names(
    kept: list[Cluster], band_hz: tuple[float, float], highest: float
) -> list[dict[str, Any]]:
    """Frequencies of the kept clusters above the poles, side by side."""
    frequencies = [cluster.frequency_hz for cluster in kept]
    places = spread(frequencies, gap=(band_hz[1] - band_hz[0]) / LABELS_ACROSS)
    return [
        {
            "x": frequency,
            "y": (HIGHEST + 0.03) * highest,
            "yref": "y2",
            "ax": float(place),
            "axref": "x",
            "ay": (HIGHEST + 0.06) * highest,
            "ayref": "y2",
            "text": f"{frequency:.1f}",
            "textangle": -90,
            "xanchor": "center",
            "yanchor": "bottom",
            "arrowhead": 0,
            "arrowwidth": 0.8,
            "arrowcolor": KEPT,
        }
        for frequency, place in zip(frequencies, places, strict=True)
    ]
