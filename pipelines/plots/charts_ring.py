"""Charts of the ring model against the measurement, order by order."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.plots.chart import (
    FAINT,
    FREQUENCY,
    MEASURED,
    NO_COLOUR,
    RING,
    Chart,
    axis,
    packed,
    printed,
)
from pipelines.results.result import Validation
from pipelines.storage.rounding import signed

ORDER = "order n"
TOLERANCE_PERCENT = 1.0
WITH_BARS = "Bars: ± 2 standard deviations of the measurement"
OPEN = {"symbol": "circle-open", "size": 10, "color": MEASURED, "line": {"width": 1.5}}
FILLED = {"size": 9, "color": RING}


def scatter_chart(found: Validation, std_hz: NDArray[np.float64]) -> Chart:
    """Frequencies of the ring over the measured ones.

    Parameters
    ----------
    found : Validation
    std_hz : ndarray, shape (n_orders,)
        Standard deviations of the measured frequencies; NaN where unknown.
    """
    every = np.concatenate([found.measured_hz, found.model_hz])
    margin = 0.08 * (every.max() - every.min()) + 1.0
    ends = np.array([every.min() - margin, every.max() + margin])
    within = int(np.sum(np.abs(found.error_percent) <= TOLERANCE_PERCENT))
    limits = [float(end) for end in ends]
    return Chart(
        "frequency-scatter",
        (*_tolerance(ends, ends), _line("equal", ends, ends, FAINT), _orders_at(found, std_hz)),
        {
            "xaxis": axis("measured / Hz", range=limits, constrain="domain"),
            "yaxis": axis("ring model / Hz", range=limits, scaleanchor="x", constrain="domain"),
        },
        f"Frequencies of the ring against measured ones; {within} of {found.order.size} orders "
        f"lie within ±{TOLERANCE_PERCENT:g} %.",
        f"Frequencies of the ring over measured ones, labelled by order; {within} of "
        f"{found.order.size} lie in the ±{TOLERANCE_PERCENT:g} % band. The lowest order leaves it "
        f"first where the foundation is not well determined. {WITH_BARS}.",
        printed(
            lambda figures, ax: figures.plot_frequency_scatter(found, ax, std_hz),
            size_cm=(9.5, 9),
        ),
        height_px=420,
    )


def _orders_at(found: Validation, std_hz: NDArray[np.float64]) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "markers+text",
        "name": "orders",
        "showlegend": False,
        "x": packed(found.measured_hz),
        "y": packed(found.model_hz),
        "text": [f"{order}" for order in found.order],
        "textposition": "top left",
        "customdata": packed(found.error_percent),
        "error_x": _bars(2 * std_hz),
        "marker": FILLED,
        "hovertemplate": "n = %{text}<br>measured %{x:.2f} Hz<br>ring %{y:.2f} Hz "
        "(%{customdata:+.2f} %)<extra></extra>",
    }


def deviation_chart(found: Validation, std_hz: NDArray[np.float64]) -> Chart:
    """Deviation of the ring's frequencies over the order.

    Parameters
    ----------
    found : Validation
    std_hz : ndarray, shape (n_orders,)
        Standard deviations of the measured frequencies; NaN where unknown.
    """
    worst = int(np.argmax(np.abs(found.error_percent)))
    largest = f"{signed(found.error_percent[worst], 2)} % at n = {found.order[worst]}"
    ends = np.array([found.order.min() - 0.5, found.order.max() + 0.5])
    bars = {
        "type": "bar",
        "name": "deviation",
        "x": found.order.tolist(),
        "y": packed(found.error_percent),
        "width": 0.5,
        "marker": {"color": RING},
        "error_y": {**_bars(200 * std_hz / found.measured_hz), "color": MEASURED},
        "showlegend": False,
        "hovertemplate": "n = %{x}<br>deviation %{y:+.2f} %<extra></extra>",
    }
    return Chart(
        "frequency-deviation",
        (*_tolerance(ends, np.zeros(2), TOLERANCE_PERCENT), bars),
        {"xaxis": _orders(found.order), "yaxis": axis("deviation / %")},
        f"Deviation of the ring's frequencies by order; the largest is {largest}.",
        f"Deviation of the ring's frequencies with the ±{TOLERANCE_PERCENT:g} % band; the largest "
        f"is {largest}. Deviations that alternate in sign are scatter, a trend over the order is "
        f"the model. {WITH_BARS}: deviations well beyond them are not noise.",
        printed(
            lambda figures, ax: figures.plot_frequency_error(found, ax, std_hz),
            size_cm=(9.5, 7.5),
        ),
        height_px=420,
    )


def dispersion_chart(
    found: Validation, std_hz: NDArray[np.float64], orders: ArrayLike, ring_hz: ArrayLike
) -> Chart:
    """Frequency over order: the measured modes and the ring's dispersion curve.

    Parameters
    ----------
    found : Validation
    std_hz : ndarray, shape (n_orders,)
        Standard deviations of the measured frequencies; NaN where unknown.
    orders, ring_hz : array_like, shape (n_shown,)
        The ring's frequencies, also at orders that were not measured.
    """
    shown = np.asarray(orders, dtype=int)
    measured = _measured(found.order, found.measured_hz, 2 * std_hz, "Hz")
    ring = _curve(shown, ring_hz, "ring %{y:.2f} Hz")
    return Chart(
        "dispersion",
        (ring, measured),
        {"xaxis": _orders(shown), "yaxis": axis(FREQUENCY)},
        f"Frequency over order: {found.order.size} measured modes, {found.measured_hz.min():.1f} "
        f"to {found.measured_hz.max():.1f} Hz, and the dispersion curve of the ring.",
        "Frequency over order. The measured modes should follow the ring's dispersion curve; one "
        "that stands off is wrongly numbered or does not belong to the belt (cavity, wheel, rig). "
        f"{WITH_BARS}, mostly smaller than the marks.",
        printed(
            lambda figures, ax: figures.plot_dispersion(found, shown, ring_hz, ax),
            size_cm=(17.5, 7.5),
        ),
        wide=True,
        height_px=380,
    )


def damping_chart(found: Validation, std: NDArray[np.float64]) -> Chart:
    """Damping ratio over order, measured and of the ring.

    Parameters
    ----------
    found : Validation
        With damping of the model.
    std : ndarray, shape (n_orders,)
        Standard deviations of the measured damping ratios; NaN where unknown.
    """
    apart = np.abs(found.model_damping / found.measured_damping - 1)
    worst = int(np.nanargmax(apart))
    largest = f"{100 * apart[worst]:.0f} % of the measured value at n = {found.order[worst]}"
    measured = _measured(found.order, 100 * found.measured_damping, 200 * std, "%")
    ring = _curve(found.order, 100 * found.model_damping, "ring %{y:.2f} %")
    return Chart(
        "damping",
        (ring, measured),
        {
            "xaxis": _orders(found.order),
            "yaxis": axis("damping ratio / %", rangemode="tozero"),
        },
        f"Damping ratio over order, measured and of the ring; they differ most, by {largest}.",
        "Damping ratio over order, measured and of the ring; the largest difference is "
        f"{largest}. Three parameters stand for all orders: one that stands off loses more or "
        f"less energy than belt and sidewall explain. {WITH_BARS}.",
        printed(
            lambda figures, ax: figures.plot_damping(found, ax, std),
            size_cm=(9.5, 7.5),
        ),
        height_px=420,
    )


def _orders(orders: NDArray[np.int_]) -> dict[str, Any]:
    return axis(ORDER, tickvals=orders.tolist(), zeroline=False)


def _curve(orders: NDArray[np.int_], values: ArrayLike, hover: str) -> dict[str, Any]:
    """The ring, known at whole orders, joined to guide the eye."""
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "name": "ring model",
        "x": orders.tolist(),
        "y": packed(values),
        "line": {"color": RING, "width": 2},
        "marker": {"size": 5, "color": RING},
        "hovertemplate": f"n = %{{x}}<br>{hover}<extra></extra>",
    }


def _measured(
    orders: NDArray[np.int_], values: NDArray[np.float64], half: NDArray[np.float64], unit: str
) -> dict[str, Any]:
    """Measured values over the order, with bars of ± `half`."""
    return {
        "type": "scatter",
        "mode": "markers",
        "name": "measured",
        "x": orders.tolist(),
        "y": packed(values),
        "error_y": _bars(half),
        "marker": OPEN,
        "hovertemplate": f"n = %{{x}}<br>measured %{{y:.2f}} {unit}<extra></extra>",
    }


def _line(name: str, x: NDArray[np.float64], y: NDArray[np.float64], colour: str) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "name": name,
        "x": x.tolist(),
        "y": y.tolist(),
        "line": {"color": colour, "width": 1},
        "hoverinfo": "skip",
        "showlegend": False,
    }


def _tolerance(
    x: NDArray[np.float64], y: NDArray[np.float64], width: float | None = None
) -> tuple[dict[str, Any], ...]:
    """A band around `y`, ±1 % of it or ±`width`: two lines with the room between them filled."""
    half = TOLERANCE_PERCENT / 100 * y if width is None else np.full(2, width)
    lower = _line("", x, y - half, NO_COLOUR)
    upper = _line(f"±{TOLERANCE_PERCENT:g} %", x, y + half, NO_COLOUR)
    shade = {"fill": "tonexty", "fillcolor": "rgba(0, 114, 178, 0.18)", "showlegend": True}
    return lower, upper | shade


def _bars(half: NDArray[np.float64]) -> dict[str, Any]:
    """Error bars; none where the uncertainty is unknown."""
    return {"type": "data", "array": np.nan_to_num(half, nan=0.0).tolist(), "thickness": 1.5}
