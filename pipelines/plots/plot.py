"""The description of a plot: panels, axes and series; `draw` and `chart` render it.

Colours are names of the page's style (``colours.css``), so that they follow light and dark; texts
are plain texts, never markup. Widths and sizes are pixels of the page. Imported as `go`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipelines.results.tables import wrapped_phase_deg

Floats = NDArray[np.float64]
MEASURED, FITTED, RING = "--measured", "--fitted", "--ring"
KEPT, DROPPED, FAINT = "--kept", "--dropped", "--faint"
SERIES = tuple(f"--series-{number}" for number in range(1, 8))
#: Colour scales for any colour vision; two of them follow the page into the dark,
#: and numbers can be read on every colour of these.
SCALES: dict[str, Any] = {
    "map": "Viridis",
    "share": [[0, "--paper"], [1, "--cell-above"]],
    "signed": [[0, "--cell-below"], [0.5, "--paper"], [1, "--cell-above"]],
}
DASHES = ("solid", "dash", "dot", "dashdot")
FREQUENCY = "frequency / Hz"
INERTANCE = "|inertance| / ((m/s²)/N)"
ORDER = "order n"
SHOWN_DECADES = 4.0  # of a logarithmic axis, below its largest value


@dataclass(frozen=True)
class Axis:
    """An axis: its title has quantity and unit; without a range its ends follow from the data."""

    title: str = ""
    range: tuple[float, float] | None = None
    log: bool = False
    ticks: Sequence[float] = ()
    labels: Sequence[str] = ()  # of the ticks, where these are not numbers
    names: Sequence[str] = ()  # categories at 0, 1, 2, …; each is used once
    every: int = 1  # which of the categories are labelled
    reverse: bool = False  # whether it runs down
    from_zero: bool = False


@dataclass(frozen=True, eq=False)
class Curve:
    """Values over x, shape (n,): a line, markers, or both; a gap where `y` is NaN."""

    x: ArrayLike
    y: ArrayLike
    colour: str  # a name of the page's style, or one fixed colour such as "#rrggbb"
    name: str = ""  # in the legend, if `listed`
    width: float = 0.0  # of the line; none where 0
    dash: str = "solid"  # one of `DASHES`
    marker: str = ""  # a symbol of Plotly such as "circle-open"; none where empty
    size: float = 7.0  # of the markers
    opacity: float = 1.0
    hover: str = ""  # what the page shows of a point, as a template of Plotly
    texts: Sequence[str] = ()  # one for each point, for `hover`; beside them where `labelled`
    labelled: bool = False
    values: ArrayLike | None = None  # one more number for each point, for `hover`
    x_bars: Floats | None = None  # half the lengths of error bars; NaN: unknown
    y_bars: Floats | None = None
    listed: bool = True
    group: str = ""  # curves of a group are switched together
    right: bool = False  # whether it belongs to the axis on the right


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
    y_bars: Floats | None = None
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
class Note:
    """A text in the panel; `align` is the side of it that is at `x`."""

    x: float
    y: float
    text: str
    colour: str = "--soft"
    align: str = "center"
    upward: bool = False  # whether it is read from below, and begins at `y`


@dataclass(frozen=True, eq=False)
class Map:
    """A matrix in colours, shape (n_rows, n_columns); NaN where unknown."""

    z: Floats
    low: float  # ends of the scale
    high: float
    scale: str  # "map", "share" (pale to dark) or "signed" (orange, white, blue)
    hover: str  # as for a `Curve`
    x: Floats | None = None  # evenly spaced; else columns are categories
    label: str = ""  # of the scale
    cells: Sequence[Sequence[str]] = ()  # texts in the cells


Series = Curve | Band | Bars | Rule | Span | Note | Map


@dataclass(frozen=True)
class Panel:
    """Series over one pair of axes; what comes later is drawn in front."""

    series: tuple[Series, ...]
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    right: Axis | None = None  # a second vertical axis, of the curves at the back
    title: str = ""
    legend: str = "best"  # in a figure: a place of matplotlib, "below", "beside", or none
    equal: bool = False  # whether both axes have one scale
    bare: bool = False  # whether axes and grid are left out


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
    """Panels row by row.

    Panels one below the other share their x axis where only the last one names it.
    """

    panels: tuple[Panel, ...]
    size_cm: tuple[float, float] = (10, 8)  # width and height in print
    columns: int = 1
    heights: tuple[float, ...] = ()  # shares of the rows, where they differ
    widths: tuple[float, ...] = ()
    margins: Margins = Margins()
    together: bool = False  # whether the page shows all curves at the frequency pointed at


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
    frequency_hz: Floats,
    inertance: NDArray[np.complex128],
    colour: str,
    name: str = "",
    *,
    width: float = 1.3,
    dash: str = "solid",
    at: str = "%{x:.2f} Hz<br>",
) -> tuple[Curve, Curve]:
    """Curves of one FRF, shape (n_frequencies,), for two panels, switched together.

    `at` begins the texts that the page shows of a point.
    """
    box = "<extra>%{fullData.name}</extra>" if name else ""
    level, phase = np.abs(inertance), wrapped_phase_deg(inertance)
    hover = f"{at}%{{y:.4~g}} (m/s²)/N{box}"
    top = Curve(frequency_hz, level, colour, name, width, dash, hover=hover, group=name)
    hover = f"{at}phase %{{y:.1f}}°{box}"
    return top, Curve(
        frequency_hz, phase, colour, name, width, dash, hover=hover, group=name, listed=False
    )
