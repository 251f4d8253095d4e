"""Poles from impulse responses: least-squares complex exponentials, all model orders at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
