"""Which mode of one result is which of the other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ema.family import family
from ema.modes import Mode

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
