"""Pairs that one result resolves and the other sees as one mode: what of them can be compared."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ema.family import family
from ema.modes import ModalModel, Mode


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
