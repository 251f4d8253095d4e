"""Whether two measured numbers differ by more than their error bars allow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Accepted chance that noise alone makes even one of all differences tested look significant.
LEVEL = 0.05
SIGNIFICANT = "significant"
NOT_SIGNIFICANT = "not significant"
UNKNOWN = "σ unknown"


@dataclass(frozen=True)
class Difference:
    """One quantity in two results; the difference is second minus first.

    Parameters
    ----------
    first, second : float
        The quantity in its unit.
    std : float
        Standard deviation of the difference in the same unit; NaN where unknown.
    adjusted_chance : float
        `chance`, raised for the number of differences tested together, see `judged`; NaN where
        nothing was tested.
    """

    first: float
    second: float
    std: float
    adjusted_chance: float = float("nan")

    @property
    def value(self) -> float:
        """Second minus first."""
        return self.second - self.first

    @property
    def percent(self) -> float:
        """Difference in percent of the first; NaN where that is zero."""
        return 100 * self.value / self.first if self.first else float("nan")

    @property
    def percent_std(self) -> float:
        """`std` in percent of the first; NaN where that is zero."""
        return 100 * self.std / abs(self.first) if self.first else float("nan")

    @property
    def z(self) -> float:
        """Difference over its standard deviation; NaN where that is unknown or zero."""
        return self.value / self.std if self.std > 0 else float("nan")

    @property
    def chance(self) -> float:
        """Two-sided probability of a difference as large from normal noise alone."""
        return math.erfc(abs(self.z) / math.sqrt(2))

    @property
    def status(self) -> str:
        """``"significant"``, ``"not significant"`` or ``"σ unknown"``."""
        if math.isnan(self.adjusted_chance):
            return UNKNOWN
        return SIGNIFICANT if self.adjusted_chance < LEVEL else NOT_SIGNIFICANT

    @property
    def is_significant(self) -> bool:
        """Whether noise is no likely explanation."""
        return self.status == SIGNIFICANT


def judged(differences: Sequence[Difference]) -> tuple[Difference, ...]:
    """Give differences that are tested together their adjusted chances, in the same order."""
    adjusted = holm([difference.chance for difference in differences])
    return tuple(
        replace(difference, adjusted_chance=float(chance))
        for difference, chance in zip(differences, adjusted, strict=True)
    )


def holm(chances: ArrayLike) -> NDArray[np.float64]:
    """Raise the chances of several tests so that all of them together keep one level.

    The step-down procedure of Holm (1979): the k-th smallest of m is multiplied by m − k + 1. It
    holds for tests that depend on each other too, as modes fitted together do.

    Parameters
    ----------
    chances : array_like, shape (n_tests,)
        NaN where nothing could be tested; such a test does not count.

    Returns
    -------
    ndarray, shape (n_tests,)
        At most 1; NaN stays.
    """
    given = np.asarray(chances, dtype=float)
    adjusted = np.full(given.shape, np.nan)
    ranked = np.argsort(given)[: np.count_nonzero(np.isfinite(given))]
    raised = given[ranked] * np.arange(ranked.size, 0, -1)
    adjusted[ranked] = np.minimum(np.maximum.accumulate(raised), 1.0)
    return adjusted
