"""What block lengths and windows do to the FRFs of a random excitation, pole by pole.

Averaged over many blocks, the spectra of a stationary random test give not H but the transform of
h(τ) r(τ), with r the autocorrelation of the window (Bendat & Piersol 2010, ch. 11): resonances
look slightly too low and too broad. For a modal model this can be written down and undone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.blocks import BlockPlan


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
