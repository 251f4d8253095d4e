"""Modes of two results side by side: matched, with their differences, and those without partner."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.family import FOREIGN
from ema.modes import ModalModel, Mode
from pipelines.comparison_match import Matches
from pipelines.comparison_pairs import Side
from pipelines.comparison_significance import Difference, judged

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
    is_named = mode.order is not None and FOREIGN not in mode.status
    return f"n = {mode.order}{mode.member}" if is_named else f"mode {number}"


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
