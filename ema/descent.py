"""Smallest sum of squares within bounds, where its normal matrix is cheap to come by."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

_FIRST_DAMPING, _NO_DAMPING = 1e-2, 1e-9
_SMALLEST_STEP = 1e-11  # of the parameters' own size
_HOLDS = 1e-3  # of the fall predicted: a step that gains less is not taken
_MOST_DAMPING = 1e12


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
    """Levenberg–Marquardt steps on the normal equations, in a box.

    A step that would leave the box puts those parameters on its face and goes on with the others.
    Nothing is ever formed that is larger than the number of parameters squared.

    Parameters
    ----------
    at : callable
        Takes parameters, gives the sum of squares there.
    start, lower, upper : ndarray, shape (n_parameters,)
    size : ndarray, shape (n_parameters,)
        How far a parameter goes in a large step: it ends the search.
    gain : float
        Share of the cost that is not worth another step.
    tries : int
        Most points to look at.

    Returns
    -------
    parameters : ndarray, shape (n_parameters,)
    point : Point
        What `at` gave there.

    References
    ----------
    Marquardt (1963); the damping follows Nielsen (1999).
    """
    x = np.clip(start, lower, upper)
    here = at(x)
    gradient, normal = here.gradient(), here.normal_matrix()
    damping, growth, too_bold = _FIRST_DAMPING, 2.0, 0.0
    for _ in range(tries - 1):
        step = _step(gradient, normal, damping, lower - x, upper - x)
        fall = -float(step @ (2 * gradient + normal @ step))
        while fall <= gain * here.cost and damping > max(100 * too_bold, _NO_DAMPING):
            # Damping holds back what is least certain: there may be more to gain without it.
            damping /= 100
            step = _step(gradient, normal, damping, lower - x, upper - x)
            fall = -float(step @ (2 * gradient + normal @ step))
        if fall <= gain * here.cost or np.all(np.abs(step) <= _SMALLEST_STEP * size):
            break
        there = at(x + step)
        ratio = (here.cost - there.cost) / fall
        if ratio > _HOLDS:
            x, here, too_bold = x + step, there, 0.0
            gradient, normal = here.gradient(), here.normal_matrix()
            damping *= max(1 / 3, 1 - (2 * ratio - 1) ** 3)
            growth = 2.0
        elif damping > _MOST_DAMPING:
            break
        else:
            too_bold = damping
            damping, growth = damping * growth, 2 * growth
    return x, here


def _step(gradient: Real, normal: Real, damping: float, lowest: Real, highest: Real) -> Real:
    """Damped Gauss–Newton step between `lowest` and `highest`."""
    curved = np.diag(normal)
    # A parameter that nothing depends on stays where it is.
    damped = normal + np.diag(damping * curved + np.where(curved > 0, 0.0, 1.0))
    step = np.zeros(gradient.size)
    # Parameters on a face they are pushed against.
    held = ((lowest >= 0) & (gradient > 0)) | ((highest <= 0) & (gradient < 0))
    while not np.all(held):
        free = ~held
        right = -gradient[free] - damped[np.ix_(free, held)] @ step[held]
        step[free] = _solved(damped[np.ix_(free, free)], right)
        outside = free & ((step < lowest) | (step > highest))
        step = np.clip(step, lowest, highest)
        if not np.any(outside):
            break
        held |= outside
    return step


def _solved(matrix: Real, right: Real) -> Real:
    """Solution of a symmetric positive system whose unknowns differ in size."""
    size = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(size, size)
    try:
        return np.asarray(np.linalg.solve(scaled, right / size) / size)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(scaled, right / size, rcond=None)[0] / size)
