"""Selection of the ring modes: one frequency per order, along the dispersion curve."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np

from ema.circumference.orders import PAIR_REACH
from ema.core.modes import Flag, Mode, OrderReport, Pair

# A shape with less of its power in one order is not one of the ring's.
PURE = 0.5
# The members of a pair are damped alike within this factor.
_PAIR_DAMPING = 1.8
# A neighbour on the curve that is damped this many times less (or more) is no tyre mode.
_ODD_DAMPING = 3.0


def family(modes: Sequence[Mode]) -> dict[int, list[int]]:
    """Modes of the ring by order n ≥ 1: index of the main mode, then of its partner if any.

    Among all ways to take one mode per order with frequencies that rise with the order, the one
    that the force drives most. |A|ω is the inverse of the modal mass, which is nearly the same for
    all orders of a ring and much larger for what the ring only shakes along with.
    """
    candidates = [k for k, mode in enumerate(modes) if mode.order and mode.order_purity >= PURE]
    main = _strongest_rising(modes, candidates)
    members: dict[int, list[int]] = {}
    for k in main:
        partners = [p for p in candidates if p not in main and _paired(modes[k], modes[p])]
        partners.sort(key=lambda p: -drive(modes[p]))
        members[modes[k].order or 0] = [k, *partners[:1]]
    return members


def further_resonances(modes: Sequence[Mode], own: Container[int]) -> list[tuple[int, list[int]]]:
    """Resonances of some order n ≥ 1 beside the ring's `own`: order, main mode, partner.

    A rim that moves, a sidewall or the air give orders of the ring a second resonance.
    """
    left = [k for k, m in enumerate(modes) if k not in own and m.order and m.order_purity >= PURE]
    left.sort(key=lambda k: -drive(modes[k]))
    found = []
    while left:
        main = left.pop(0)
        partners = [p for p in left if _paired(modes[main], modes[p])][:1]
        left = [k for k in left if k not in partners]
        found.append((modes[main].order or 0, [main, *partners]))
    return found


def judged(modes: Sequence[Mode], reports: Sequence[OrderReport]) -> tuple[Mode, ...]:
    """Flag modes that are not of the ring and give members of resolved pairs their letter."""
    if not reports:
        return tuple(modes)
    verdicts = {report.order: report.pair.verdict for report in reports}
    # One row holds a pair that was looked into and not resolved; a second one is none of it.
    members = {
        order: chosen if verdicts.get(order, Pair.RESOLVED) is Pair.RESOLVED else chosen[:1]
        for order, chosen in family(modes).items()
    }
    own = [k for chosen in members.values() for k in chosen]
    named = list(modes)
    for order, chosen in members.items():
        pair = verdicts.get(order, Pair.NOT_SEPARABLE)
        letters = "ab" if pair is Pair.RESOLVED and len(chosen) > 1 else ("", "")
        for k, letter in zip(sorted(chosen), letters, strict=False):
            named[k] = replace(modes[k], member=letter, pair=pair)
    for k in set(range(len(modes))) - set(own):
        flag, remark = why_not_ring_mode(modes[k], [modes[o] for o in own])
        named[k] = replace(modes[k], flags=(flag, *modes[k].flags), remark=remark)
    return tuple(named)


def why_not_ring_mode(mode: Mode, own: Sequence[Mode]) -> tuple[Flag, str]:
    """Flag of a mode that is none of the ring's `own`, and the reason."""
    if mode.order is None:
        remark = f"{mode.residues.size} positions cannot separate it from lower orders"
        return Flag.ORDER_UNKNOWN, remark
    return Flag.NOT_RING_MODE, why_foreign(mode, own)


def why_foreign(mode: Mode, own: Sequence[Mode]) -> str:
    """Say why a mode is not one of the ring's `own`."""
    if mode.order_purity < PURE:
        return f"its shape is no single order (purity {mode.order_purity:.2f})"
    if mode.order == 0:
        return "order 0 is not on the ring's dispersion curve"
    reasons = [f"order {mode.order} of the ring is elsewhere on the dispersion curve"]
    near = min(own, key=lambda other: abs(other.frequency_hz - mode.frequency_hz), default=None)
    if near is not None and mode.damping_ratio * _ODD_DAMPING < near.damping_ratio:
        reasons.append(
            f"damping {near.damping_ratio / mode.damping_ratio:.1f} times lower than that of "
            "its neighbour"
        )
    return ", ".join(reasons)


def drive(mode: Mode) -> float:
    """How strongly the force drives a mode: RMS |A|ω over the positions."""
    return float(np.sqrt(np.mean(np.abs(mode.residues) ** 2)) * abs(mode.pole))


def _strongest_rising(modes: Sequence[Mode], candidates: Sequence[int]) -> list[int]:
    """Indices of the chain of rising order and frequency with the largest total drive."""
    ordered = sorted(candidates, key=lambda k: (modes[k].order or 0, modes[k].frequency_hz))
    best: dict[int, tuple[float, list[int]]] = {}
    for k in ordered:
        before: tuple[float, list[int]] = (0.0, [])
        for earlier in best:
            rises = modes[earlier].frequency_hz < modes[k].frequency_hz
            if (modes[earlier].order or 0) < (modes[k].order or 0) and rises:
                before = max(before, best[earlier], key=lambda chain: chain[0])
        weight = drive(modes[k]) * modes[k].order_purity
        best[k] = (before[0] + weight, [*before[1], k])
    return max(best.values(), key=lambda chain: chain[0])[1] if best else []


def _paired(main: Mode, other: Mode) -> bool:
    ratio = other.damping_ratio / main.damping_ratio
    return (
        main.order == other.order
        and abs(other.frequency_hz / main.frequency_hz - 1) < PAIR_REACH
        and 1 / _PAIR_DAMPING < ratio < _PAIR_DAMPING
    )
