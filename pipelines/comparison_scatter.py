"""All modes together: how large the differences are, measured by what their error bars allow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ema.chance import chi_square_tail
from pipelines.comparison_significance import LEVEL, Difference


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
        return float(chi_square_tail(self.chi_square, self.freedom))

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
