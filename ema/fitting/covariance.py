"""Covariance of the fitted parameters from the residuals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.core.frf import FRF
from ema.core.numerics import kept_with
from ema.fitting.driven import Driven
from ema.fitting.joint_poles import JointPoint
from ema.fitting.pole_fit import N_STAND_INS, Lines, PoleFit
from ema.fitting.variable_projection import Projection, Real, slope_rows

# Lines within this many half-widths of a pole make up its resonance …
_RESONANCE = 2.0
# … but never more than this part of all lines.
_FEWEST_PIECES = 8
# Share of the lines that is left out at one end.
_TRIM = 0.06


def line_correlation(frf: FRF) -> float:
    """Lines that share the information of one: N Σw⁴/(Σw²)², 1 for a boxcar, 1.94 for Hann.

    A window correlates the noise of neighbouring lines; sums over lines scatter by this factor
    more than independent lines would. An exponential window of the analyser, e^{−t/τ} over blocks
    of length T, gives T/τ coth T/τ.
    """
    of_blocks = 1.0 if frf.blocks is None else float(np.mean(frf.blocks.taper**4))
    if frf.exponential_window is None:
        return of_blocks
    block_s = 1 / float(np.min(np.diff(frf.frequency_hz)))
    decays = block_s / frf.exponential_window.time_constant_s
    return of_blocks * decays / float(np.tanh(decays))


def parameter_covariance(fit: PoleFit, correlation: float) -> Real:
    """Covariance of (Re s, Im s) of all poles in rad/s, then of the drift of the runs.

    N⁻¹ (Σ g gᵀ) N⁻¹ with the score g of each run and line (White 1980, clustered): it follows the
    residuals as they are, whether noise, leakage or a model that does not quite fit, and the fact
    that all sensors of a run see the same excitation. Residuals are first restored to what they
    were before the fit took its share. `correlation` is that of `line_correlation`.
    """
    inverse = inverse_of(fit.normal_matrix())
    middle = np.zeros_like(inverse)
    for score in _scores_of_runs(fit):
        middle += score.T @ score
    slope = fit.likeness_slope()
    middle = correlation * middle + slope.T @ slope
    return np.asarray(inverse @ middle @ inverse)


def std_of_waves(fit: PoleFit) -> Real:
    """Standard deviations of frequency and damping ratio where residuals are no white noise.

    What the model leaves out of a resonance changes slowly from line to line. Scores count together
    with those of the lines around them, as far as the resonance reaches (Newey & West 1987).

    Returns
    -------
    ndarray, shape (n_modes, 2)
    """
    n = 2 * fit.poles.size
    towards = inverse_of(fit.normal_matrix())[:, :n] @ to_frequency_damping(fit.poles).T
    step = float(np.diff(fit.lines.omega[:2])[0])
    reach = np.repeat(np.ceil(_RESONANCE * -fit.poles.real / step).astype(int), 2)
    variance = np.zeros(n)
    for score in _scores_of_runs(fit):
        variance += _variance_of_waves(score @ towards, reach)
    return np.sqrt(np.maximum(variance, 0)).reshape(-1, 2)


def _variance_of_waves(influence: Real, reach: NDArray[np.int_]) -> Real:
    """Variance of sums over lines, (n_lines, n_numbers); lines up to `reach` apart are alike."""
    n_lines = len(influence)
    furthest = np.clip(reach, 1, max(n_lines // _FEWEST_PIECES, 1))
    spectrum = np.fft.rfft(influence, 2 * n_lines, axis=0)
    products = np.fft.irfft(np.abs(spectrum) ** 2, 2 * n_lines, axis=0)[:n_lines]
    weight = np.maximum(1 - np.arange(n_lines)[:, None] / (furthest + 1), 0.0)
    return np.asarray(2 * np.sum(weight * products, axis=0) - products[0])


def std_between_runs(fit: PoleFit, correlation: float) -> Real:
    """Standard deviations of frequency and damping ratio from what the runs differ by.

    Scores count run by run (clustered: Liang & Zeger 1986) beyond those of single lines: what
    holds for a whole run, such as places and pairs, does not average out over lines.

    Returns
    -------
    ndarray, shape (n_modes, 2)
    """
    n = 2 * fit.poles.size
    towards = inverse_of(fit.normal_matrix())[:, :n] @ to_frequency_damping(fit.poles).T
    influences = [score @ towards for score in _scores_of_runs(fit)]
    if len(influences) < 2:
        return np.zeros((fit.poles.size, 2))
    of_runs = np.var([each.sum(axis=0) for each in influences], axis=0, ddof=1) * len(influences)
    of_lines = correlation * np.sum([np.sum(each**2, axis=0) for each in influences], axis=0)
    return np.asarray(np.sqrt(np.maximum(of_runs - of_lines, 0)).reshape(-1, 2))


def _scores_of_runs(fit: PoleFit) -> Iterator[Real]:
    """Score of each line for all parameters, run by run, (n_frequencies, n_parameters)."""
    for number, (part, rows) in enumerate(zip(fit.parts, fit.groups, strict=True)):
        transform = fit.transforms[number]
        run, scale = fit.lines.run[rows], fit.lines.scale[rows]
        for name in np.unique(run):
            yield _line_scores(part, scale, run == name) @ transform


def frequency_damping_covariance(poles: NDArray[np.complex128], covariance: Real) -> Real:
    """Covariance of (frequency_hz, damping_ratio), mode by mode, from that of (Re s, Im s)."""
    n = 2 * poles.size
    transform = to_frequency_damping(poles)
    return np.asarray(transform @ covariance[:n, :n] @ transform.T)


def to_frequency_damping(poles: NDArray[np.complex128]) -> Real:
    """Derivative of (frequency_hz, damping_ratio) to (Re s, Im s), mode by mode."""
    n = 2 * poles.size
    transform = np.zeros((n, n))
    for r, s in enumerate(poles):
        size = abs(s)
        rows, columns = slice(2 * r, 2 * r + 2), slice(2 * r, 2 * r + 2)
        transform[rows, columns] = [
            [s.real / size / (2 * np.pi), s.imag / size / (2 * np.pi)],
            [-(s.imag**2) / size**3, s.real * s.imag / size**3],
        ]
    return transform


def residue_std(fit: PoleFit, covariance: Real, correlation: float) -> Real:
    """Standard deviation of the residues' parts (RMS of real and imaginary), like `residues`.

    From the residuals of each position at given poles, and from the poles' own uncertainty, the
    `covariance` of `parameter_covariance`; `correlation` is that of `line_correlation`.
    """
    noise = fit.noise
    std = np.empty(fit.residues.shape)
    for number, (part, rows) in enumerate(zip(fit.parts, fit.groups, strict=True)):
        transform = fit.transforms[number]
        poles = transform @ covariance @ transform.T
        own = correlation * np.diag(part.unscaled)[:-2, None] * noise[rows] ** 2
        following = part.following[:-2, slope_rows(fit.poles.size)]
        slope = np.einsum("akp,kpi->iak", following, part.coefficients)
        variance = own + np.einsum("iak,kl,ial->ai", slope, poles, slope)
        std[rows] = np.sqrt((variance[0::2] + variance[1::2]) / 2).T
    return std


def _line_scores(part: Projection, scale: Real, here: NDArray[np.bool_]) -> Real:
    """Score of each line from the positions of one run, (n_frequencies, 2 n_modes)."""
    restored = part.misfit[:, here] / np.sqrt(np.clip(1 - part.leverage, 0.1, 1))[:, None]
    weighted = part.coefficients[:, :, here] * scale[here] ** 2
    along = np.einsum("fi,kpi->fkp", restored, weighted)
    score = np.einsum("fkp,fkp->fk", part.slopes[:, slope_rows(part.poles.size)], along)
    n_lines = score.shape[0] // 2
    return np.asarray(score[:n_lines] + score[n_lines:])


def inverse_of(normal: Real, told: float = 1e-12) -> Real:
    """Inverse of a normal matrix; directions the data say nothing about are left out."""
    size = np.sqrt(np.maximum(np.diag(normal), 0.0))  # whatever the rounding
    size[size == 0] = 1.0
    curvature, axes = np.linalg.eigh(normal / np.outer(size, size))
    seen = curvature > told * curvature[-1]
    scaled = (axes[:, seen] / curvature[seen]) @ axes[:, seen].T
    return np.asarray(scaled / np.outer(size, size))


def band_shift(
    fit: PoleFit, refit: Callable[[Lines, NDArray[np.complex128]], PoleFit]
) -> NDArray[np.float64]:
    """Largest change of each pole when the fit loses lines at either end of the band.

    Changes of frequency in Hz and of damping ratio, (n_modes, 2); NaN for poles next to the ends.
    The last pole of the fit stands for modes above the band; `refit` fits lines from start poles.
    """
    shifts = [_shift(fit, refit, lines) for lines in without_ends(fit.lines)]
    stacked = np.abs(np.stack(shifts))
    known = np.isfinite(stacked)
    largest = np.max(np.where(known, stacked, 0.0), axis=0)
    return np.asarray(np.where(known.any(axis=0), largest, np.nan))


def without_ends(lines: Lines) -> list[Lines]:
    """The lines without those at the lower and without those at the upper end."""
    cut = int(_TRIM * lines.frequency_hz.size)
    return [
        replace(
            lines,
            frequency_hz=lines.frequency_hz[kept],
            values=lines.values[:, kept],
            weight=lines.weight[kept],
            importance=lines.importance[kept],
        )
        for kept in (slice(cut, None), slice(0, lines.frequency_hz.size - cut))
    ]


def _shift(
    fit: PoleFit, refit: Callable[[Lines, NDArray[np.complex128]], PoleFit], lines: Lines
) -> NDArray[np.float64]:
    poles = fit.poles[:-N_STAND_INS]
    frequency_hz, half_width_hz = np.abs(poles) / (2 * np.pi), -poles.real / (2 * np.pi)
    low, high = lines.frequency_hz[[0, -1]]
    inside = (frequency_hz - low > half_width_hz) & (high - frequency_hz > half_width_hz)
    inside &= half_width_hz > 0  # states of the runs may leave a weak pole without decay
    shift = np.full((fit.poles.size, 2), np.nan)
    if not np.any(inside):
        return shift
    again = refit(lines, poles[inside]).poles[:-N_STAND_INS]
    rows = np.flatnonzero(inside)
    shift[rows, 0] = np.abs(again) / (2 * np.pi) - frequency_hz[inside]
    shift[rows, 1] = again.real / -np.abs(again) - poles[inside].real / -np.abs(poles[inside])
    return shift


@dataclass(frozen=True, eq=False)
class JointSpread:
    """How well a `JointPoint` is known.

    Parameters
    ----------
    covariance : ndarray, shape (2 n_modes, 2 n_modes)
        Of frequency in Hz and damping ratio, mode by mode.
    waves, forces : ndarray, shape (n_modes, 2)
        Standard deviations of the same where residuals are no white noise, and from what the
        forces say differently.
    participation : ndarray, shape (n_modes, n_forces)
        Standard deviation of real and imaginary part.
    """

    covariance: Real
    waves: Real
    forces: Real
    participation: Real


@kept_with
def spread_of(point: JointPoint, correlation: float) -> JointSpread:
    """± from the residuals as they are (White 1980; Newey & West 1987; Liang & Zeger 1986).

    All forces of a line count together, as they may have acted at the same time. Of poles no
    farther apart than their own ±, the distance is found too large by σ²/2d, at most σ.
    """
    driven, n = point.driven, point.driven.poles.size
    inverse = inverse_of(point.normal_matrix())
    scores = point.scores()
    transform = to_frequency_damping(driven.poles)
    towards = inverse[:, : 2 * n] @ transform.T
    influence = scores.sum(axis=0) @ towards
    covariance = correlation * influence.T @ influence
    step = float(np.diff(point.problem.forces[0].lines.omega[:2])[0])
    reach = np.repeat(np.ceil(_RESONANCE * -driven.poles.real / step).astype(int), 2)
    variance = _variance_of_waves(influence, reach)
    of_forces = scores.sum(axis=1) @ towards
    between = np.var(of_forces, axis=0, ddof=1) * len(of_forces)
    of_lines = correlation * np.sum((scores @ towards) ** 2, axis=(0, 1))
    everything = correlation * (inverse @ (scores.sum(axis=0).T @ scores.sum(axis=0)) @ inverse)
    drives = np.zeros(point.free.shape)
    own = np.diag(everything)[2 * n : 2 * (n + int(point.free.sum()))].reshape(-1, 2)
    drives[point.free] = np.sqrt(np.maximum(own.mean(axis=1), 0.0))
    # Few lines make up a narrow resonance: what they scatter by may be little by chance.
    white = correlation * point.reduced * (transform @ inverse[: 2 * n, : 2 * n] @ transform.T)
    covariance = covariance + np.diag(np.maximum(np.diag(white) - np.diag(covariance), 0.0))
    covariance = covariance + np.diag(_of_distance(driven, covariance))
    return JointSpread(
        covariance=np.asarray(covariance),
        waves=np.sqrt(np.maximum(variance, 0.0)).reshape(-1, 2),
        forces=np.sqrt(np.maximum(between - of_lines, 0.0)).reshape(-1, 2),
        participation=drives,
    )


def _of_distance(driven: Driven, covariance: Real) -> Real:
    """Variance from poles that are no farther apart than their ±: see `joint_pair`."""
    numbers = driven.numbers
    std = np.sqrt(np.diag(covariance)).reshape(-1, 2)
    width = np.column_stack([numbers[:, 0] * numbers[:, 1], numbers[:, 1]])
    variance = np.zeros_like(numbers)
    near = driven.shared & ~np.eye(driven.poles.size, dtype=bool)
    for k, others in enumerate(near):
        for other in np.flatnonzero(others):
            off = (numbers[k] - numbers[other]) / width[k]
            both = np.hypot(std[k], std[other]) / width[k]
            apart, known = float(np.hypot(*off)), float(np.hypot(*both)) / np.sqrt(2)
            bias = min(known**2 / (2 * max(apart, 1e-300)), known)
            variance[k] = np.maximum(variance[k], (bias * width[k]) ** 2)
    return np.asarray(variance.ravel())
