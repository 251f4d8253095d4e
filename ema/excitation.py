"""What kind of force excites the structure: steady, so that blocks are alike, or an event."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.recording import Channel

_SEGMENTS = 8
_SEGMENT_SAMPLES = 1 << 14
_BANDS = 16
# Share of its mean by which the power in a band varies over the segments; a steady random force
# stays below 0.5, sweeps, bursts and impacts are well above 1.
_STEADY_VARIATION = 1.0


def is_steady(force: Channel) -> bool:
    """Whether the force looks alike all along the recording, as shaker noise does.

    A sweep, a burst or an impact is one event: cut into blocks, each block would hold only a part
    of it. It is told from the power in bands, compared between segments of the recording.

    Parameters
    ----------
    force : Channel
    """
    length = min(force.n_samples // _SEGMENTS, _SEGMENT_SAMPLES)
    if length < 4 * _BANDS:
        return True
    starts = np.linspace(0, force.n_samples - length, _SEGMENTS).astype(int)
    segments = [force.block(start, start + length) for start in starts]
    power = np.array([_band_power(part) for part in segments if np.all(np.isfinite(part))])
    if len(power) < 2:
        return True
    weight = power.mean(axis=0)
    if not np.any(weight > 0):
        return True
    excited = weight > 1e-3 * weight.max()
    variation = power[:, excited].std(axis=0) / weight[excited]
    return bool(np.median(variation) < _STEADY_VARIATION)


def _band_power(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    spectrum = np.abs(np.fft.rfft((samples - samples.mean()) * np.hanning(samples.size))[1:]) ** 2
    edges = np.unique(np.geomspace(1, spectrum.size, _BANDS + 1).astype(int)) - 1
    return np.add.reduceat(spectrum, edges[:-1])
