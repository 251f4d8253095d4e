"""Figures of a comparison on paper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pipelines.comparison_significance import Difference

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def plot_changes(
    names: Sequence[str], differences: Sequence[Difference], quantity: str, ax: Axes
) -> Axes:
    """Relative change of each mode; filled where it is significant, bars of two σ.

    Parameters
    ----------
    names : sequence of str
        Of the modes.
    differences : sequence of Difference
        One for each mode.
    quantity : str
        What changes.
    ax : Axes

    Returns
    -------
    Axes
    """
    from pipelines.figures_style import FAINT, RING

    places = np.arange(len(names))
    for significant, fill, label in (
        (True, RING, "significant"),
        (False, "white", "not significant or σ unknown"),
    ):
        chosen = [k for k, each in enumerate(differences) if each.is_significant == significant]
        if not chosen:
            continue
        std = np.array([differences[k].percent_std for k in chosen])
        ax.errorbar(
            places[chosen],
            [differences[k].percent for k in chosen],
            yerr=np.nan_to_num(2 * std, nan=0.0),
            fmt="o",
            color=RING,
            markerfacecolor=fill,
            elinewidth=1.0,
            capsize=2.0,
            label=label,
        )
    low, high = ax.get_ylim()
    if low < 0 < high:
        ax.axhline(0, color=FAINT, linewidth=0.8)
    ax.set_xticks(places, names, rotation=45 if len(names) > 9 else 0)
    ax.set_ylabel(f"change of {quantity} / %")
    ax.legend(loc="best")
    return ax


def plot_frf_pair(names: Sequence[str], curves: Sequence[tuple[Any, Any]], axes: Any) -> Any:
    """Magnitude and phase of the FRFs of two results.

    Parameters
    ----------
    names : (str, str)
    curves : sequence of (ndarray, ndarray)
        Frequencies in Hz and inertances of each result.
    axes : ndarray of Axes, shape (2,)
        For magnitude and phase.

    Returns
    -------
    ndarray of Axes
    """
    from pipelines.figures_labels import literal
    from pipelines.figures_style import SERIES, log_axis, phase_axes
    from pipelines.figures_values import wrapped_phase_deg

    magnitude, phase = axes
    styles = ({"color": SERIES[0]}, {"color": SERIES[5], "linestyle": "--"})
    for name, (frequency_hz, values), style in zip(names, curves, styles, strict=True):
        magnitude.plot(frequency_hz, np.abs(values), label=literal(name), **style)
        phase.plot(frequency_hz, wrapped_phase_deg(values), **style)
    log_axis(magnitude)
    magnitude.set_ylabel("|inertance| / ((m/s²)/N)")
    magnitude.legend(loc="lower right")
    phase_axes(phase)
    return axes
