"""Poles from FRFs, all model orders at once, by two estimators that share the roots' computation.

LSCE, least-squares complex exponentials, works on impulse responses; pLSCF, polyreference
least-squares complex frequency, on the FRFs. All responses share a denominator A(z), a matrix
polynomial of as many rows and columns as there are forces, and each has a numerator B_i(z) of its
own, z = e^{−jωΔt}. With one force A is a scalar polynomial.

Where responses or FRFs have a first axis, it is that of the forces.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.core.drift import lever_at
from ema.core.errors import FitError, require_type
from ema.core.frf import FRF
from ema.core.frf_arrays import band_of
from ema.core.numerics import kept_with, readonly
from ema.signals.leakage import SMOOTHING_LINES, without_spikes

NO_FRF = "Use estimate_frf or FRF.from_arrays"
# Beyond the band, lines are used up to this share of its width, for modes just outside it …
_MARGIN = 0.25
# … as long as they are not noisier than the noisiest part of the band by more than this factor.
_MARGIN_NOISE = 2.0
_FEWEST_LINES = 32
# Share of the impulse responses' energy that may be cut off with their tail.
_TAIL_ENERGY = 0.002
# Part of a pole's decay that no other pole has.
_TOO_CLOSE = 1e-10

# A model order that shows every strong mode of a run and few others.
_ORDER = 30
_NEAR = 0.01
# Runs differ by no more than this, and poles that they share agree within so many half-widths.
_MOST_DRIFT, _ALIKE = 0.03, 0.2
# A shift is undone where it is this many times larger than its own scatter over the modes.
_CLEAR = 3.0


def widened_band(frf: FRF, band_hz: tuple[float, float]) -> slice:
    """Lines of the band and, where their noise allows, of a margin on both sides.

    `FitError` where the band holds too few lines to identify anything.
    """
    require_type("frf", frf, FRF, NO_FRF)
    band_hz = band_of(band_hz)
    frequency_hz = frf.frequency_hz
    low = int(np.searchsorted(frequency_hz, band_hz[0], side="left"))
    high = int(np.searchsorted(frequency_hz, band_hz[1], side="right"))
    if high - low < _FEWEST_LINES:
        raise FitError(
            f"only {max(high - low, 0)} frequency lines between {band_hz[0]:g} and "
            f"{band_hz[1]:g} Hz; at least {_FEWEST_LINES} are needed, and the FRFs end at "
            f"{frequency_hz[-1]:g} Hz. Widen the band, use longer blocks or correct the sampling "
            "rate."
        )
    margin = int(_MARGIN * (high - low))
    first, last = max(low - margin, 0), min(high + margin, frequency_hz.size)
    noise = np.median(frf.std[:, first:last], axis=0)
    # FRFs without σ get no verdict on their noise: the margin stays whole.
    allowed = _MARGIN_NOISE * np.max(noise[low - first : high - first])
    barred = first + np.flatnonzero((noise > allowed) | (frequency_hz[first:last] <= 0))
    below, above = barred[barred < low], barred[barred >= high]
    return slice(int(below.max(initial=first - 1)) + 1, int(above.min(initial=last)))


def impulse_responses(
    frequency_hz: NDArray[np.float64], values: NDArray[np.complex128]
) -> tuple[NDArray[np.complex128], float]:
    """Impulse responses of a band, shifted so that its lowest line becomes zero frequency.

    The lines of the band, equidistant, are taken as the whole spectrum of an analytic signal. Its
    step is the inverse of the *band's* width; a pole s of the structure appears as s − jω₁, ω₁ the
    lowest line. Returns the responses, (…, n_positions, n_samples), and the time between samples.
    """
    n_lines = frequency_hz.size
    spacing_hz = (frequency_hz[-1] - frequency_hz[0]) / (n_lines - 1)
    return np.fft.ifft(values, axis=-1), 1 / (n_lines * spacing_hz)


def useful_length(responses: NDArray[np.complex128], shortest: int) -> int:
    """Samples after which impulse responses hold only noise and wrapped-around ringing.

    The noise level is read from the second half of the responses, (n_positions, n_samples); the
    useful part ends where what is left above it is a small share of the whole, but not before
    `shortest`. A longer piece biases damping upwards.
    """
    power = np.sum(np.abs(_by_force(responses)) ** 2, axis=(0, 1))
    n_samples = power.size
    noise = np.median(power[n_samples // 2 : max(n_samples * 9 // 10, n_samples // 2 + 1)])
    above = np.cumsum((power - noise)[: n_samples // 2][::-1])[::-1]
    useful = int(np.argmax(above < _TAIL_ENERGY * above[0])) or n_samples // 2
    return int(min(max(useful, shortest), n_samples * 9 // 10))


@kept_with
def prepared(frf: FRF, start: int, stop: int) -> NDArray[np.complex128]:
    """FRFs of some lines with runs aligned and tones taken out; both estimators ask for them."""
    lines = slice(start, stop)
    return readonly(without_spikes(frf, lines, align_runs(frf, lines)), complex)


def normal_matrix(responses: NDArray[np.complex128], max_order: int) -> NDArray[np.complex128]:
    """Normal matrix of the prediction problem, ((max_order + 1) · n_forces) squared.

    R[a, b] = Σ_i Σ_j h*_i(j+a) h_i(j+b) of responses ([n_forces,] n_positions, n_samples), h_i a
    row with one response for each force; its blocks serve every lower order.
    """
    rows = np.moveaxis(_by_force(responses), 0, -1)
    size = (max_order + 1) * rows.shape[-1]
    matrix = np.zeros((size, size), dtype=complex)
    for response in rows:
        shifted = np.lib.stride_tricks.sliding_window_view(response, max_order + 1, axis=0)
        shifted = shifted.swapaxes(1, 2).reshape(len(shifted), size)
        matrix += shifted.conj().T @ shifted
    return matrix


def _by_force(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    return values.reshape(-1, *values.shape[-2:])


def poles_of_order(
    matrix: NDArray[np.complex128], order: int, step_s: float, lowest_hz: float
) -> NDArray[np.complex128]:
    """Poles of one model order of one force; see `driven_poles_of_order`."""
    return driven_poles_of_order(matrix, order, step_s, lowest_hz)[0]


def driven_poles_of_order(
    matrix: NDArray[np.complex128], order: int, step_s: float, lowest_hz: float, n_forces: int = 1
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Poles of one model order from the shared normal matrix, and how the forces drive each.

    Solves Σ_{k=0..p} h_i(j+k) β_k = 0 (Brown, Allemang, Zimmerman & Mergeay 1979; of several
    forces Vold, Kundrat, Rocklin & Russell 1982) with β_0 = I: predicting backwards leaves the
    structure's roots inside the unit circle and drives those of the noise outside (Kumaresan &
    Tufts 1982), so that most of them show as unstable. Participations L are in the left null
    space, L Σ z^k β_k = 0; the roots are those of the companion matrix.

    `matrix` is that of `normal_matrix`, `step_s` the time step of the impulse responses and
    `lowest_hz` the frequency that was shifted to zero. Returns p · n_forces poles in rad/s,
    unstable ones too, and participations (n_poles, n_forces), the largest of each 1.
    """
    block = slice(n_forces, n_forces * (order + 1))
    later = np.asarray(np.linalg.solve(matrix[block, block], -matrix[block, :n_forces]), complex)
    if n_forces == 1:
        roots = np.roots(np.concatenate([later[::-1, 0], [1.0]]))
        roots = roots[roots != 0]
        participation = np.ones((roots.size, 1), dtype=complex)
    else:
        companion = np.eye(later.shape[0], k=n_forces, dtype=complex)
        companion[:, :n_forces] = -later
        inverse = np.linalg.eigvals(companion)
        roots = 1 / inverse[inverse != 0]
        participation = _left_null(later, roots)
    decay = np.log(np.abs(roots)) / step_s
    offset = np.mod(np.angle(roots), 2 * np.pi) / step_s
    return np.asarray(decay + 1j * (offset + 2 * np.pi * lowest_hz)), np.asarray(participation)


def _left_null(
    later: NDArray[np.complex128], roots: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """L of each root z in L (I + Σ z^k β_k) = 0, the largest of each 1, (n_roots, n_forces)."""
    order, n_forces = later.shape[0] // later.shape[1], later.shape[1]
    # As z^(k − order) where powers of z would become large.
    from_end = np.abs(roots) > 1
    powers = np.vander(np.where(from_end, 1 / roots, roots), order + 1, increasing=True)
    powers[from_end] = powers[from_end, ::-1]
    matrices = powers @ np.concatenate([np.eye(n_forces), later]).reshape(order + 1, -1)
    found = np.linalg.svd(matrices.reshape(-1, n_forces, n_forces))[0][:, :, -1].conj()
    largest = np.argmax(np.abs(found), axis=1)
    return np.asarray(found / found[np.arange(roots.size), largest][:, None])


def shapes_of_poles(
    responses: NDArray[np.complex128],
    poles: NDArray[np.complex128],
    step_s: float,
    lowest_hz: float,
    participation: NDArray[np.complex128] | None = None,
) -> NDArray[np.complex128]:
    """Amplitude of each pole in each impulse response, (n_poles, n_positions), by least squares.

    `responses`, ([n_forces,] n_positions, n_samples), are those the poles came from; see
    `driven_poles_of_order`.
    """
    per_step = np.exp((poles - 2j * np.pi * lowest_hz) * step_s)
    decay = np.vander(per_step, responses.shape[-1], increasing=True).T
    if participation is not None:
        decay = np.concatenate(participation.T[:, None] * decay)
        responses = np.concatenate(responses, axis=1)
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

    `values` are the frequency responses of the band, ([n_forces,] n_positions, n_lines),
    `max_order` is below n_lines / 2, and `weight` is w of each line, all equal by default.
    """
    rows = np.moveaxis(_by_force(values), 0, 1)
    n_forces, size = rows.shape[1], max_order + 1
    squared = np.ones(values.shape[-1]) if weight is None else weight**2
    inverse = np.linalg.inv(np.linalg.cholesky(_toeplitz(squared, max_order)))
    spectra = np.einsum("irf,isf->rsf", rows.conj(), rows) * squared
    matrix = np.block([[_toeplitz(cell, max_order) for cell in line] for line in spectra])
    for row in rows:
        shifted = np.concatenate([_toeplitz(squared * of, max_order) for of in row], axis=1)
        seen = inverse @ shifted
        matrix -= seen.conj().T @ seen
    by_power = matrix.reshape(n_forces, size, n_forces, size).transpose(1, 0, 3, 2)
    return by_power[::-1, :, ::-1].reshape(matrix.shape)


def line_weight(std: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Weight of each line, 1/σ with the noise level common to the positions, (n_lines,).

    None where σ, (n_positions, n_lines), is unknown or zero: nothing then tells a good line from a
    poor one.
    """
    level = np.median(std, axis=0)
    if not np.all(level > 0):
        return None
    smooth = scipy.ndimage.median_filter(level, SMOOTHING_LINES, mode="nearest")
    return np.asarray(smooth.min() / smooth)


def _toeplitz(spectrum: NDArray[np.generic], order: int) -> NDArray[np.complex128]:
    """Σ_f X_f z_f*^a z_f^b for a, b = 0 … order; only the lag a − b matters."""
    lags = np.fft.ifft(spectrum)
    row = np.arange(order + 1)
    return np.asarray(lags[row[:, None] - row])


def align_runs(frf: FRF, lines: slice) -> NDArray[np.complex128]:
    """FRFs of some lines, each run's stretched to the natural frequencies of the first run.

    A drift of temperature or pressure moves all frequencies of a run together; seen in one diagram,
    every mode would appear several times. What is undone here only serves the search for poles: the
    curve fit estimates the drift with its uncertainty from the FRFs as measured.
    """
    values = np.array(frf.values[:, lines])
    names = frf.run_names
    if len(names) < 2:
        return values
    frequency_hz = frf.frequency_hz[lines]
    run = np.array([names.index(name) for name in frf.run])
    poles = [_strong_poles(frequency_hz, values[run == number]) for number in range(len(names))]
    middle_hz = float(np.sqrt(max(frequency_hz[0], 1.0) * frequency_hz[-1]))
    for number in range(1, len(names)):
        shift = _shift(poles[0], poles[number], middle_hz)
        if np.any(shift):
            rows = run == number
            factor = 1 + shift[0] + shift[1] * lever_at(frequency_hz, middle_hz)
            values[rows] = stretched(frequency_hz, values[rows], factor)
    return values


def _strong_poles(
    frequency_hz: NDArray[np.float64], values: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    responses, step_s = impulse_responses(frequency_hz, values)
    order = min(_ORDER, responses.shape[1] // 4)
    length = useful_length(responses, shortest=3 * order)
    matrix = normal_matrix(responses[:, 1:length], order)
    poles = poles_of_order(matrix, order, step_s, frequency_hz[0])
    damping = -poles.real / np.abs(poles)
    return np.asarray(poles[(damping > 0) & (damping < 0.2)])


def _shift(
    first: NDArray[np.complex128], other: NDArray[np.complex128], middle_hz: float
) -> NDArray[np.float64]:
    """Relative shift of the poles that two runs share and its slope over `lever_at`.

    The slope is only used where it is clear; zeros where nothing is.
    """
    nothing = np.zeros(2)
    if not (first.size and other.size):
        return nothing
    ratio = np.abs(other)[None, :] / np.abs(first)[:, None] - 1
    moved = other / (1 + _common_shift(first, ratio))
    distance = np.abs(moved[None, :] - first[:, None]) / np.abs(first)[:, None]
    mutual = distance.argmin(axis=0)[distance.argmin(axis=1)] == np.arange(first.size)
    pairs = np.flatnonzero(mutual & (distance.min(axis=1) < _NEAR))
    if pairs.size < 3:
        return nothing
    shifts = ratio[pairs, distance.argmin(axis=1)[pairs]]
    lever = lever_at(np.abs(first[pairs]) / (2 * np.pi), middle_hz)
    for columns in (2, 1):
        basis = np.stack([np.ones(pairs.size), lever], axis=1)[:, :columns]
        if pairs.size < columns + 3:
            continue
        fitted, scatter = _robust_line(basis, shifts)
        if abs(fitted[-1]) > _CLEAR * scatter[-1]:
            return np.asarray(np.append(fitted, np.zeros(2 - columns)))
    return nothing


def _common_shift(first: NDArray[np.complex128], ratio: NDArray[np.float64]) -> float:
    """The shift at which most poles of a run lie on those of the first one.

    The nearest pole may be the other member of a pair, where a drift is half its split or more.
    """
    shifts = np.append(0.0, ratio[np.abs(ratio) < _MOST_DRIFT])
    width = _ALIKE * -first.real / np.abs(first)
    away = np.min(np.abs(ratio - shifts[:, None, None]), axis=2) / width
    return float(shifts[np.argmax(np.sum(1 / (1 + away**2), axis=1))])


def _robust_line(
    basis: NDArray[np.float64], shifts: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least absolute deviations by reweighting, with standard deviations from the median one."""
    weight = np.ones(shifts.size)
    for _ in range(20):
        root = np.sqrt(weight)
        fitted = np.linalg.lstsq(root[:, None] * basis, root * shifts, rcond=None)[0]
        left = np.abs(shifts - basis @ fitted)
        weight = 1 / np.maximum(left, 1e-7)
    spread = 1.48 * float(np.median(left))
    inverse = np.linalg.pinv(basis.T @ basis)
    return np.asarray(fitted), spread * np.sqrt(np.diag(inverse))


def stretched(
    frequency_hz: NDArray[np.float64],
    values: NDArray[np.complex128],
    factor: NDArray[np.float64] | float,
) -> NDArray[np.complex128]:
    """FRFs whose natural frequencies are `factor` too high, on the lines of the right ones.

    A factor may be given for each line.
    """
    within = np.clip(frequency_hz * factor, frequency_hz[0], frequency_hz[-1])
    return np.asarray(scipy.interpolate.CubicSpline(frequency_hz, values, axis=1)(within))
