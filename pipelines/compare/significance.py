"""Significance of differences: single values, ring parameters, and all modes together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from model.identifiability import GIVEN, IDENTIFIED
from model.tuning_problem import PARAMETERS
from pipelines.results.parameter_set import Parameter

#: Accepted probability that noise alone makes any of the differences tested look significant.
LEVEL = 0.05


class Verdict(StrEnum):
    """Verdict on a difference, as tables and ``--json`` show it."""

    SIGNIFICANT = "significant"
    NOT_SIGNIFICANT = "not significant"
    UNKNOWN = "σ unknown"
    NOT_TESTED = "not tested"


@dataclass(frozen=True)
class Difference:
    """A quantity in two results, with the standard deviation of its difference, in one unit.

    `std` is NaN where unknown, `adjusted_p_value` (from `jointly_tested`) where not tested.
    """

    first: float
    second: float
    std: float
    adjusted_p_value: float = float("nan")

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
    def p_value(self) -> float:
        """Two-sided probability of a difference as large from normal noise alone."""
        return math.erfc(abs(self.z) / math.sqrt(2))

    @property
    def status(self) -> Verdict:
        """Significant, not significant, or σ unknown."""
        if math.isnan(self.adjusted_p_value):
            return Verdict.UNKNOWN
        return Verdict.SIGNIFICANT if self.adjusted_p_value < LEVEL else Verdict.NOT_SIGNIFICANT

    @property
    def is_significant(self) -> bool:
        """Whether noise is an unlikely explanation."""
        return self.status is Verdict.SIGNIFICANT


def jointly_tested(differences: Iterable[Difference]) -> tuple[Difference, ...]:
    """Differences that are tested together with their adjusted p-values, in the same order."""
    given = tuple(differences)
    adjusted = holm([difference.p_value for difference in given]).tolist()
    return tuple(
        replace(difference, adjusted_p_value=p_value)
        for difference, p_value in zip(given, adjusted, strict=True)
    )


def holm(p_values: ArrayLike) -> NDArray[np.float64]:
    """Adjust the p-values, shape (n_tests,), of several tests so that together they keep one level.

    Step-down procedure of Holm (1979): the k-th smallest of m is multiplied by m − k + 1. It also
    holds for dependent tests, such as those of modes fitted together. NaN (not tested) stays NaN
    and does not count.
    """
    given = np.asarray(p_values, dtype=float)
    adjusted = np.full(given.shape, np.nan)
    ranked = np.argsort(given)[: np.count_nonzero(np.isfinite(given))]
    raised = given[ranked] * np.arange(ranked.size, 0, -1)
    adjusted[ranked] = np.minimum(np.maximum.accumulate(raised), 1.0)
    return adjusted


@dataclass(frozen=True)
class ParameterChange:
    """A ring or damping parameter in two results or parameter sets, named as in ``tyre.toml``."""

    name: str
    # NaN where unknown
    first_std: float
    second_std: float
    # how each was obtained: given, identified, not identified or at bound
    first_how: str
    second_how: str
    difference: Difference
    # whether the same parameters were given to both tunings. If not, the identified ones follow
    # from different assumptions, and their difference does not come from the tyres alone.
    alike: bool = True

    @property
    def status(self) -> Verdict:
        """Verdict on the difference; not tested unless both were identified."""
        return self.difference.status if self.is_tested else Verdict.NOT_TESTED

    @property
    def is_tested(self) -> bool:
        """Whether both values come from measurements under the same given parameters."""
        return self.alike and self._are_identified

    @property
    def hows(self) -> str:
        """How both were obtained, for a difference that is not tested."""
        if self._are_identified:
            return "other parameters given"
        return " and ".join(dict.fromkeys((self.first_how, self.second_how)))

    @property
    def _are_identified(self) -> bool:
        return self.first_how == self.second_how == IDENTIFIED


def parameter_changes(
    first: Mapping[str, Parameter], second: Mapping[str, Parameter], *, independent: bool = True
) -> tuple[ParameterChange, ...]:
    """Parameters that both have; the identified ones are tested together.

    Independent standard deviations are added; otherwise σ of the differences is unknown. Where they
    come from the residuals of the ring model, which are similar for two similar tyres, this is
    conservative: a change that is not significant may still be real.
    """
    alike = all(_is_given(first.get(name)) == _is_given(second.get(name)) for name in PARAMETERS)
    changes = []
    for name in (name for name in first if name in second):
        a, b = first[name], second[name]
        std_a, std_b = (math.nan if each.std is None else each.std for each in (a, b))
        std = math.hypot(std_a, std_b) if independent else math.nan
        change = Difference(a.value, b.value, std)
        changes.append(ParameterChange(name, std_a, std_b, a.how, b.how, change, alike))
    tested = iter(jointly_tested(change.difference for change in changes if change.is_tested))
    return tuple(
        replace(change, difference=next(tested)) if change.is_tested else change
        for change in changes
    )


def _is_given(parameter: Parameter | None) -> bool:
    return parameter is not None and parameter.how == GIVEN


@dataclass(frozen=True)
class Scatter:
    """Differences of many modes against their standard deviations, with χ² = Σ (difference/σ)².

    `freedom` is the number of differences less fitted parameters.
    """

    freedom: int
    chi_square: float
    rms_percent: float

    @property
    def ratio(self) -> float:
        """Size of the differences in units of their error bars, √(χ²/freedom); 1 for noise."""
        return math.sqrt(self.chi_square / self.freedom) if self.freedom else float("nan")

    @property
    def p_value(self) -> float:
        """Probability of a χ² at least as large from noise alone; NaN without freedom."""
        if not self.freedom:
            return float("nan")
        return float(scipy.special.chdtrc(self.freedom, self.chi_square))

    @property
    def is_noise(self) -> bool:
        """Whether noise alone explains the differences."""
        return self.p_value >= LEVEL


@dataclass(frozen=True)
class Agreement:
    """Agreement of two results over all matched modes, the measure of repeatability.

    Modes are taken as independent. For modes of one fit this is a good approximation: the full
    covariance changes χ² by a few percent, unless two modes lie within each other's half width.
    """

    frequency: Scatter
    damping: Scatter
    # common shift of all frequencies, weighted by their error bars: the effect of a common cause
    # such as pressure, temperature or the analyser's clock
    shift_percent: float
    shift_std_percent: float
    apart: Scatter  # frequencies without the common shift


def agreement(frequency: Sequence[Difference], damping: Sequence[Difference]) -> Agreement | None:
    """Summarise the differences of all modes; None where no standard deviation is known."""
    known = [each for each in frequency if each.std > 0]
    if not known:
        return None
    percent, std = (
        np.array([getattr(each, of) for each in known]) for of in ("percent", "percent_std")
    )
    weight = std**-2
    total = weight.sum()
    shift = float(weight @ percent / total)
    apart = _scatter(percent - shift, std, n_fitted=1)
    damped = [each for each in damping if each.std > 0]
    of_damping = _scatter([each.percent for each in damped], [each.percent_std for each in damped])
    return Agreement(_scatter(percent, std), of_damping, shift, float(total**-0.5), apart)


def _scatter(percent: ArrayLike, std: ArrayLike, n_fitted: int = 0) -> Scatter:
    percent, std = np.asarray(percent), np.asarray(std)
    rms = float(np.sqrt(np.mean(percent**2))) if percent.size else math.nan
    return Scatter(percent.size - n_fitted, float(np.sum((percent / std) ** 2)), rms)
