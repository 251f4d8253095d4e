"""Interactive charts as data: traces and layout for the page, and the same drawn for paper."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

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


def packed(values: ArrayLike) -> dict[str, str]:
    """Numbers for a chart: single precision, base64; `shape` for a matrix."""
    array = np.ascontiguousarray(values, dtype="<f4")
    found = {"dtype": "f4", "bdata": b64encode(array.tobytes()).decode("ascii")}
    if array.ndim > 1:
        found["shape"] = ",".join(map(str, array.shape))
    return found
