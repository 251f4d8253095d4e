"""Every order n ≥ 1 of a ring is a pair of modes: whether one is seen, or both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.chance import chi_square_tail
from ema.covariance import parameter_covariance
from ema.errors import FitError
from ema.orders import OrderFrf, fit_order
from ema.pole_fit import PoleFit

RESOLVED = "resolved pair"
NOT_RESOLVABLE = "pair not resolvable"
SINGLE = "single"

# A second pole is looked into when chance would ask for it once in 10 000 orders.
_CHANCE = 1e-4
# The two frequencies of a pair must differ by this many standard deviations …
_SEPARATION = 3.0
# … their damping by no more than this factor, and neither may be weaker than this share.
_DAMPING_FACTOR = 1.6
_SHARE = 0.03
# Damping of pairs that are searched for stays within this factor of the one pole's …
_ALIKE = 1.3
# … and the misfit that this costs at most.
_MUCH_WORSE = 1.1
# Steps after which a second pole that is there shows in the misfit.
_FIRST_TRIES = 12


@dataclass(frozen=True)
class PairVerdict:
    """Whether an order shows one mode of its pair or both, and on what evidence.

    Parameters
    ----------
    order : int
    verdict : str
        ``"resolved pair"``, ``"pair not resolvable"`` or ``"single"`` (order 0).
    chance : float
        Probability that noise alone makes a second pole fit that much better (likelihood ratio);
        NaN where it was not tested.
    evidence : str
        In words.
    """

    order: int
    verdict: str
    chance: float
    evidence: str


def judge_pair(
    order: OrderFrf, poles: NDArray[np.complex128], correlation: float
) -> tuple[PairVerdict, NDArray[np.complex128]]:
    """Test one pole against two on the FRFs of one order.

    Parameters
    ----------
    order : OrderFrf
        With everything but the mode (or pair) in question taken out.
    poles : ndarray of complex
        The one pole found so far, or two.
    correlation : float
        Lines that share the information of one, from `line_correlation`.

    Returns
    -------
    verdict : PairVerdict
    poles : ndarray of complex
        What to go on with: two poles for a resolved pair, one where one explains everything, and
        those found already where it cannot be told.
    """
    number = order.order
    if not np.all(np.isfinite(order.std)):
        text = "the noise is unknown: one pole against two cannot be tested"
        verdict = RESOLVED if poles.size > 1 else NOT_RESOLVABLE
        return PairVerdict(number, verdict, float("nan"), text), poles
    try:
        one = fit_order(order, np.array([np.mean(poles)]))
        start = poles if poles.size > 1 else _beside(one.poles[0])[0]
        two = fit_order(order, start, tries=_FIRST_TRIES)
        chance, doubt = _chance(one, two, correlation), _doubt(two, correlation)
        if chance < _CHANCE:
            better = fit_order(order, two.poles)
            if doubt or _doubt(better, correlation):
                better = _searched(order, one.poles[0], two)
            two = better
            chance, doubt = _chance(one, two, correlation), _doubt(two, correlation)
    except FitError as error:
        return PairVerdict(number, NOT_RESOLVABLE, float("nan"), str(error)), poles
    if not chance < _CHANCE:
        text = f"one pole explains the order; a second may fit better by chance (p = {chance:.2g})"
        return PairVerdict(number, NOT_RESOLVABLE, chance, text), one.poles
    if doubt:
        text = f"a second pole fits better (p = {chance:.2g}), but {doubt}"
        return PairVerdict(number, NOT_RESOLVABLE, chance, text), poles
    text = f"two poles fit better than one (p = {chance:.2g})"
    return PairVerdict(number, RESOLVED, chance, text), two.poles[np.argsort(np.abs(two.poles))]


def _searched(order: OrderFrf, pole: complex, found: PoleFit) -> PoleFit:
    """Best of some pairs around one pole whose members are damped alike, if any is better.

    Turning a tyre turns its modes: the members of a pair differ in frequency, hardly in damping.
    """
    fits = [fit_order(order, start, damping_reach=_ALIKE) for start in _beside(pole)]
    best = min(fits, key=lambda fit: fit.chi_square)
    return best if best.chi_square < _MUCH_WORSE * found.chi_square else found


def _beside(pole: complex) -> list[NDArray[np.complex128]]:
    """Two poles split evenly around one, and the one with another above or below it."""
    width = -pole.real
    shifts = ((-0.5j, 0.5j), (0.0, 1.0j), (0.0, -1.0j))
    return [np.asarray(pole + width * (0.1 + np.array(pair))) for pair in shifts]


def _chance(one: PoleFit, two: PoleFit, correlation: float) -> float:
    """Likelihood-ratio test with the noise as large as the better fit leaves it."""
    scale = correlation * max(two.misfit, 1.0)
    freedom = 2 + 2 * one.lines.scale.size
    return float(chi_square_tail(max(one.chi_square - two.chi_square, 0.0) / scale, freedom))


def _doubt(two: PoleFit, correlation: float) -> str:
    """Why two fitted poles cannot be taken for a pair; empty where they can."""
    covariance = parameter_covariance(two, correlation)
    gap = abs(two.poles[1].imag - two.poles[0].imag)
    spread = np.sqrt(max(covariance[1, 1] + covariance[3, 3] - 2 * covariance[1, 3], 0.0))
    damping = -two.poles.real
    strength = np.linalg.norm(two.residues, axis=0)
    if np.any(two.at_bound[1::2]):
        return "its frequency is not determined"
    if gap < _SEPARATION * spread:
        return f"the two frequencies differ by only {gap / spread:.1f} standard deviations"
    unlike = damping.max() / damping.min()
    if unlike > _DAMPING_FACTOR:
        return f"the two would be damped differently by a factor of {unlike:.1f}"
    share = strength.min() / strength.max()
    if share < _SHARE:
        return f"the weaker one has {100 * share:.1f} % of the stronger"
    return ""
