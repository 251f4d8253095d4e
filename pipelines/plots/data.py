"""Figures of the measurement: set-up, coherence, reference sensor."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes

from ema.checks.quality import ReferenceCheck
from ema.core.frf import FRF
from pipelines.plots.style import FAINT, FITTED, MEASURED, log_axis, phase_axes, series_style
from pipelines.results.labels import (
    apart,
    coherence_map,
    in_band,
    literal,
    sparse_labels,
    wrapped_phase_deg,
)

MOST_COLUMNS = 500  # of a map on paper


def plot_setup(
    frf: FRF, ax: Axes, excitation_deg: float | None = None, reference_deg: float | None = None
) -> Axes:
    """Sketch the tyre with its measured positions, the force and the reference sensor.

    Parameters
    ----------
    frf : FRF
        Its `position_deg` and `run` give the positions and their colours.
    ax : Axes
    excitation_deg, reference_deg : float, optional
        Where the force and the reference sensor sit.

    Returns
    -------
    Axes
    """
    ax.set_aspect("equal")
    ax.set_axis_off()
    circle = np.linspace(0, 2 * np.pi, 361)
    for radius, width in ((1.0, 2.5), (0.55, 1.0)):
        ax.plot(radius * np.cos(circle), radius * np.sin(circle), color=FAINT, linewidth=width)
    _draw_positions(frf, ax)
    for angle in range(0, 360, 90):
        ax.text(*_on_circle(angle, 0.73), f"{angle}°", ha="center", va="center", color="#555555")
    ax.set_xlim(-1.1, 1.1)
    ax.set_ylim(-1.1, 1.1)
    if excitation_deg is not None:
        _force_arrow(ax, excitation_deg)
    if reference_deg is not None:
        x, y = _on_circle(reference_deg, 0.91)
        ax.plot(x, y, "*", markersize=10, color="black", linestyle="none", label="reference")
    ax.legend(
        loc="center",
        bbox_to_anchor=(0.0, 0.0),
        bbox_transform=ax.transData,
        handletextpad=0.2,
        labelspacing=0.3,
    )
    return ax


def plot_coherence(frf: FRF, ax: Axes, band_hz: tuple[float, float] | None = None) -> Axes:
    """Map of the coherence, position by position over frequency; grey where it is unknown.

    Parameters
    ----------
    frf : FRF
    ax : Axes
    band_hz : tuple of float, optional
        Band shown; all lines otherwise.

    Returns
    -------
    Axes
    """
    low, high = band_hz or (frf.frequency_hz[0], frf.frequency_hz[-1])
    shown = coherence_map(frf, (low, high), MOST_COLUMNS)
    image = ax.imshow(
        np.ma.masked_invalid(shown.values),
        aspect="auto",
        origin="lower",
        vmin=0,
        vmax=1,
        cmap=_with_grey("viridis"),
        interpolation="nearest",
        extent=(low, high, -0.5, len(shown.names) - 0.5),
    )
    ax.grid(visible=False)
    ax.set_yticks(*sparse_labels(shown.names))
    ax.set_xlabel("frequency / Hz")
    ax.set_ylabel("position" if np.isfinite(frf.position_deg).all() else "node")
    ax.figure.colorbar(image, ax=ax, label="coherence γ²", pad=0.02)
    if not np.isfinite(shown.values).any():
        ax.text(0.5, 0.5, "coherence unknown", transform=ax.transAxes, ha="center")
    return ax


def plot_reference(
    reference: ReferenceCheck, ax: Axes, band_hz: tuple[float, float] | None = None
) -> Axes:
    """Overlay the reference sensor's inertances of all runs.

    Parameters
    ----------
    reference : ReferenceCheck
    ax : Axes
    band_hz : tuple of float, optional
        Band shown; all lines otherwise.

    Returns
    -------
    Axes
    """
    low, high = band_hz or (reference.frequency_hz[0], reference.frequency_hz[-1])
    inside = in_band(reference.frequency_hz, (low, high))
    frequency = reference.frequency_hz[inside]
    names = apart(reference.run)
    for index, (name, values) in enumerate(zip(names, reference.values, strict=True)):
        style = series_style(index) | {"marker": ""}
        ax.plot(frequency, np.abs(values[inside]), label=literal(name), linewidth=0.9, **style)
    log_axis(ax)
    ax.set_xlim(low, high)
    ax.set_xlabel("frequency / Hz")
    ax.set_ylabel("|inertance| / ((m/s²)/N)")
    ax.legend(ncols=2 if len(names) <= 8 else 4, loc="lower right")
    return ax


def plot_drive_point(frf: FRF, row: int, band_hz: tuple[float, float], axes: Any) -> Any:
    """Draw magnitude and phase of the FRF at the force, with the limits of its phase.

    Parameters
    ----------
    frf : FRF
    row : int
        Row of `frf`.
    band_hz : tuple of float
        Band shown.
    axes : sequence of Axes
        One for the magnitude, one below it for the phase.

    Returns
    -------
    sequence of Axes
    """
    magnitude, phase = axes
    lines = in_band(frf.frequency_hz, band_hz)
    magnitude.plot(frf.frequency_hz[lines], np.abs(frf.values[row, lines]), color=MEASURED)
    log_axis(magnitude)
    magnitude.set_ylabel("|inertance| / ((m/s²)/N)")
    phase.plot(frf.frequency_hz[lines], wrapped_phase_deg(frf.values[row, lines]), color=MEASURED)
    for limit in (0, 180):
        phase.axhline(limit, color=FITTED, linewidth=0.8, linestyle=":")
    phase.set_xlim(*band_hz)
    phase_axes(phase)
    return axes


def _draw_positions(frf: FRF, ax: Axes) -> None:
    """Draw the positions, each run with its own mark."""
    runs = list(dict.fromkeys(frf.run))
    for index, (run, name) in enumerate(zip(runs, apart(runs), strict=True)):
        mine = np.array([name == run for name in frf.run])
        x, y = _on_circle(frf.position_deg[mine], 1.0)
        label = literal(name) if run else "positions"
        ax.plot(x, y, linestyle="none", label=label, **series_style(index))


def _on_circle(angle_deg: Any, radius: float) -> tuple[Any, Any]:
    angle = np.deg2rad(angle_deg)
    return radius * np.cos(angle), radius * np.sin(angle)


def _force_arrow(ax: Axes, angle_deg: float) -> None:
    tail, head = _on_circle(angle_deg, 1.45), _on_circle(angle_deg, 1.06)
    ax.annotate(
        "",
        xy=head,
        xytext=tail,
        arrowprops={"arrowstyle": "-|>", "color": FITTED, "linewidth": 2.2, "shrinkB": 0},
    )
    x, y = _on_circle(angle_deg, 1.53)
    ax.text(x, y, "F", color=FITTED, weight="bold", ha="center", va="center")
    ax.set_xlim(min(-1.1, x - 0.1), max(1.1, x + 0.1))
    ax.set_ylim(min(-1.1, y - 0.1), max(1.1, y + 0.1))


def _with_grey(name: str) -> Any:

    return colormaps[name].with_extremes(bad="#C8C8C8")
