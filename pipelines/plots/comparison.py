"""Charts of a comparison: changes over the modes, and FRFs of both results overlaid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pipelines.compare.compare import Comparison, common_positions
from pipelines.compare.modes import MatchedMode, mode_name
from pipelines.compare.significance import Difference
from pipelines.plots.chart import FAINT, RING, SERIES, Chart, as_text, axis, packed, printed
from pipelines.plots.charts_data import drive_point_row, frf_axes, magnitude_and_phase
from pipelines.plots.charts_matrix import mac_chart
from pipelines.results.labels import in_band, literal, short, wrapped_phase_deg
from pipelines.results.result import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIRST, SECOND = SERIES[0], SERIES[5]
BARS = "Bars: ± 2 standard deviations of the difference"


def change_chart(
    name: str, quantity: str, modes: Sequence[MatchedMode], differences: Sequence[Difference]
) -> Chart:
    """Relative change of each mode with its error bar; filled where it is significant.

    Parameters
    ----------
    name : str
        Of the chart, unique in the page.
    quantity : str
        ``"frequency"`` or ``"damping ratio"``.
    modes : sequence of MatchedMode
    differences : sequence of Difference
        One for each mode.
    """
    count = sum(each.is_significant for each in differences)
    names = _each_once([mode.name for mode in modes])
    traces = (
        _changes("significant", names, differences, {"color": RING, "size": 9}, significant=True),
        _changes(
            "not significant or σ unknown",
            names,
            differences,
            {"color": FAINT, "size": 9, "symbol": "circle-open", "line": {"width": 2}},
            significant=False,
        ),
    )
    return Chart(
        name,
        tuple(trace for trace in traces if trace["x"]),
        {
            "xaxis": axis("mode", type="category", categoryarray=names, categoryorder="array"),
            "yaxis": axis(f"change of {quantity} / %", zeroline=True, zerolinecolor="--soft"),
        },
        f"Change of the {quantity} of {len(modes)} modes in percent; {count} are significant.",
        f"Change of the {quantity}, second against first; {count} of {len(modes)} are significant. "
        f"A change that is the same for all modes has one cause; one that grows or falls over the "
        f"order tells belt from sidewall. Filled: significant. {BARS}.",
        printed(
            lambda _figures, ax: plot_changes(names, differences, quantity, ax),
            size_cm=(10.5, 7.5),
        ),
        height_px=380,
    )


def cross_mac_chart(comparison: Comparison) -> Chart | None:
    """MAC of all shapes of the first against all of the second; None where they are unknown."""
    if comparison.mac.size == 0 or not np.isfinite(comparison.mac).all():
        return None
    rows, columns = (
        _each_once([mode_name(k, mode) for k, mode in enumerate(result.modal_model.modes, start=1)])
        for result in (comparison.first, comparison.second)
    )
    first, second = comparison.names
    return mac_chart(
        comparison.mac,
        rows,
        columns,
        name="mac-between",
        titles=(short(first), short(second)),
        alternative=f"MAC of {len(rows)} shapes of {first} against {len(columns)} of {second}.",
        caption=f"MAC of the shapes of both results. {comparison.shapes_note} Matched modes should "
        "be close to 1 and stand alone in their row; large values elsewhere mean shapes that the "
        "positions cannot tell apart.",
    )


def frf_charts(comparison: Comparison, angles_deg: Sequence[float]) -> tuple[Chart, ...]:
    """FRFs of both results overlaid, at positions that both have.

    Parameters
    ----------
    comparison : Comparison
    angles_deg : sequence of float
        Wanted angles from the force; the nearest common position stands for each.
    """
    first, second = comparison.first, comparison.second
    here, there = common_positions(first.frf.position_deg, second.frf.position_deg)
    force_deg = first.excitation_deg
    if here.size == 0 or force_deg is None:
        return ()
    from_force = (first.frf.position_deg[here] - force_deg + 180) % 360 - 180
    chosen = {int(np.argmin(np.abs(from_force - wanted))) for wanted in angles_deg}
    return tuple(_frf_chart(comparison, int(here[k]), int(there[k])) for k in sorted(chosen))


def _each_once(names: Sequence[str]) -> list[str]:
    """Names of which no two are the same: an axis would draw them at one place."""
    return [
        name if names.index(name) == k else f"{name} ({names[: k + 1].count(name)})"
        for k, name in enumerate(names)
    ]


def _frf_chart(comparison: Comparison, here: int, there: int) -> Chart:
    first, second = comparison.first, comparison.second
    angle_deg = float(first.frf.position_deg[here])
    where = f"{angle_deg:g}°"
    if here == drive_point_row(first.frf, first.excitation_deg):
        where += ", at the force"
    names = tuple(map(short, comparison.names))
    curves = tuple(_curve(result, row) for result, row in ((first, here), (second, there)))
    traces = [
        trace
        for name, curve, line in zip(names, curves, _LINES, strict=True)
        for trace in magnitude_and_phase(
            *curve, {"name": as_text(name), "legendgroup": name, "line": line}
        )
    ]
    return Chart(
        f"frf-{here}",
        tuple(traces),
        frf_axes(),
        f"Measured inertance of both results at {where}, magnitude and phase.",
        f"Measured inertance of both results at {where}. Peaks that move apart are the change of "
        "frequency, peaks of another height that of damping or of modal mass. A constant factor "
        "between the two is a calibration, not the tyre.",
        printed(
            lambda _figures, axes: plot_frf_pair(names, curves, axes),
            size_cm=(13, 9),
            rows=2,
        ),
        wide=True,
        height_px=460,
    )


_LINES: tuple[dict[str, Any], ...] = (
    {"color": FIRST, "width": 1.5},
    {"color": SECOND, "width": 1.5, "dash": "dash"},
)


def _curve(result: Result, row: int) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
    """Lines and inertances of a row within the band."""
    shown = in_band(result.frf.frequency_hz, result.modal_model.band_hz)
    return result.frf.frequency_hz[shown], result.frf.values[row, shown]


def _changes(
    label: str,
    names: Sequence[str],
    differences: Sequence[Difference],
    marker: dict[str, Any],
    *,
    significant: bool,
) -> dict[str, Any]:
    chosen = [k for k, each in enumerate(differences) if each.is_significant == significant]
    std = np.array([differences[k].percent_std for k in chosen])
    return {
        "type": "scatter",
        "mode": "markers",
        "name": label,
        "x": [names[k] for k in chosen],
        "y": packed([differences[k].percent for k in chosen]),
        "error_y": {
            "type": "data",
            "array": np.nan_to_num(2 * std, nan=0.0).tolist(),
            "thickness": 1.5,
        },
        "marker": marker,
        "hovertemplate": "%{x}<br>%{y:+.3f} %<extra></extra>",
    }


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
    # Loads matplotlib, which the page on a screen does without.
    from pipelines.plots import style  # loads matplotlib, which the page does without

    places = np.arange(len(names))
    for significant, fill, label in (
        (True, style.RING, "significant"),
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
            color=style.RING,
            markerfacecolor=fill,
            elinewidth=1.0,
            capsize=2.0,
            label=label,
        )
    low, high = ax.get_ylim()
    if low < 0 < high:
        ax.axhline(0, color=style.FAINT, linewidth=0.8)
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
    # Loads matplotlib, which the page on a screen does without.
    from pipelines.plots import style

    magnitude, phase = axes
    styles = ({"color": style.SERIES[0]}, {"color": style.SERIES[5], "linestyle": "--"})
    for name, (frequency_hz, values), look in zip(names, curves, styles, strict=True):
        magnitude.plot(frequency_hz, np.abs(values), label=literal(name), **look)
        phase.plot(frequency_hz, wrapped_phase_deg(values), **look)
    style.log_axis(magnitude)
    magnitude.set_ylabel("|inertance| / ((m/s²)/N)")
    magnitude.legend(loc="lower right")
    style.phase_axes(phase)
    return axes
