"""Leakage bias of FRFs under random excitation, and their noise.

Averaged over many blocks, the spectra of a stationary random test give not H but the transform of
h(τ) r(τ), with r the autocorrelation of the window (Bendat & Piersol 2010, ch. 11): resonances
look slightly too low and too broad. For a modal model this can be written down and undone.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, median_filter

from ema.core.arrays import readonly
from ema.core.block_plan import BlockPlan
from ema.core.frf import FRF


def leakage_bias(
    plan: BlockPlan,
    frequency_hz: NDArray[np.float64],
    poles: NDArray[np.complex128],
    residues: NDArray[np.complex128],
) -> NDArray[np.complex128]:
    """Mean error of estimated inertances of given modes under a random excitation.

    With φ(ω) = −ω²/(jω−s) = jω + s + s²/(jω−s), only the decaying part s²e^{sτ} is touched:
    Δφ(ω) = s² ∫ (r(τ)−1) e^{(s−jω)τ} dτ.

    Parameters
    ----------
    plan : BlockPlan
        How the recordings were cut.
    frequency_hz : ndarray, shape (n_frequencies,)
        Some of the plan's lines.
    poles : ndarray of complex, shape (n_modes,)
    residues : ndarray of complex, shape (n_positions, n_modes)

    Returns
    -------
    ndarray of complex, shape (n_positions, n_frequencies)
        To be subtracted from the estimated FRFs.
    """
    lines = np.round(frequency_hz * plan.block_s).astype(int)
    return np.asarray(
        residues @ _line_error(plan, poles)[:, lines]
        + residues.conj() @ _line_error(plan, poles.conj())[:, lines]
    )


def _line_error(plan: BlockPlan, poles: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Δφ on all lines of a block, (n_modes, block_samples)."""
    n, step_s = plan.block_samples, 1 / plan.sampling_rate_hz
    spectrum = np.fft.rfft(plan.taper, 2 * n)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[:n] / n
    decay = np.exp(poles[:, None] * np.arange(n) * step_s)
    inside = np.fft.fft((correlation - 1) * decay, axis=1) * step_s
    # Beyond one block r is zero: there the whole response is missing. e^{−jωT} = 1 on the lines.
    turn = np.exp(-2j * np.pi * np.arange(n) / n)
    beyond = np.exp(poles * n * step_s)[:, None] / (1 - np.exp(poles * step_s)[:, None] * turn)
    return np.asarray(poles[:, None] ** 2 * (inside - beyond * step_s))


# Lines over which the level is smoothed: σ of one line is itself uncertain.
_SMOOTHING_LINES = 21
# A line whose σ is this many times the level around it carries hum or another tone.
_SPIKE = 3.0


def noise_level(frf: FRF, lines: slice) -> NDArray[np.float64]:
    """Standard deviation to weigh each line with, (n_positions, n_frequencies).

    Smoothed over neighbouring lines, except where a line sticks out. Where σ is unknown, lines
    are taken as equally good relative to the FRFs around them.

    Parameters
    ----------
    frf : FRF
    lines : slice
        Lines to use.
    """
    values = frf.values[:, lines]
    floor = max(1e-12 * np.max(np.abs(values)) ** 2, np.finfo(float).tiny)
    if not np.all(np.isfinite(frf.std[:, lines])):
        power = np.broadcast_to(np.mean(np.abs(values) ** 2, axis=0), values.shape)
        smooth = _smoothed(power)
        return np.asarray(np.sqrt(np.maximum(smooth, floor)))
    power = frf.std[:, lines] ** 2
    around = _median_level(frf, lines.start, lines.stop)
    spikes = power > _SPIKE**2 * around
    smooth = _smoothed(np.where(spikes, around, power))
    return np.asarray(np.sqrt(np.maximum(np.where(spikes, power, smooth), floor)))


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


@lru_cache(maxsize=1)
def _median_level(frf: FRF, start: int | None, stop: int | None) -> NDArray[np.float64]:
    """Median noise power around each line; both pole estimators and the fit ask for it."""
    power = frf.std[:, start:stop] ** 2
    size = (1,) * (power.ndim - 1) + (_SMOOTHING_LINES,)
    return readonly(median_filter(power, size, mode="nearest"))


def _smoothed(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over neighbouring lines; a running sum would lose the digits of small values."""
    mean = np.full(_SMOOTHING_LINES, 1 / _SMOOTHING_LINES)
    return np.asarray(correlate1d(power, mean, mode="nearest"))
