"""What counts as missed, invented and wrong: found modes against the modes of a known tyre."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from tyres import ORDERS, RandomTyre

from pipelines.simulate.truth import TruthMode

# A member of a pair is driven when it carries at least this share of its order's response power …
DRIVEN_SHARE = 0.1
# … and two driven members must be told apart when their frequencies differ by this many times
# damping ratio × frequency, half the half-power bandwidth.
RESOLVABLE_SPLIT = 1.0
# A mode belongs to an order up to this share of the frequency below and above its members.
REACH = 0.01


@dataclass(frozen=True)
class FoundMode:
    """A mode as a method reports it; standard deviations are NaN where it gives none.

    `foreign` is set where the method itself says that the mode is none of the tyre's.
    """

    frequency_hz: float
    damping_ratio: float
    frequency_std_hz: float = float("nan")
    damping_std: float = float("nan")
    foreign: bool = False


@dataclass(frozen=True)
class Target:
    """A mode that a found one is compared with.

    Parameters
    ----------
    order : int
    kind : str
        ``"member"``: one of two modes of a pair; ``"single"``: the one driven member of an order;
        ``"unresolved"``: the mean of two members, weighted by power, where both are driven, but
        too close together to ask for two modes.
    frequency_hz, damping_ratio : float
    """

    order: int
    kind: str
    frequency_hz: float
    damping_ratio: float


@dataclass(frozen=True)
class Match:
    """A target and the mode found for it."""

    target: Target
    found: FoundMode

    @property
    def frequency_error_percent(self) -> float:
        """Relative error of the frequency."""
        return 100 * (self.found.frequency_hz / self.target.frequency_hz - 1)

    @property
    def damping_error_percent(self) -> float:
        """Relative error of the damping ratio."""
        return 100 * (self.found.damping_ratio / self.target.damping_ratio - 1)

    @property
    def frequency_z(self) -> float:
        """Error of the frequency in its standard deviations."""
        return (self.found.frequency_hz - self.target.frequency_hz) / self.found.frequency_std_hz

    @property
    def damping_z(self) -> float:
        """Error of the damping ratio in its standard deviations."""
        return (self.found.damping_ratio - self.target.damping_ratio) / self.found.damping_std


@dataclass(frozen=True)
class Score:
    """One method on one tyre."""

    matches: list[Match] = field(default_factory=list)
    missed: list[Target] = field(default_factory=list)
    invented: list[FoundMode] = field(default_factory=list)
    seconds: float = float("nan")


@dataclass(frozen=True, eq=False)
class OrderTruth:
    """The pair of an order and how it is driven, in a state off that of the first run."""

    tyre: RandomTyre
    order: int
    drift: float

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles of both members over 2π, in Hz."""
        return (1 + self.drift) * np.array([_pole(mode) for mode in self.tyre.pair(self.order)])

    @property
    def share(self) -> NDArray[np.float64]:
        """Share of each member in the order's response power, for a force at 0°."""
        shapes = [mode.shape(np.zeros(1))[0] for mode in self.tyre.pair(self.order)]
        return np.square(shapes)

    @property
    def window_hz(self) -> tuple[float, float]:
        """Frequencies at which a found mode belongs to this order; those of orders do not meet."""
        low, high = np.abs(self.poles)
        return float(low * (1 - REACH)), float(high * (1 + REACH))

    @property
    def split(self) -> float:
        """Distance of the members over damping ratio times frequency."""
        low, high = self.poles
        return float((np.abs(high) - np.abs(low)) / -low.real)

    @property
    def members(self) -> list[Target]:
        """Both members, each a mode of its own."""
        return [_target(self.order, "member", pole) for pole in self.poles]

    @property
    def targets(self) -> list[Target]:
        """What has to be found."""
        if self.share.min() < DRIVEN_SHARE:
            return [_target(self.order, "single", self.poles[np.argmax(self.share)])]
        if self.split >= RESOLVABLE_SPLIT:
            return self.members
        return [_target(self.order, "unresolved", self.share @ self.poles)]


def true_frequencies_hz(tyre: RandomTyre, drift: float) -> list[float]:
    """Frequencies of everything that has to be found."""
    orders = [OrderTruth(tyre, order, drift) for order in ORDERS]
    return [target.frequency_hz for truth in orders for target in truth.targets]


def score(tyre: RandomTyre, found: list[FoundMode], seconds: float, drift: float = 0.0) -> Score:
    """Compare what was found up to half way between orders 7 and 8 with what had to be found.

    An order takes the modes in its window. Two modes in it are compared with the two members,
    whether or not both had to be found; too few are missed; a third is invented, as is every mode
    outside the windows.
    """
    end_hz = (tyre.pair(ORDERS[-1])[1].frequency_hz + tyre.pair(ORDERS[-1] + 1)[0].frequency_hz) / 2
    left = [mode for mode in found if mode.frequency_hz < end_hz]
    matches, missed = [], []
    for order in ORDERS:
        truth = OrderTruth(tyre, order, drift)
        low, high = truth.window_hz
        inside = [mode for mode in left if low <= mode.frequency_hz <= high]
        targets = truth.targets if len(inside) < 2 else truth.members
        pairs = _assigned(targets, inside)
        matches += pairs
        missed += [target for target in targets if target not in [m.target for m in pairs]]
        left = [mode for mode in left if mode not in [m.found for m in pairs]]
    return Score(matches, missed, left, seconds)


def _assigned(targets: list[Target], found: list[FoundMode]) -> list[Match]:
    """Each target with one mode, closest together in all."""
    if not found:
        return []
    wanted_hz = np.array([target.frequency_hz for target in targets])
    distance = np.abs(wanted_hz[:, None] - [mode.frequency_hz for mode in found])
    rows, columns = linear_sum_assignment(distance)
    return [Match(targets[t], found[f]) for t, f in zip(rows, columns, strict=True)]


def _pole(mode: TruthMode) -> complex:
    ratio = mode.damping_ratio
    return complex(mode.frequency_hz * (-ratio + 1j * np.sqrt(1 - ratio**2)))


def _target(order: int, kind: str, pole: complex) -> Target:
    size = float(np.abs(pole))
    return Target(order, kind, size, float(-np.real(pole) / size))
