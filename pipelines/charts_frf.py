"""FRFs as charts: magnitude above, phase below, over one frequency."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.charts_basis import FREQUENCY, INERTANCE, axis, log_axis
from pipelines.figures_values import wrapped_phase_deg
from pipelines.report.chart import packed

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
