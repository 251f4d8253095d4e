"""The pair of one order from its FRFs: fitted around the resonance, and judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import PURE, circle_basis, highest_order, order_content
from ema.core.frf import FRF
from ema.core.modes import OrderReport, Pair, synthesise
from ema.core.settings import IdentificationSettings
from ema.fitting.pair import PairFit, joint_report, one_row, order_report, reported
from ema.fitting.pole_fit import N_STAND_INS, PoleFit, evaluate
from ema.fitting.ring_pair import Known, PairProblem
from ema.fitting.variable_projection import Complex, Real

# Half-widths of the resonance on either side whose lines are fitted.
_REACH = 6.0
_FEWEST_LINES = 12
# FRFs of an order that change by less than this, in standard deviations of all lines together, move
# none of its parameters by more: the pair is what it was.
_UNTOUCHED = 0.05
# Damping of members within a half-width of each other is not believed to differ by more than this
# many times what is usual (`pair_damping_likeness`): an error of the FRFs looks like that too.
_UNLIKE = 3.0
# Poles closer than this many half-widths of the broader one share a resonance.
SHARED = 1.5
# Members whose shares of the response change by more than this, while the misfit of their order
# grows by this factor, are not what the order shows: 10 g on an uneven tyre were off by 6.7 σ.
_SETTLED, _GROWN = 0.1, 1.05
# Steps that give slopes, of the sizes of the parameters.
_SLOPE_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class OrderFrf:
    """The part of the FRFs that goes with cos n(θ − θ₀) and sin n(θ − θ₀).

    Parameters
    ----------
    order : int
    frequency_hz : ndarray, shape (n_frequencies,)
    values : ndarray of complex, shape (2, n_frequencies)
        Amplitudes of cosine and sine; one row for n = 0.
    std : ndarray, shape (2, n_frequencies)
        Standard deviation per quadrature.
    """

    order: int
    frequency_hz: Real
    values: Complex
    std: Real

    def seen_from(self, angle_rad: float) -> OrderFrf:
        """The same with θ₀ turned by an angle, in radians of the wave."""
        if self.order == 0:
            return self
        turn = _turn(angle_rad)
        std = np.sqrt(np.square(turn) @ np.square(self.std))
        return OrderFrf(self.order, self.frequency_hz, turn @ self.values, std)


class OrderDecomposition:
    """FRFs of a circle of positions, resolved into circumferential orders.

    The spatial Fourier transform where the positions are complete and equidistant, least squares
    where some are missing.

    Parameters
    ----------
    frf : FRF
        With angles.
    """

    def __init__(self, frf: FRF) -> None:
        self._frf = frf
        self.highest = highest_order(frf.position_deg)
        self._inverse = np.linalg.pinv(circle_basis(frf.position_deg, self.highest))

    def order(
        self, order: int, lines: slice | NDArray[np.int_], values: Complex | None = None
    ) -> OrderFrf:
        """Resolve one order from the FRFs, or from other `values` on the same lines."""
        rows = self.rows(order)
        measured = self._frf.values[:, lines] if values is None else values
        variance = np.square(rows) @ np.square(self._frf.std[:, lines])
        return OrderFrf(order, self._frf.frequency_hz[lines], rows @ measured, np.sqrt(variance))

    def waves(self, shape: Complex) -> Complex:
        """Amplitudes of cosine and sine of all orders in a shape, (n_orders, 2)."""
        return np.asarray(np.insert(self._inverse @ shape, 1, 0.0).reshape(-1, 2))

    def rows(self, order: int) -> Real:
        """What multiplies the positions to give cosine and sine of an order."""
        return np.asarray(
            self._inverse[[0]] if order == 0 else self._inverse[2 * order - 1 : 2 * order + 1]
        )


def _turn(angle_rad: float) -> Real:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cosine, sine], [-sine, cosine]])


def resonance(frequency_hz: Real, pole: complex, reach: float = 1.0) -> NDArray[np.bool_]:
    """Lines around the resonance of a pole that its pair is fitted to."""
    width_hz = -pole.real / (2 * np.pi)
    return np.asarray(np.abs(frequency_hz - abs(pole) / (2 * np.pi)) < reach * _REACH * width_hz)


@dataclass(frozen=True, eq=False)
class Seen:
    """What the pair of one order is found from.

    Parameters
    ----------
    frequency_hz, values, std : ndarray
        Of an `OrderFrf`, turned to the force.
    start : complex
        Pole of the order as one mode, rad/s.
    known : Known
    force_rad : float
        Direction that is called the force's, as angle of the wave.
    """

    frequency_hz: Real
    values: Complex
    std: Real
    start: complex
    known: Known
    force_rad: float

    def _beside(self, pole: complex) -> int:
        """How many other poles lie where the pair is fitted; those farther off look alike."""
        hz = np.abs(np.array(self.known.beside)) / (2 * np.pi)
        return int(np.count_nonzero(resonance(hz, pole)))

    def is_as(self, before: Seen) -> bool:
        """Whether the pair is what it was, whatever changed in the rest of the fit."""
        now, then = self.known, before.known
        allowed, before_that = ((each.force_std_rad, each.wave_std) for each in (now, then))
        if (
            self.values.shape != before.values.shape
            or self._beside(before.start) != before._beside(before.start)
            or not np.allclose(allowed, before_that, rtol=_UNTOUCHED, atol=0.0)
        ):
            return False
        near = resonance(self.frequency_hz, before.start)
        power = np.sum(np.abs(self.values - before.values)[:, near] ** 2, axis=1)
        variance = np.mean(before.std[:, near] ** 2, axis=1)
        return bool(np.all(variance > 0) and np.sum(power / variance) < _UNTOUCHED**2)


@dataclass(frozen=True, eq=False)
class RingOrder:
    """What was found of one order of the ring.

    Parameters
    ----------
    order : int
    members : tuple of int
        Poles of the curve fit that belong to it.
    pair : PairFit or None
        None where too few lines lie around the resonance.
    report : OrderReport
    seen : Seen
        What `pair` was found from, before pairs of any order were known.
    is_main : bool
        False for further resonances of an order, as of a rim or a sidewall.
    """

    order: int
    members: tuple[int, ...]
    pair: PairFit | None
    report: OrderReport
    seen: Seen
    is_main: bool
    jointly: bool = False  # whether several forces determine the pair

    @property
    def key(self) -> int:
        """The pole that stands for all members."""
        return self.members[0]

    @property
    def is_resolved(self) -> bool:
        """Whether both members are determined."""
        return self.is_main and self.report.pair.verdict is Pair.RESOLVED

    @property
    def one_row(self) -> int | None:
        """The member that one row stands for, where members are not listed; None for the mean."""
        alone = not (self.jointly or self.is_resolved)
        return one_row(self.pair) if alone and self.pair else None

    def shows_two(self, settings: IdentificationSettings) -> bool:
        """Whether two poles explain the order better than one."""
        return self.pair is not None and self.report.pair.chance < settings.pair_p_value

    def is_within(self, main: RingOrder, settings: IdentificationSettings) -> bool:
        """Whether it is a further resonance in that of its order, which two poles explain."""
        if self.is_main or self.pair is None or main.pair is None or main.order != self.order:
            return False
        poles = np.array([self.pair.mean, main.pair.mean])
        near = abs(poles[1] - poles[0]) < SHARED * np.max(-poles.real)
        return bool(near) and main.is_main and main.shows_two(settings)

    @property
    def poles(self) -> Complex:
        """Members a and b; none where the pair is not known."""
        return np.array(self.pair.poles if self.pair else ())

    def followers(self, fit: PoleFit, position_deg: NDArray[np.float64]) -> set[int]:
        """Poles that only follow what one pole leaves of a pair that several forces determine."""
        if not (self.jointly and self.pair):
            return set()
        within = np.abs(fit.poles - self.pair.mean) < -self.pair.mean.real
        within[[*self.members, *range(fit.poles.size - N_STAND_INS, fit.poles.size)]] = False
        near = np.flatnonzero(within).tolist()
        shapes = {k: order_content(fit.residues[:, k], position_deg) for k in near}
        return {k for k, c in shapes.items() if c.order == self.order or c.purity < PURE}

    def waves(self, position_deg: NDArray[np.float64]) -> Complex:
        """Residues of members a and b as pure waves, (n_positions, 2)."""
        assert self.pair is not None
        angle = self.order * np.deg2rad(position_deg) - self.seen.force_rad
        return np.asarray(np.stack([np.cos(angle), np.sin(angle)], axis=1) @ self.pair.residues.T)


def in_one_state(fit: PoleFit, poles: Complex) -> Complex:
    """FRFs of all runs in the state that has these poles: less their own fit, plus that one's.

    In the middle between the runs, what the fit leaves of a pair is in that state too.
    """
    values = np.array(fit.lines.values)
    terms = fit.lower, fit.upper
    residues, lines = fit.residues, fit.lines
    for rows, drift in zip(fit.groups, fit.drift, strict=True):
        own, wanted = (
            synthesise(lines.frequency_hz, each, residues[rows], *(t[rows] for t in terms))
            for each in (lines.drifted(fit.poles, drift), poles)
        )
        values[rows] += wanted - own
    return values


def beside_pairs(
    fit: PoleFit,
    position_deg: Real,
    poles: Complex,
    pairs: Mapping[int, RingOrder],
    locked: tuple[int, ...],
) -> PoleFit:
    """Linear solution for poles, with the pairs in the place of some of them taken as they are.

    Such a pole has the residues of both members and what is in no wave. Were it fitted alone, the
    poles of other orders would make up for what one pole cannot follow of two.
    """
    values = np.array(fit.lines.values)
    own = np.zeros((len(position_deg), poles.size), dtype=complex)
    for k, order in pairs.items():
        assert order.pair is not None
        waves, members = order.waves(position_deg), np.array(order.pair.poles)
        own[:, k] = waves.sum(axis=1)
        for rows, drift in zip(fit.groups, fit.drift, strict=True):
            none = np.zeros(len(rows))
            here = fit.lines.drifted(members, drift)
            values[rows] -= synthesise(fit.lines.frequency_hz, here, waves[rows], none, none)
    again = evaluate(replace(fit.lines, values=values), poles, fit.drift, locked=locked)
    parts = zip(again.groups, again.parts, strict=True)
    with_pairs = [replace(part, residues=part.residues + own[rows]) for rows, part in parts]
    return replace(again, parts=tuple(with_pairs)) if pairs else again


def pair_problem(
    frequency_hz: Real, values: Complex, std: Real, start: complex, known: Known, reach: float = 1.0
) -> PairProblem | None:
    """The problem of an order around its resonance; None where too few lines lie there.

    Arguments as for `PairProblem`, with the noise of every line: `std`, shape (2, n_lines).
    """
    near = resonance(frequency_hz, start, reach)
    if np.count_nonzero(near) < _FEWEST_LINES:
        return None
    own = values[:, near]
    level = np.sqrt(np.mean(std[:, near] ** 2, axis=1))
    measured = bool(np.all(np.isfinite(level)) and np.all(level > 0))
    noise = level if measured else np.full(2, np.sqrt(np.mean(np.abs(own) ** 2)))
    return PairProblem(frequency_hz[near], own, noise, start, known, noise_known=measured)


def fit_pair(
    frequency_hz: Real, values: Complex, std: Real, start: complex, known: Known
) -> PairFit | None:
    """Fit the pair of one order; arguments as for `pair_problem`."""
    given = frequency_hz, values, std, start, known
    wide, narrow = pair_problem(*given), pair_problem(*given, 0.5)
    if wide is None:
        return None
    solved = wide.solve()
    pair = replace(solved, curved=variance_beyond_slopes(wide, solved.parameters))
    pair = pair if narrow is None else _with_window(pair, wide, narrow)
    return _with_likeness(pair, known.settings)


def _with_window(pair: PairFit, wide: PairProblem, narrow: PairProblem) -> PairFit:
    """The pair with what half the lines would change in its covariance.

    A model that is not quite right shows here: the two estimates differ by more than the variances
    do (Hausman 1978).
    """
    narrow.amplitude, narrow.scale = wide.amplitude, wide.scale
    found = narrow.minimum(pair.parameters)
    given = found.x, narrow.covariance(found), pair.misfit
    other = narrow.pair_of(*given, amplitude=complex(wide.amplitude))
    return with_change(pair, _matched(pair, other, narrow.settings))


def _matched(pair: PairFit, other: PairFit, settings: IdentificationSettings) -> PairFit:
    """Another fit of a pair with the driven member in the same place, where one is driven.

    Of a member that is hardly driven, fewer lines or other FRFs may not even tell on which side of
    the other one it lies.
    """
    if other.stronger == pair.stronger or min(pair.share) >= settings.pair_weakest_share:
        return other
    turned = [2, 3, 0, 1, 4, 5]
    covariance = other.covariance[np.ix_(turned, turned)]
    return replace(other, numbers=other.numbers[turned], covariance=covariance)


def with_change(pair: PairFit, other: PairFit) -> PairFit:
    """The pair with what changes in another one, of fewer lines or other FRFs, in its ±."""
    change = (other.numbers - pair.numbers) ** 2
    expected = np.maximum(np.diag(other.covariance) - np.diag(pair.covariance), 0.0)
    return replace(pair, covariance=pair.covariance + np.diag(np.maximum(change - expected, 0.0)))


def _with_likeness(pair: PairFit, settings: IdentificationSettings) -> PairFit:
    """The pair with a damping of its members more unlike than usual in its covariance.

    Only the shape of one peak tells members within a half-width of each other, and an error of the
    FRFs bends it as unlike damping does: the weaker member, which hardly shapes it, most. What
    moves a pole in damping moves it as far in frequency. Farther apart each member has a peak of
    its own.
    """
    a_hz, a_ratio, b_hz, b_ratio, hz, ratio = pair.numbers
    if b_hz - a_hz >= hz * ratio:
        return pair
    usual = _UNLIKE * settings.pair_damping_likeness * ratio
    a, b = (max((each - ratio) ** 2 - usual**2, 0.0) for each in (a_ratio, b_ratio))
    added = np.diag([a * hz**2, a, b * hz**2, b, 0, 0])
    return replace(pair, covariance=pair.covariance + added)


def poles_shown(poles: Complex, ring: Sequence[RingOrder]) -> Complex:
    """Poles of a fit, moved to what their orders show where that is beyond the half-width.

    A further resonance not to where another pole is: one would explain what the other leaves.
    """
    moved = poles.copy()
    for each in ring:
        shown = each.pair.mean if each.pair else poles[each.key]
        near = np.abs(poles - shown) < -shown.real
        if not (near[each.key] if each.is_main else np.any(near)):
            moved[each.key] = shown
    return moved


def contradicted(order: RingOrder, other: RingOrder, settings: IdentificationSettings) -> RingOrder:
    """The order with what changes of it in FRFs that are as likely in its ±, and judged anew."""
    if order.pair is None or other.pair is None:
        return order
    pair = with_change(order.pair, _matched(order.pair, other.pair, settings))
    if order.report.pair.verdict is not Pair.RESOLVED:
        report = reported(order.report.pair, pair)
    elif order.jointly:
        report = joint_report(order.order, pair, settings)
    else:
        report = order_report(order.order, pair, settings)
    return replace(order, pair=pair, report=report)


def settled(order: RingOrder, before: RingOrder) -> RingOrder:
    """The order, its members in doubt where they change places while their misfit grows.

    `before` is the order before the mass of the sensors was compensated by what it shows once more.
    What it shows is not what it is then, wherever the rounds end.
    """
    now, was = order.pair, before.pair
    if now is None or was is None or not order.is_resolved:
        return order
    if abs(now.share[0] - was.share[0]) < _SETTLED or now.misfit < _GROWN * was.misfit:
        return order
    evidence = "what the sensors' mass does to the members does not settle"
    verdict = replace(order.report.pair, verdict=Pair.NOT_SEPARABLE, evidence=evidence)
    return replace(order, report=reported(verdict, now))


def with_curvature(order: RingOrder, settings: IdentificationSettings) -> RingOrder:
    """The order as listed, judged with what slopes leave out in its ±."""
    if (pair := order.pair) is None or order.jointly or not pair.split_std > 0:
        return order
    split_hz = float(pair.numbers[2] - pair.numbers[0])
    std = max(float(np.hypot(split_hz / pair.split_std, np.sqrt(pair.curved[6]))), 1e-300)
    covariance = pair.covariance + np.diag(pair.curved[:6])
    pair = replace(pair, covariance=covariance, split_std=split_hz / std, curved=np.zeros(7))
    by_slopes = order_report(order.order, order.pair, settings).pair.verdict
    judged = order.report.pair.verdict is by_slopes is Pair.RESOLVED  # else a person wants both
    anew = order_report(order.order, pair, settings) if judged else None
    return replace(order, pair=pair, report=anew or reported(order.report.pair, pair))


def variance_beyond_slopes(problem: PairProblem, x: Real) -> Real:
    """Variance of the six numbers and of the split that points show more than slopes, (7,).

    The split of a pair is √(δ_c² + δ_s²): it has no slope along the force where noise happens to
    put δ_c near 0, however large δ_c may be. Points at √3 σ of the parameters, which have the
    moments of a normal distribution, tell (Julier & Uhlmann 2004).
    A member that is hardly driven may lie on either side of the other one: there the members are
    told by which one is driven.
    """
    variances, axes = np.linalg.eigh(problem.spread(x) / np.outer(problem.sizes, problem.sizes))
    steps = np.sqrt(np.maximum(variances, 0.0))[:, None] * (axes.T * problem.sizes)
    far, near = (_away(problem, x, reach * steps) / reach for reach in (np.sqrt(3), _SLOPE_STEP))
    # Two points of 2n, each with the weight 1/6 at √3 σ, and half of the two that give a slope.
    return np.asarray(np.maximum(np.sum(far**2, axis=0) / 2 - np.sum(near**2, axis=0) / 2, 0.0))


def _away(problem: PairProblem, x: Real, steps: Real) -> Real:
    """Change of the numbers and the split on either side of a minimum, (2 n_parameters, 7)."""
    numbers = problem.numbers(x + np.concatenate([0 * steps[:1], steps, -steps]))
    a, b, mean = (numbers[:, ::2] * (1 + 1j * numbers[:, 1::2])).T
    to_a, to_b = np.abs(mean - a), np.abs(mean - b)  # the mean is near the member driven most
    if min(to_a[0], to_b[0]) < problem.settings.pair_weakest_share * abs(b[0] - a[0]):
        other = (to_a < to_b) != (to_a[0] < to_b[0])
        numbers[other, :4] = numbers[np.ix_(other, [2, 3, 0, 1])]
    whole = np.column_stack([numbers, numbers[:, 2] - numbers[:, 0]])
    return np.asarray(whole[1:] - whole[0])
