"""The description of a plot: panels, axes and series; `draw` and `chart` render it.

Colours are names of the page's style (``report.css``), so that they follow light and dark; texts
are plain texts, whatever they hold. Widths and sizes are pixels of the page.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.results.labels import wrapped_phase_deg

MEASURED, FITTED, RING = "--measured", "--fitted", "--ring"
KEPT, DROPPED, FAINT = "--kept", "--dropped", "--faint"
SERIES = tuple(f"--series-{number}" for number in range(1, 8))
DASHES = ("solid", "dash", "dot", "dashdot")
FREQUENCY = "frequency / Hz"
INERTANCE = "|inertance| / ((m/s²)/N)"
ORDER = "order n"
SHOWN_DECADES = 4.0  # of a logarithmic axis, below its largest value


@dataclass(frozen=True)
class Axis:
    """An axis.

    Parameters
    ----------
    title : str
        Quantity and unit.
    range : tuple of float, optional
        Its ends; they follow from the data otherwise.
    log : bool
        Whether it is logarithmic.
    ticks, labels : sequence
        Where ticks stand, and their labels where these are not numbers.
    names : sequence of str
        Categories at 0, 1, 2, …; each is used once.
    every : int
        Which of the categories are labelled.
    reverse : bool
        Whether it runs down.
    from_zero : bool
        Whether it begins at zero.
    """

    title: str = ""
    range: tuple[float, float] | None = None
    log: bool = False
    ticks: Sequence[float] = ()
    labels: Sequence[str] = ()
    names: Sequence[str] = ()
    every: int = 1
    reverse: bool = False
    from_zero: bool = False


@dataclass(frozen=True, eq=False)
class Curve:
    """Values over x: a line, markers, or both.

    Parameters
    ----------
    x, y : array_like, shape (n,)
        A gap where `y` is NaN.
    colour : str
        A name of the page's style, or one fixed colour as ``"#rrggbb"``.
    name : str
        In the legend, if `listed`.
    width : float
        Of the line; none where 0.
    dash : str
        One of `DASHES`.
    marker : str
        A symbol of Plotly such as ``"circle-open"``; none where empty.
    size : float
        Of the markers.
    hover : str
        What the page shows of a point, as a template of Plotly; nothing where empty.
    texts : sequence of str
        One for each point, for `hover`; written beside the points where `labelled`.
    values : array_like, optional
        One more number for each point, for `hover`.
    x_bars, y_bars : ndarray, optional
        Half the lengths of error bars; NaN where unknown.
    group : str
        Curves of a group are switched together.
    right : bool
        Whether it belongs to the axis on the right.
    """

    x: ArrayLike
    y: ArrayLike
    colour: str
    name: str = ""
    width: float = 0.0
    dash: str = "solid"
    marker: str = ""
    size: float = 7.0
    opacity: float = 1.0
    hover: str = ""
    texts: Sequence[str] = ()
    labelled: bool = False
    values: ArrayLike | None = None
    x_bars: NDArray[np.float64] | None = None
    y_bars: NDArray[np.float64] | None = None
    listed: bool = True
    group: str = ""
    right: bool = False


@dataclass(frozen=True, eq=False)
class Band:
    """The room between two curves, filled."""

    x: ArrayLike
    low: ArrayLike
    high: ArrayLike
    colour: str
    name: str = ""
    opacity: float = 0.18


@dataclass(frozen=True, eq=False)
class Bars:
    """Bars from zero, with error bars of half the length `y_bars`."""

    x: ArrayLike
    y: ArrayLike
    colour: str
    width: float = 0.5
    y_bars: NDArray[np.float64] | None = None
    hover: str = ""


@dataclass(frozen=True)
class Rule:
    """A straight line across the panel, level or upright."""

    at: float
    colour: str = FAINT
    dash: str = "solid"
    width: float = 1.0
    upright: bool = False


@dataclass(frozen=True)
class Span:
    """A shaded range of x."""

    start: float
    stop: float


@dataclass(frozen=True)
class Flags:
    """Places of x marked by lines and named above the data, side by side.

    The panel needs the ranges of both axes; `height` is the share of it below the names.
    """

    at: Sequence[float]
    names: Sequence[str]
    height: float


@dataclass(frozen=True)
class Note:
    """A text in the panel; `align` is the side of it that is at `x`."""

    x: float
    y: float
    text: str
    colour: str = "--soft"
    align: str = "center"


@dataclass(frozen=True, eq=False)
class Map:
    """A matrix in colours.

    Parameters
    ----------
    z : ndarray, shape (n_rows, n_columns)
        NaN where unknown.
    low, high : float
        Ends of the scale.
    scale : str
        ``"map"``, ``"share"`` (pale to dark) or ``"signed"`` (orange, white, blue).
    hover : str
        As for a `Curve`.
    x : ndarray, shape (n_columns,), optional
        Evenly spaced; without it the columns are the categories of the axis.
    label : str
        Of the scale.
    cells : sequence of sequence of str
        Texts in the cells.
    """

    z: NDArray[np.float64]
    low: float
    high: float
    scale: str
    hover: str
    x: NDArray[np.float64] | None = None
    label: str = ""
    cells: Sequence[Sequence[str]] = ()


Series = Curve | Band | Bars | Rule | Span | Flags | Note | Map


@dataclass(frozen=True)
class Panel:
    """Series over one pair of axes.

    Parameters
    ----------
    series : tuple of Series
        What comes later is drawn in front.
    x, y : Axis
    right : Axis, optional
        A second vertical axis, of the curves at the back.
    title : str
    legend : str
        Where a figure has it: a place of matplotlib, ``"below"`` or ``"beside"`` the panel.
    equal : bool
        Whether both axes have one scale.
    bare : bool
        Whether axes and grid are left out.
    """

    series: tuple[Series, ...]
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    right: Axis | None = None
    title: str = ""
    legend: str = "best"
    equal: bool = False
    bare: bool = False


@dataclass(frozen=True)
class Margins:
    """Room around and between axes in cm, for tick labels, axis labels and titles."""

    left: float = 1.6
    right: float = 0.3
    bottom: float = 1.15
    top: float = 0.55
    between_columns: float = 1.0
    between_rows: float = 0.5


@dataclass(frozen=True)
class Plot:
    """Panels in rows and columns.

    Parameters
    ----------
    panels : tuple of Panel
        Row by row. Panels one below the other share their x axis where only the last names it.
    size_cm : tuple of float
        Width and height in print.
    columns : int
    heights, widths : tuple of float
        Shares of rows and columns, where they differ.
    margins : Margins
    together : bool
        Whether the page shows the values of all curves at the frequency pointed at.
    """

    panels: tuple[Panel, ...]
    size_cm: tuple[float, float] = (10, 8)
    columns: int = 1
    heights: tuple[float, ...] = ()
    widths: tuple[float, ...] = ()
    margins: Margins = Margins()
    together: bool = False


def log_axis(title: str, *values: ArrayLike) -> Axis:
    """A logarithmic axis for values, at most `SHOWN_DECADES` below the largest one."""
    each = np.concatenate([np.ravel(np.abs(one)) for one in values]) if values else np.empty(0)
    powers = np.log10(each[np.isfinite(each) & (each > 0)])
    if powers.size == 0:
        return Axis(title, log=True)
    top = float(powers.max())
    bottom = max(float(powers.min()), top - SHOWN_DECADES)
    room = 0.05 * max(top - bottom, 0.5)
    return Axis(title, (10 ** (bottom - room), 10 ** (top + room)), log=True)


PHASE = Axis("phase / °", (-190, 190), ticks=(-180, -90, 0, 90, 180))


def magnitude_and_phase(
    frequency_hz: NDArray[np.float64],
    inertance: NDArray[np.complex128],
    colour: str,
    name: str = "",
    *,
    width: float = 1.3,
    dash: str = "solid",
    at: str = "%{x:.2f} Hz<br>",
) -> tuple[Curve, Curve]:
    """Curves of one FRF for two panels, switched together.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
    inertance : ndarray, shape (n_frequencies,)
        In (m/s²)/N.
    colour, name, width, dash
        As of a `Curve`.
    at : str
        Begins the texts that the page shows of a point.
    """
    box = "<extra>%{fullData.name}</extra>" if name else ""
    level, phase = np.abs(inertance), wrapped_phase_deg(inertance)
    hover = f"{at}%{{y:.4~g}} (m/s²)/N{box}"
    top = Curve(frequency_hz, level, colour, name, width, dash, hover=hover, group=name)
    hover = f"{at}phase %{{y:.1f}}°{box}"
    return top, Curve(
        frequency_hz, phase, colour, name, width, dash, hover=hover, group=name, listed=False
    )
