"""Ring parameters over inflation pressure."""

from __future__ import annotations

from math import isfinite

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.library.series import UNITS_PA, Series, Trend
from pipelines.plots.style import FITTED, MEASURED, Margins, styled_figure

_WIDTH_CM, _HEIGHT_CM, _COLUMNS = 8.2, 5.6, 2
_NAMES = RING_NAMES | DAMPING_NAMES


def draw_series(series: Series, unit: str) -> Figure:
    """Every trend of a series in axes of its own, two beside each other.

    Parameters
    ----------
    series : Series
    unit : str
        Of the pressure; a key of `UNITS_PA`.
    """
    columns = min(_COLUMNS, len(series.trends))
    rows = -(-len(series.trends) // columns)
    room = Margins(
        left=1.5, right=0.35, top=0.75, bottom=1.15, between_columns=1.7, between_rows=1.9
    )
    size = _WIDTH_CM * columns, _HEIGHT_CM * rows
    with styled_figure(*size, rows, columns, room, squeeze=False) as (figure, axes):
        for trend, ax in zip(series.trends, axes.flat, strict=False):
            plot_trend(trend, unit, ax)
        for ax in axes.flat[len(series.trends) :]:
            ax.set_visible(False)
    return figure


def plot_trend(trend: Trend, unit: str, ax: Axes) -> Axes:
    """One parameter over pressure: values with ± σ, the line and its ± σ band.

    Parameters
    ----------
    trend : Trend
    unit : str
        Of the pressure; a key of `UNITS_PA`.
    ax : Axes

    Returns
    -------
    Axes
    """
    name, symbol, value_unit = _NAMES[trend.name]
    power = _power(trend)
    scale, per_unit = 10.0**-power, 1 / UNITS_PA[unit]
    ends = np.array([trend.pressure_pa.min(), trend.pressure_pa.max()])
    margin = 0.12 * (ends[1] - ends[0])
    across = np.linspace(ends[0] - margin, ends[1] + margin, 60)
    line, std = scale * trend.line.at(across), scale * trend.line.std_at(across)
    if isfinite(trend.line.slope_std):
        ax.fill_between(
            across * per_unit, line - std, line + std, color=FITTED, alpha=0.15, linewidth=0
        )
    ax.plot(across * per_unit, line, color=FITTED)
    error = np.where(np.isfinite(trend.std), trend.std, 0.0)
    ax.errorbar(
        trend.pressure_pa * per_unit,
        scale * trend.value,
        scale * error,
        fmt="o",
        color=MEASURED,
        capsize=2.5,
        linewidth=0.9,
    )
    ax.set_title(name)
    ax.set_xlabel(f"inflation pressure / {unit}")
    ax.set_ylabel(_axis_label(symbol, value_unit, power))
    ax.margins(x=0.02)
    return ax


def _power(trend: Trend) -> int:
    """Power of ten, a multiple of three, that leaves readable numbers on the axis."""
    largest = float(np.abs(trend.value).max())
    exponent = int(np.floor(np.log10(largest))) if largest else 0
    return 0 if -2 <= exponent <= 3 else 3 * (exponent // 3)


def _axis_label(symbol: str, unit: str, power: int) -> str:
    shown = _mathematical(symbol)
    if power == 0:
        return shown if unit == "1" else f"{shown} / ({unit})"
    factor = f"$10^{{{power}}}$"
    return f"{shown} / {factor}" if unit == "1" else f"{shown} / ({factor} {unit})"


def _mathematical(symbol: str) -> str:
    """A symbol such as k_θ with its index set low."""
    letter, _, index = symbol.partition("_")
    return f"{letter}$_{{{index}}}$" if index else letter
