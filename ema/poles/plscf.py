"""Poles from FRFs in the frequency domain: polyreference least-squares complex frequency.

One shaker is one reference, so the matrix polynomial of the polyreference form is a scalar one:
all FRFs share a denominator A(z), and each has a numerator B_i(z) of its own, z = e^{−jωΔt}.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ema.signals.bias_and_noise import SMOOTHING_LINES


def reduced_normal_matrix(
    values: NDArray[np.complex128], max_order: int, weight: NDArray[np.float64] | None = None
) -> NDArray[np.complex128]:
    """Normal matrix of the common denominator, all numerators eliminated.

    Σ_i (T_i − S_iᴴ R⁻¹ S_i) from the linearised misfit w (A H_i − B_i) (Guillaume, Verboven,
    Vanlanduit, Van der Auweraer & Peeters 2003; Peeters, Van der Auweraer, Guillaume & Leuridan
    2004). The lines of the band go once around the unit circle, as in
    `ema.poles.lsce.impulse_responses`, so R, S_i and T_i are Toeplitz and come from FFTs.

    Row and column a belong to the coefficient of z^(max_order − a). Leading blocks thus serve the
    lower orders as those of `normal_matrix` do, and `poles_of_order` sets the
    coefficient of the highest power to 1, which drives the poles of the noise unstable (Cauberghe,
    Guillaume, Verboven, Vanlanduit & Parloo 2005).

    `values` are the frequency responses of the band, (n_positions, n_lines), `max_order` is below
    n_lines / 2, and `weight` is w of each line, all equal by default.
    """
    squared = np.ones(values.shape[1]) if weight is None else weight**2
    inverse = np.linalg.inv(np.linalg.cholesky(_toeplitz(squared, max_order)))
    matrix = _toeplitz(squared * np.sum(np.abs(values) ** 2, axis=0), max_order)
    for row in values:
        seen = inverse @ _toeplitz(squared * row, max_order)
        matrix -= seen.conj().T @ seen
    return matrix[::-1, ::-1]


def line_weight(std: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Weight of each line, 1/σ with the noise level common to the positions, (n_lines,).

    None where σ, (n_positions, n_lines), is unknown or zero: nothing then tells a good line from a
    poor one.
    """
    level = np.median(std, axis=0)
    if not np.all(level > 0):
        return None
    smooth = median_filter(level, SMOOTHING_LINES, mode="nearest")
    return np.asarray(smooth.min() / smooth)


def _toeplitz(spectrum: NDArray[np.generic], order: int) -> NDArray[np.complex128]:
    """Σ_f X_f z_f*^a z_f^b for a, b = 0 … order; only the lag a − b matters."""
    lags = np.fft.ifft(spectrum)
    row = np.arange(order + 1)
    return np.asarray(lags[row[:, None] - row])
