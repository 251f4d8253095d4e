"""Runs of equal samples: the flat tops of a clipped signal, and stretches where nothing moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

# Two equal samples on top of each other happen; three and more are a limit that was reached.
_SHORTEST_TOP = 3
# A smooth top rounded to a step leaves its run by four steps at most; a limit cuts steep flanks.
_ROUNDED_STEPS = 5.0
# With fewer levels than these every top is flat: a quiet signal in coarse steps, a trigger.
_FEWEST_LEVELS = 64


@dataclass
class _Extreme:
    """The largest value so far and how many samples lie on it in flat tops."""

    value: float = -np.inf
    n_flat: int = 0

    def add(
        self, top: float, flat_values: NDArray[np.float64], flat_lengths: NDArray[np.int_]
    ) -> None:
        if top > self.value:
            self.value, self.n_flat = top, 0
        self.n_flat += int(flat_lengths[flat_values == self.value].sum())


class Plateaus:
    """Runs of equal values of a signal that comes piece by piece.

    Attributes
    ----------
    longest : int
        Length of the longest run.
    longest_start : int
        Its first sample.
    step : float
        Smallest difference between two samples in a row; infinite for a constant.
    """

    def __init__(self) -> None:
        self.longest = self.longest_start = 0
        self.step = np.inf
        self._high, self._low = _Extreme(), _Extreme()
        self._before = np.nan  # value ahead of the run that is still open
        self._open = np.zeros(0)
        self._open_length = self._n = 0

    def add(self, piece: NDArray[np.float64]) -> None:
        """Go on with the next samples; NaN is equal to nothing."""
        if not piece.size:
            return
        starts = np.r_[0, np.flatnonzero(piece[1:] != piece[:-1]) + 1]
        lengths = np.diff(np.r_[starts, piece.size])
        values = piece[starts]
        starts = starts + self._n
        if self._open_length:
            if values[0] == self._open[0]:
                starts[0] -= self._open_length
                lengths[0] += self._open_length
            else:
                values = np.r_[self._open, values]
                lengths = np.r_[self._open_length, lengths]
                starts = np.r_[self._n - self._open_length, starts]
        self._n += piece.size
        self._judge(values, lengths, starts)
        self._open, self._open_length = values[-1:], int(lengths[-1])
        self._before = float(values[-2]) if values.size > 1 else self._before

    def clipped(self) -> tuple[int, int]:
        """Samples on flat tops at the lowest and at the highest value."""
        if self._open_length:  # the last run ends with the signal
            steep = np.abs(self._open - self._before) > _ROUNDED_STEPS * self.step
            self._extend(self._open, np.array([self._open_length]), steep)
            self._open_length = 0
        span = self._high.value + self._low.value
        if not span >= _FEWEST_LEVELS * self.step:
            return 0, 0
        return self._low.n_flat, self._high.n_flat

    def _judge(
        self,
        values: NDArray[np.float64],
        lengths: NDArray[np.int_],
        starts: NDArray[np.int_],
    ) -> None:
        row = int(np.argmax(lengths))
        if lengths[row] > self.longest:
            self.longest, self.longest_start = int(lengths[row]), int(starts[row])
        rise = np.abs(np.diff(values))
        if np.any(rise > 0):  # not between missing samples
            self.step = min(self.step, float(np.min(rise[rise > 0])))
        first = abs(float(values[0]) - self._before)
        drop = np.fmax(np.r_[first, rise[:-1]], rise) if rise.size else rise
        self._extend(values[:-1], lengths[:-1], drop > _ROUNDED_STEPS * self.step)

    def _extend(
        self, values: NDArray[np.float64], lengths: NDArray[np.int_], steep: NDArray[np.bool_]
    ) -> None:
        if not values.size:
            return
        flat = (lengths >= _SHORTEST_TOP) & steep
        flat_values, flat_lengths = values[flat], lengths[flat]
        self._high.add(float(np.fmax.reduce(values)), flat_values, flat_lengths)
        self._low.add(-float(np.fmin.reduce(values)), -flat_values, flat_lengths)
