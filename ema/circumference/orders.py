"""Circumferential orders of shapes on a ring, and how its belt moves along the circumference."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ema.core.modes import Flag, Mode, OrderReport, Pair

# Condition number of the least-squares problem above which orders get mixed up.
_WELL_CONDITIONED = 10.0
# A shape with this share of its power in one order is surely of that order, or of an alias.
_CLEAR = 0.9
# Beyond a third of the circle without sensors, waves of different orders look alike.
_WIDEST_GAP_DEG = 120.0
# The members of a pair lie within this share of their frequency.
PAIR_REACH = 0.06
# A shape with less of its power in one order is not one of the ring's.
PURE = 0.5
# The members of a pair are damped alike within this factor.
_PAIR_DAMPING = 1.8
# A neighbour on the curve that is damped this many times less (or more) is no tyre mode.
_ODD_DAMPING = 3.0


@dataclass(frozen=True, eq=False)
class OrderContent:
    """A shape as a sum of cos nθ and sin nθ: amplitudes of orders 0, 1, 2 …, (n_orders,)."""

    cosine: NDArray[np.complex128]
    sine: NDArray[np.complex128]

    @property
    def power(self) -> NDArray[np.float64]:
        """Mean square over the circle that each order carries."""
        power = (np.abs(self.cosine) ** 2 + np.abs(self.sine) ** 2) / 2
        power[0] = np.abs(self.cosine[0]) ** 2
        return np.asarray(power)

    @property
    def order(self) -> int:
        """Order that carries most."""
        return int(np.argmax(self.power))

    @property
    def purity(self) -> float:
        """Share of the power in that order; NaN for a shape that is zero."""
        total = float(self.power.sum())
        return float(self.power.max()) / total if total > 0 else float("nan")


def order_content(shape: NDArray[np.complex128], position_deg: NDArray[np.float64]) -> OrderContent:
    """Resolve a shape, (n_positions,), into circumferential orders.

    Least squares; on complete equidistant positions this is the spatial Fourier transform.
    """
    amplitude = _resolving(tuple(float(angle) for angle in position_deg)) @ shape
    cosine = np.concatenate([amplitude[:1], amplitude[1::2]])
    sine = np.concatenate([[0], amplitude[2::2]])
    return OrderContent(cosine, sine)


@cache
def _highest_order(position_deg: tuple[float, ...]) -> int:
    angles = np.array(position_deg)
    for highest in range((angles.size - 1) // 2, 0, -1):
        if np.linalg.cond(circle_basis(angles, highest)) < _WELL_CONDITIONED:
            return highest
    return 0


@cache
def _resolving(position_deg: tuple[float, ...]) -> NDArray[np.float64]:
    """Matrix that takes a shape to its orders."""
    basis = circle_basis(np.array(position_deg), _highest_order(position_deg))
    return np.asarray(np.linalg.pinv(basis))


def highest_order(position_deg: NDArray[np.float64]) -> int:
    """Highest order up to which the positions can tell all orders from each other.

    35 for 72 equidistant positions; fewer where positions are missing.
    """
    return _highest_order(tuple(float(angle) for angle in position_deg))


def circle_basis(position_deg: NDArray[np.float64], highest: int) -> NDArray[np.float64]:
    """Columns 1, cos θ, sin θ, cos 2θ, sin 2θ … up to the highest order."""
    phase = np.outer(np.deg2rad(position_deg), np.arange(1, highest + 1))
    waves = np.stack([np.cos(phase), np.sin(phase)], axis=2).reshape(phase.shape[0], 2 * highest)
    return np.column_stack([np.ones(phase.shape[0]), waves])


def on_circle(position_deg: NDArray[np.float64]) -> bool:
    """Whether positions have angles, all around the circle, so that they determine orders."""
    return widest_gap_deg(position_deg) <= _WIDEST_GAP_DEG


def widest_gap_deg(position_deg: NDArray[np.float64]) -> float:
    """Largest part of the circle without a position; infinite where there are no angles."""
    if position_deg.size < 3 or not np.all(np.isfinite(position_deg)):
        return float("inf")
    ordered = np.sort(np.mod(position_deg, 360.0))
    return float(np.max(np.diff(np.append(ordered, ordered[0] + 360.0))))


def label_modes(modes: Sequence[Mode], position_deg: NDArray[np.float64]) -> tuple[Mode, ...]:
    """Give each mode its circumferential order and purity; unchanged where there is no circle.

    The order stays unknown above the frequency of the highest order that the positions can tell:
    there, twelve sensors see order 7 as order 5.
    """
    if not on_circle(position_deg):
        gap_deg = widest_gap_deg(position_deg)
        if not np.isfinite(gap_deg):
            return tuple(modes)
        remark = f"{gap_deg:.0f}° of the circle without a sensor: orders look alike"
        return tuple(without_order(mode, remark) for mode in modes)
    contents = [order_content(mode.residues, position_deg) for mode in modes]
    labelled = [
        replace(mode, order=content.order, order_purity=content.purity)
        for mode, content in zip(modes, contents, strict=True)
    ]
    limit_hz = _end_of_orders(labelled, highest_order(position_deg))
    return tuple(
        replace(mode, order=None, order_purity=float("nan"))
        if mode.frequency_hz > limit_hz
        else mode
        for mode in labelled
    )


def of_order(mode: Mode, order: int, position_deg: NDArray[np.float64]) -> Mode:
    """The mode with the order that a person gave it, and that order's share of its power."""
    power = order_content(mode.residues, position_deg).power
    share = float(power[order] / power.sum()) if order < power.size else float("nan")
    return replace(mode, order=order, order_purity=share)


def with_aliases(modes: Sequence[Mode], position_deg: NDArray[np.float64]) -> list[Mode]:
    """The modes, those of unknown order with the order that they look like at the positions.

    Purity is then that order's share of the whole shape: the shortest wave that equidistant
    positions see, + − + −, is in none of the orders.
    """
    seen = list(modes)
    for k, mode in enumerate(modes):
        if mode.order is None:
            content = order_content(mode.residues, position_deg)
            share = content.power.max() / np.mean(np.abs(mode.residues) ** 2)
            seen[k] = replace(mode, order=content.order, order_purity=float(share))
    return seen


def without_order(mode: Mode, remark: str) -> Mode:
    """The mode, said to be of unknown order for a reason."""
    flags = (Flag.ORDER_UNKNOWN, *(flag for flag in mode.flags if flag is not Flag.ORDER_UNKNOWN))
    unknown = replace(mode, order=None, member="", order_purity=float("nan"), pair=Pair.UNKNOWN)
    return replace(unknown, flags=flags, remark=remark)


def _end_of_orders(modes: Sequence[Mode], highest: int) -> float:
    """Frequency above which orders may be mistaken for lower ones."""
    below = np.inf
    for mode in sorted(modes, key=lambda each: each.frequency_hz):
        if mode.order_purity < _CLEAR:
            continue
        if mode.order == highest - 1:
            below = min(below, mode.frequency_hz)
        if mode.order == highest and mode.frequency_hz > below:
            return mode.frequency_hz * (1 + PAIR_REACH)
    return float("inf")


def order_basis(position_deg: NDArray[np.float64], order: int) -> NDArray[np.float64]:
    """Columns cos nθ and sin nθ; a constant for n = 0."""
    basis = circle_basis(position_deg, order)
    return basis[:, :1] if not order else basis[:, -2:]


def family(modes: Sequence[Mode]) -> dict[int, list[int]]:
    """Modes of the ring by order n ≥ 1: index of the main mode, then of its partner if any.

    Among all ways to take one mode per order with frequencies that rise with the order, the one
    that the force drives most. |A|ω is the inverse of the modal mass, which is nearly the same for
    all orders of a ring and much larger for what the ring only shakes along with.
    """
    candidates = [k for k, mode in enumerate(modes) if mode.order and mode.order_purity >= PURE]
    # By its amplitude, a broad pole that is no mode would outweigh all of them. Damping may be the
    # belt's, with equal ratios, or the sidewalls', with equal rates of decay.
    sizes = [(modes[k].damping_ratio, -modes[k].pole.real) for k in candidates]
    odd = np.min(np.divide(sizes, np.median(sizes, axis=0)), axis=1) if sizes else []
    candidates = [k for k, ratio in zip(candidates, odd, strict=True) if ratio <= _ODD_DAMPING]
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
    # A member that hardly shows may be fitted farther away, where both resonances still touch.
    touching = main.damping_ratio + other.damping_ratio
    return (
        main.order == other.order
        and abs(other.frequency_hz / main.frequency_hz - 1) < max(PAIR_REACH, touching)
        and 1 / _PAIR_DAMPING < ratio < _PAIR_DAMPING
    )


Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# √(K/ρh)/(2πa), frequency of extension of a belt, where order 0 does not show it: that of the
# paper's tyre (Table 4). None is softer than one that grows by 2 % when inflated.
_STRETCH_HZ, _SOFTEST_HZ = 545.0, 250.0
# √(k_r/ρh)/2π: the bed alone, of the paper's tyre; a thirtieth of the stiffness of the breathing.
_BED_HZ = 100.0
# √(k_θ/ρh)/2π, torsion of a belt on its rim: that of rings of car tyres, 30 to 60 Hz.
_TORSION_HZ = 45.0
# Lines below the breathing, where order 0 answers by its stiffness.
_STIFF_HZ = 300.0
# Orders whose resonances tell the mass of the ring, 2 to 6: a rim moves order 1.
_WEIGHED = slice(1, 6)


def stretch_hz(frequency_hz: Real, breathing: Complex, mass_kg: Real, noise: Real) -> float:
    """Frequency of extension of a belt from the inertance of order 0 and the orders' modal masses.

    Order 0 stretches the belt evenly: its inertance is ω²/(M (ω² − ω_0²)), with the mass M of the
    ring, of which order n moves (1 + 1/n²)/2, and ω_0² = (K/a² + k_r)/ρh. `mass_kg` are those of
    orders 1, 2 …, `noise` is that of each line.
    """
    order = np.arange(1, mass_kg.size + 1)
    whole = (2.0 * mass_kg / (1.0 + 1.0 / order**2))[_WEIGHED]
    lines = (frequency_hz > 0) & (frequency_hz < _STIFF_HZ) & (np.abs(breathing) > 0)
    if not np.any(lines) or not np.all(whole > 0):
        return _STRETCH_HZ
    square = frequency_hz[lines] ** 2
    softness = 1.0 / (square * (1.0 - (1.0 / breathing[lines]).real / np.median(whole)))
    rising = np.argsort(softness)
    share = np.cumsum((square / noise[lines])[rising])
    middle = softness[rising[np.searchsorted(share, share[-1] / 2)]]
    softest, stiffest = np.hypot(_SOFTEST_HZ, _BED_HZ), 1e3 * _STRETCH_HZ
    breathing_hz = 1.0 / np.sqrt(np.clip(middle, stiffest**-2, softest**-2))
    return float(np.sqrt(breathing_hz**2 - _BED_HZ**2))


def pull_on_waves(
    mass_kg: Real,
    seats: Real,
    radial: Complex,
    waves: Complex,
    frequency_hz: Real,
    stretch_hz: float,
) -> Complex:
    """Pull of the masses at the seats on each wave, (n_waves, n_frequencies).

    A sensor moves along the belt too. A belt that does not stretch moves v = −w'/n² (Kim, Nam &
    Lee 2020; v' = −w): for order n the tangential pull adds about 1/n² of the radial one. Its own
    inertia, less the pull of the bed, stretches it: v is larger by (ρhω² − k_θ)a²/(n²K), 1 to 2 %
    for order 1.
    """
    order = np.arange(1, (seats.shape[1] + 1) // 2)
    along = np.zeros_like(seats)
    along[:, 1::2], along[:, 2::2] = -seats[:, 2::2] / order, seats[:, 1::2] / order
    stretch = np.ones((seats.shape[1], frequency_hz.size))
    inertia = frequency_hz**2 - _TORSION_HZ**2
    stretch[1:] += inertia / (stretch_hz * np.repeat(order, 2)[:, None]) ** 2
    tangential = along @ (stretch * waves)
    return np.asarray((mass_kg * seats.T) @ radial + stretch * ((mass_kg * along.T) @ tangential))
