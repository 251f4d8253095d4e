"""Type of excitation: steady, periodic or transient; and the blocks that suit it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Processing
from ema.core.errors import InputError
from ema.core.recording import BlockPlan, Channel

_SEGMENTS = 8
_SEGMENT_SAMPLES = 1 << 14
_BANDS = 16
# Share of its mean by which the power in a band varies over the segments; a steady random force
# stays below 0.5, sweeps, bursts and impacts are well above 1.
_STEADY_VARIATION = 1.0
# Correlation of the force with itself one period later; noise of 20 dB leaves 0.99.
_REPEATS = 0.98
# The same at the nearest sample, where a force of all frequencies repeats between two samples …
_BETWEEN_SAMPLES = 0.6
# … and the parts of a sample that are looked at then.
_PARTS = np.linspace(-0.5, 0.5, 11)
# What the search for a period looks at; memory and time stay small.
_SEARCHED_SAMPLES = 1 << 18
_FEW_MISSING = 1e-3  # share of samples without which a force repeats as clearly as with them
DEFAULT_WINDOW = "hann"
# Tyre modes have decayed after 0.3 s: longer blocks only cost averages.
LONGEST_DEFAULT_BLOCK_S = 4.0
# A short recording is still cut into this many lengths, so that coherence means something.
FEWEST_DEFAULT_LENGTHS = 4
# What repeats sooner is a tone or its harmonics: between its lines, 4 Hz apart, nothing is excited.
SHORTEST_PERIOD_S = 0.25


def is_steady(force: Channel) -> bool:
    """Whether the force looks alike all along the recording, as shaker noise does.

    A sweep, a burst or an impact is one event: cut into blocks, each block would hold only a part
    of it. It is told from the power in bands, compared between segments of the recording.
    """
    length = min(force.n_samples // _SEGMENTS, _SEGMENT_SAMPLES)
    if length < 4 * _BANDS:
        return True
    starts = np.linspace(0, force.n_samples - length, _SEGMENTS).astype(int)
    segments = [force.block(start, start + length) for start in starts]
    whole = [part for part in segments if np.all(np.isfinite(part))]
    if len(whole) < 2:
        return True
    # A window would hide an impact at the start of a segment: what changes from sample to sample.
    moving = np.array([np.mean(np.diff(part) ** 2) for part in whole])
    if moving.std() > _STEADY_VARIATION * moving.mean():
        return False
    power = np.array([_band_power(part) for part in whole])
    weight = power.mean(axis=0)
    if not np.any(weight > 0):
        return True
    excited = weight > 1e-3 * weight.max()
    variation = power[:, excited].std(axis=0) / weight[excited]
    return bool(np.median(variation) < _STEADY_VARIATION)


def period_samples(force: Channel, shortest: int) -> int:
    """Samples after which the force repeats, as repeated sweeps and pseudo-random noise do; or 0.

    A generator with a clock of its own repeats between two samples; the nearest one is given. What
    repeats sooner than after `shortest` samples is a tone.
    """
    samples = _swings(force)
    if not samples.size:
        return 0
    alike = _self_correlation(samples)
    apart = np.flatnonzero(alike < 0.5)
    first = max(int(apart[0]), shortest) if apart.size else alike.size
    again = first + np.flatnonzero(alike[first:] > _BETWEEN_SAMPLES)
    if not again.size:
        return 0
    peak = again[np.cumsum(np.diff(again, prepend=again[0] - 1) > 1) == 0]
    period = int(peak[np.argmax(alike[peak])])
    return period if repeats_after(force, period) else 0


def repeats_after(force: Channel, period: int) -> bool:
    """Whether the force repeats after this many samples, give or take half a sample."""
    samples = _swings(force)
    if samples.size < 2 * period:
        return False
    early, late = samples[:-period], samples[period:]
    spectrum = np.conj(np.fft.rfft(early)) * np.fft.rfft(late)
    turn = 2 * np.pi * np.fft.rfftfreq(early.size)
    shifted = [np.real(np.sum(spectrum * np.exp(1j * turn * part))) for part in _PARTS]
    size = np.linalg.norm(early) * np.linalg.norm(late) * early.size / 2
    return bool(max(shifted) > _REPEATS * size)


def _swings(force: Channel) -> NDArray[np.float64]:
    """The force about its mean, there too where few samples miss; nothing where many do."""
    samples = force.block(0, min(force.n_samples, _SEARCHED_SAMPLES))
    known = np.isfinite(samples)
    if np.mean(~known) > _FEW_MISSING:
        return np.zeros(0)
    return np.where(known, samples - samples.mean(where=known), 0.0)


def _self_correlation(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    """Correlation coefficient of a signal with itself, by lag up to half its length."""
    n = samples.size
    lags = np.arange(n // 2 + 1)
    product = np.fft.irfft(np.abs(np.fft.rfft(samples, 2 * n)) ** 2)[lags]
    energy = np.append(0.0, np.cumsum(samples**2))
    size = np.sqrt(energy[n - lags] * (energy[n] - energy[lags]))
    return np.asarray(np.divide(product, size, out=np.zeros(lags.size), where=size > 0))


def _band_power(samples: NDArray[np.float64]) -> NDArray[np.float64]:
    spectrum = np.abs(np.fft.rfft((samples - samples.mean()) * np.hanning(samples.size))[1:]) ** 2
    edges = np.unique(np.geomspace(1, spectrum.size, _BANDS + 1).astype(int)) - 1
    return np.add.reduceat(spectrum, edges[:-1])


def plan_blocks(
    n_samples: int,
    sampling_rate_hz: float,
    processing: Processing,
    place: str,
    *,
    steady: bool = True,
    period_samples: int = 0,
) -> BlockPlan:
    """Cut a recording into blocks as asked for, or as suits a tyre.

    By default Hann windows overlap by half over blocks of 4 s, or a quarter of a shorter recording;
    a sweep, burst or impact (a force that is not `steady`) stays one block without a window, and a
    force that repeats after `period_samples` (0 for one that does not) gets blocks of one period
    without a window. The paper's setting is ``averages=10, window="boxcar"``.

    `InputError`, which names `place`, if the blocks asked for do not fit the recording.
    """
    chosen = processing.averages is not None or processing.block_seconds is not None
    whole = not (steady or chosen or period_samples)
    asked = round((processing.block_seconds or 0) * sampling_rate_hz)
    one_period = period_samples > 0 and (not chosen or asked == period_samples)
    window = processing.window or ("boxcar" if whole or one_period else DEFAULT_WINDOW)
    usual = 0.0 if window == "boxcar" else 0.5
    overlap = usual if processing.overlap is None else processing.overlap
    duration_s = n_samples / sampling_rate_hz
    block_s = _block_seconds(duration_s, processing, overlap, whole)
    if period_samples and not chosen:
        block_s = period_samples / sampling_rate_hz
    block = int(block_s * sampling_rate_hz * (1 + 1e-9))
    if not 8 <= block <= n_samples:
        found = f"blocks of {block_s:g} s in a recording of {duration_s:g} s"
        rule = "a block needs at least 8 samples and must not be longer than the recording"
        raise InputError(place, found, rule, "Choose other averages or block_seconds")
    # Rounded down, so that the last of the averages asked for still fits.
    step = max(int(block * (1 - overlap) * (1 + 1e-9)), 1)
    n_blocks = 1 + (n_samples - block) // step
    return BlockPlan(sampling_rate_hz, block, step, n_blocks, window, period_samples)


def _block_seconds(duration_s: float, processing: Processing, overlap: float, whole: bool) -> float:
    if processing.averages is not None:
        lengths = 1 + (processing.averages - 1) * (1 - overlap)
        return duration_s / lengths if lengths > 0 else 0.0
    if processing.block_seconds is not None:
        return processing.block_seconds
    if whole:
        return duration_s
    return min(LONGEST_DEFAULT_BLOCK_S, duration_s / FEWEST_DEFAULT_LENGTHS)
