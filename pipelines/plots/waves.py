"""Figures of free waves: how rotation splits frequencies, and what a pair of waves looks like."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from model import Bifurcation
from pipelines.plots.style import FAINT, FITTED, MEASURED, RING, series_style, shades

DEFLECTION = 0.25  # drawn deflection of a wave of unit amplitude, in radii


def plot_bifurcation(found: Bifurcation, ax: Axes) -> Axes:
    """Frequencies over speed: regressive waves solid, progressive ones dashed.

    Parameters
    ----------
    found : Bifurcation
        At several speeds.
    ax : Axes

    Returns
    -------
    Axes
    """
    for row, order in enumerate(found.orders):
        color = series_style(row)["color"]
        for frequency_hz, style in ((found.regressive_hz, "-"), (found.progressive_hz, "--")):
            ax.plot(found.speed_rad_s, frequency_hz[row], style, color=color)
        known = np.flatnonzero(np.isfinite(found.regressive_hz[row]))
        if known.size:
            _name_at_end(found, row, int(order), int(known[-1]), color, ax)
    ax.plot([], [], "-", color=MEASURED, label="regressive")
    ax.plot([], [], "--", color=MEASURED, label="progressive")
    ax.margins(x=0.02)
    ax.set_xlabel("speed Ω / (rad/s)")
    ax.set_ylabel("frequency / Hz")
    ax.legend(loc="upper left")
    return ax


def plot_wave_frequencies(found: Bifurcation, ax: Axes) -> Axes:
    """Frequencies over order at the first speed: regressive and progressive waves.

    Parameters
    ----------
    found : Bifurcation
    ax : Axes

    Returns
    -------
    Axes
    """
    ax.plot(found.orders, found.regressive_hz[:, 0], "o-", color=RING, label="regressive")
    ax.plot(found.orders, found.progressive_hz[:, 0], "s--", color=FITTED, label="progressive")
    ax.set_xticks(found.orders)
    ax.set_title(f"Ω = {found.speed_rad_s[0]:g} rad/s")
    ax.set_xlabel("order n")
    ax.set_ylabel("frequency / Hz")
    ax.legend(loc="upper left")
    return ax


def plot_waves_unrolled(
    angles_rad: ArrayLike, times_s: ArrayLike, field: NDArray[np.float64], ax: Axes
) -> Axes:
    """Radial displacement over the angle, one curve per instant, from dark (first) to light.

    Parameters
    ----------
    angles_rad : array_like, shape (n_angles,)
    times_s : array_like, shape (n_times,)
    field : ndarray, shape (n_angles, n_times)
        Radial displacement, the largest value being 1.
    ax : Axes

    Returns
    -------
    Axes
    """
    angles, times = np.rad2deg(np.asarray(angles_rad)), np.asarray(times_s)
    for color, time, curve in zip(shades(times.size), times, field.T, strict=True):
        ax.plot(angles, curve, color=color, linewidth=1.0, label=f"{1e3 * time:.1f} ms")
    ax.set_xlim(0, 360)
    ax.set_xticks(range(0, 361, 60))
    ax.set_xlabel("angle / °")
    ax.set_ylabel("radial displacement / its maximum")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), title="time", handlelength=1.2)
    return ax


def plot_waves_on_circle(
    angles_rad: ArrayLike, field: NDArray[np.float64], names: Sequence[str], ax: Axes
) -> Axes:
    """Draw the ring at the beginning of a cycle (solid) and at its end (dashed).

    Parameters
    ----------
    angles_rad : array_like, shape (n_angles,)
        A closed turn: first and last angle meet.
    field : ndarray, shape (n_angles, 2)
        Radial displacement at both instants, the largest value being 1.
    names : sequence of str
        Names of both instants.
    ax : Axes

    Returns
    -------
    Axes
    """
    angles = np.asarray(angles_rad)
    ax.plot(np.cos(angles), np.sin(angles), color=FAINT, linewidth=0.7)
    styles = (("-", MEASURED, 1.4), ("--", FITTED, 1.4))
    for (style, color, width), curve, name in zip(styles, field.T, names, strict=True):
        radius = 1.0 + DEFLECTION * curve
        ax.plot(
            radius * np.cos(angles),
            radius * np.sin(angles),
            style,
            color=color,
            linewidth=width,
            label=name,
        )
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.legend(loc="center")
    return ax


def _name_at_end(
    found: Bifurcation, row: int, order: int, column: int, color: str, ax: Axes
) -> None:
    """Write the order between the ends of its two branches."""
    ax.annotate(
        f"n = {order}",
        (found.speed_rad_s[column], found.standing_hz[row, column]),
        xytext=(5, 0),
        textcoords="offset points",
        color=color,
        va="center",
        annotation_clip=False,
    )
