"""How far to trust a curve fit: covariance of its parameters from what it left over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.blocks import BlockPlan
from ema.variable_projection import Projection, slope_rows

Real = NDArray[np.float64]


def line_correlation(plan: BlockPlan | None) -> float:
    """Lines that share the information of one: N Σw⁴/(Σw²)², 1 for a boxcar, 1.94 for Hann.

    A window correlates the noise of neighbouring lines; sums over lines scatter by this factor
    more than independent lines would.
    """
    return 1.0 if plan is None else float(np.mean(plan.taper**4))


def pole_covariance(
    solution: Projection, scale: Real, run: NDArray[np.int_], correlation: float
) -> Real:
    """Covariance of (Re s, Im s) of all poles, (2 n_modes, 2 n_modes), in (rad/s)².

    N⁻¹ (Σ g gᵀ) N⁻¹ with the score g of each run and line (White 1980, clustered): it follows
    the residuals as they are, whether noise, leakage or a model that does not quite fit, and the
    fact that all sensors of a run see the same excitation. Residuals are first restored to what
    they were before the fit took its share.

    Parameters
    ----------
    solution : Projection
    scale : ndarray, shape (n_positions,)
        Weights of the positions in the fit.
    run : ndarray of int, shape (n_positions,)
        Run each position was measured in.
    correlation : float
        From `line_correlation`.
    """
    inverse = _inverse(solution.normal_matrix(scale))
    restored = solution.misfit / np.sqrt(np.clip(1 - solution.leverage, 0.1, 1))[:, None]
    rows = slope_rows(solution.poles.size)
    middle = np.zeros_like(inverse)
    for number in np.unique(run):
        here = run == number
        weighted = solution.coefficients[:, :, here] * scale[here] ** 2
        along = np.einsum("fi,kpi->fkp", restored[:, here], weighted)
        score = np.einsum("fkp,fkp->fk", solution.slopes[:, rows], along)
        n_lines = score.shape[0] // 2
        line = score[:n_lines] + score[n_lines:]
        middle += line.T @ line
    return np.asarray(correlation * inverse @ middle @ inverse)


def frequency_damping_covariance(poles: NDArray[np.complex128], covariance: Real) -> Real:
    """Covariance of (frequency_hz, damping_ratio), mode by mode, from that of (Re s, Im s)."""
    transform = np.zeros_like(covariance)
    for r, s in enumerate(poles):
        size = abs(s)
        rows, columns = slice(2 * r, 2 * r + 2), slice(2 * r, 2 * r + 2)
        transform[rows, columns] = [
            [s.real / size / (2 * np.pi), s.imag / size / (2 * np.pi)],
            [-(s.imag**2) / size**3, s.real * s.imag / size**3],
        ]
    return np.asarray(transform @ covariance @ transform.T)


def residue_std(solution: Projection, covariance: Real, noise: Real, correlation: float) -> Real:
    """Standard deviation of the residues' parts (RMS of real and imaginary), like `residues`.

    From the residuals of each position at given poles, and from the poles' own uncertainty.

    Parameters
    ----------
    solution : Projection
    covariance : ndarray
        From `pole_covariance`.
    noise : ndarray, shape (n_positions,)
        RMS of each position's weighted residuals.
    correlation : float
        From `line_correlation`.
    """
    n_modes = solution.poles.size
    own = correlation * np.diag(solution.unscaled)[:-2, None] * noise**2
    following = solution.following[:-2, slope_rows(n_modes)]
    slope = np.einsum("akp,kpi->iak", following, solution.coefficients)
    shared = np.einsum("iak,kl,ial->ai", slope, covariance, slope)
    variance = own + shared
    return np.asarray(np.sqrt((variance[0::2] + variance[1::2]) / 2).T)


def _inverse(normal: Real) -> Real:
    """Inverse of a normal matrix; directions the data say nothing about are left out."""
    size = np.sqrt(np.diag(normal))
    size[size == 0] = 1.0
    scaled = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-12, hermitian=True)
    return np.asarray(scaled / np.outer(size, size))
