"""Figures of the identification: stability diagram, FRFs, shapes, how alike they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.poles.stability import Cluster, StabilityDiagram
from pipelines.plots.style import DROPPED, FAINT, FITTED, KEPT, MEASURED, RING, log_axis, phase_axes
from pipelines.results.labels import (
    in_band,
    mode_name,
    place_name,
    pole_marks,
    sparse_labels,
    spread,
    wrapped_phase_deg,
)

DEFLECTION = 0.3  # largest drawn deflection, in radii
POLE_STYLES: dict[str, dict[str, Any]] = {
    "not stable": {"marker": "+", "color": FAINT, "alpha": 0.6},
    "stable, not in a mode": {"marker": "x", "color": DROPPED},
    "in a mode, not stable": {"marker": "o", "color": KEPT, "markerfacecolor": "white"},
    "in a mode": {"marker": "o", "color": KEPT},
}


def plot_stability(diagram: StabilityDiagram, ax: Axes) -> Axes:
    """Draw the stability diagram over the mode indicator function.

    Parameters
    ----------
    diagram : StabilityDiagram
    ax : Axes

    Returns
    -------
    Axes
        The axis of the poles; the indicator has its own behind it.
    """
    low, high = diagram.band_hz
    _draw_indicator(diagram, ax)
    for label, chosen in pole_marks(diagram).items():
        ax.plot(
            diagram.frequency_hz[chosen],
            diagram.model_order[chosen],
            linestyle="none",
            markersize=3.0,
            markeredgewidth=0.7,
            label=label,
            **POLE_STYLES[label],
        )
    ax.set_xlim(low, high)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("frequency / Hz")
    ax.set_ylabel("model order")
    in_band = [cluster for cluster in diagram.clusters if low <= cluster.frequency_hz <= high]
    _name_clusters([cluster for cluster in in_band if cluster.kept], ax)
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=4, handletextpad=0.2)
    return ax


def plot_frf_magnitude(frf: FRF, model: ModalModel, row: int, ax: Axes) -> Axes:
    """Magnitude of one FRF, measured (dashed) and fitted (solid).

    Parameters
    ----------
    frf : FRF
    model : ModalModel
    row : int
        Row of `frf`.
    ax : Axes

    Returns
    -------
    Axes
    """
    shown, fitted = _shown_lines(frf, model)
    measured = np.abs(frf.values[row, shown])
    synthesis = np.abs(_fitted(frf, model, row, fitted))
    ax.plot(frf.frequency_hz[fitted], synthesis, color=FITTED, label="fitted", lw=2.0)
    ax.plot(frf.frequency_hz[shown], measured, "--", color=MEASURED, label="measured", lw=0.8)
    log_axis(ax)
    _shade_outside(model.band_hz, ax)
    ax.set_title(place_name(int(frf.node[row]), float(frf.position_deg[row])))
    ax.set_ylabel("|inertance| / ((m/s²)/N)")
    ax.legend(loc="lower right")
    return ax


def plot_frf_phase(frf: FRF, model: ModalModel, row: int, ax: Axes) -> Axes:
    """Phase of one FRF, measured (dashed) and fitted (solid), between −180° and 180°.

    Parameters
    ----------
    frf : FRF
    model : ModalModel
    row : int
        Row of `frf`.
    ax : Axes

    Returns
    -------
    Axes
    """
    shown, fitted = _shown_lines(frf, model)
    measured = wrapped_phase_deg(frf.values[row, shown])
    synthesis = wrapped_phase_deg(_fitted(frf, model, row, fitted))
    ax.plot(frf.frequency_hz[fitted], synthesis, color=FITTED, lw=2.0)
    ax.plot(frf.frequency_hz[shown], measured, "--", color=MEASURED, lw=0.8)
    _shade_outside(model.band_hz, ax)
    phase_axes(ax)
    return ax


def plot_shape_on_circle(mode: Mode, position_deg: ArrayLike, ax: Axes) -> Axes:
    """Draw a shape on the circle: undeformed (grey), deformed, half a period later (dotted).

    Parameters
    ----------
    mode : Mode
    position_deg : array_like, shape (n_positions,)
        Angles of the shape's values, counter-clockwise from the right.
    ax : Axes

    Returns
    -------
    Axes
    """
    angles = np.deg2rad(np.asarray(position_deg, dtype=float))
    rows = np.argsort(angles)
    closed = np.append(rows, rows[0])
    deflection = DEFLECTION * mode.shape.real
    circle = np.linspace(0, 2 * np.pi, 181)
    ax.plot(np.cos(circle), np.sin(circle), color=FAINT, linewidth=0.8)
    for sign, style in ((-1, ":"), (1, "-")):
        radius = 1 + sign * deflection
        x, y = radius * np.cos(angles), radius * np.sin(angles)
        ax.plot(x[closed], y[closed], style, color=RING, linewidth=0.9 if sign < 0 else 1.4)
    ax.plot(x, y, ".", color=RING, markersize=2.5)
    limit = 1.05 + DEFLECTION
    ax.set_xlim(-limit, limit)
    ax.set_ylim(-limit, limit)
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.set_title(mode_name(mode), loc="center", pad=2)
    return ax


def plot_shape_by_node(mode: Mode, names: Sequence[str], ax: Axes) -> Axes:
    """Draw a shape as bars over its nodes, where there is no circle to draw it on.

    Parameters
    ----------
    mode : Mode
    names : sequence of str, length n_positions
        Names of the nodes.
    ax : Axes

    Returns
    -------
    Axes
    """
    ax.bar(np.arange(len(names)), mode.shape.real, color=RING, width=0.7)
    ax.axhline(0, color="black", linewidth=0.6)
    ax.set_xticks(*sparse_labels(names))
    ax.set_ylim(-1.1, 1.1)
    ax.set_yticks([-1, 0, 1])
    ax.grid(visible=False, axis="x")
    ax.set_title(mode_name(mode), loc="center", pad=2)
    return ax


def plot_frac(model: ModalModel, ax: Axes) -> Axes:
    """FRAC of measured against fitted FRFs, position by position.

    Parameters
    ----------
    model : ModalModel
    ax : Axes

    Returns
    -------
    Axes
    """
    on_circle = bool(np.isfinite(model.position_deg).all())
    nodes = np.where(model.node >= 0, model.node, np.arange(1, model.node.size + 1))
    where = model.position_deg if on_circle else nodes
    ax.plot(where, model.frac, "o-", color=RING, linewidth=0.6)
    ax.axhline(0.9, color=FITTED, linewidth=0.8, linestyle="--")
    ax.set_ylim(max(0.0, np.floor(10 * min(model.frac.min(), 0.85) - 0.5) / 10), 1.01)
    if on_circle:
        ax.set_xlim(-5, 365)
        ax.set_xticks(range(0, 361, 60))
    ax.set_xlabel("position / °" if on_circle else "node")
    ax.set_ylabel("FRAC")
    return ax


def _draw_indicator(diagram: StabilityDiagram, ax: Axes) -> None:
    inside = in_band(diagram.indicator_hz, diagram.band_hz)
    behind = ax.twinx()
    behind.plot(
        diagram.indicator_hz[inside], diagram.indicator[inside], color="#9DB7CC", linewidth=1.4
    )
    log_axis(behind)
    behind.set_ylabel("RMS inertance / ((m/s²)/N)", color="#557A95")
    behind.tick_params(axis="y", colors="#557A95", which="both")
    behind.grid(visible=False)
    behind.spines["right"].set_visible(True)
    ax.set_zorder(behind.get_zorder() + 1)
    ax.patch.set_visible(False)


def _name_clusters(kept: Sequence[Cluster], ax: Axes) -> None:
    """Write the frequency of each kept cluster above the diagram, side by side."""
    low, high = ax.get_xlim()
    frequencies = sorted(cluster.frequency_hz for cluster in kept)
    places = spread(frequencies, gap=(high - low) / 45)
    for frequency, place in zip(frequencies, places, strict=True):
        ax.axvline(frequency, color=KEPT, linewidth=0.6, alpha=0.6)
        ax.annotate(
            f"{frequency:.1f}",
            xy=(frequency, 1.0),
            xytext=(place, 1.045),
            xycoords=("data", "axes fraction"),
            textcoords=("data", "axes fraction"),
            rotation=90,
            ha="center",
            va="bottom",
            fontsize=7.5,
            arrowprops={"arrowstyle": "-", "color": KEPT, "linewidth": 0.6, "shrinkA": 0},
        )


def _shown_lines(frf: FRF, model: ModalModel) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Lines to draw as measured (the band and what was fitted) and as fitted."""
    low = min(model.band_hz[0], model.fit_band_hz[0])
    high = max(model.band_hz[1], model.fit_band_hz[1])
    return in_band(frf.frequency_hz, (low, high)), in_band(frf.frequency_hz, model.fit_band_hz)


def _shade_outside(band_hz: tuple[float, float], ax: Axes) -> None:
    """Grey what was fitted for the sake of the band only."""
    left, right = ax.dataLim.intervalx
    ax.set_xlim(left, right)
    for start, stop in ((left, band_hz[0]), (band_hz[1], right)):
        if stop > start:
            ax.axvspan(start, stop, color="#EEEEEE", linewidth=0)


def _fitted(
    frf: FRF, model: ModalModel, row: int, lines: NDArray[np.bool_]
) -> NDArray[np.complex128]:
    return np.asarray(model.synthesise(frf.frequency_hz[lines], frf.run)[row])
