"""Modes of two results: which belong together, how they differ, and which have no partner."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import family
from ema.core.modes import ModalModel, Mode
from pipelines.compare.significance import Difference, jointly_tested

#: MAC below which the shapes of matched modes are reported as different (customary limit).
LOWEST_MAC = 0.9
#: Lowest MAC of two modes, not both ring modes, that may be the same mode.
LEAST_MAC = 0.6
#: Largest |ln(f2/f1)| of such modes, a change by 22 %.
LARGEST_LOG_RATIO = 0.2
#: Largest |ln(f2/f1)| of modes whose shapes or orders differ that are still the same resonance.
SAME_FREQUENCY = 5e-4
#: Difference of MAC from which shapes decide which member of a pair is which.
CLEAR_MAC_STEP = 0.3

Matches = list[tuple[int, int]]


@dataclass(frozen=True, eq=False)
class MatchedMode:
    """A mode that both results have."""

    # numbers in ``modes.csv``, from 1
    first_number: int
    second_number: int
    first: Mode
    second: Mode
    mac: float  # MAC of the shapes; NaN where they cannot be compared
    # in Hz, and of the damping ratio (a fraction)
    frequency: Difference
    damping: Difference
    # whether the mode of the first, of the second is the mean of a pair of which the other result
    # has one mode
    averaged: tuple[bool, bool] = (False, False)
    remark: str = ""  # a caveat; may be empty

    @property
    def name(self) -> str:
        """Name in the first result, without a member letter that differs in the second."""
        alike = self.first.member == self.second.member
        return mode_name(self.first_number, self.first if alike else replace(self.first, member=""))


@dataclass(frozen=True, eq=False)
class UnmatchedMode:
    """A mode that only one result has: its number in ``modes.csv`` and a possible reason."""

    number: int
    mode: Mode
    reason: str

    @property
    def name(self) -> str:
        """Order and member, or the number."""
        return mode_name(self.number, self.mode)


def mode_name(number: int, mode: Mode) -> str:
    """Order and member of a ring mode, ``"n = 4a"``, else the number, ``"mode 3"``."""
    return f"n = {mode.order}{mode.member}" if mode.is_ring_mode else f"mode {number}"


def matched_modes(
    first: Side, second: Side, matches: Matches, mac: NDArray[np.float64]
) -> tuple[MatchedMode, ...]:
    """Matched modes with their differences; frequencies and damping are tested together."""
    rows = [_matched(first, second, i, j, float(mac[i, j])) for i, j in matches]
    tested = jointly_tested([row.frequency for row in rows] + [row.damping for row in rows])
    half = len(rows)
    return tuple(
        replace(row, frequency=frequency, damping=damping)
        for row, frequency, damping in zip(rows, tested[:half], tested[half:], strict=True)
    )


def std_of_difference(
    stds: tuple[float, float], band_shifts: tuple[float, float], *, same_band: bool
) -> float:
    """Standard deviation of a difference between two measurements in one laboratory.

    Noise of different recordings is independent: variances add. The shift of a mode by the ends of
    the band is systematic: in the same band it is nearly the same twice, and only the difference
    counts; in two different bands both shifts count in full. NaN counts as no shift.

    Errors common to both measurements (calibration, the analyser's clock, the fixture) drop out of
    a difference; their size is unknown, and nothing is subtracted for them. Unintended differences
    between two set-ups (pressure as set, temperature, mounting, warm-up) are not included: only
    repeated measurements show them.
    """
    first, second = (0.0 if math.isnan(shift) else shift for shift in band_shifts)
    systematic = abs(first - second) if same_band else math.hypot(first, second)
    return math.hypot(*stds, systematic)


def unmatched_modes(
    own: Side, other: Side, matched: Mapping[int, int]
) -> tuple[UnmatchedMode, ...]:
    """Modes of `own` that have no partner among the keys of `matched`."""
    known_hz = own.model.frequencies_hz[list(matched)]
    factors = other.model.frequencies_hz[list(matched.values())] / known_hz

    def shift_nearby(mode: Mode) -> float:
        """Frequency ratio of the nearest matched mode."""
        distance = np.abs(known_hz - mode.frequency_hz)
        return float(factors[np.argmin(distance)]) if distance.size else 1.0

    return tuple(
        UnmatchedMode(own.numbers[k], mode, _why_missing(mode, other.model, shift_nearby(mode)))
        for k, mode in enumerate(own.model.modes)
        if k not in matched
    )


def _matched(first: Side, second: Side, i: int, j: int, mac: float) -> MatchedMode:
    one, two = first.model.modes[i], second.model.modes[j]
    same_band = first.model.band_hz == second.model.band_hz

    def difference(name: str, std: str, shift: str) -> Difference:
        values, stds, shifts = ((getattr(one, of), getattr(two, of)) for of in (name, std, shift))
        return Difference(*values, std_of_difference(stds, shifts, same_band=same_band))

    averaged = i in first.averaged, j in second.averaged
    numbers, remark = (first.numbers[i], second.numbers[j]), _remark(one, two, mac, averaged)
    frequency = difference("frequency_hz", "frequency_std_hz", "frequency_band_shift_hz")
    damping = difference("damping_ratio", "damping_std", "damping_band_shift")
    return MatchedMode(*numbers, one, two, mac, frequency, damping, averaged, remark)


def _remark(first: Mode, second: Mode, mac: float, averaged: tuple[bool, bool]) -> str:
    remarks = []
    if any(averaged):
        where = "first" if averaged[0] else "second"
        remarks.append(f"resolved as a pair in the {where} result only: its mean is compared")
    elif first.member != second.member:
        remarks.append(f"matched by shape: member {first.member} became {second.member}")
    if first.doubtful or second.doubtful:
        same = first.flags == second.flags
        both = f"first: {first.status}", f"second: {second.status}"
        remarks += [first.status] if same else both
    if first.order != second.order:
        orders = ("unknown" if each.order is None else each.order for each in (first, second))
        remarks.append("matched by frequency: order {}, then {}".format(*orders))
    if mac < LOWEST_MAC:
        remarks.append("the shapes differ")
    return "; ".join(remarks)


def _why_missing(mode: Mode, other: ModalModel, factor: float) -> str:
    low, high = other.band_hz
    expected_hz = factor * mode.frequency_hz
    if not low <= mode.frequency_hz <= high:
        return f"outside the other's band, {low:g} to {high:g} Hz"
    if not low <= expected_hz <= high:
        return f"expected near {expected_hz:.4g} Hz, outside the band of {low:g} to {high:g} Hz"
    if mode.doubtful:
        return mode.status
    if mode.member:
        return "the other has one mode of this order"
    return "not found in the other"


def match_modes(first: Sequence[Mode], second: Sequence[Mode], mac: NDArray[np.float64]) -> Matches:
    """Pair the modes of two results.

    Ring modes are paired by order and members of a resolved pair by shape, however far a pressure
    or a load has moved them. All others (cavity, wheel, rig, structures without a circle) are
    paired by shape and frequency, the most similar first, and what is then left by equal frequency.

    Where the MAC, shape (n_first, n_second), is NaN, frequencies decide. Indices are ascending in
    the first; each occurs at most once.
    """
    apart = np.abs(
        [[math.log(b.frequency_hz / a.frequency_hz) for b in second] for a in first]
    ).reshape(mac.shape)
    members_first, members_second = family(first), family(second)
    found: Matches = []
    for order in members_first.keys() & members_second.keys():
        # Ascending in frequency: member a comes first.
        found += _best_pairing(
            sorted(members_first[order]), sorted(members_second[order]), mac, apart
        )
    likeness = np.where(np.isnan(mac), 1.0, mac) * (1 - apart / LARGEST_LOG_RATIO)
    left = set(range(len(first))) - {i for i, _ in found}
    right = set(range(len(second))) - {j for _, j in found}
    candidates = [
        (i, j)
        for i in left
        for j in right
        if not (apart[i, j] >= LARGEST_LOG_RATIO or mac[i, j] < LEAST_MAC)
        and len({first[i].order, second[j].order} - {None}) <= 1
    ]
    for i, j in sorted(candidates, key=lambda pair: (-likeness[pair], pair)):
        if i in left and j in right:
            found.append((i, j))
            left.remove(i)
            right.remove(j)
    # What is left and has the same frequency is the same resonance, however its shape was seen.
    for i in sorted(left):
        near = min(right, key=lambda j: apart[i, j], default=None)
        if near is not None and apart[i, near] < SAME_FREQUENCY:
            found.append((i, near))
            right.remove(near)
    return sorted(found)


def _best_pairing(
    here: list[int], there: list[int], mac: NDArray[np.float64], apart: NDArray[np.float64]
) -> Matches:
    """Pair one or two modes of an order with one or two, by shape where that is clear.

    The shapes of a tyre that was turned on its rim lie between those of both members; then the
    frequencies decide.
    """
    if len(here) == len(there) == 2:
        ways = [list(zip(here, order, strict=True)) for order in (there, there[::-1])]
    else:
        ways = [[(i, j)] for i in here for j in there]
    alike = [float(np.mean([mac[pair] for pair in way])) for way in ways]
    if max(alike) - min(alike) > CLEAR_MAC_STEP:
        return ways[int(np.argmax(alike))]
    return min(ways, key=lambda way: sum(apart[pair] for pair in way))


@dataclass(frozen=True, eq=False)
class Side:
    """The modes of one result as they are compared with those of the other."""

    model: ModalModel  # with one mode in place of each pair of which the other result has one mode
    # number of each mode in ``modes.csv``, from 1; of a pair that of member a
    numbers: tuple[int, ...]
    averaged: frozenset[int]  # indices of the modes that replace a pair


def seen_by(own: ModalModel, other: ModalModel) -> Side:
    """Average each pair of `own` of which `other` has only one mode.

    An unresolved pair is identified near the mean of its members, weighted by how strongly each is
    driven, with the sum of their shapes; compared with one member it would seem to have changed.
    """
    theirs = family(other.modes)
    pairs = [
        sorted(members)
        for order, members in family(own.modes).items()
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
