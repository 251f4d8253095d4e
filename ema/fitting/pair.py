"""The pair of one order as its FRFs show it, and whether they determine both members."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.circumference.orders import PAIR_REACH
from ema.core.modes import OrderReport, Pair, PairVerdict
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.fitting.variable_projection import numbers_of

_KNOWN_DAMPING = 0.05  # members known to no better than this share are not listed by themselves
# A pair is not told from a drift that is known to no better than this share of its split …
_DRIFTS = 0.1
# … nor, with less than this share of the response, where it leaves more than this reduced χ².
_PLAIN_SHARE, _MOST_LEFT = 0.15, 2.0
# An order whose other member has less than this share of the response shows one member.
_ONE_MEMBER = 0.02
# Members farther apart than those of tyres are two modes, as of a rim that moves in two directions,
# if both have this share: less is seen of a member that is hardly there, at any frequency. Where
# order 1 has other resonances as well, the rim moves, and a third of that distance tells them.
_OF_TWO_MODES, _ON_A_RIM = 0.05, 1 / 3


@dataclass(frozen=True, eq=False)
class PairFit:
    """What the FRFs of one order say about its pair.

    Parameters
    ----------
    poles : tuple of complex
        Members a and b, a the lower one, in rad/s.
    share : tuple of float
        Share of the response's power that each member has; they add up to 1.
    numbers, covariance : ndarray, shape (6,), (6, 6)
        (frequency_hz, damping_ratio) of member a, of member b, and of the mean.
    split_std : float
        Difference of the frequencies over its standard deviation.
    gain : float
        Difference in −2 log likelihood to one pole for the whole order.
    misfit : float
        Reduced χ² against the noise of the FRFs.
    residues : ndarray of complex, shape (2, 2)
        Of members a and b (rows) in cosine and sine.
    mean : complex
        Mean pole as the force drives the members, rad/s.
    parameters : ndarray, shape (7,)
        Of `PairProblem`.
    curved : ndarray, shape (7,)
        Variance of the numbers and of the split beyond what slopes say.
    turned_std_rad : float
        Standard deviation of the members' direction, as angle of the wave; NaN where unknown.
    """

    poles: tuple[complex, complex]
    share: tuple[float, float]
    numbers: NDArray[np.float64]
    covariance: NDArray[np.float64]
    split_std: float
    gain: float
    misfit: float
    residues: NDArray[np.complex128]
    mean: complex
    parameters: NDArray[np.float64]
    curved: NDArray[np.float64] = field(default_factory=lambda: np.zeros(7))
    turned_std_rad: float = float("nan")

    @property
    def stronger(self) -> int:
        """The member with the larger share, 0 or 1."""
        return int(np.argmax(self.share))

    def moved(self, shift: float, decay: float) -> PairFit:
        """The pair in a state whose frequencies and decay rates are smaller by these factors."""
        a, b, mean = (p.real / decay + 1j * p.imag / shift for p in (*self.poles, self.mean))
        return replace(self, poles=(a, b), mean=mean, numbers=numbers_of(np.array([a, b, mean])))

    @property
    def chance(self) -> float:
        """Probability that one pole for the whole order would be as much worse by chance."""
        return float(scipy.special.chdtrc(4, max(self.gain, 0.0)))


def order_report(
    order: int,
    pair: PairFit | None,
    settings: IdentificationSettings = IDENTIFICATION,
    drift_hz: float = 0.0,
) -> OrderReport:
    """Verdict on a pair, with its evidence; `drift_hz` is how well the runs' states are known."""
    nothing = float("nan")
    if pair is None:
        few = PairVerdict(order, Pair.NOT_SEPARABLE, nothing, "too few lines around the resonance")
        return OrderReport(few)
    doubt = _doubt(pair, settings, drift_hz)
    weaker = min(pair.share)
    if pair.chance < settings.pair_p_value and not doubt:
        verdict, text = Pair.RESOLVED, f"two poles fit better than one (p = {pair.chance:.2g})"
    elif weaker < _ONE_MEMBER:
        verdict = Pair.ONE_SEEN
        text = f"the force drives one member; the other has {100 * weaker:.1f} % of the response"
    elif pair.chance < settings.pair_p_value:
        verdict, text = Pair.NOT_SEPARABLE, doubt
    else:
        verdict = Pair.NOT_SEPARABLE
        text = f"one pole explains the order; a second is not significant (p = {pair.chance:.2g})"
    return reported(PairVerdict(order, verdict, pair.chance, text), pair)


def are_two_modes(pair: PairFit, *, on_a_rim: bool) -> bool:
    """Whether the members are too far apart for one modal mass and two directions 90°/n apart."""
    lower, upper = pair.numbers[[0, 2]]
    reach = PAIR_REACH * (_ON_A_RIM if on_a_rim else 1.0)
    return bool(upper > (1 + reach) * lower and min(pair.share) > _OF_TWO_MODES)


def two_modes(order: int) -> OrderReport:
    """Report on an order with two modes."""
    text = "its resonances are too far apart for a pair, as where the rim moves"
    return OrderReport(PairVerdict(order, Pair.ONE_SEEN, float("nan"), text))


def one_row(pair: PairFit, settings: IdentificationSettings = IDENTIFICATION) -> int | None:
    """The member that one row of an order stands for, 0 or 1; None where that is the mean.

    Where the other member is seen, but too weak to be listed, the mean would be beside both.
    """
    is_pair = pair.chance < settings.pair_p_value
    return pair.stronger if is_pair and min(pair.share) < settings.pair_weakest_share else None


def joint_report(
    order: int, pair: PairFit, settings: IdentificationSettings = IDENTIFICATION
) -> OrderReport:
    """Verdict on a pair that several forces drive: whether they determine both members."""
    std = np.sqrt(np.diag(pair.covariance))
    worst, factor = float(np.max(std[[1, 3]] / pair.numbers[[1, 3]])), _damping_factor(pair)
    verdict, text = Pair.RESOLVED, "the forces together drive both members"
    if not worst < _KNOWN_DAMPING:
        verdict = Pair.NOT_SEPARABLE
        text = f"the damping of one member is known to {100 * worst:.0f} % only"
    elif factor > settings.pair_damping_factor:
        verdict = Pair.NOT_SEPARABLE
        text = f"the damping ratios would differ by a factor of {factor:.1f}"
    return reported(PairVerdict(order, verdict, pair.chance, text), pair)


def reported(verdict: PairVerdict, pair: PairFit) -> OrderReport:
    """A verdict with the mean of the pair."""
    std = np.sqrt(np.diag(pair.covariance))
    return OrderReport(
        verdict,
        frequency_hz=float(pair.numbers[4]),
        frequency_std_hz=float(std[4]),
        damping_ratio=float(pair.numbers[5]),
        damping_std=float(std[5]),
    )


def _doubt(pair: PairFit, settings: IdentificationSettings, drift_hz: float) -> str:
    """Why the members are not determined; empty where they are."""
    if min(pair.share) < settings.pair_weakest_share:
        return f"the weaker member has {100 * min(pair.share):.1f} % of the response"
    if pair.split_std < min(settings.pair_separation_std, 1.0):
        return "the two frequencies are equal within their ±"
    if pair.split_std < settings.pair_separation_std:
        return f"the two frequencies differ by only {pair.split_std:.1f} standard deviations"
    split_hz = (abs(pair.poles[1]) - abs(pair.poles[0])) / (2 * np.pi)
    if drift_hz > _DRIFTS * split_hz:
        states = f"the states of the runs are known to {drift_hz:.2g} Hz"
        return f"{states}, the members differ by {split_hz:.2g} Hz"
    if pair.misfit > _MOST_LEFT and min(pair.share) < _PLAIN_SHARE:
        return f"both members leave {pair.misfit:.0f} times the noise"
    damping = [-pole.real / abs(pole) for pole in pair.poles]
    if (factor := _damping_factor(pair)) > settings.pair_damping_factor:
        return f"the damping ratios would differ by a factor of {factor:.1f}"
    std = np.sqrt(np.diag(pair.covariance))[[1, 3]]
    worst = float(np.max(std / damping))
    if worst > _KNOWN_DAMPING:
        return f"the damping of one member is known to {100 * worst:.0f} % only"
    return ""


def _damping_factor(pair: PairFit) -> float:
    """How many times more damped one member is than the other."""
    damping = [-pole.real / abs(pole) for pole in pair.poles]
    return float(max(damping) / min(damping))
