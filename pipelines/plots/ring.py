"""Figures of the ring model beside the measurement."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from pipelines.plots.style import FAINT, MEASURED, RING
from pipelines.results.result import Validation

BARS: dict[str, Any] = {"fmt": "none", "elinewidth": 1.0, "capsize": 2.0}


def plot_frequency_scatter(
    validation: Validation, ax: Axes, std_hz: NDArray[np.float64] | None = None
) -> Axes:
    """Model against measured frequencies, with the ±1 % band.

    Parameters
    ----------
    validation : Validation
    ax : Axes
    std_hz : ndarray, shape (n_orders,), optional
        Standard deviations of the measured frequencies; drawn twofold as bars.

    Returns
    -------
    Axes
    """
    every = np.concatenate([validation.measured_hz, validation.model_hz])
    margin = 0.08 * (every.max() - every.min()) + 1.0
    ends = np.array([every.min() - margin, every.max() + margin])
    ax.fill_between(ends, 0.99 * ends, 1.01 * ends, color="#CFE3F1", label="±1 %")
    ax.plot(ends, ends, color=FAINT, linewidth=0.8)
    ax.plot(validation.measured_hz, validation.model_hz, "o", color=RING)
    if std_hz is not None:
        bars = {"color": RING, **BARS}
        ax.errorbar(validation.measured_hz, validation.model_hz, xerr=2 * std_hz, **bars)
    for order, x, y in zip(
        validation.order, validation.measured_hz, validation.model_hz, strict=True
    ):
        ax.annotate(str(order), (x, y), xytext=(-6, 4), textcoords="offset points", ha="right")
    ax.set_xlim(*ends)
    ax.set_ylim(*ends)
    ax.set_aspect("equal")
    ax.set_xlabel("measured / Hz")
    ax.set_ylabel("ring model / Hz")
    ax.legend(loc="lower right")
    return ax


def plot_frequency_error(
    validation: Validation, ax: Axes, std_hz: NDArray[np.float64] | None = None
) -> Axes:
    """Deviation of the model's frequencies, order by order, with the ±1 % band.

    Parameters
    ----------
    validation : Validation
    ax : Axes
    std_hz : ndarray, shape (n_orders,), optional
        Standard deviations of the measured frequencies; drawn twofold as bars.

    Returns
    -------
    Axes
    """
    error = validation.error_percent
    ax.axhspan(-1, 1, color="#CFE3F1")
    ax.axhline(0, color=FAINT, linewidth=0.8)
    ax.vlines(validation.order, 0, error, color=RING)
    ax.plot(validation.order, error, "o", color=RING)
    if std_hz is not None:
        half = 200 * std_hz / validation.measured_hz
        ax.errorbar(validation.order, error, yerr=half, color=MEASURED, **BARS)
    limit = 1.15 * max(1.0, float(np.abs(error).max()))
    ax.set_ylim(-limit, limit)
    ax.set_xticks(validation.order)
    ax.set_xlabel("order n")
    ax.set_ylabel("deviation / %")
    return ax


def plot_dispersion(
    validation: Validation, orders: ArrayLike, ring_hz: ArrayLike, ax: Axes
) -> Axes:
    """Frequency over order: what was measured and the curve of the ring.

    Parameters
    ----------
    validation : Validation
    orders, ring_hz : array_like, shape (n_orders,)
        The ring's frequencies, also at orders that were not measured.
    ax : Axes

    Returns
    -------
    Axes
    """
    ax.plot(orders, ring_hz, "-", marker=".", color=RING, label="ring model")
    ax.plot(
        validation.order,
        validation.measured_hz,
        "o",
        color=MEASURED,
        markerfacecolor="none",
        markersize=7,
        label="measured",
    )
    ax.set_xticks(np.asarray(orders))
    ax.set_xlabel("order n")
    ax.set_ylabel("frequency / Hz")
    ax.legend(loc="upper left")
    return ax


def plot_damping(validation: Validation, ax: Axes, std: NDArray[np.float64] | None = None) -> Axes:
    """Damping ratio over order, measured and of the ring.

    Parameters
    ----------
    validation : Validation
    ax : Axes
    std : ndarray, shape (n_orders,), optional
        Standard deviations of the measured damping ratios; drawn twofold as bars.

    Returns
    -------
    Axes
    """
    measured, ring = 100 * validation.measured_damping, 100 * validation.model_damping
    ax.plot(validation.order, ring, "-", marker=".", color=RING, label="ring model")
    ax.plot(
        validation.order,
        measured,
        "o",
        color=MEASURED,
        markerfacecolor="none",
        markersize=7,
        label="measured",
    )
    if std is not None:
        ax.errorbar(validation.order, measured, yerr=200 * std, color=MEASURED, **BARS)
    ax.set_ylim(0, 1.15 * float(np.nanmax(np.concatenate([measured, ring]))))
    ax.set_xticks(validation.order)
    ax.set_xlabel("order n")
    ax.set_ylabel("damping ratio / %")
    ax.legend(loc="lower left")
    return ax
