"""Interactive charts as data: traces and layout for the page, and the same drawn for paper."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Colours are names of the page's style (``report.css``), so that they follow light and dark.
MEASURED, FITTED, RING, KEPT, DROPPED, FAINT = (
    "--measured",
    "--fitted",
    "--ring",
    "--kept",
    "--dropped",
    "--faint",
)
SERIES = tuple(f"--series-{number}" for number in range(1, 8))


@dataclass(frozen=True)
class Drawing:
    """A figure as it is printed: nothing in it moves.

    Parameters
    ----------
    name : str
        Unique in the page; the name of its file.
    alternative, caption : str
        What it shows, and what to look for.
    draw : callable
        Gives a matplotlib figure.
    wide : bool
        Whether it needs the whole width of the page.
    """

    name: str
    alternative: str
    caption: str
    draw: Callable[[], Figure]
    wide: bool = False


@runtime_checkable
class Drawn(Protocol):
    """A block that moves on the page and is drawn for paper."""

    @property
    def drawings(self) -> tuple[Drawing, ...]:
        """The block in print."""


@dataclass(frozen=True)
class Chart:
    """A figure that zooms and shows values, with its caption and its picture for paper.

    Parameters
    ----------
    name : str
        Unique in the page, for anchors and file names: letters and hyphens.
    data : tuple of mapping
        Traces as Plotly's JSON describes them; arrays from `packed`; colours such as `RING`.
    layout : mapping
        Layout in the same form; fonts, margins and colours of paper and axes come from the page.
    alternative : str
        What the chart shows, for readers who cannot see it, with its main finding.
    caption : str
        What to look for.
    draw : callable
        Draws the same in print: gives a matplotlib figure.
    wide : bool
        Whether it needs the whole width of the page.
    height_px : int
        Height in the page.
    """

    name: str
    data: tuple[Mapping[str, Any], ...]
    layout: Mapping[str, Any]
    alternative: str
    caption: str
    draw: Callable[[], Figure]
    wide: bool = False
    height_px: int = 340
    kind: ClassVar[str] = "chart"

    @property
    def drawings(self) -> tuple[Drawing, ...]:
        """The chart in print."""
        return (Drawing(self.name, self.alternative, self.caption, self.draw, self.wide),)

    @property
    def specification(self) -> dict[str, Any]:
        """What the page's script reads."""
        return {"data": self.data, "layout": self.layout}


def packed(values: ArrayLike) -> dict[str, str]:
    """Numbers for a chart: single precision, base64; `shape` for a matrix."""
    array = np.ascontiguousarray(values, dtype="<f4")
    found = {"dtype": "f4", "bdata": b64encode(array.tobytes()).decode("ascii")}
    if array.ndim > 1:
        found["shape"] = ",".join(map(str, array.shape))
    return found


FREQUENCY = "frequency / Hz"
INERTANCE = "|inertance| / ((m/s²)/N)"
NO_COLOUR = "rgba(0, 0, 0, 0)"
#: Colour scales for any colour vision; two of them follow the page into the dark,
#: and numbers can be read on every colour of these.
MAP_SCALE = "Viridis"
SHARE_SCALE = [[0, "--paper"], [1, "--cell-above"]]
SIGNED_SCALE = [[0, "--cell-below"], [0.5, "--paper"], [1, "--cell-above"]]


def axis(title: str, **options: Any) -> dict[str, Any]:
    """An axis with its title; `options` as Plotly names them."""
    return {"title": {"text": title}, **options}


def log_axis(title: str, **options: Any) -> dict[str, Any]:
    """A logarithmic axis with plain numbers."""
    return axis(title, type="log", tickformat="~g", dtick=1, **options)


def as_text(text: str) -> str:
    """A text from a file as it stands: nothing in it is taken for markup."""
    return escape(text, quote=False)


def printed(
    plot: Callable[..., Any],
    *data: Any,
    size_cm: tuple[float, float],
    rows: int = 1,
    **margins_cm: float,
) -> Callable[[], Figure]:
    """How a chart is drawn on paper, in the common style.

    Parameters
    ----------
    plot : callable
        Called with the module `pipelines.plots.figures`, the data and the axis; with the axes as an
        array where there are several.
    data
        Passed on to `plot`.
    size_cm : tuple of float
        Width and height.
    rows : int
        Axes one below the other, over one frequency.
    margins_cm
        Margins that differ from the usual ones.
    """

    def draw() -> Figure:
        # Loaded here alone: a page on a screen does not wait for it.
        from pipelines.plots import figures

        margins = figures.Margins(**margins_cm)
        with figures.styled_figure(*size_cm, rows, margins=margins, sharex=True) as (figure, ax):
            plot(figures, *data, ax)
        return figure

    return draw
