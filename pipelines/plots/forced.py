"""Figures of forced vibration: inertance, the cleat test, the hub, the tyre on the road."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from model import HubResponse
from pipelines.plots.style import FITTED, KEPT, RING, log_axis, phase_axes, series_style, shades
from pipelines.results.labels import wrapped_phase_deg
from pipelines.simulate.responses import CleatResponse, LoadedSweep, SimulatedInertance

LINES = ("-", "--", "-.", ":")


def plot_inertances(
    curves: Mapping[str, SimulatedInertance],
    ax: Axes,
    styles: Mapping[str, Mapping[str, Any]] | None = None,
) -> Axes:
    """Magnitudes of inertances on a logarithmic axis.

    Parameters
    ----------
    curves : mapping of str to SimulatedInertance
        By name; all in one unit.
    ax : Axes
    styles : mapping of str to mapping, optional
        Line properties by name in place of the usual ones.

    Returns
    -------
    Axes
    """
    for index, (name, curve) in enumerate(curves.items()):
        style: dict[str, Any] = {
            "color": series_style(index)["color"],
            "linestyle": LINES[index % len(LINES)],
            **(styles or {}).get(name, {}),
        }
        ax.plot(curve.frequency_hz, curve.magnitude, label=name, **style)
    log_axis(ax)
    ax.margins(x=0.01)
    ax.set_xlabel("frequency / Hz")
    ax.set_ylabel(f"|inertance| / ({next(iter(curves.values())).unit})")
    if len(curves) > 1:
        ax.legend(loc="lower right")
    return ax


def plot_phase(curve: SimulatedInertance, ax: Axes) -> Axes:
    """Phase of an inertance, with a gap wherever it wraps.

    Parameters
    ----------
    curve : SimulatedInertance
    ax : Axes

    Returns
    -------
    Axes
    """
    ax.plot(curve.frequency_hz, wrapped_phase_deg(curve.values), color=RING)
    phase_axes(ax)
    return ax


def plot_cleat_response(found: CleatResponse, ax: Axes) -> Axes:
    """What a point reads after the blow, over time.

    Parameters
    ----------
    found : CleatResponse
    ax : Axes

    Returns
    -------
    Axes
    """
    ax.plot(1e3 * found.time_s, found.response, color=RING)
    ax.margins(x=0.01)
    ax.set_xlabel("time / ms")
    ax.set_ylabel(f"{found.observer.quantity} / ({found.observer.unit})")
    return ax


def plot_cleat_spectrum(found: CleatResponse, ax: Axes) -> Axes:
    """The same over frequency.

    Parameters
    ----------
    found : CleatResponse
    ax : Axes

    Returns
    -------
    Axes
    """
    ax.plot(found.frequency_hz, np.abs(found.spectrum), color=RING)
    log_axis(ax)
    ax.margins(x=0.01)
    ax.set_xlabel("frequency / Hz")
    ax.set_ylabel(f"|spectrum| / ({found.observer.unit}·s)")
    return ax


def plot_transmissibility(found: HubResponse, ax: Axes) -> Axes:
    """Forces and moment on the hub per unit of force on the belt.

    Parameters
    ----------
    found : HubResponse
    ax : Axes

    Returns
    -------
    Axes
    """
    for values, name, color, style in (
        (found.force_x, "force x / N", RING, "-"),
        (found.force_z, "force z / N", FITTED, "--"),
        (found.moment_m, "moment / (N m)", KEPT, "-."),
    ):
        magnitude = np.abs(values)
        if magnitude.max() > 0:
            ax.plot(found.frequency_hz, magnitude, style, color=color, label=name)
    log_axis(ax)
    ax.margins(x=0.01)
    ax.set_xlabel("frequency / Hz")
    ax.set_ylabel("at the hub per N on the belt")
    ax.legend(loc="best")
    return ax


def plot_loaded_frequencies(found: LoadedSweep, ax: Axes) -> Axes:
    """Change of each frequency with the load, against the smallest one, mode by mode.

    Parameters
    ----------
    found : LoadedSweep
    ax : Axes

    Returns
    -------
    Axes
    """
    rising = np.argsort(found.load_n)
    orders = found.dominant_order[rising[-1]]
    colors = shades(int(orders.max()) + 1)
    for mode, order in enumerate(orders):
        second = bool(np.any(orders[:mode] == order))
        label = None if second else f"n = {order}"
        style = "--" if second else "-"
        frequency_hz = found.frequency_hz[rising, mode]
        change = 100.0 * (frequency_hz / frequency_hz[0] - 1.0)
        ax.plot(found.load_n[rising], change, style, marker=".", color=colors[order], label=label)
    ax.margins(x=0.01)
    ax.set_xlabel("vertical load / N")
    ax.set_ylabel("change of frequency / %")
    ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return ax


def plot_deflection(found: LoadedSweep, ax: Axes) -> Axes:
    """Radial deflection by the largest load around the tyre.

    Parameters
    ----------
    found : LoadedSweep
    ax : Axes

    Returns
    -------
    Axes
    """
    ax.plot(found.angle_deg, 1e3 * found.deflection_m, color=RING)
    ax.set_xlim(-180, 180)
    ax.set_xticks(range(-180, 181, 60))
    ax.set_title(f"load {found.load_n.max():g} N")
    ax.set_xlabel("angle from the contact / °")
    ax.set_ylabel("radial deflection / mm")
    return ax
