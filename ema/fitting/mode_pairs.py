"""Pairs of the ring, order by order: whether one member is seen, or both."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ema.circumference.orders import family, further_resonances, with_aliases
from ema.core.drift import Drift
from ema.core.frf import FRF
from ema.core.modes import Mode, synthesise
from ema.core.numerics import towards_fixed_point
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.fitting.order_pair import (
    OrderDecomposition,
    RingOrder,
    Seen,
    fit_pair,
    in_one_state,
    pair_problem,
)
from ema.fitting.pair import PairFit, are_two_modes, order_report, two_modes
from ema.fitting.pole_fit import N_STAND_INS, PoleFit
from ema.fitting.ring_pair import Known
from ema.fitting.variable_projection import Complex, Real, numbers_of
from ema.fitting.wave_mixing import WaveMixing, sharing_resonance
from ema.signals.leakage import has_leakage, leakage_bias

# The place of the force is known to this many degrees of angle around the tyre (1 σ); where the
# orders respond along another one, more than three times that away, it is that one …
_FORCE_STD_DEG = 0.5
# … and not known at all where most orders point elsewhere by more than this, in rad.
_ELSEWHERE_RAD, _UNKNOWN_RAD = 0.5, 0.3
# A pair of its own is not told within this share of the frequency of another one of its order.
_BESIDE = 0.15
# Sensors mix of one order into another so many times what is the median of all.
_MIXED = 3.0
# … and an uneven tyre no more than this share of a mode into the order of one close by.
_MOST_MIXED = 0.2
# Further fits of the orders beside poles, and with leakage and states, of the pairs found so far:
# at most so many, until poles move by less than this share of their standard deviation.
_ROUNDS, _SETTLED = 15, 0.2
# Rounds that tell where the pairs are heading for, and how far ahead that is believed: half-widths,
# or shares of a shape.
_DEPTH, _FAR = 4, 0.5


class PairSearch:
    """Pairs of all orders of the ring, and what of them is determined.

    On FRFs in the middle state of the runs, so that nothing is in another.

    Parameters
    ----------
    frf : FRF
        Of a closed circle of positions.
    lines : slice
        Lines of the fit.
    fit : PoleFit
    modes : sequence of Mode
        One for each pole of the fit but those that stand for modes above the lines, with orders.
    band_hz : tuple of float
        Band of the result; orders outside are told apart where one pole does not explain them.
    correlation : float
        From `ema.fitting.covariance.line_correlation`.
    drift : Drift
        Of the runs.
    settings : IdentificationSettings
    """

    def __init__(
        self,
        frf: FRF,
        lines: slice,
        fit: PoleFit,
        modes: Sequence[Mode],
        band_hz: tuple[float, float],
        correlation: float,
        drift: Drift,
        settings: IdentificationSettings = IDENTIFICATION,
    ) -> None:
        self.frf, self.lines, self.fit = frf, lines, fit
        self.correlation, self.drift, self.settings = correlation, drift, settings
        self.state = np.average(fit.drift, axis=0, weights=[len(rows) for rows in fit.groups])
        self.decomposition = OrderDecomposition(frf)
        ring = family(modes)
        low, high = frf.frequency_hz[lines][[0, -1]].tolist()
        self.main = _inside(ring.items(), modes, (low, high))
        in_band = _inside(self.main, modes, band_hz)
        self.beside = {each[1][0] for each in self.main if each not in in_band}
        inside = {k for _, found in in_band for k in found}
        self.guards = [k for n, found in ring.items() for k in found if n and k not in inside]
        own = {k for found in ring.values() for k in found}
        others = further_resonances(with_aliases(modes, frf.position_deg), own)
        self.orders = self.main + _inside(others, modes, band_hz)
        # Above the highest order that the positions can tell, an order is an alias.
        self.aliases = {k for k, mode in enumerate(modes) if mode.order is None}
        self.directions = {
            found[0]: _direction(
                self.decomposition.rows(order) @ fit.residues[:, found].sum(axis=1)
            )
            for order, found in self.orders
        }
        on_curve = {order: self.directions[found[0]] for order, found in in_band}
        self.force_deg = _force_deg(on_curve, frf.excitation_deg)

    def orders_alone(self, before: Sequence[RingOrder] = ()) -> tuple[RingOrder, ...]:
        """All orders, from FRFs that poles of other orders do not take part of.

        Those that are as in a fit `before` stay what they were. Beside the band only orders count
        that one pole does not explain.
        """
        self.resolve(())
        known = {(each.order, each.members): each for each in before}
        orders = []
        for order, found in self.orders:
            there, seen = known.get((order, tuple(found))), self.seen_of(order, found)
            kept = there is not None and seen.is_as(there.seen)
            orders.append(there if there and kept else self.fitted(order, found, seen))
        return tuple(
            each for each in orders if each.key not in self.beside or each.shows_two(self.settings)
        )

    def orders_together(
        self, orders: Sequence[RingOrder], before: Sequence[RingOrder] = ()
    ) -> tuple[RingOrder, ...]:
        """Orders found alone, each beside the pairs of all others; those of `before` stay."""
        for _ in range(_ROUNDS):
            both = [each for each in orders if each.shows_two(self.settings)]
            if not both or all(each in before for each in orders):
                break
            agreed = self._agreed(orders, [each.key for each in both if each not in before])
            near = {each.key for each in both}
            orders = [
                each if each in before else self._again(each, each.key in near) for each in agreed
            ]
            if all(_is_settled(*each) for each in zip(agreed, orders, strict=True)):
                break
        return tuple(orders)

    def _agreed(self, orders: Sequence[RingOrder], moving: Sequence[int]) -> list[RingOrder]:
        """Orders whose pairs, those `moving`, are where the pairs of all others put them.

        Verdicts stay, and what leakage does to two poles is that of the start.
        """
        shown, path = {each.key: each for each in orders}, _Path()
        leakage = self.leakage_of_two(self._both(shown.values()))
        for _ in range(_ROUNDS if moving else 0):
            self._resolve(self._both(shown.values()), leakage)
            found = {key: self._near(shown[key]) for key in moving}
            settled = all(_is_settled(shown[key], each) for key, each in found.items())
            shown |= found if settled else path.ahead([shown[key] for key in found], found)
            if settled:
                break
        self.resolve(self._both(shown.values()))
        return list(shown.values())

    def _both(self, orders: Iterable[RingOrder]) -> list[RingOrder]:
        return [each for each in orders if each.shows_two(self.settings)]

    def resolve(self, orders: Sequence[RingOrder]) -> None:
        """Take the fit as known: FRFs in one state, with the leakage of the pairs of `orders`.

        Nothing is subtracted: what one pole cannot describe of a pair, and some of its noise, is in
        the residues of all other poles, which are free at all positions.
        """
        self._resolve(orders, self.leakage_of_two(orders))

    def _resolve(self, orders: Sequence[RingOrder], leakage: Complex | float) -> None:
        fit, lines = self.fit, self.fit.lines
        self.middle = replace(fit, poles=lines.drifted(fit.poles, self.state))
        self.whole = in_one_state(fit, self.middle.poles) + leakage
        self.pairs = {each.key: lines.drifted(each.poles, self.state) for each in orders}
        self.in_pairs = {k for each in orders for k in each.members[1:]}  # it stands for these too
        if orders and len(fit.drift) > 1:
            poles, shapes = self._two_for_one(orders)
            wanted = lines.drifted(poles, self.state)
            for rows, drift in zip(fit.groups, fit.drift, strict=True):
                here = lines.drifted(poles, drift)
                moved = np.append(wanted, here), np.concatenate([shapes, -shapes], axis=1)[rows]
                self.whole[rows] += _alone(lines.frequency_hz, *moved)
        told = {k for each in orders for k in each.members}  # which member comes first can change
        self.counted = [o for o in self.orders if o[1][0] not in self.beside - told]
        self.mixing = WaveMixing(
            fit,
            self.middle.poles,
            self.frf.std[:, self.lines],
            self.decomposition,
            self.counted,
            [(each.members, each.poles) for each in orders if each.jointly and each.pair],
            self.correlation,
            self.settings,
        )
        self.mixed = self._mixed()

    def _two_for_one(self, orders: Sequence[RingOrder]) -> tuple[Complex, Complex]:
        """Poles and shapes of pairs, less those of the poles in their place."""
        poles, shapes = list[Complex](), list[Complex]()
        for each in orders:
            own = list(each.members)
            poles += [each.poles, self.fit.poles[own]]
            shapes += [each.waves(self.frf.position_deg), -self.fit.residues[:, own]]
        return np.concatenate(poles), np.concatenate(shapes, axis=1)

    def _mixed(self) -> Real:
        """How much of each pole another order may hold (1 σ), by what the sensors mix.

        Of a pole that is of no order of the ring it may hold as much as there is. Those in the
        place of modes above the lines are of orders above.
        """
        strays = {n: self.mixing.stray(n, found)[0] for n, found in self.counted}
        share = np.ones(self.fit.poles.size)
        for n, found in self.counted:
            share[found] = _MIXED * strays[n]
        if strays:
            beyond = self.guards if self.mixing.beside else []
            share[[*beyond, *range(share.size - N_STAND_INS, share.size)]] = _MIXED * np.median(
                list(strays.values())
            )
        return np.asarray(share * _sizes(self.middle))

    def _held(self, order: int, found: Sequence[int]) -> tuple[list[complex], list[float]]:
        """Poles that an order's FRFs hold beside its own, and how much of each at most (1 σ)."""
        alike = {k for n, others in self.orders if n == order for k in others}
        poles, sizes = list[complex](), list[float]()
        for k, pole in enumerate(self.middle.poles):
            if k not in found and k not in self.in_pairs:
                own = self.pairs.get(k, np.array([pole]))
                size = _sizes(self.middle)[k] if k in alike else self._mixed_into(found[0], k)
                poles += own.tolist()
                sizes += [float(size)] * own.size
        return poles, sizes

    def _mixed_into(self, own: int, k: int) -> float:
        """How much of a pole an order with another pole of its own may hold (1 σ).

        What makes a tyre uneven mixes modes the more the closer they are, as 1/(λ² − λ_k²): order 1
        of a moving rim beneath order 2 held 7 % of that, and 0.2 % of most other orders.
        """
        apart = np.abs(self.middle.poles**2 - self.middle.poles[k] ** 2)
        others = [o[1][0] for o in self.main if not {own, k} & {*o[1]}]
        if k not in sharing_resonance(self.middle.poles, [own]) or not others:
            return float(self.mixed[k])
        nearer = float(np.median(apart[others])) / max(float(apart[own]), 1e-300)
        size = min(self.mixed[k] * max(nearer, 1.0), _MOST_MIXED * _sizes(self.middle)[k])
        return float(max(size, self.mixed[k]))

    def pair_in(self, seen: Seen) -> PairFit | None:
        """The pair of one order, whatever it may be."""
        pair = fit_pair(seen.frequency_hz, seen.values, seen.std, seen.start, seen.known)
        return None if pair is None else self.in_first_state(pair, seen.start)

    def fitted(self, order: int, found: list[int], seen: Seen) -> RingOrder:
        """The pair of one order, or its one mode, and the verdict on it."""
        pair = self.pair_in(seen)
        is_main = (order, found) in self.main
        on_a_rim = order == 1 and any(n == 1 and k != found for n, k in self.orders)
        apart = pair is not None and are_two_modes(pair, on_a_rim=on_a_rim)
        if apart or (not is_main and self._is_beside_its_order(order, found)):
            return RingOrder(order, tuple(found), None, two_modes(order), seen, is_main)
        hz = abs(seen.start) / (2 * np.pi)
        unknown = np.hypot(self.drift.std_of_mean[0], self.drift.unsteadiness(hz)[0])
        report = order_report(order, pair, self.settings, float(hz * unknown))
        return RingOrder(order, tuple(found), pair, report, seen, is_main)

    def _is_beside_its_order(self, order: int, found: list[int]) -> bool:
        """Whether a further resonance shares its lines with another one of its order."""
        size = np.abs(self.middle.poles)
        return any(
            n == order and other != found and abs(size[other[0]] / size[found[0]] - 1) < _BESIDE
            for n, other in self.orders
        )

    def _again(self, before: RingOrder, is_near: bool) -> RingOrder:
        """The same order beside pairs that are known, perhaps near where its pair was."""
        near = before.pair.parameters if is_near and before.pair else None
        # After other states of the runs another member may come first, or none be an order's own.
        members = sorted(before.members, key=lambda k: k not in self.directions)
        if members[0] not in self.directions:
            return before
        found = self.fitted(before.order, members, self.seen_of(before.order, members, near))
        return replace(found, seen=before.seen, is_main=before.is_main)

    def orders_near(self, before: Sequence[RingOrder]) -> tuple[RingOrder, ...]:
        """The orders as found before in much the same fit: pairs move, verdicts stay."""
        self.resolve(())
        now = {each.key: self._still_seen(each) for each in before}
        moved = [each.key for each in before if (own := now[each.key]) and not own.is_as(each.seen)]
        if not moved:
            return tuple(before)
        together = {each.key for each in self._both(before)}.intersection(moved)
        found = list[RingOrder]()
        for each in self._agreed(before, [key for key in moved if key in together]):
            if each.key in moved:
                each = each if each.key in together else self._near(each)
                each = replace(each, seen=now[each.key] or each.seen)
            found.append(each)
        return tuple(found)

    def _still_seen(self, before: RingOrder) -> Seen | None:
        found = sorted(before.members, key=lambda k: k not in self.directions)
        known = before.pair is not None and found[0] in self.directions
        return self.seen_of(before.order, found) if known else None

    def _near(self, before: RingOrder) -> RingOrder:
        seen = self._still_seen(before)
        if seen is None or before.pair is None:
            return before
        given = seen.frequency_hz, seen.values, seen.std, seen.start, seen.known
        problem = pair_problem(*given)
        if problem is None:
            return before
        pair = self.in_first_state(problem.solve_near(before.pair), seen.start)
        return replace(before, pair=pair)

    def seen_of(self, order: int, found: list[int], near: Real | None = None) -> Seen:
        """What is seen of one order, and known of it: its own, and what sensors mix into it."""
        power = np.sum(np.abs(self.fit.residues[:, found]) ** 2, axis=0)
        start = complex(np.average(self.middle.poles[found], weights=power))
        force_rad, spread = self.directions[found[0]], _UNKNOWN_RAD
        if self.force_deg is not None and found[0] not in self.aliases:
            radians = order * np.pi / 180
            force_rad, spread = self.force_deg * radians, _FORCE_STD_DEG * radians
        seen = self.decomposition.order(order, self.lines, self.whole).seen_from(force_rad)
        stray, mixed = self.mixing.stray(order, found)
        beside, sizes = self._held(order, found)
        known = Known(
            force_std_rad=float(np.hypot(spread, mixed)),
            wave_std=stray,
            correlation=self.correlation,
            settings=self.settings,
            beside=tuple(beside),
            beside_size=tuple(sizes),
            near=near,
            drive_std=mixed,
        )
        return Seen(seen.frequency_hz, seen.values, seen.std, start, known, force_rad)

    def in_first_state(self, pair: PairFit, start: complex) -> PairFit:
        """A pair of the middle state in that of the first run."""
        shift, decay = self.fit.lines.drift_factors(np.array([start]), self.state)
        return pair.moved(float(shift[0]), float(decay[0]))

    def leakage_of_two(self, orders: Sequence[RingOrder]) -> Complex | float:
        """What leakage does to two poles and not to the one in their place.

        It alone gives both members 3 % too much damping where they are 1 % apart.
        """
        fit, lines = self.fit, self.fit.lines
        if not orders or not has_leakage(self.frf):
            return 0.0
        moving, shapes = self._two_for_one(orders)
        names = self.frf.run_names
        states = fit.drift if len(fit.drift) > 1 else np.repeat(fit.drift, len(names), axis=0)
        runs = {
            name: lines.drifted(moving, state) for name, state in zip(names, states, strict=True)
        }
        return -leakage_bias(self.frf, lines.frequency_hz, runs, shapes)


class _Path:
    """Pairs of all orders from round to round, and what they are heading for."""

    def __init__(self) -> None:
        self.tried, self.found = list[Complex](), list[Complex]()

    def ahead(
        self, tried: Sequence[RingOrder], found: Mapping[int, RingOrder]
    ) -> Mapping[int, RingOrder]:
        """What to try after what was tried last and what that led to."""
        self.tried.append(_pairs_of(tried))
        self.found.append(_pairs_of(found.values()))
        width, size = -self.found[-1][:, 2].real, np.linalg.norm(self.found[-1][:, 3:], axis=1)
        alike = np.repeat(np.stack([width, size], axis=1), [3, 4], axis=1)
        goal = towards_fixed_point(self.tried[-_DEPTH:], self.found[-_DEPTH:], alike)
        if np.max(np.abs(goal - self.found[-1]) / alike) > _FAR:
            return found
        return {
            k: _with_pair(each, own) for (k, each), own in zip(found.items(), goal, strict=True)
        }


def _pairs_of(orders: Iterable[RingOrder]) -> Complex:
    """Poles of members and mean, then residues of the members, (n_orders, 7)."""
    pairs = [each.pair for each in orders if each.pair]
    return np.array([[*pair.poles, pair.mean, *pair.residues.ravel()] for pair in pairs])


def _with_pair(order: RingOrder, numbers: Complex) -> RingOrder:
    """An order with a pair of these poles and residues."""
    assert order.pair is not None
    a, b, mean = numbers[:3].tolist()
    own, waves = numbers_of(numbers[:3]), numbers[3:].reshape(2, 2)
    pair = replace(order.pair, poles=(a, b), mean=mean, numbers=own, residues=waves)
    return replace(order, pair=pair)


def _is_settled(before: RingOrder, now: RingOrder) -> bool:
    """Whether a further round changed nothing of an order."""
    if before.pair is None or now.pair is None:
        return before.pair is now.pair
    away = np.abs(now.pair.numbers - before.pair.numbers)
    shown = slice(None) if now.is_resolved else slice(4, None)
    return bool(np.all(away[shown] <= _SETTLED * np.sqrt(np.diag(now.pair.covariance))[shown]))


def _inside(
    orders: Iterable[tuple[int, list[int]]], modes: Sequence[Mode], band_hz: tuple[float, float]
) -> list[tuple[int, list[int]]]:
    """Orders n ≥ 1 whose main mode lies in the band."""
    low, high = band_hz
    return [each for each in orders if each[0] and low <= modes[each[1][0]].frequency_hz <= high]


def _direction(amplitude: Complex) -> float:
    """Angle of a nearly real vector of cosine and sine amplitudes, in radians, modulo π."""
    turned = amplitude * np.exp(-0.5j * np.angle(np.sum(amplitude**2)))
    return float(np.mod(np.arctan2(turned[1].real, turned[0].real), np.pi))


def _force_deg(directions: dict[int, float], excitation_deg: float) -> float | None:
    """Where the force acts: both members of an order together respond along it.

    The stated angle, or the one that the orders agree on; None where they agree on none.
    """
    if not (np.isfinite(excitation_deg) and directions):
        return None
    orders, angles = np.array(list(directions)), np.array(list(directions.values()))

    def away_rad(angle_deg: float) -> Real:
        turned = angles - orders * np.deg2rad(angle_deg)
        return np.asarray(np.mod(turned + np.pi / 2, np.pi) - np.pi / 2)

    off_deg = float(np.rad2deg(np.median(away_rad(excitation_deg) / orders)))
    found_deg = excitation_deg + (off_deg if abs(off_deg) > 3 * _FORCE_STD_DEG else 0.0)
    known = np.median(np.abs(away_rad(found_deg))) < _ELSEWHERE_RAD
    return found_deg if known else None


def _sizes(fit: PoleFit) -> Real:
    """Amplitude of each pole's FRF over that of a unit receptance, RMS of the positions."""
    return np.asarray(np.sqrt(2 * np.mean(np.abs(fit.residues) ** 2, axis=0)) * 2 * fit.poles.imag)


def _alone(frequency_hz: Real, poles: Complex, residues: Complex) -> Complex:
    none = np.zeros(len(residues))
    return synthesise(frequency_hz, poles, residues, none, none)
