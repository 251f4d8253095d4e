"""Whether two measured numbers differ by more than their error bars allow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc

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


@dataclass(frozen=True)
class Scatter:
    """Differences of many modes against their standard deviations.

    Parameters
    ----------
    freedom : int
        Degrees of freedom: differences that count, less what was fitted to them.
    chi_square : float
        Σ (difference/σ)².
    rms_percent : float
        Root mean square of the differences, percent.
    """

    freedom: int
    chi_square: float
    rms_percent: float

    @property
    def ratio(self) -> float:
        """How many times larger than the error bars allow: √(χ²/freedom), 1 for noise alone."""
        return math.sqrt(self.chi_square / self.freedom) if self.freedom else float("nan")

    @property
    def chance(self) -> float:
        """Probability of a χ² at least as large from noise alone; NaN without freedom."""
        if not self.freedom:
            return float("nan")
        return float(chdtrc(self.freedom, self.chi_square))

    @property
    def is_noise(self) -> bool:
        """Whether noise alone explains the differences."""
        return self.chance >= LEVEL


@dataclass(frozen=True)
class Agreement:
    """How well two results agree over all matched modes; what repeatability is read from.

    Modes are counted as independent. Those of one fit are nearly so: with the full covariance
    χ² changes by some per cent, unless two modes lie within each other's half width.

    Parameters
    ----------
    frequency, damping : Scatter
    shift_percent, shift_std_percent : float
        Common shift of all frequencies, weighted by their error bars. One cause that moves all
        alike (pressure, temperature, the analyser's clock) shows here.
    apart : Scatter
        Frequencies apart from the common shift.
    """

    frequency: Scatter
    damping: Scatter
    shift_percent: float
    shift_std_percent: float
    apart: Scatter


def agreement(frequency: Sequence[Difference], damping: Sequence[Difference]) -> Agreement | None:
    """Sum up the differences of all modes; None where no standard deviation is known."""
    known = [each for each in frequency if each.std > 0]
    if not known:
        return None
    percent = np.array([each.percent for each in known])
    weight = 1 / np.array([each.percent_std for each in known]) ** 2
    shift = float(np.sum(weight * percent) / np.sum(weight))
    apart = Scatter(
        len(known) - 1, float(np.sum(weight * (percent - shift) ** 2)), _rms(percent - shift)
    )
    return Agreement(
        _scatter(known),
        _scatter([each for each in damping if each.std > 0]),
        shift,
        float(1 / np.sqrt(np.sum(weight))),
        apart,
    )


def _scatter(known: Sequence[Difference]) -> Scatter:
    chi_square = sum(each.z**2 for each in known)
    return Scatter(len(known), chi_square, _rms([each.percent for each in known]))


def _rms(percent: Sequence[float] | np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    return float(np.sqrt(np.mean(np.square(percent)))) if len(percent) else float("nan")
