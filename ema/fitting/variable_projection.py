"""Poles, residues and residual terms by bounded variable projection: arrays in, arrays out.

Only the poles are nonlinear. For given poles the residues and residual terms of all positions
follow from one linear least-squares problem and are eliminated (Golub & Pereyra 1973), with
Kaufman's (1975) Jacobian; because all positions share the basis, nothing of the size of the
measured FRFs is ever formed (O'Leary & Rust 2013 for the single-response case).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol, TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.core.numerics import end_if_stopped, readonly

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Columns with less than this share beside the others are orthogonalised themselves: their products
# hold the square of it, to sixteen digits.
_TOO_ALIKE = 1e-4
_SMALLEST_STEP = 1e-9  # of the parameters' own size
_NOT_SEEN = 1e-14  # curvature, of the largest, in a direction that nothing depends on
_DIMENSIONS = 20  # hold every pole near the resonance to 3e-4
_KEPT = 64  # of the last lines and poles


@dataclass(frozen=True, eq=False)
class Projection:
    """Linear solution for given poles and what the covariance needs from it.

    n_linear = 2 n_modes + 2 columns are linear, in 2 n_frequencies rows. What a search asks for at
    every step comes from products of columns alone.
    """

    poles: Complex
    residues: Complex  # (n_positions, n_modes)
    lower: Real  # residual terms, (n_positions,)
    upper: Real
    target: Real  # weighted FRFs as columns, real parts above imaginary parts
    columns: Real  # everything linear, then the slopes, (2 n_frequencies, n_linear + 2 n_modes)
    inverse: Real  # makes an orthonormal basis of everything linear, (n_linear, n_linear)
    inside: Real  # the target in that basis, (n_linear, n_positions)
    seen: Real  # slopes of the modal terms to each pole in that basis, (n_linear, 2 n_modes)
    inner: Real  # products of the slopes with each other, everything linear projected out
    towards: Real  # products of those slopes with the target, (2 n_modes, n_positions)

    @cached_property
    def orthonormal(self) -> Real:
        """Basis of everything linear, (2 n_frequencies, n_linear)."""
        return np.asarray(self.columns[:, : len(self.inverse)] @ self.inverse)

    @cached_property
    def slopes(self) -> Real:
        """Slopes of the modal terms to each pole, everything linear projected out."""
        return np.asarray(self.columns[:, len(self.inverse) :] - self.orthonormal @ self.seen)

    @property
    def unscaled(self) -> Real:
        """Inverse normal matrix of one position at unit weight."""
        return np.asarray(self.inverse @ self.inverse.T)

    @property
    def following(self) -> Real:
        """What linear parameters give way for a slope, (n_linear, 2 n_modes)."""
        return np.asarray(self.inverse @ self.seen)

    @cached_property
    def misfit(self) -> Real:
        """Weighted residuals, (2 n_frequencies, n_positions), real parts above imaginary parts."""
        return np.asarray(self.target - self.orthonormal @ self.inside)

    @property
    def leverage(self) -> Real:
        """Share of each weighted line that the linear parameters follow, (2 n_frequencies,)."""
        return np.asarray(np.sum(self.orthonormal**2, axis=1))

    def chi_square(self, power: Real, scale: Real) -> float:
        """Weighted sum of squared residuals.

        `power` is the sum of squares of the target per position, which never changes.
        """
        left = power - np.sum(self.inside**2, axis=0)
        return float(np.sum(np.maximum(left, 0.0) * scale**2))

    @cached_property
    def coefficients(self) -> NDArray[np.float64]:
        """What multiplies `slopes` in the Jacobian, (2 n_modes parameters, 2, n_positions).

        Parameter 2r is Re s_r, 2r+1 is Im s_r; slopes 2r and 2r+1 belong to Re A_r and Im A_r.
        """
        real, imag = self.residues.T.real, self.residues.T.imag
        pairs = np.stack([np.stack([real, imag], 1), np.stack([-imag, real], 1)], 1)
        return np.asarray(pairs.reshape(2 * real.shape[0], 2, real.shape[1]))

    def normal_matrix(self, scale: Real) -> Real:
        """JᵀJ of the poles' parameters, (2 n_modes, 2 n_modes); `scale` per position."""
        rows = slope_rows(self.poles.size).ravel()
        c = (self.coefficients * scale).reshape(rows.size, -1)
        products = (c @ c.T) * self.inner[rows][:, rows]
        return np.asarray(products.reshape(rows.size // 2, 2, -1, 2).sum(axis=(1, 3)))

    def gradient(self, scale: Real) -> Real:
        """Jᵀr of the poles' parameters, (2 n_modes,)."""
        # The slopes hold nothing that is linear, so they see residuals and target alike.
        rows = slope_rows(self.poles.size)
        weighted = self.coefficients * scale**2
        return np.asarray(-np.sum(weighted * self.towards[rows], axis=(1, 2)))


def slope_rows(n_modes: int) -> NDArray[np.int_]:
    """Slopes that belong to each parameter: both parameters of a pole use both of its slopes."""
    return np.asarray(np.repeat(np.arange(2 * n_modes).reshape(n_modes, 2), 2, axis=0))


def project(omega: Real, target: Real, weight: Real, poles: Complex) -> Projection:
    """Best residues and residual terms for given poles, and the slopes towards better poles.

    `omega` is in rad/s; `target`, (2 n_frequencies, n_positions), are weighted inertances from
    `stacked`; `weight` is 1/σ over frequency, shared by the positions.
    """
    columns = _columns(omega, weight, poles)
    n_linear = 2 * poles.size + 2
    products, given = columns.T @ columns, columns.T @ target
    size = np.sqrt(np.diag(products)[:n_linear])
    linear = columns[:, :n_linear]
    inverse = orthogonalising(lambda: linear, products[:n_linear, :n_linear], size)
    inside, seen = inverse.T @ given[:n_linear], inverse.T @ products[:n_linear, n_linear:]
    found = inverse @ inside
    return Projection(
        poles=poles,
        residues=np.asarray((found[0:-2:2] + 1j * found[1:-2:2]).T),
        lower=found[-2],
        upper=found[-1],
        target=target,
        columns=columns,
        inverse=inverse,
        inside=inside,
        seen=seen,
        inner=products[n_linear:, n_linear:] - seen.T @ seen,
        towards=given[n_linear:] - seen.T @ inside,
    )


def _columns(omega: Real, weight: Real, poles: Complex) -> Real:
    """Columns of residues and residual terms, then slopes; real parts above imaginary parts."""
    n, n_lines, inertia = poles.size, omega.size, -(omega**2) * weight
    away = 1 / (1j * omega - np.array([poles, poles.conj()])[:, :, None])
    rows = np.zeros((4 * n + 2, 2 * n_lines))
    in_parts(inertia * away, rows[: 2 * n])
    rows[2 * n, :n_lines], rows[2 * n + 1, :n_lines] = weight, inertia
    in_parts(inertia * away**2, rows[2 * n + 2 :])
    return rows.T


def in_parts(functions: Complex, rows: Real) -> None:
    """What multiplies real and imaginary part of complex factors, one after the other, into rows.

    Of `functions` of the factors and of their conjugates, (2, n_factors, n_lines); rows have the
    real parts of the lines, then imaginary parts: (2 n_factors, 2 n_lines).
    """
    n_lines, both, turned = functions.shape[2], functions[0] + functions[1], np.subtract(*functions)
    rows[0::2, :n_lines], rows[0::2, n_lines:] = both.real, both.imag
    rows[1::2, :n_lines], rows[1::2, n_lines:] = -turned.imag, turned.real


def orthogonalising(columns: Callable[[], Real], products: Real, size: Real) -> Real:
    """R⁻¹ of columns, given their products; where two poles coincide, the least-norm one."""
    triangle, failed = scipy.linalg.lapack.dpotrf(products / np.outer(size, size))
    diagonal = np.diag(triangle)
    if failed or diagonal.min() < _TOO_ALIKE:  # products have lost the difference
        triangle = np.linalg.qr(columns() / size, mode="r")
        diagonal = np.abs(np.diag(triangle))
    if diagonal.min() > 1e-9 * diagonal.max():
        return np.asarray(scipy.linalg.lapack.dtrtri(triangle)[0] / size[:, None])
    return np.asarray(np.linalg.pinv(triangle, rcond=1e-9) / size[:, None])


def stacked(rows: Complex, weight: Real) -> Real:
    """Weighted rows as real columns, real parts above imaginary parts."""
    weighted = rows * weight
    return np.asarray(np.concatenate([weighted.real, weighted.imag], axis=1).T)


class SumOfSquares(Protocol):
    """Sum of squared residuals r at one point, and its slopes."""

    @property
    def cost(self) -> float:
        """rᵀr."""

    def gradient(self) -> Real:
        """Jᵀr, (n_parameters,)."""

    def normal_matrix(self) -> Real:
        """JᵀJ, (n_parameters, n_parameters)."""


Point = TypeVar("Point", bound=SumOfSquares)


def descend(
    at: Callable[[Real], Point],
    start: Real,
    lower: Real,
    upper: Real,
    *,
    size: Real,
    gain: float,
    tries: int,
) -> tuple[Real, Point]:
    """Minimum of a sum of squares in a box, by scipy's trust-region reflective algorithm.

    The search needs rᵀr, Jᵀr and JᵀJ only, so it is given the shortest residuals that have them:
    nothing larger than the number of parameters squared is ever formed.

    Parameters
    ----------
    at : callable
        Takes parameters, gives the sum of squares there.
    start, lower, upper : ndarray, shape (n_parameters,)
    size : ndarray, shape (n_parameters,)
        How far a parameter goes in a large step.
    gain : float
        Share of the cost that is not worth another step.
    tries : int
        Most points to look at.

    Returns
    -------
    parameters : ndarray, shape (n_parameters,)
    point : Point
        What `at` gave there.
    """
    last: list[tuple[Real, Point, tuple[Real, Real]]] = []

    def seen(x: Real) -> tuple[Real, Point, tuple[Real, Real]]:
        if not last or not np.array_equal(last[0][0], x):
            end_if_stopped()
            point = at(x)
            last[:] = [(x.copy(), point, _shortest(point))]
        return last[0]

    found = scipy.optimize.least_squares(
        lambda x: seen(x)[2][0],
        np.clip(start, lower, upper),
        lambda x: seen(x)[2][1],
        bounds=(lower, upper),
        x_scale=size,
        ftol=max(gain, np.finfo(float).eps),
        xtol=_SMALLEST_STEP,
        gtol=None,
        max_nfev=tries,
    )
    return found.x, seen(found.x)[1]


def _shortest(point: SumOfSquares) -> tuple[Real, Real]:
    """Residuals and Jacobian with the rᵀr, Jᵀr and JᵀJ of a point, of n_parameters + 1 rows."""
    normal = point.normal_matrix()
    size = np.sqrt(np.maximum(np.diag(normal), 0.0))  # rounding
    size[size == 0] = 1.0
    curvature, directions = np.linalg.eigh(normal / np.outer(size, size))
    root = np.sqrt(np.maximum(curvature, _NOT_SEEN * curvature[-1]))
    inside = directions.T @ (point.gradient() / size) / root
    rest = np.sqrt(max(point.cost - float(inside @ inside), 0.0))
    jacobian = np.vstack([root[:, None] * directions.T * size, np.zeros(size.size)])
    return np.append(inside, rest), jacobian


@lru_cache(maxsize=_KEPT)
def near_pole(lines_hz: bytes, start: complex) -> tuple[Real, Complex]:
    """Background of lines around a pole, ω² and 1, and what holds every pole near beside that.

    Orthonormal columns and rows. The same lines are fitted again and again: with what is known of
    the other orders, and against each force.
    """
    omega, size, ratio = 2 * np.pi * np.frombuffer(lines_hz), abs(start), -start.real / abs(start)
    ground = np.linalg.qr(np.vander(omega / size, 3)[:, ::2])[0]
    frequencies = size * (1 + ratio * np.linspace(-2.5, 2.5, 9))
    widths = np.array([0.4, 0.7, 1.0, 1.5, 2.2])
    poles = np.array([f * (-ratio * w + 1j) for f in frequencies for w in widths])
    functions = above_ground(ground, alone(omega, poles))
    functions /= np.linalg.norm(functions, axis=1, keepdims=True)
    above = min(_DIMENSIONS, omega.size - 2)  # the rest is background
    span = np.linalg.svd(functions, full_matrices=False)[2][:above]
    return readonly(ground), readonly(span, complex)


def above_ground(ground: Real, values: Complex) -> Complex:
    """Rows of values without the background."""
    return np.asarray(values - (values @ ground) @ ground.T)


def alone(omega: Real, poles: Complex) -> Complex:
    """FRFs of single poles, (n_poles, n_lines)."""
    away = 1j * omega - poles[:, None], 1j * omega - poles.conj()[:, None]
    return np.asarray(omega**2 / (away[0] * away[1]))


def numbers_of(poles: Complex) -> Real:
    """Frequency in Hz and damping ratio of poles, one after the other."""
    return np.ravel(np.column_stack([np.abs(poles) / (2 * np.pi), -poles.real / np.abs(poles)]))
