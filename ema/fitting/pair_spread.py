"""How far members of a pair may be from what slopes at the minimum say.

The split of a pair is √(δ_c² + δ_s²): it has no slope along the force where noise happens to put
δ_c near 0, however large δ_c may be. Points at √3 σ of the parameters, which have the moments of a
normal distribution, tell (Julier & Uhlmann 2004).
"""

from __future__ import annotations

import numpy as np

from ema.fitting.ring_pair import PairProblem
from ema.fitting.variable_projection import Real

# Steps that give slopes, of the sizes of the parameters.
_STEP = 1e-4


def variance_beyond_slopes(problem: PairProblem, x: Real) -> Real:
    """Variance of the six numbers and of the split that points show more than slopes, (7,).

    A member that is hardly driven may lie on either side of the other one: there the members are
    told by which one is driven.
    """
    variances, axes = np.linalg.eigh(problem.spread(x) / np.outer(problem.sizes, problem.sizes))
    steps = np.sqrt(np.maximum(variances, 0.0))[:, None] * (axes.T * problem.sizes)
    far, near = (_away(problem, x, reach * steps) / reach for reach in (np.sqrt(3), _STEP))
    # Two points of 2n, each with the weight 1/6 at √3 σ, and half of the two that give a slope.
    return np.asarray(np.maximum(np.sum(far**2, axis=0) / 2 - np.sum(near**2, axis=0) / 2, 0.0))


def _away(problem: PairProblem, x: Real, steps: Real) -> Real:
    """Change of the numbers and the split on either side of a minimum, (2 n_parameters, 7)."""
    numbers = problem.numbers(x + np.concatenate([0 * steps[:1], steps, -steps]))
    a, b, mean = (numbers[:, ::2] * (1 + 1j * numbers[:, 1::2])).T
    to_a, to_b = np.abs(mean - a), np.abs(mean - b)  # the mean is near the member driven most
    if min(to_a[0], to_b[0]) < problem.settings.pair_weakest_share * abs(b[0] - a[0]):
        other = (to_a < to_b) != (to_a[0] < to_b[0])
        numbers[other, :4] = numbers[np.ix_(other, [2, 3, 0, 1])]
    whole = np.column_stack([numbers, numbers[:, 2] - numbers[:, 0]])
    return np.asarray(whole[1:] - whole[0])
