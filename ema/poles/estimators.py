"""Poles from FRFs, all model orders at once, by two estimators that share the roots' computation.

LSCE, least-squares complex exponentials, works on impulse responses; pLSCF, polyreference
least-squares complex frequency, on the FRFs. One shaker is one reference, so the matrix polynomial
of the polyreference form is a scalar one: all FRFs share a denominator A(z), and each has a
numerator B_i(z) of its own, z = e^{−jωΔt}.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ema.signals.bias_and_noise import SMOOTHING_LINES

# Share of the impulse responses' energy that may be cut off with their tail.
_TAIL_ENERGY = 0.002
# Part of a pole's decay that no other pole has.
_TOO_CLOSE = 1e-10


def impulse_responses(
    frequency_hz: NDArray[np.float64], values: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], float]:
    """Impulse responses of a band, shifted so that its lowest line becomes zero frequency.

    The lines of the band, equidistant, are taken as the whole spectrum of an analytic signal. Its
    step is the inverse of the *band's* width; a pole s of the structure appears as s − jω₁, ω₁ the
    lowest line. Returns the responses, (n_positions, n_samples), and the time between samples.
    """
    n_lines = frequency_hz.size
    spacing_hz = (frequency_hz[-1] - frequency_hz[0]) / (n_lines - 1)
    return np.fft.ifft(values, axis=1), 1 / (n_lines * spacing_hz)


def useful_length(responses: NDArray[np.complex128], shortest: int) -> int:
    """Samples after which impulse responses hold only noise and wrapped-around ringing.

    The noise level is read from the second half of the responses, (n_positions, n_samples); the
    useful part ends where what is left above it is a small share of the whole, but not before
    `shortest`. A longer piece biases damping upwards.
    """
    power = np.sum(np.abs(responses) ** 2, axis=0)
    n_samples = power.size
    noise = np.median(power[n_samples // 2 : max(n_samples * 9 // 10, n_samples // 2 + 1)])
    above = np.cumsum((power - noise)[: n_samples // 2][::-1])[::-1]
    useful = int(np.argmax(above < _TAIL_ENERGY * above[0])) or n_samples // 2
    return int(min(max(useful, shortest), n_samples * 9 // 10))


def normal_matrix(responses: NDArray[np.complex128], max_order: int) -> NDArray[np.complex128]:
    """Normal matrix of the prediction problem for `max_order`, (max_order + 1) squared.

    R[a, b] = Σ_i Σ_j h*_i(j+a) h_i(j+b) of responses (n_positions, n_samples); its blocks serve
    every lower order.
    """
    matrix = np.zeros((max_order + 1, max_order + 1), dtype=complex)
    for response in responses:
        shifted = np.lib.stride_tricks.sliding_window_view(response, max_order + 1)
        matrix += shifted.conj().T @ shifted
    return matrix


def poles_of_order(
    matrix: NDArray[np.complex128], order: int, step_s: float, lowest_hz: float
) -> NDArray[np.complex128]:
    """Poles of one model order from the shared normal matrix.

    Solves Σ_{k=0..p} β_k h_i(j+k) = 0 (Brown, Allemang, Zimmerman & Mergeay 1979) with β_0 = 1:
    predicting backwards leaves the structure's roots inside the unit circle and drives those of
    the noise outside (Kumaresan & Tufts 1982), so that most of them show as unstable.

    `matrix` is that of `normal_matrix`, `step_s` the time step of the impulse responses and
    `lowest_hz` the frequency that was shifted to zero. Returns p poles in rad/s, unstable ones too.
    """
    block = slice(1, order + 1)
    later = np.linalg.solve(matrix[block, block], -matrix[block, 0])
    roots = np.roots(np.concatenate([later[::-1], [1.0]]))
    roots = roots[roots != 0]
    decay = np.log(np.abs(roots)) / step_s
    offset = np.mod(np.angle(roots), 2 * np.pi) / step_s
    return np.asarray(decay + 1j * (offset + 2 * np.pi * lowest_hz))


def shapes_of_poles(
    responses: NDArray[np.complex128],
    poles: NDArray[np.complex128],
    step_s: float,
    lowest_hz: float,
) -> NDArray[np.complex128]:
    """Amplitude of each pole in each impulse response, (n_poles, n_positions), by least squares.

    `responses`, (n_positions, n_samples), are those the poles came from; see `poles_of_order`.
    """
    per_step = np.exp((poles - 2j * np.pi * lowest_hz) * step_s)
    decay = np.vander(per_step, responses.shape[1], increasing=True).T
    scale = np.linalg.norm(decay, axis=0)
    orthonormal, triangle = np.linalg.qr(decay / scale)
    seen = orthonormal.conj().T @ responses.T
    size = np.abs(np.diag(triangle))
    if np.all(size > _TOO_CLOSE):
        return np.asarray(np.linalg.solve(triangle, seen) / scale[:, None])
    # Poles too close to be told apart share what they have in common.
    return np.asarray(np.linalg.lstsq(triangle, seen, rcond=None)[0] / scale[:, None])


def reduced_normal_matrix(
    values: NDArray[np.complex128], max_order: int, weight: NDArray[np.float64] | None = None
) -> NDArray[np.complex128]:
    """Normal matrix of the common denominator, all numerators eliminated.

    Σ_i (T_i − S_iᴴ R⁻¹ S_i) from the linearised misfit w (A H_i − B_i) (Guillaume, Verboven,
    Vanlanduit, Van der Auweraer & Peeters 2003; Peeters, Van der Auweraer, Guillaume & Leuridan
    2004). The lines of the band go once around the unit circle, as in
    `impulse_responses`, so R, S_i and T_i are Toeplitz and come from FFTs.

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
