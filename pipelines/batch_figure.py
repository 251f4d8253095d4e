"""The figure of a batch: frequencies of all campaigns over the order."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from pipelines.batch_record import Record
from pipelines.charts_batch import points_by_tyre
from pipelines.figures_labels import literal, short
from pipelines.figures_style import SERIES, series_style


def plot_frequencies(records: Sequence[Record], ax: Axes) -> Axes:
    """Frequency over order, one point a mode, tyres side by side in their colours.

    Parameters
    ----------
    records : sequence of Record
    ax : matplotlib.axes.Axes

    Returns
    -------
    Axes
    """
    shown = points_by_tyre(records)
    for index, points in enumerate(shown):
        named = index < len(SERIES) - 1 or len(shown) == len(SERIES)
        style = series_style(min(index, len(SERIES) - 1))
        label = literal(short(points.tyre, 18)) if named else "others"
        ax.plot(
            points.place,
            points.frequency_hz,
            linestyle="",
            alpha=0.5,
            markeredgewidth=0,
            label=label if named or index == len(SERIES) - 1 else None,
            **style,
        )
    ax.set_xlabel("order")
    ax.set_ylabel("frequency / Hz")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    return ax
