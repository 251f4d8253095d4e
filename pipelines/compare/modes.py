"""Modes of two results side by side: matched, with their differences, and those without partner."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference.ring_modes import family
from ema.core.modes import ModalModel, Mode
from pipelines.compare.significance import Difference, judged

#: Shapes of a matched mode less alike than this need an explanation.
LOWEST_MAC = 0.9


@dataclass(frozen=True, eq=False)
class MatchedMode:
    """A mode that both results have.

    Parameters
    ----------
    first_number, second_number : int
        Numbers in ``modes.csv``, from 1.
    first, second : Mode
    mac : float
        Likeness of the shapes; NaN where they cannot be compared.
    frequency : Difference
        In Hz.
    damping : Difference
        Of the damping ratio, a fraction.
    averaged : (bool, bool)
        Whether the mode of the first, of the second stands for a pair of which the other result
        shows one mode.
    remark : str
        What a reader of the differences must know; empty where there is nothing.
    """

    first_number: int
    second_number: int
    first: Mode
    second: Mode
    mac: float
    frequency: Difference
    damping: Difference
    averaged: tuple[bool, bool] = (False, False)
    remark: str = ""

    @property
    def name(self) -> str:
        """Name of the mode in the first result, without a member that the second has not."""
        alike = self.first.member == self.second.member
        return mode_name(self.first_number, self.first if alike else replace(self.first, member=""))


@dataclass(frozen=True, eq=False)
class UnmatchedMode:
    """A mode that only one result has.

    Parameters
    ----------
    number : int
        In ``modes.csv``, from 1.
    mode : Mode
    reason : str
        Why the other may lack it.
    """

    number: int
    mode: Mode
    reason: str

    @property
    def name(self) -> str:
        """Order and member, or the number."""
        return mode_name(self.number, self.mode)


def mode_name(number: int, mode: Mode) -> str:
    """Order and member of a mode, ``"n = 4a"``, or else its number, ``"mode 3"``."""
    return f"n = {mode.order}{mode.member}" if mode.is_ring_mode else f"mode {number}"


def matched_modes(
    first: Side, second: Side, matches: Matches, mac: NDArray[np.float64]
) -> tuple[MatchedMode, ...]:
    """Matched modes with their differences; those of frequency and damping are tested together.

    Parameters
    ----------
    first, second : Side
    matches : list of (int, int)
        From `match_modes`.
    mac : ndarray, shape (n_first, n_second)
    """
    same_band = first.model.band_hz == second.model.band_hz
    rows = [_matched(first, second, i, j, float(mac[i, j]), same_band) for i, j in matches]
    tested = judged([row.frequency for row in rows] + [row.damping for row in rows])
    half = len(rows)
    return tuple(
        replace(row, frequency=frequency, damping=damping)
        for row, frequency, damping in zip(rows, tested[:half], tested[half:], strict=True)
    )


def std_of_difference(
    stds: tuple[float, float], band_shifts: tuple[float, float], *, same_band: bool
) -> float:
    """Honest standard deviation of a difference between two measurements of one lab.

    Noise is independent between recordings: its variances add. What the ends of the band do to a
    mode (its band shift) is no noise: in the same band it is the same twice and drops out but for
    what differs; in two different bands both shifts count in full.

    What is common to both measurements (calibration of sensors and shaker, the analyser's clock,
    the fixture) drops out of a difference as well; how much of it is not known and nothing is
    subtracted for it. What differs between two set-ups although nothing was meant to (pressure as
    set, temperature, mounting, warm-up) is in no recording's noise and not in this number either:
    only repeated measurements show it.

    Parameters
    ----------
    stds : (float, float)
        Standard deviations of both; NaN where unknown.
    band_shifts : (float, float)
        Band shifts of both; NaN counts as none.
    same_band : bool

    Returns
    -------
    float
        NaN where one of the standard deviations is unknown.
    """
    first, second = (0.0 if math.isnan(shift) else shift for shift in band_shifts)
    systematic = abs(first - second) if same_band else math.hypot(first, second)
    return math.hypot(*stds, systematic)


def unmatched_modes(
    own: Side, other: Side, matched: Mapping[int, int]
) -> tuple[UnmatchedMode, ...]:
    """Modes of `own` without a partner.

    Parameters
    ----------
    own, other : Side
    matched : mapping of int to int
        Indices of the modes of `own` that have a partner, and of the partner in `other`.
    """
    known_hz = own.model.frequencies_hz[list(matched)]
    factors = other.model.frequencies_hz[list(matched.values())] / known_hz

    def factor(mode: Mode) -> float:
        """How far the nearest matched mode moved."""
        nearest = np.abs(known_hz - mode.frequency_hz)
        return float(factors[np.argmin(nearest)]) if nearest.size else 1.0

    return tuple(
        UnmatchedMode(own.numbers[k], mode, _why_missing(mode, other.model, factor(mode)))
        for k, mode in enumerate(own.model.modes)
        if k not in matched
    )


def _matched(first: Side, second: Side, i: int, j: int, mac: float, same_band: bool) -> MatchedMode:
    one, two = first.model.modes[i], second.model.modes[j]
    frequency_std_hz = std_of_difference(
        (one.frequency_std_hz, two.frequency_std_hz),
        (one.frequency_band_shift_hz, two.frequency_band_shift_hz),
        same_band=same_band,
    )
    damping_std = std_of_difference(
        (one.damping_std, two.damping_std),
        (one.damping_band_shift, two.damping_band_shift),
        same_band=same_band,
    )
    averaged = i in first.averaged, j in second.averaged
    return MatchedMode(
        first.numbers[i],
        second.numbers[j],
        one,
        two,
        mac,
        Difference(one.frequency_hz, two.frequency_hz, frequency_std_hz),
        Difference(one.damping_ratio, two.damping_ratio, damping_std),
        averaged,
        _remark(one, two, mac, averaged),
    )


def _remark(first: Mode, second: Mode, mac: float, averaged: tuple[bool, bool]) -> str:
    remarks = []
    if any(averaged):
        where = "first" if averaged[0] else "second"
        remarks.append(f"resolved as a pair in the {where} result only: its mean is compared")
    elif first.member != second.member:
        remarks.append(f"matched by shape: member {first.member} became {second.member}")
    statuses = {mode.status: word for word, mode in (("second", second), ("first", first))}
    for status, word in statuses.items() if first.doubtful or second.doubtful else ():
        remarks.append(status if len(statuses) == 1 else f"{word}: {status}")
    if mac < LOWEST_MAC:
        remarks.append("the shapes differ")
    return "; ".join(remarks)


def _why_missing(mode: Mode, other: ModalModel, factor: float) -> str:
    low, high = other.band_hz
    expected_hz = factor * mode.frequency_hz
    if not low <= mode.frequency_hz <= high:
        return f"outside the other's band, {low:g} to {high:g} Hz"
    if not low <= expected_hz <= high:
        return (
            f"would be near {expected_hz:.4g} Hz, outside the band of {low:g} to {high:g} Hz, if "
            "it moved like its neighbour"
        )
    if mode.doubtful:
        return mode.status
    if mode.member:
        return "the other shows one mode of this order"
    return "not found in the other"


#: What is not of the ring's family is the same mode only with a shape as alike as this …
ALIKE = 0.6
#: … and a frequency within this factor's logarithm.
REACH = 0.2
#: A MAC that is larger by this tells one member of a pair from the other.
CLEARLY = 0.3

Matches = list[tuple[int, int]]


def match_modes(first: Sequence[Mode], second: Sequence[Mode], mac: NDArray[np.float64]) -> Matches:
    """Pair the modes of two results.

    The ring's own modes go by their order and the members of a resolved pair by their shapes,
    however far a pressure or a load has moved them. All others (cavity, wheel, rig, structures
    without a circle) go by shape and frequency together, the most alike first.

    Parameters
    ----------
    first, second : sequence of Mode
    mac : ndarray, shape (n_first, n_second)
        NaN where shapes cannot be compared; frequencies decide then.

    Returns
    -------
    list of (int, int)
        Indices into `first` and `second`, ascending in the first; each index at most once.
    """
    members_first, members_second = family(first), family(second)
    found: Matches = []
    for order in members_first.keys() & members_second.keys():
        # Ascending in frequency: member a comes first.
        here, there = sorted(members_first[order]), sorted(members_second[order])
        found += _best_pairing(here, there, first, second, mac)
    found += _by_likeness(first, second, mac, found)
    return sorted(found)


def _best_pairing(
    here: Sequence[int],
    there: Sequence[int],
    first: Sequence[Mode],
    second: Sequence[Mode],
    mac: NDArray[np.float64],
) -> Matches:
    """Pair one or two modes of an order with one or two: by shape where that is clear.

    A tyre that sits turned on its rim shows shapes between those of both members; then the
    frequencies decide.
    """
    if len(here) == len(there) == 2:
        ways = [list(zip(here, order, strict=True)) for order in (there, list(reversed(there)))]
    else:
        ways = [[(i, j)] for i in here for j in there]
    alike = [float(np.mean([mac[pair] for pair in way])) for way in ways]
    if max(alike) - min(alike) > CLEARLY:
        return ways[int(np.argmax(alike))]
    return min(ways, key=lambda way: sum(_apart(first[i], second[j]) for i, j in way))


def _by_likeness(
    first: Sequence[Mode], second: Sequence[Mode], mac: NDArray[np.float64], found: Matches
) -> Matches:
    """Pair what is left over, the most alike first."""
    left = set(range(len(first))) - {i for i, _ in found}
    right = set(range(len(second))) - {j for _, j in found}
    candidates = [
        (likeness, i, j)
        for i in left
        for j in right
        if (likeness := _likeness(first[i], second[j], float(mac[i, j]))) > 0
    ]
    matches: Matches = []
    for _, i, j in sorted(candidates, key=lambda each: (-each[0], each[1:])):
        if i in left and j in right:
            matches.append((i, j))
            left.remove(i)
            right.remove(j)
    return matches


def _likeness(first: Mode, second: Mode, mac: float) -> float:
    """Between 0, surely another mode, and 1."""
    orders = {first.order, second.order} - {None}
    apart = _apart(first, second)
    if len(orders) > 1 or apart > REACH or mac < ALIKE:
        return 0.0
    return (1.0 if math.isnan(mac) else mac) * (1 - apart / REACH)


def _apart(first: Mode, second: Mode) -> float:
    return abs(math.log(second.frequency_hz / first.frequency_hz))


@dataclass(frozen=True, eq=False)
class Side:
    """The modes of one result as the other can be compared with them.

    Parameters
    ----------
    model : ModalModel
        With one mode in place of each pair that the other result sees as one.
    numbers : tuple of int
        Number in ``modes.csv`` of each mode, that of member a for a pair; from 1.
    averaged : frozenset of int
        Indices of the modes that stand for a pair.
    """

    model: ModalModel
    numbers: tuple[int, ...]
    averaged: frozenset[int]


def seen_by(own: ModalModel, other: ModalModel) -> Side:
    """Take the mean of each pair of `own` of which `other` shows one mode.

    One mode in place of two lies at their mean, weighted by how strongly each was driven, and has
    the sum of their shapes; to compare it with either member would show a change where there is
    none.

    Parameters
    ----------
    own, other : ModalModel
    """
    mine, theirs = family(own.modes), family(other.modes)
    pairs = [
        sorted(members)
        for order, members in mine.items()
        if len(members) == 2 and len(theirs.get(order, ())) == 1
    ]
    dropped = {later for _, later in pairs}
    kept = [k for k in range(len(own.modes)) if k not in dropped]
    means = {first: _mean(own.modes[first], own.modes[later]) for first, later in pairs}
    modes = tuple(means.get(k, own.modes[k]) for k in kept)
    rows = np.ravel([[2 * k, 2 * k + 1] for k in kept]).astype(int)
    model = replace(own, modes=modes, covariance=own.covariance[np.ix_(rows, rows)])
    averaged = frozenset(place for place, k in enumerate(kept) if k in means)
    return Side(model, tuple(k + 1 for k in kept), averaged)


def _mean(first: Mode, second: Mode) -> Mode:
    share = np.array([np.linalg.norm(mode.residues) ** 2 for mode in (first, second)])
    one, two = share / share.sum()
    omega = one * abs(first.pole) + two * abs(second.pole)
    ratio = one * first.damping_ratio + two * second.damping_ratio
    return replace(
        first,
        pole=omega * complex(-ratio, math.sqrt(1 - ratio**2)),
        frequency_std_hz=math.hypot(one * first.frequency_std_hz, two * second.frequency_std_hz),
        damping_std=math.hypot(one * first.damping_std, two * second.damping_std),
        residues=first.residues + second.residues,
        residues_std=np.hypot(first.residues_std, second.residues_std),
        member="",
        frequency_band_shift_hz=max(first.frequency_band_shift_hz, second.frequency_band_shift_hz),
        damping_band_shift=max(first.damping_band_shift, second.damping_band_shift),
    )
