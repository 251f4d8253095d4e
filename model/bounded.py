"""Least squares of a few unknowns within bounds: linear, and step by step where it is not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Real = NDArray[np.float64]

_FIRST_DAMPING = 1e-4
_MOST_DAMPING = 1e16


def solve_within(matrix: Real, right: Real, lower: ArrayLike, upper: ArrayLike) -> Real:
    """Linear least squares with bounds, by an active set.

    Parameters
    ----------
    matrix : ndarray, shape (n_rows, n_unknowns)
    right : ndarray, shape (n_rows,)
    lower, upper : array_like, shape (n_unknowns,) or ()
        Bounds; infinite ones bound nothing.

    Returns
    -------
    ndarray, shape (n_unknowns,)

    References
    ----------
    Stark & Parker (1995), Bounded-variable least-squares.
    """
    n = matrix.shape[1]
    low, high = np.broadcast_to(lower, n), np.broadcast_to(upper, n)
    size = np.linalg.norm(matrix, axis=0)
    size = np.where(size > 0, size, 1.0)
    scaled, low, high = matrix / size, low * size, high * size
    x = np.clip(np.zeros(n), low, high)
    free = (x > low) & (x < high)
    small = 1e-13 * max(float(np.linalg.norm(right)), 1e-300)
    for _ in range(10 * n + 10):
        x, free = _free_solution(scaled, right, x, free, low, high)
        pull = scaled.T @ (right - scaled @ x)
        held = ~free & (low < high)
        gain = np.where(held & (x <= low), pull, np.where(held, -pull, -np.inf))
        best = int(np.argmax(gain))
        if gain[best] <= small:
            break
        free = free.copy()
        free[best] = True
    return np.asarray(x / size)


def _free_solution(
    matrix: Real, right: Real, x: Real, free: NDArray[np.bool_], low: Real, high: Real
) -> tuple[Real, NDArray[np.bool_]]:
    """Best values of the free unknowns; those that meet a bound on the way stay on it."""
    free = free.copy()
    while np.any(free):
        best = x.copy()
        best[free] = np.linalg.lstsq(
            matrix[:, free], right - matrix[:, ~free] @ x[~free], rcond=None
        )[0]
        step = best - x
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(step > 0, (high - x) / step, np.where(step < 0, (low - x) / step, 2.0))
        room[~free] = 2.0
        first = int(np.argmin(room))
        if room[first] >= 1.0:
            return np.asarray(np.clip(best, low, high)), free
        x = np.clip(x + room[first] * step, low, high)
        x[first] = high[first] if step[first] > 0 else low[first]
        free[first] = False
    return x, free


def descend_within(
    residual: Callable[[Real], Real],
    slope: Callable[[Real], Real],
    start: Real,
    lower: Real,
    upper: Real,
    *,
    tolerance: float,
    tries: int,
) -> Real:
    """Levenberg–Marquardt steps, each the best one within the bounds.

    Parameters
    ----------
    residual, slope : callable
        Residuals, (n_rows,), and their slopes, (n_rows, n_unknowns), at some values.
    start, lower, upper : ndarray, shape (n_unknowns,)
    tolerance : float
        Share of the sum of squares that is not worth another step.
    tries : int
        Most points to look at.

    Returns
    -------
    ndarray, shape (n_unknowns,)
    """
    x = np.clip(start, lower, upper)
    here = residual(x)
    rows, damping = slope(x), _FIRST_DAMPING
    for _ in range(tries - 1):
        weight = np.sqrt(damping) * np.linalg.norm(rows, axis=0)
        matrix = np.vstack([rows, np.diag(weight)])
        step = solve_within(matrix, np.append(-here, np.zeros(x.size)), lower - x, upper - x)
        cost, expected = float(here @ here), float(np.sum((here + rows @ step) ** 2))
        if cost - expected <= tolerance * cost or cost <= tolerance**2:
            break
        moved = np.clip(x + step, lower, upper)
        there = residual(moved)
        if there @ there < cost:
            x, here, rows = moved, there, slope(moved)
            damping = damping / 10
        elif damping < _MOST_DAMPING:
            damping = damping * 10
        else:
            break
    return x
