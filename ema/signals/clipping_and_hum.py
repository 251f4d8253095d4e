"""Detection of clipping, held values and mains hum in a signal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

# Two equal samples on top of each other happen; three and more are a limit that was reached.
_SHORTEST_TOP = 3
# A smooth top rounded to a step leaves its run by four steps at most; a limit cuts steep flanks.
_ROUNDED_STEPS = 5.0
# With fewer levels than these every top is flat: a quiet signal in coarse steps, a trigger.
_FEWEST_LEVELS = 64
_MAINS_HZ = (50.0, 60.0)
_HARMONICS = 10
_LOW_HARMONICS = 3  # 300 Hz alone says nothing: it belongs to both
_MAINS_TOLERANCE = 0.002  # grids keep their frequency within 0.1 Hz
_STANDS_OUT = 10.0  # in power, above the median of its neighbours: 10 dB
_NEIGHBOURS_HZ = 4.0
# The power of a tone varies little from segment to segment; that of noise, and so of a lightly
# damped mode, by as much as its mean.
_STEADY_VARIATION = 0.5
_AUDIBLE = 1e-3  # of the rms; anything less is of no concern
_SEGMENTS = 8  # how much a power varies cannot be told from fewer
_ENOUGH_RATE_HZ = 4096.0
_RATES_HZ = (250.0, 1e9)  # of recordings that can be judged


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

    `longest` is the length of the longest run and `longest_start` its first sample; `step` is the
    smallest difference between two samples in a row, infinite for a constant.
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
        self, values: NDArray[np.float64], lengths: NDArray[np.int_], starts: NDArray[np.int_]
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


_LONGEST_SEGMENT_S, _SHORTEST_SEGMENT_S = 4.0, 1.0  # a line must be told from a mode


@dataclass(frozen=True)
class Hum:
    """Lines of the mains in a signal."""

    mains_hz: float  # 50 or 60
    frequency_hz: float  # harmonic of the mains that is strongest
    rms: float  # of all lines together, in the signal's unit


class HumMeter:
    """Averaged spectrum of a signal that comes piece by piece, searched for mains lines.

    Hann segments of up to 4 s overlap by half (Welch 1967). Rates above 8 kHz are reduced by plain
    averaging first: hum is sought up to 600 Hz only. Less than 8 s are too short to tell a line
    from a mode.
    """

    def __init__(self, sampling_rate_hz: float, n_samples: int) -> None:
        self._length = self._factor = self._count = 0
        self._samples = np.zeros(0)
        if not _RATES_HZ[0] <= sampling_rate_hz <= _RATES_HZ[1]:
            return
        segment_s = min(_LONGEST_SEGMENT_S, n_samples / sampling_rate_hz / _SEGMENTS)
        if segment_s < _SHORTEST_SEGMENT_S:
            return
        self._factor = max(1, int(sampling_rate_hz // _ENOUGH_RATE_HZ))
        self._rate_hz = sampling_rate_hz / self._factor
        self._length = int(segment_s * self._rate_hz)
        self._taper = np.hanning(self._length + 1)[:-1]
        self._sum = np.zeros(self._length // 2 + 1)
        self._squares = np.zeros_like(self._sum)

    def add(self, piece: NDArray[np.float64]) -> None:
        """Go on with the next samples; segments with missing ones are left out."""
        if not self._length:
            return
        self._samples = np.concatenate([self._samples, piece])
        whole, start = self._length * self._factor, 0
        while start + whole <= self._samples.size:
            self._add_segment(self._samples[start : start + whole])
            start += whole // 2
        self._samples = self._samples[start:]

    def _add_segment(self, samples: NDArray[np.float64]) -> None:
        segment = samples.reshape(-1, self._factor).mean(axis=1)
        mean = segment.mean()
        if not np.isfinite(mean):
            return
        power = np.abs(np.fft.rfft((segment - mean) * self._taper)) ** 2
        self._sum += power
        self._squares += power**2
        self._count += 1

    def hum(self, signal_rms: float) -> Hum | None:
        """Hum found in all that was added; None where there is none, or none can be told."""
        if self._count < _SEGMENTS or not signal_rms > 0:
            return None
        power = self._sum / self._count
        frequency_hz = np.asarray(np.arange(power.size) * (self._rate_hz / self._length))
        tones = self._tones(power)
        found = [self._of_mains(mains, power, frequency_hz, tones) for mains in _MAINS_HZ]
        hums = [(hum, n) for hum, n in found if hum and hum.rms > _AUDIBLE * signal_rms]
        if not hums:
            return None
        hum, n_lines = max(hums, key=lambda each: each[0].rms)
        # More tones elsewhere: the signal is made of lines, as under periodic excitation.
        return hum if tones.size - n_lines <= n_lines else None

    def _tones(self, power: NDArray[np.float64]) -> NDArray[np.int_]:
        """Lines of the spectrum that are narrow, steady and stand out."""
        width = 2 * max(6, round(_NEIGHBOURS_HZ * self._length / self._rate_hz)) + 1
        above = power[1:-1] > _STANDS_OUT * scipy.ndimage.median_filter(power, size=width)[1:-1]
        top = (power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])
        variance = self._squares[1:-1] / self._count - power[1:-1] ** 2
        steady = variance < (_STEADY_VARIATION * power[1:-1]) ** 2
        return np.flatnonzero(above & top & steady) + 1

    def _of_mains(
        self,
        mains_hz: float,
        power: NDArray[np.float64],
        frequency_hz: NDArray[np.float64],
        tones: NDArray[np.int_],
    ) -> tuple[Hum | None, int]:
        """Hum of one mains frequency, and how many lines it has."""
        squares: dict[int, float] = {}
        resolution_hz = frequency_hz[1]
        for harmonic in range(1, _HARMONICS + 1):
            tolerance_hz = max(0.6 * resolution_hz, _MAINS_TOLERANCE * harmonic * mains_hz)
            near = tones[np.abs(frequency_hz[tones] - harmonic * mains_hz) <= tolerance_hz]
            if near.size:
                line = int(near[np.argmax(power[near])])
                lobe = power[max(line - 2, 0) : line + 3].sum()
                squares[harmonic] = 2 * float(lobe) / (self._length * float(np.sum(self._taper**2)))
        if not any(harmonic <= _LOW_HARMONICS for harmonic in squares):
            return None, 0
        strongest = max(squares, key=squares.__getitem__)
        rms = float(np.sqrt(sum(squares.values())))
        return Hum(mains_hz, strongest * mains_hz, rms), len(squares)
