"""Frequency response functions: the type, and their estimation from recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema._arrays import readonly


@dataclass(frozen=True, eq=False)
class FRF:
    """Inertances of all positions against one force, e^{+jωt}, H = X/F.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
        Frequency lines, equidistant.
    values : ndarray, shape (n_positions, n_frequencies), complex
        Inertance in (m/s²)/N.
    coherence : ndarray, shape (n_positions, n_frequencies)
        Ordinary coherence; NaN where unknown.
    std : ndarray, shape (n_positions, n_frequencies)
        Standard deviation of the real and of the imaginary part; NaN where unknown.
    node : ndarray of int, shape (n_positions,)
        Node numbers; −1 where there are none.
    position_deg : ndarray, shape (n_positions,)
        Angles counter-clockwise from the excitation's zero; NaN where there is no circle.
    run : tuple of str
        The run each row was measured in.
    """

    frequency_hz: NDArray[np.float64]
    values: NDArray[np.complex128]
    coherence: NDArray[np.float64]
    std: NDArray[np.float64]
    node: NDArray[np.int_]
    position_deg: NDArray[np.float64]
    run: tuple[str, ...]

    def __post_init__(self) -> None:
        for name, dtype in (
            ("frequency_hz", float),
            ("values", complex),
            ("coherence", float),
            ("std", float),
            ("node", int),
            ("position_deg", float),
        ):
            object.__setattr__(self, name, readonly(getattr(self, name), dtype))
