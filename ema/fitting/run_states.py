"""States of the runs, with the pairs of the ring in place: what changed, and whether it is chance.

The sensors of a run see a mixture of the members of each pair, those of the next run another one:
to one pole in the place of the pair that is a drift. So every order has both members here, with one
free amplitude at each position, and shows in each run r how far its poles are shifted,

    x_ro = μ_o + law(f_o) θ_r + e_ro,   e_ro ~ N(0, noise + τ_o²),

in half-widths. μ_o is the order's own, θ_r the state of the run, of which all orders tell. What
places, gains and an uneven tyre do to single orders, τ_o, is seen from how far they stray from
the law that they share: without it every drift would be significant that they feign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.core.drift import NO_DRIFT, Drift
from ema.core.frf import FRF
from ema.core.modes import synthesise
from ema.fitting.covariance import inverse_of, parameter_covariance
from ema.fitting.mode_pairs import PairSearch
from ema.fitting.order_pair import RingOrder
from ema.fitting.pole_fit import N_DRIFT, Lines, PoleFit, evaluate
from ema.fitting.variable_projection import Complex, Real

# Relative change of poles that gives their slopes.
_STEP = 1e-5
# No fit leaves less than this share of the power: rounding.
_EXACT = 1e-12
# Shifts that one run tells less of than this share are left alone: rounding.
_TOLD = 1e-10
# No shift is known better than to these half-widths, nor free of rounding by this share.
_LEAST_SHIFT, _ROUNDED = 1e-7, 1e-9
# A single order tells no τ_o: then it strays by this many half-widths (benchmarks/laboratory.py).
_STRAYS = 0.01
# States take at least this share off what the median order scatters over the runs: 0.6 and more in
# 55 campaigns of benchmarks/laboratory.py that drift, nothing where two of nine orders feigned one.
_SHARED = 0.3
# Rounds in which τ_o settles, and how much the runs differ in each number of their states.
_ROUNDS, _SETTLING = 6, 40
# A number of the states varies by this from run to run at first, and never by less than the least.
_VARIES, _LEAST_VARIES = np.array([3e-3, 3e-3, 3e-3, 3e-2]), 1e-7
# Numbers of the state that few orders tell; more tell all.
_TOLD_BY = {1: [0, 3], 2: [0, 3], 3: [0, 1, 3]}


def drift_in_one_step(fit: PoleFit, frf: FRF, correlation: float, p_value: float) -> Drift:
    """Drift of the runs, one Gauss–Newton step away from a common state, tested against chance.

    Of single poles: where pairs are known, `drift_beside_pairs` has the last word.
    """
    apart = evaluate(fit.lines, fit.poles, np.zeros((fit.lines.n_runs, N_DRIFT)))
    own = slice(2 * fit.poles.size, None)
    covariance = parameter_covariance(apart, correlation)[own, own]
    step = -np.linalg.lstsq(apart.normal_matrix(), apart.gradient(), rcond=1e-12)[0][own]
    size = float(step @ np.linalg.pinv(covariance, rcond=1e-10) @ step)
    chance = float(scipy.special.chdtrc(step.size, size))
    return with_states(_tested(frf, fit, chance, p_value), step, covariance)


def _tested(frf: FRF, fit: PoleFit, chance: float, p_value: float) -> Drift:
    """A drift that is applied where it is less probable by chance; its states are yet unknown."""
    known = replace(NO_DRIFT, run=frf.run_names, number=frf.run_numbers, chance=chance)
    return replace(known, middle_hz=fit.lines.middle_hz, applied=chance < p_value)


def with_states(drift: Drift, step: NDArray[np.floating], covariance: Real) -> Drift:
    """The drift with the states of all runs but the first, and their standard deviations."""
    variance = np.diag(covariance).reshape(-1, N_DRIFT)
    states, std = (
        100 * np.vstack([np.zeros(N_DRIFT), each])
        for each in (step.reshape(-1, N_DRIFT), np.sqrt(variance))
    )
    return replace(
        drift,
        percent=states[:, 0],
        std_percent=std[:, 0],
        slope_percent=states[:, 1],
        curvature_percent=states[:, 2],
        damping_percent=states[:, 3],
        damping_std_percent=std[:, 3],
    )


def drift_beside_pairs(search: PairSearch, orders: Sequence[RingOrder], p_value: float) -> Drift:
    """States of all runs with the pairs of orders in place, tested against chance."""
    shifts = _shifts_of(search, orders)
    spread = shifts.spread()
    chance = shifts.chance(spread)
    states, covariance = shifts.states(spread)
    n_runs = len(states)
    relative = np.kron(np.eye(n_runs)[1:] - np.eye(n_runs)[0], np.eye(N_DRIFT))
    drift = _tested(search.frf, search.fit, chance, p_value)
    return with_states(drift, relative @ states.ravel(), relative @ covariance @ relative.T)


def in_states(fit: PoleFit, drift: Real) -> PoleFit:
    """The fit with other states of its runs, its poles as they are in the middle of them."""
    away = middle_of(fit.lines, fit.drift) - middle_of(fit.lines, drift)
    again = evaluate(fit.lines, fit.lines.drifted(fit.poles, away), drift)
    return replace(again, at_bound=fit.at_bound, pairs=fit.pairs, locked=fit.locked)


def middle_of(lines: Lines, drift: Real) -> Real:
    """State in the middle of those of all positions."""
    counts = np.bincount(lines.run) if len(drift) > 1 else None
    return np.asarray(np.average(drift, axis=0, weights=counts))


def ring_in(ring: Sequence[RingOrder], lines: Lines, state: Real) -> tuple[RingOrder, ...]:
    """Orders with their pairs in another state of the tyre."""
    moved = list[RingOrder]()
    for order in ring:
        pair = order.pair
        if pair is not None:
            shift, decay = lines.drift_factors(np.array([pair.mean]), state)
            pair = pair.moved(1 / float(shift[0]), 1 / float(decay[0]))
        moved.append(replace(order, pair=pair))
    return tuple(moved)


@dataclass(frozen=True, eq=False)
class _Shifts:
    """How far the poles of each order are shifted in each run, in half-widths.

    First the frequencies of all orders, then their damping.
    """

    away: Real  # (n_runs, 2 n_orders)
    noise: Real  # its covariance, (n_runs, 2 n_orders, 2 n_orders)
    law: Real  # what the numbers of a state shift, (2 n_orders, n_numbers)
    numbers: list[int]  # which of the state are told

    def spread(self, *, alike: bool = False) -> Real:
        """Covariance of the shifts beside the law, with what single orders stray.

        An order strays as it is seen to do, and no less than half of the orders. Or all but the one
        that strays most do so `alike`.
        """
        n_runs, n_shifts = self.away.shape
        noise = np.mean([np.diag(each) for each in self.noise], axis=0)
        stray, design = np.zeros(n_shifts // 2), self._design(n_runs - 1)
        left = (n_runs - 1) * (n_shifts - self.law.shape[1])
        if not left:
            return np.asarray(self.noise + _STRAYS**2 * np.eye(n_shifts))
        for _ in range(_ROUNDS):
            spread = self.noise + np.diag(np.tile(stray, 2))
            found = _least_squares(design, self.away, spread)[0]
            beyond = np.mean((self.away - design @ found) ** 2, axis=0)
            beyond = beyond * (n_runs * n_shifts / left) - noise
            own = np.maximum(beyond.reshape(2, -1).mean(axis=0), 0.0)
            most = np.arange(own.size) == np.argmax(own)
            usual = np.where(most, own, np.mean(own[~most])) if own.size > 1 else own
            stray = usual if alike else np.maximum(own, np.median(own))
        return np.asarray(self.noise + np.diag(np.tile(stray, 2)))

    def chance(self, spread: Real) -> float:
        """Probability of states that differ as much where all runs are in one state.

        A law that is bent to the few orders that stray makes them look as if they kept to it. So
        it has to be no chance where all orders stray alike, too, and most have to keep to it.
        """
        if not self._is_shared(spread):
            return 1.0
        return max(map(self._chance, (spread, self.spread(alike=True))))

    def _is_shared(self, spread: Real) -> bool:
        """Whether states explain what most orders do from run to run, in frequency or damping."""
        n_runs = len(self.away)
        together, apart = (
            self.away - design @ _least_squares(design, self.away, spread)[0]
            for design in (self._design(0), self._design(n_runs - 1))
        )
        scatter, left = (np.sum(each**2, axis=0).reshape(2, -1) for each in (together, apart))
        taken_off = 1 - left / np.maximum(scatter, np.finfo(float).tiny)
        return bool(np.max(np.median(taken_off, axis=1)) > _SHARED)

    def _chance(self, spread: Real) -> float:
        """The same for shifts with a covariance (F-test)."""
        n_runs, n_shifts = self.away.shape
        tested = (n_runs - 1) * self.law.shape[1]
        left = (n_runs - 1) * n_shifts - tested
        common, apart = (
            _least_squares(self._design(moving), self.away, spread)[2] for moving in (0, n_runs - 1)
        )
        if not left:
            return float(scipy.special.chdtrc(tested, common - apart))
        return float(
            scipy.special.fdtrc(tested, left, (common - apart) / tested / max(apart / left, 1.0))
        )

    def states(self, spread: Real) -> tuple[Real, Real]:
        """State of each run beside their mean, (n_runs, 4), and the covariance of all numbers.

        What does not vary from run to run, as far as all runs together tell, is drawn to zero: how
        much each number varies is found along with it (empirical Bayes, MacKay 1992). That is known
        to √(2/(n − 1)) of the variance which a run alone leaves open; the covariance allows for it.
        """
        n_runs, n_shifts = self.away.shape
        design, varies = self._design(n_runs), _VARIES[self.numbers]
        for _ in range(_SETTLING):
            found, inner, _ = _least_squares(design, self.away, spread, np.tile(varies, n_runs))
            own = found[n_shifts:].reshape(n_runs, -1)
            inner = inner[n_shifts:, n_shifts:]
            variance = np.diag(inner).reshape(n_runs, -1)
            varies = np.maximum(np.sqrt(np.mean(own**2 + variance, axis=0)), _LEAST_VARIES)
        told = [np.linalg.inv(self.law.T @ np.linalg.solve(each, self.law)) for each in spread]
        alone = np.mean([np.diag(each) for each in told], axis=0)
        allowed = np.sqrt(varies**2 + np.sqrt(2 / max(n_runs - 1, 1)) * alone)
        inner = _least_squares(design, self.away, spread, np.tile(allowed, n_runs))[1]
        inner = inner[n_shifts:, n_shifts:]
        states = np.zeros((n_runs, N_DRIFT))
        states[:, self.numbers] = own
        at = np.ravel(N_DRIFT * np.arange(n_runs)[:, None] + self.numbers)
        covariance = np.zeros((states.size, states.size))
        covariance[np.ix_(at, at)] = inner
        return states, covariance

    def _design(self, moving: int) -> Real:
        """Shifts by those that all runs have and the states of the last runs.

        Shape (n_runs, n_shifts, n_shifts + moving · n_numbers).
        """
        n_runs, n_shifts = self.away.shape
        n_told = self.law.shape[1]
        design = np.zeros((n_runs, n_shifts, n_shifts + moving * n_told))
        design[:, :, :n_shifts] = np.eye(n_shifts)
        for k in range(moving):
            at = n_shifts + k * n_told
            design[n_runs - moving + k, :, at : at + n_told] = self.law
        return design


def _least_squares(
    design: Real, values: Real, spread: Real, varies: Real | None = None
) -> tuple[Real, Real, float]:
    """Generalised least squares over runs: solution, covariance and what is left.

    `varies` are the standard deviations of the last parameters around zero.
    """
    white = np.linalg.inv(np.linalg.cholesky(spread))
    matrix = np.concatenate(white @ design)
    right = np.ravel(white @ values[:, :, None])
    normal = matrix.T @ matrix
    if varies is not None:
        own = np.arange(len(normal) - len(varies), len(normal))
        normal[own, own] += varies**-2
    inner = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    found = inner @ (matrix.T @ right)
    return found, inner, float(np.sum((right - matrix @ found) ** 2))


def _shifts_of(search: PairSearch, orders: Sequence[RingOrder]) -> _Shifts:
    """Shifts of orders in each run, one Gauss–Newton step away from the states of the fit."""
    fit, lines, n = search.fit, search.fit.lines, len(orders)
    members = {k for each in orders for k in each.members}
    others = [k for k in range(fit.poles.size) if k not in members]
    shapes = np.concatenate([each.waves(search.frf.position_deg) for each in orders], axis=1)
    poles = np.concatenate([each.poles for each in orders])
    values = (lines.values + search.leakage_of_two(orders)) * lines.weight
    hz, ratio = np.array([each.pair.numbers[4:] for each in orders if each.pair]).T
    size, lever = np.append(ratio, np.ones(n)), lines.lever(2 * np.pi * hz)
    law = np.zeros((2 * n, N_DRIFT))
    law[:n, :3] = np.stack([lever**0, lever, lever**2], axis=1)
    law[n:, 3] = 1.0
    law /= size[:, None]
    away, noise = list[Real](), list[Real]()
    for run in range(lines.n_runs):
        state, rows = fit.drift[run % len(fit.drift)], np.flatnonzero(lines.run == run)
        here, beside = (lines.drifted(each, state) for each in (poles, fit.poles[others]))
        functions = _functions(lines.frequency_hz, here, beside) * lines.weight
        scale = lines.scale[rows, None]
        step, inner = _step(functions, scale * values[rows], scale * shapes[rows])
        away.append(step / size + law @ state)
        own = inner * search.correlation / np.outer(size, size)
        noise.append(own + np.diag(_ROUNDED * np.diag(own) + _LEAST_SHIFT**2))
    numbers = _TOLD_BY.get(n, [*range(N_DRIFT)])
    return _Shifts(np.array(away), np.array(noise), law[:, numbers], numbers)


def _functions(frequency_hz: Real, poles: Complex, others: Complex) -> Complex:
    """FRFs of single poles, their slopes to frequency and to damping, then those of others."""
    more = poles * (1 + _STEP), poles + _STEP * poles.real
    every = np.concatenate([poles, *more, others])
    none = np.zeros(every.size)
    unit = np.array(1j * np.eye(every.size), dtype=np.complex128)
    alone = -1j * synthesise(frequency_hz, every, unit, none, none)
    n = poles.size
    alone[n : 3 * n] = (alone[n : 3 * n] - np.tile(alone[:n], (2, 1))) / _STEP
    ground = np.stack([np.ones_like(frequency_hz), (frequency_hz / frequency_hz[-1]) ** 2])
    return np.concatenate([alone, ground])


def _step(functions: Complex, values: Complex, shapes: Complex) -> tuple[Real, Real]:
    """Shifts of frequencies and damping of all orders in one run, and their covariance.

    Each order has a free amplitude at each position, and all other functions too. `shapes` are what
    the members of all orders have at the positions, (n_positions, 2 n_orders).
    """
    n_rows, n = len(shapes), shapes.shape[1] // 2
    n_free = n + len(functions) - 6 * n
    mixed = np.zeros((n_rows, len(functions), n_free + 2 * n), dtype=complex)
    member = np.arange(2 * n)
    for first, at in ((0, 0), (2 * n, n_free), (4 * n, n_free + n)):
        mixed[:, first + member, at + member // 2] = shapes
    mixed[:, 6 * n + np.arange(n_free - n), n + np.arange(n_free - n)] = 1.0
    turned = mixed.conj().transpose(0, 2, 1)
    inner = turned @ (functions.conj() @ functions.T) @ mixed
    right = (turned @ (values @ functions.conj().T)[:, :, None])[:, :, 0]
    free, slope = slice(n_free), slice(n_free, None)
    given = np.concatenate([inner[:, free, slope], right[:, free, None]], axis=2)
    solved = np.linalg.solve(inner[:, free, free], given)
    normal = np.sum(inner[:, slope, slope] - inner[:, slope, free] @ solved[:, :, :-1], axis=0).real
    along = inner[:, slope, free] @ solved[:, :, -1:]
    towards = np.sum(right[:, slope] - along[:, :, 0], axis=0).real
    left = np.sum(np.abs(values) ** 2) - np.sum(right[:, free].conj() * solved[:, :, -1]).real
    inverse = inverse_of(normal, _TOLD)
    step = inverse @ towards
    left = max(left - float(step @ towards), _EXACT * float(np.sum(np.abs(values) ** 2)))
    return step, np.asarray(inverse * (left / (2 * n_rows * (values.shape[1] - n_free))))
