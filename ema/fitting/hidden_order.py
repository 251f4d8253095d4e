"""An order whose resonance lies beneath that of another one, as order 1 of a rim that moves.

A pole that is free at all positions follows what the stronger order's pole leaves of its pair, not
the weaker order. The weaker order's own FRFs show it: nothing else of that size is in them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ema.circumference.orders import family, order_basis, order_content
from ema.core.modes import Mode
from ema.fitting.mode_pairs import PairSearch
from ema.fitting.pair import PairFit
from ema.fitting.variable_projection import Real

# A ring mode of less purity may hide one of another order, damped this much more.
_IMPURE, _BROADER = 0.985, 1.8
# The other order has this many times the power of any third one: errors of sensors spread.
_CLEARLY = 4.0
# A pole of its own lies this far from that of the order above it, half-widths and 1 σ, …
_APART, _APART_STD = 0.2, 4.0
# … and leaves at most this share of the impurity.
_LEFT = 0.7
# Fits of the order's own FRFs and of the rest, beside each other; two were enough.
_ROUNDS = 4


def suspects(
    modes: Sequence[Mode], position_deg: Real, band_hz: tuple[float, float]
) -> Iterator[tuple[Mode, int]]:
    """Ring modes in the band that may hide another order, and which one."""
    low, high = band_hz
    for found in family(modes).values():
        mode = modes[found[0]]
        if mode.order_purity < _IMPURE and low <= mode.frequency_hz <= high:
            power = order_content(mode.residues, position_deg).power
            power[[0, mode.order or 0]] = 0.0
            second, third = np.argsort(power)[[-1, -2]].tolist()
            if power[second] > _CLEARLY * power[third]:
                yield mode, second


def beneath(mode: Mode) -> complex:
    """Where the search for a pole beneath that of a mode starts."""
    size, ratio = abs(mode.pole), min(_BROADER * mode.damping_ratio, 0.9)
    return complex(size * (-ratio + 1j * np.sqrt(1 - ratio**2)))


def of_its_order(mode: Mode, order: int, position_deg: Real) -> Mode:
    """The mode with what its shape has of one order, and nothing else of it.

    The rest is what the pole above leaves there.
    """
    content = order_content(mode.residues, position_deg)
    own = order_basis(position_deg, order) @ [content.cosine[order], content.sine[order]]
    return replace(mode, residues=own, order=order, order_purity=1.0)


def pairs_beneath(
    mode: Mode, order: int, beside: Callable[[complex], PairSearch]
) -> tuple[PairFit, PairFit] | None:
    """The pair that an order's own FRFs show beneath a mode, and that of the mode's order.

    `beside` fits all other poles beside one of that order, the first of all, and gives the search
    for pairs on that fit. None where the FRFs show none.
    """
    pole, pair = beneath(mode), None
    for _ in range(_ROUNDS):
        search = beside(pole)
        pair = _pair_of(search, order, [0])
        if pair is None:
            return None
        pole = pair.mean
    above = [_pair_of(search, n, found) for n, found in search.main if n == mode.order]
    return (pair, above[0]) if pair and above and above[0] else None


def _pair_of(search: PairSearch, order: int, found: list[int]) -> PairFit | None:
    if found[0] not in search.directions:
        return None
    return search.fitted(order, found, search.seen_of(order, found)).pair


def is_another(before: Mode, others: Sequence[Mode], pairs: tuple[PairFit, PairFit]) -> bool:
    """Whether an order has a pair of its own beneath a mode, which is one of `others` with it.

    What sensors or an uneven tyre mix of the mode into the order has the poles of the mode's pair.
    """
    above = min(others, key=lambda mode: abs(mode.pole - before.pole))
    pair, (hz_std, ratio_std) = pairs[0], np.sqrt(np.diag(pairs[0].covariance)[4:])
    pole, mixed = pair.mean, np.array([above.pole, pairs[1].mean, *pairs[1].poles])
    apart = float(np.min(np.abs(pole - mixed)))
    known = np.hypot(2 * np.pi * hz_std, abs(pole) * ratio_std)
    return bool(
        before.order == above.order
        and 1 - above.order_purity < _LEFT * (1 - before.order_purity)
        and apart > -_APART * above.pole.real
        and apart > _APART_STD * known
    )


def note_of(mode: Mode, order: int, pair: PairFit) -> str:
    """What was found, for the notes of the result."""
    return (
        f"Order {order} has a resonance at {abs(pair.mean) / (2 * np.pi):.1f} Hz beneath that of "
        f"order {mode.order}: its pole is taken from the FRFs of order {order} alone."
    )
