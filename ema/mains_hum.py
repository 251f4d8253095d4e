"""Hum of the mains in a signal: steady lines at 50 or 60 Hz and their harmonics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
_LONGEST_SEGMENT_S, _SHORTEST_SEGMENT_S = 4.0, 1.0  # a line must be told from a mode
_SEGMENTS = 8  # how much a power varies cannot be told from fewer
_ENOUGH_RATE_HZ = 4096.0
_RATES_HZ = (250.0, 1e9)  # of recordings that can be judged


@dataclass(frozen=True)
class Hum:
    """Lines of the mains in a signal.

    Parameters
    ----------
    mains_hz : float
        50 or 60.
    frequency_hz : float
        Harmonic of the mains that is strongest.
    rms : float
        Of all lines together, in the signal's unit.
    """

    mains_hz: float
    frequency_hz: float
    rms: float


class HumMeter:
    """Averaged spectrum of a signal that comes piece by piece, searched for mains lines.

    Hann segments of up to 4 s overlap by half (Welch 1967). Rates above 8 kHz are reduced by
    plain averaging first: hum is sought up to 600 Hz only.

    Parameters
    ----------
    sampling_rate_hz : float
    n_samples : int
        Of the whole signal. Less than 8 s are too short to tell a line from a mode.
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
        from scipy.ndimage import median_filter

        width = 2 * max(6, round(_NEIGHBOURS_HZ * self._length / self._rate_hz)) + 1
        above = power[1:-1] > _STANDS_OUT * median_filter(power, size=width)[1:-1]
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
