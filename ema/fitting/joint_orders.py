"""Pairs of the ring from several forces: every order, and the states of runs and forces."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from ema.core.numerics import one_blas_thread
from ema.core.settings import IdentificationSettings
from ema.fitting.joint_pair import ForceState, JointFit, JointProblem
from ema.fitting.mode_pairs import PairSearch
from ema.fitting.order_pair import OrderFrf, RingOrder, contradicted, pair_problem, settled
from ema.fitting.pair import PairFit, joint_report
from ema.fitting.ring_pair import PairProblem
from ema.fitting.run_states import drift_beside_pairs, in_states
from ema.fitting.search import NO_SHIFT, CurveFit
from ema.fitting.variable_projection import Complex, Real

# Orders change alike from force to force to these shares of frequency and decay.
_UNEVEN = np.array([2e-5, 1e-3])
# What is known of the state at another force (1 σ): a tyre warms up a little between runs, not in
# one run with several forces.
_STATE_STD, _SAME = np.array([0.003, 0.02]), np.array([1e-7, 1e-6])
# Least share of what is known of a force with an order that the order is taken to tell.
_TELLS_NOTHING = 1e-6
# A member with less than this share of the other's residue is not driven.
_NOT_DRIVEN = 1e-6
# … nor does one with less than this tell one force what lies across it.
_HARDLY_DRIVEN = 0.1
# What one force sees of a pair tells what lies across the force where the members are apart by so
# many standard deviations. A partner of 0.03 % of the response, a hertz off, made one member two.
_PLACED_STD = 2.0
# Fits, each with leakage and states of runs and forces as the one before shows them; each leaves a
# fifth of the error. Members that moved, or will, by less than this share of their σ stay.
_ROUNDS, _LEFT, _SETTLED = 4, 0.2, 0.2
_BOTH = [0, 1]  # members
# Lines that are fitted, and those that the last fit is compared with, beside what one force's pair
# is found from: from 6 half-widths the residual terms take a tenth to a sixth of what FRFs tell.
_REACHES = (2.0, 1.0)


@one_blas_thread
def joint_curves(curves: Sequence[CurveFit], two: Collection[int] = ()) -> list[CurveFit]:
    """Fits of one ring against each of several forces, with the pairs that all of them show.

    What one pole for each order leaves of a pair looks like a drift of the runs: their states are
    found again with the pairs. Orders in `two` have both members whatever the data tell.
    """
    curves = _with_all_orders(curves)
    joint = _JointSearch(curves)
    for _ in range(_ROUNDS - 1):
        before = joint
        before.search()
        if before.moved < _SETTLED:
            break
        joint = _JointSearch([joint.with_run_states(k) for k in range(len(curves))], before)
        if joint.is_as(before) or before.moved * _LEFT < _SETTLED:
            break
    joint.search(is_last=True)
    return [joint.with_ring(k, two) for k in range(len(curves))]


class _JointSearch:
    """Pairs of all orders of the ring that all forces show, perhaps from where others ended."""

    def __init__(self, curves: Sequence[CurveFit], before: _JointSearch | None = None) -> None:
        self.curves = curves
        self.searches = [curve.pair_search() for curve in curves]
        by_order = [
            {
                order.order: led
                for order in curve.ring
                if _is_shared(order, curve)
                and (led := _led(order, search))
                and not {*order.members} & {*curve.locked}
            }
            for curve, search in zip(curves, self.searches, strict=True)
        ]
        shared = set(by_order[0]).intersection(*by_order[1:])
        self.alone = {order: [each[order] for each in by_order] for order in sorted(shared)}
        self.joint: dict[int, list[RingOrder]] = self.alone if before is None else before.joint
        self.fits: dict[int, JointFit] = {} if before is None else before.fits
        self.moved = np.inf  # how far the last search moved a pair, in its ±
        self._parts: dict[tuple[int, float], list[PairProblem | None]] = {}
        for force, search in enumerate(self.searches):
            search.resolve(self._of_force(force))
        self.seen = {
            order: [
                search.seen_of(order, list(each.members))
                for search, each in zip(self.searches, alone, strict=True)
            ]
            for order, alone in self.alone.items()
        }

    def is_as(self, before: _JointSearch) -> bool:
        """Whether pairs, found from what is seen now, are what they were."""
        return self.seen.keys() == before.seen.keys() and all(
            now.is_as(then)
            for order, seen in self.seen.items()
            for now, then in zip(seen, before.seen[order], strict=True)
        )

    def search(self, *, is_last: bool = False) -> None:
        """Fit all orders, at last with what the others tell of the forces, and to verdicts."""
        states = {order: self._states(order, known=is_last) for order in self.alone}
        tried = {order: self._fitted(order, states[order], is_last) for order in self.alone}
        fits = {order: found for order, found in tried.items() if found is not None}
        if self.fits.keys() == fits.keys():
            steps = [_moved(self.fits[n].pairs[0], fit.pairs[0]) for n, (fit, _) in fits.items()]
            self.moved = max(steps, default=0.0)
        self.joint = {order: orders for order, (_, orders) in fits.items()}
        self.fits = {order: fit for order, (fit, _) in fits.items()}

    def _states(self, order: int, *, known: bool) -> list[ForceState]:
        """What is known of each force for one order: beforehand, or with what the others tell."""
        others = [n for n in self.fits if n != order and n in self.seen] if known else []
        states = []
        for force, search in enumerate(self.searches):
            std, uneven = self._beforehand(order, force)
            expected = np.zeros(std.size)
            if others and search.force_deg is not None:
                wave = np.array([(n, 1, 1) for n in others])
                fits = [self.fits[n] for n in others]
                found = np.array([fit.of_forces[force] for fit in fits]) / wave
                found_std = np.array([fit.of_forces_std[force] for fit in fits]) / wave
                before = np.array([self._beforehand(n, force) for n in others])
                expected, std = _pooled(found, found_std, before[:, 0], before[:, 1], std)
            wave = np.array([order, 1, 1])
            states.append(ForceState(wave * expected, wave * np.hypot(std, uneven)))
        return states

    def _beforehand(self, order: int, force: int) -> tuple[Real, Real]:
        """σ of the place of a force and of the state there: of all orders, and of one alone.

        The place in radians around the ring.
        """
        known = self.seen[order][force].known
        place = np.sqrt(max(known.force_std_rad**2 - known.drive_std**2, 0.0)) / order
        own, first = self.curves[force].frf, self.curves[0].frf
        # Rows of a file with FRFs have one name, whenever they were measured.
        at_once = own.blocks is not None and own.run_names == first.run_names
        state, uneven = (_STATE_STD, _UNEVEN) if force and not at_once else (_SAME, np.zeros(2))
        return np.append(place, state), np.append(known.drive_std / order, uneven)

    def with_ring(self, force: int, two: Collection[int] = ()) -> CurveFit:
        """The fit of a force with the orders that both members are determined of, or wanted."""
        curve = copy(self.curves[force])
        both = {n for n, orders in self.joint.items() if n in two or orders[0].is_resolved}
        curve.ring = tuple(
            self.joint[each.order][force] if each.is_main and each.order in both else each
            for each in curve.ring
        )
        return curve

    def with_run_states(self, force: int) -> CurveFit:
        """The fit of a force with the states of its runs found again."""
        curve, search = copy(self.curves[force]), self.searches[force]
        if search.fit.lines.n_runs < 2 or not self.joint:
            return curve
        limit = curve.settings.drift_p_value
        curve.drift = drift_beside_pairs(search, self._of_force(force), limit)
        curve.fit = in_states(search.fit, curve.drift.states if curve.drift.applied else NO_SHIFT)
        return curve

    def _of_force(self, force: int) -> list[RingOrder]:
        return [each[force] for each in self.joint.values()]

    def _fitted(
        self, order: int, states: Sequence[ForceState], is_last: bool
    ) -> tuple[JointFit, list[RingOrder]] | None:
        """Joint fit of an order, and the order as each force shows it in its first run's state."""
        alone, seen = self.alone[order], self.seen[order]
        start, axes_rad = _common_start([each.start for each in seen]), seen[0].force_rad
        turned = [each.force_rad - axes_rad for each in seen]
        own = [
            OrderFrf(order, each.frequency_hz, each.values, each.std).seen_from(-angle)
            for each, angle in zip(seen, turned, strict=True)
        ]
        problems = []
        for reach in _REACHES if is_last else _REACHES[:1]:
            if (order, reach) not in self._parts:
                self._parts[order, reach] = [
                    pair_problem(part.frequency_hz, part.values, part.std, start, each.known, reach)
                    for part, each in zip(own, seen, strict=True)
                ]
            parts = self._parts[order, reach]
            whole = [part for part in parts if part is not None]
            if len(whole) == len(parts):
                problems.append(JointProblem(whole, turned, states))
        if not problems:
            return None
        near = self.fits[order].parameters if order in self.fits else None
        if is_last:
            fit = problems[0].solve(problems[1] if len(problems) > 1 else None, near)
        else:
            fit = problems[0].rough(near)
        orders = []
        for search, each, pair, single in zip(self.searches, seen, fit.pairs, alone, strict=True):
            pair = search.in_first_state(pair, each.start)
            wave = pair.residues[0] * np.exp(-0.5j * np.angle(np.sum(pair.residues[0] ** 2)))
            antinode = np.mod(np.arctan2(wave[1].real, wave[0].real) + axes_rad, np.pi)
            report = replace(
                joint_report(order, pair, search.settings),
                antinode_deg=float(np.rad2deg(antinode) / order),
                antinode_std_deg=float(np.rad2deg(pair.turned_std_rad) / order),
            )
            axes = replace(each, force_rad=axes_rad)
            found = replace(single, pair=pair, seen=axes, report=report, jointly=True)
            orders.append(found)
        return fit, orders


def across_forces(curves: Sequence[CurveFit]) -> list[dict[int, tuple[Complex, Complex]]]:
    """Against each force, how a pair answers across it less how it answers along it.

    By order the poles of its members and their residues: what one force does not see of a pair.
    The residue of a member for a force on its crest is that against the force which drives it most.
    """
    alone = len(curves) == 1
    rings = [
        {
            o.order: o
            for o in curve.ring
            if (_is_placed(o, curve.settings) if alone else o.is_resolved and o.jointly)
        }
        for curve in curves
    ]
    forces_rad = np.deg2rad([curve.frf.excitation_deg for curve in curves])
    found: list[dict[int, tuple[Complex, Complex]]] = [{} for _ in curves]
    for order, first in rings[0].items() if np.all(np.isfinite(forces_rad)) else ():
        away = order * forces_rad - first.seen.force_rad
        along = np.stack([np.cos(away), np.sin(away)], axis=1)
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        pairs = [ring[order].pair for ring in rings]
        residues = np.array([pair.residues for pair in pairs if pair])  # (n_forces, members, 2)
        size = np.linalg.norm(residues, axis=2).max(axis=0)
        if not np.min(size) > (_HARDLY_DRIVEN if alone else _NOT_DRIVEN) * np.max(size):
            continue  # nothing is seen of a member
        strongest = residues[np.argmax(np.linalg.norm(residues, axis=2), axis=0), _BOTH]
        phase = np.exp(-0.5j * np.angle(np.sum(strongest**2, axis=1)))
        crest = (strongest * phase[:, None]).real
        crest /= np.linalg.norm(crest, axis=1)[:, None]
        drive = along @ crest.T  # (n_forces, members)
        most = np.argmax(np.abs(drive), axis=0)
        whole = np.sum(residues[most, _BOTH] * crest, axis=1) / drive[most, _BOTH]
        if alone:  # one modal mass for both, as the pair has it
            share = drive[0] ** 2
            whole = np.full(2, whole @ share / share.sum())
        change = whole * ((across @ crest.T) ** 2 - drive**2)
        for own, ring, each in zip(found, rings, change, strict=True):
            own[order] = ring[order].poles, each
    return found


def contradicted_curves(curves: Sequence[CurveFit], others: Sequence[CurveFit]) -> list[CurveFit]:
    """Fits whose pairs have in their ± what they differ by in `others`, of the same FRFs.

    The mass of the sensors was compensated in another way there; neither is known to be better.
    """
    return _beside(curves, others, contradicted)


def settled_curves(curves: Sequence[CurveFit], before: Sequence[CurveFit]) -> list[CurveFit]:
    """Fits whose pairs are in doubt where the mass of the sensors does not settle, `settled`."""
    return _beside(curves, before, lambda order, was, _: settled(order, was))


def _beside(
    curves: Sequence[CurveFit],
    others: Sequence[CurveFit],
    judged: Callable[[RingOrder, RingOrder, IdentificationSettings], RingOrder],
) -> list[CurveFit]:
    """Fits whose orders are judged beside the same ones of others."""
    found = []
    for curve, other in zip(curves, others, strict=True):
        there = {(o.order, o.is_main): o for o in other.ring}
        ring = tuple(
            judged(o, there.get((o.order, o.is_main), o), curve.settings) for o in curve.ring
        )
        if any(now is not was for now, was in zip(ring, curve.ring, strict=True)):
            curve = copy(curve)
            curve.ring = ring
        found.append(curve)
    return found


def _is_placed(order: RingOrder, settings: IdentificationSettings) -> bool:
    """Whether one force tells where the members of a pair lie; across it there may be only one."""
    placed = order.pair is not None and order.pair.split_std > _PLACED_STD
    return placed and order.is_main and order.shows_two(settings)


def _with_all_orders(curves: Sequence[CurveFit]) -> list[CurveFit]:
    """Fits with poles added for orders of the ring that only other forces show."""
    shared = {o.order: o.pair for c in curves for o in c.ring if o.pair and _is_shared(o, c)}
    complete = []
    for curve in curves:
        own = {o.order for o in curve.ring if o.is_main and o.pair}
        missing = [pair.mean for order, pair in shared.items() if order not in own]
        if missing:
            curve = curve.going_on(added=missing)
            curve.find_pairs()
        complete.append(curve)
    return complete


def _is_shared(order: RingOrder, curve: CurveFit) -> bool:
    """Whether forces tell of an order together: main resonances in the band."""
    low, high = (2 * np.pi * hz for hz in curve.band_hz)
    return order.is_main and order.pair is not None and low <= abs(order.pair.mean) <= high


def _led(order: RingOrder, search: PairSearch) -> RingOrder | None:
    """The order of the ring with the member first that the search knows as its main one."""
    members = tuple(sorted(order.members, key=lambda k: k not in search.directions))
    return replace(order, members=members) if members[0] in search.directions else None


def _moved(before: PairFit, now: PairFit) -> float:
    """How far the members of a pair moved, in their ±."""
    std = np.sqrt(np.diag(now.covariance))
    return float(np.max(np.abs(now.numbers - before.numbers) / np.maximum(std, 1e-300)))


def _common_start(starts: Sequence[complex]) -> complex:
    """Mean of the poles that forces start from, without those that only fill a gap: broad ones."""
    narrow = max(starts, key=lambda pole: pole.real)
    return complex(np.mean([pole for pole in starts if abs(pole - narrow) < -narrow.real]))


def _pooled(
    found: Real, std: Real, beforehand: Real, uneven: Real, known: Real
) -> tuple[Real, Real]:
    """Common value of what orders found, each from what was known beforehand, and its σ.

    What was `known` counts once, and each order strays by `uneven`.
    """
    told = np.maximum(std**-2 - 1 / (beforehand**2 + uneven**2), _TELLS_NOTHING * std**-2)
    values, weight = found / std**2 / told, 1 / (1 / told + uneven**2)
    mean = np.sum(weight * values, axis=0) / np.sum(weight, axis=0)
    scatter = np.sum(weight * (values - mean) ** 2, axis=0) / max(len(found) - 1, 1)
    seen = np.sum(weight, axis=0) / np.maximum(scatter, 1.0)
    return mean * seen / (seen + known**-2), 1 / np.sqrt(seen + known**-2)
