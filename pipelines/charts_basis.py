"""What all charts share: axes with their units, texts from files, and how they are printed."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
        Called with the module `pipelines.figures`, the data and the axis; with the axes as an
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
        from pipelines import figures

        margins = figures.Margins(**margins_cm)
        with figures.styled_figure(*size_cm, rows, margins=margins, sharex=True) as (figure, ax):
            plot(figures, *data, ax)
        return figure

    return draw
