"""Moving averages and medians along the lines of a spectrum; `scipy.ndimage` takes long to load."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray


def moving_mean(values: NDArray[Any], width: int) -> NDArray[np.float64]:
    """Mean of `width` (odd) neighbours along the last axis; the outermost values go on."""
    return np.asarray(np.mean(_windows(values, width), axis=-1))


def moving_median(values: NDArray[Any], width: int) -> NDArray[np.float64]:
    """Median of `width` (odd) neighbours along the last axis; the outermost values go on."""
    return np.asarray(np.median(_windows(values, width), axis=-1))


def _windows(values: NDArray[Any], width: int) -> NDArray[np.float64]:
    margins = [(0, 0)] * (np.ndim(values) - 1) + [(width // 2, width // 2)]
    extended = np.pad(np.asarray(values, dtype=np.float64), margins, mode="edge")
    return sliding_window_view(extended, width, axis=-1)
