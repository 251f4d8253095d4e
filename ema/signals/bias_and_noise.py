"""Noise level and coherence of FRFs, line by line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, median_filter, uniform_filter1d

from ema.core.arrays import readonly
from ema.core.frf import FRF, ForceRecord
from ema.core.numerics import kept_with

#: Lines over which the noise level is smoothed: σ of one is itself uncertain, or that of a tone.
SMOOTHING_LINES = 21
# A line whose σ is this many times the level around it carries hum or another tone.
_SPIKE = 3.0
# Coherence below this says nothing; in a file it is rounded to steps of about this.
_LEAST_COHERENCE, _COHERENCE_STEP = 1e-3, 1e-5
# Averages and lines that one value rests on: noise alone has a coherence of about 1/20.
_VALUES = 20


def noise_level(frf: FRF, lines: slice) -> NDArray[np.float64]:
    """Standard deviation to weigh each of some lines with, (n_positions, n_frequencies).

    Smoothed over neighbouring lines, except where a line sticks out. Where σ is unknown, the
    coherence gives the weights; without it, lines are taken as equally good relative to the FRFs
    around them.
    """
    values = frf.values[:, lines]
    floor = max(1e-12 * np.max(np.abs(values)) ** 2, np.finfo(float).tiny)
    if not np.all(np.isfinite(frf.std[:, lines])):
        coherence = frf.coherence[:, lines]
        if np.isnan(frf.n_effective) and np.all(np.isfinite(coherence)):  # 1 of one average
            power = incoherent_power(values, coherence)
        else:
            power = np.broadcast_to(np.mean(np.abs(values) ** 2, axis=0), values.shape)
        smooth = _smoothed(power)
        return np.asarray(np.sqrt(np.maximum(smooth, floor)))
    power = frf.std[:, lines] ** 2
    around = _median_level(frf, lines.start, lines.stop)
    spikes = power > _SPIKE**2 * around
    smooth = _smoothed(np.where(spikes, around, power))
    return np.asarray(np.sqrt(np.maximum(np.where(spikes, power, smooth), floor)))


def incoherent_power(
    values: NDArray[np.complex128], coherence: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Power of what is not coherent with the force, |H|² (1 − γ²)/γ²."""
    known = np.clip(coherence, _LEAST_COHERENCE, 1 - _COHERENCE_STEP)
    return np.asarray(np.abs(values) ** 2 * (1 - known) / known)


def without_spikes(
    frf: FRF, lines: slice, values: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """FRFs with lines that carry a tone, such as mains hum, replaced from their neighbours.

    In an impulse response a tone never decays and looks like a mode without damping.
    """
    std = frf.std[:, lines]
    if not np.all(np.isfinite(std)):
        return values
    spikes = std**2 > _SPIKE**2 * _median_level(frf, lines.start, lines.stop)
    number = np.arange(values.shape[1])
    for row in np.flatnonzero(spikes.any(axis=1)):
        good = ~spikes[row]
        values[row] = np.interp(number, number[good], values[row, good])
    return values


@kept_with
def _median_level(frf: FRF, start: int | None, stop: int | None) -> NDArray[np.float64]:
    """Median noise power around each line; both pole estimators and the fit ask for it."""
    power = frf.std[:, start:stop] ** 2
    size = (1,) * (power.ndim - 1) + (SMOOTHING_LINES,)
    return readonly(median_filter(power, size, mode="nearest"))


def _smoothed(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over neighbouring lines; a running sum would lose the digits of small values."""
    mean = np.full(SMOOTHING_LINES, 1 / SMOOTHING_LINES)
    return np.asarray(correlate1d(power, mean, mode="nearest"))


def line_coherence(frf: FRF) -> NDArray[np.float64]:
    """Coherence of each row as if neighbouring lines were further averages of one FRF.

    A response has a smooth FRF, noise has not. Lower than the coherence where an FRF changes
    within a few lines, in all rows alike. NaN where the force of a row is not known, and without a
    coherence.
    """
    found = np.full(frf.values.shape, np.nan)
    run, least = np.array(frf.run), np.finfo(float).tiny
    for name, record in frf.exact_forces.items():
        rows = run == name
        width = max(-(-_VALUES // record.plan.n_blocks), 1)
        force = _force_power(record)
        cross = frf.values[rows] * force
        power = np.abs(frf.values[rows]) ** 2 * force / np.maximum(frf.coherence[rows], least)
        cross, power, force = (uniform_filter1d(each, width) for each in (cross, power, force))
        found[rows] = np.abs(cross) ** 2 / np.maximum(force * power, least)
    return found


def force_density(record: ForceRecord) -> NDArray[np.float64]:
    """One-sided power spectral density of a run's force on the lines of its blocks, N²/Hz."""
    plan = record.plan
    share = plan.n_blocks * plan.block_samples * plan.sampling_rate_hz
    return 2 * _force_power(record) / share


def _force_power(record: ForceRecord) -> NDArray[np.float64]:
    """Power of the force on the lines, summed over the blocks."""
    plan = record.plan
    total = np.zeros(plan.frequency_hz.size)
    for start in plan.starts:
        block = record.force.block(start, start + plan.block_samples)
        spectrum = np.fft.rfft((block - block.mean()) * plan.taper)
        total += np.abs(spectrum[1 : total.size + 1]) ** 2
    return total
