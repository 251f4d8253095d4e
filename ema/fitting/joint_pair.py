"""The pair of one order from several forces: the same two poles and waves, driven differently.

With Λ and M as in `ema.fitting.ring_pair`, all in the axes of the first force, the FRFs of the
order against force r are

    H_r = −ω²/M [(jω − Λ)(jω − Λ*)]⁻¹ u_r,   u_r = g_r (cos η_r, sin η_r),   H_r → (1 + E) H_r.

Two forces that are not on one line of antinodes drive both members, so that Λ is determined however
little its members are apart. What belongs to the sensors (E) is common to all forces; gain g_r and
direction η_r of a force, and what the ring's state has changed since the first one, have to pay for
themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ema.core.numerics import end_if_stopped
from ema.fitting.order_pair import with_change
from ema.fitting.pair import PairFit
from ema.fitting.ring_pair import PairProblem
from ema.fitting.variable_projection import Complex, Real

# Shared parameters, as in `PairProblem`; then direction, frequency and decay of each force's state.
_SHARED, _OF_FORCE = 6, 3
_POLE = (0, 1)  # mean frequency and damping
# Forces agree in their gain to this share (1 σ): the same cell, mounted twice.
_GAIN = 0.02
_MIXING = 4
_EVALUATIONS = 40


@dataclass(frozen=True, eq=False)
class ForceState:
    """What is known of a force beside its stated direction and the ring's state at the first one.

    Parameters
    ----------
    expected, std : ndarray, shape (3,)
        Direction in radians of the wave, frequency and decay, relative, with their 1 σ.
    """

    expected: Real
    std: Real


@dataclass(frozen=True, eq=False)
class JointFit:
    """What all forces say about the pair of an order.

    Parameters
    ----------
    pairs : tuple of PairFit
        As each force's FRFs show it: poles in its own state, and its own residues, both in the axes
        of the first force. Numbers and covariance of the members are those of all forces.
    of_forces, of_forces_std : ndarray, shape (n_forces, 3)
        As in `ForceState`, and what is known of them with this order.
    parameters : ndarray
        Of `JointProblem`.
    """

    pairs: tuple[PairFit, ...]
    of_forces: Real
    of_forces_std: Real
    parameters: Real


@dataclass(frozen=True, eq=False)
class _Linear:
    """What is linear: mixing and gains, as in `PairProblem` times the amplitude."""

    left: Complex  # weighted residuals
    orthonormal: Complex
    found: Complex  # amplitude, mixing, gains
    waves: list[Complex]  # of each force, for unit amplitude


class JointProblem:
    """Least-squares problem of one order's pair against several forces.

    Parameters
    ----------
    problems : sequence of PairProblem
        Of each force, all with the same start and in the axes of the first one.
    turned : sequence of float
        η of each force as stated, in radians of the wave from the first one.
    states : sequence of ForceState
        Of each force.
    """

    def __init__(
        self, problems: Sequence[PairProblem], turned: Sequence[float], states: Sequence[ForceState]
    ) -> None:
        self.problems, self.turned = tuple(problems), np.array(turned)
        first = problems[0]
        self.expected = np.zeros(_SHARED + _OF_FORCE * len(problems))
        self.sizes = np.concatenate(
            [first.sizes[:_SHARED], *([[0.02, 1e-4, 1e-3]] * len(problems))]
        )
        self.expected[_SHARED:] = np.concatenate([state.expected for state in states])
        of_forces = [state.std for state in states]
        self.spread = np.concatenate([[np.inf, np.inf], first.priors[:4], *of_forces])
        none, every = np.zeros(self.expected.size), np.eye(self.expected.size)
        #: Slopes of a force's parameters to those searched.
        self.to_force = [
            self.of_force(every, k) - self.of_force(none, k) for k in range(len(problems))
        ]
        self._solved: tuple[tuple[float, ...], _Linear] | None = None
        self._steep: tuple[bytes, _Linear, Real] | None = None
        self.amplitude = 1e-12  # no mixing at first, to see the size of the wave
        self.amplitude = abs(self._linear(self.expected).found[0])

    def _own(self, force: int) -> slice:
        """Parameters of a force."""
        return slice(_SHARED + _OF_FORCE * force, _SHARED + _OF_FORCE * (force + 1))

    def of_force(self, x: Real, force: int) -> Real:
        """Parameters of a force's `PairProblem`, for many sets."""
        own = x[..., self._own(force)]
        shared = x[..., :_SHARED].copy()
        shared[..., 0] += own[..., 1]
        shared[..., 1] += own[..., 2] - own[..., 1]
        return np.concatenate([shared, own[..., :1] + self.turned[force]], axis=-1)

    def minimum(self, start: Real, free: Sequence[int] | None = None) -> tuple[Real, float]:
        """The parameters of the minimum from a start, and twice its cost."""
        end_if_stopped()
        chosen = np.arange(start.size) if free is None else np.array(free)

        def whole(values: Real) -> Real:
            x = start.copy()
            x[chosen] = values
            return x

        found = scipy.optimize.leastsq(
            lambda values: self.residuals(whole(values)),
            start[chosen],
            (),
            lambda values: self.jacobian(whole(values))[:, chosen],
            True,
            diag=1 / self.sizes[chosen],
            maxfev=_EVALUATIONS,
            ftol=1e-6,
            xtol=1e-6,
            gtol=1e-8,
        )[0]
        x = whole(found)
        return x, float(np.sum(self.residuals(x) ** 2))

    def rough(self, near: Real | None) -> JointFit:
        """The best pair, from parameters near it or from nothing."""
        x, _ = self.minimum(self.start() if near is None else near)
        return self._fit(x, 0.0, is_linear=True)

    def solve(self, narrow: JointProblem | None, near: Real | None = None) -> JointFit:
        """The best pair, with what the data say against one pole.

        What half the lines would change, in a `narrow` problem, is part of the covariance as in
        `ema.fitting.order_pair`.
        """
        x, cost = self.minimum(self.start() if near is None else near)
        scale = max(self._misfit(cost), 1e-12)
        for problem in (*self.problems, *(narrow.problems if narrow else ())):
            problem.scale = scale
        x, cost = self.minimum(x)
        one = self.expected.copy()
        one[list(_POLE)] = x[list(_POLE)]
        gain = self.minimum(one, [*_POLE, *range(_SHARED, one.size)])[1] - cost
        fit = self._fit(x, gain)
        if narrow is None:
            return fit
        narrow.amplitude = self.amplitude
        other = narrow._fit(narrow.minimum(x)[0], gain)
        pairs = tuple(map(with_change, fit.pairs, other.pairs))
        return replace(fit, pairs=pairs)

    def start(self) -> Real:
        """Parameters from the equation of motion, in which they are linear.

        (−ω² + jωC + K) H_r/(−ω²) = u_r/M, weighted as the residuals of one pole would be.
        """
        rows, rights = list[list[Complex]](), list[Complex]()
        x = self.expected
        for k, problem in enumerate(self.problems):
            omega = problem.omega
            own = self.of_force(x, k)
            alone = omega**2 / (
                omega**2 - problem.size**2 - 2j * problem.ratio * problem.size * omega
            )
            weight = problem.weight[0] * np.abs(alone)
            cosine, sine = weight * problem.values / -(omega**2)
            none, drive = np.zeros_like(cosine), -weight + 0j
            speed = 1j * omega
            direction = np.cos(own[6]), np.sin(own[6])
            rows.append(
                [speed * cosine, speed * sine, none, cosine, sine, none, drive * direction[0]]
            )
            rows.append(
                [none, speed * cosine, speed * sine, none, cosine, sine, drive * direction[1]]
            )
            rights += [omega**2 * cosine, omega**2 * sine]
        design = np.concatenate([np.array(each) for each in rows], axis=1).T
        size = np.linalg.norm(design, axis=0)
        right = np.concatenate(rights)
        found = np.linalg.lstsq(
            np.concatenate([(design / size).real, (design / size).imag]),
            np.concatenate([right.real, right.imag]),
            rcond=None,
        )[0]
        found = found / size
        damping, stiffness = (found[[k, k + 1, k + 1, k + 2]].reshape(2, 2) for k in (0, 3))
        squared, axes = np.linalg.eigh(stiffness - damping @ damping / 4)
        coupled = -damping / 2 + 1j * (axes * np.sqrt(np.maximum(squared, 0.0))) @ axes.T
        x = self.expected.copy()
        x[:_SHARED] = self.problems[0].parameters_of(coupled)
        return x

    def residuals(self, x: Real) -> Real:
        """Weighted residuals, those of the priors included."""
        return np.concatenate([self._linear(x).left.view(float), self._strayed(x)])

    def jacobian(self, x: Real) -> Real:
        """Slopes of the residuals to the parameters, of Kaufman (1975); the last ones are kept."""
        key, linear = x.tobytes(), self._linear(x)
        if self._steep is None or self._steep[:2] != (key, linear):
            self._steep = key, linear, self._slopes(x, linear)
        return self._steep[2]

    def _slopes(self, x: Real, linear: _Linear) -> Real:
        found = linear.found
        mixed = found[0] * np.eye(2) + found[1 : 1 + _MIXING].reshape(2, 2)
        rows = np.zeros((x.size, linear.left.size), dtype=complex)
        at = 0
        for k, problem in enumerate(self.problems):
            size = 1e-6 * problem.sizes
            ahead = problem.inside_waves(self.of_force(x, k) + np.diag(size))
            slopes = (ahead - linear.waves[k]) / size[:, None, None]
            slopes = mixed @ slopes + found[1 + _MIXING + k] * slopes
            own = (slopes * problem.weight[:, None]).reshape(size.size, -1)
            rows[:, at : at + own.shape[1]] = self.to_force[k] @ own
            at += own.shape[1]
        rows -= (rows @ linear.orthonormal.conj()) @ linear.orthonormal.T
        priors = np.eye(x.size)[:, 2:] / self.spread[2:]
        return np.concatenate([-rows.view(float), priors], axis=1).T

    def _strayed(self, x: Real) -> Real:
        return np.asarray(((x - self.expected) / self.spread)[2:])

    def _linear(self, x: Real) -> _Linear:
        """What is linear, at best; the last is kept."""
        key = (*x, self.amplitude, *(problem.scale for problem in self.problems))
        if self._solved is None or self._solved[0] != key:
            self._solved = key, self._eliminated(x)
        return self._solved[1]

    def _eliminated(self, x: Real) -> _Linear:
        n_columns = 1 + _MIXING + len(self.problems)
        every = [p.inside_waves(self.of_force(x[None], k))[0] for k, p in enumerate(self.problems)]
        blocks, rights = list[Complex](), list[Complex]()
        for k, (problem, waves) in enumerate(zip(self.problems, every, strict=True)):
            weighted = waves * problem.weight[:, None]
            block = np.zeros((n_columns, *waves.shape), dtype=complex)
            block[0] = weighted
            block[1:3, 0] = waves * problem.weight[0]
            block[3:5, 1] = waves * problem.weight[1]
            block[1 + _MIXING + k] = weighted
            blocks.append(block.reshape(n_columns, -1))
            rights.append((problem.inside * problem.weight[:, None]).ravel())
        wave = max(problem.wave_std for problem in self.problems)
        gains = [np.hypot(_GAIN, problem.drive_std) for problem in self.problems]
        stray = np.array([*[wave] * _MIXING, *gains]) * self.amplitude
        prior = np.zeros((n_columns, n_columns - 1), dtype=complex)
        prior[1:] = np.diag(1 / np.maximum(stray, 1e-300))
        columns = np.concatenate([*blocks, prior], axis=1)
        right = np.concatenate([*rights, np.zeros(n_columns - 1)])
        size = np.linalg.norm(columns, axis=1)
        lapack = scipy.linalg.lapack  # faster than numpy's qr
        factors, scales, _, _ = lapack.zgeqrf((columns / size[:, None]).T)
        orthonormal = lapack.zungqr(factors, scales)[0]
        seen = orthonormal.conj().T @ right
        found = lapack.ztrtrs(factors[:n_columns], seen)[0] / size
        return _Linear(right - orthonormal @ seen, orthonormal, found, every)

    def _misfit(self, cost: float) -> float:
        """Reduced χ² of all forces, in terms of their scales."""
        outside = sum(float(np.sum(p.outside / p.std**2)) / p.scale for p in self.problems)
        free = sum(p.n_independent for p in self.problems) - 20 * len(self.problems)
        return float(cost + outside) / max(free, 1)

    def _fit(self, x: Real, gain: float, *, is_linear: bool = False) -> JointFit:
        covariance = self.covariance(x)
        found = self._linear(x).found
        mixed = found[0] + found[1 + _MIXING :]
        pairs = tuple(
            replace(self._of_force(x, covariance, k, complex(mixed[k]), is_linear), gain=gain)
            for k in range(len(self.problems))
        )
        of_forces, std = (
            each[_SHARED:].reshape(-1, _OF_FORCE) for each in (x, np.sqrt(np.diag(covariance)))
        )
        return JointFit(pairs, of_forces, std, x)

    def covariance(self, x: Real) -> Real:
        """Covariance of the parameters at a minimum."""
        slopes = self.jacobian(x)
        size = np.linalg.norm(slopes, axis=0)
        slopes = slopes / size
        inner = np.linalg.pinv(slopes.T @ slopes, rcond=1e-12, hermitian=True)
        return np.asarray(inner / np.outer(size, size))

    def _of_force(
        self, x: Real, covariance: Real, force: int, amplitude: complex, is_linear: bool
    ) -> PairFit:
        """The pair as one force's FRFs show it.

        Members whose split is no larger than its ± are far from linear in the parameters: what a
        step of one σ to either side changes, and how unequally, is their covariance. It is that of
        steps to one side where only its size matters.
        """
        problem, own = self.problems[force], self.to_force[force]
        here = self.of_force(x, force)
        variance, axes = np.linalg.eigh(own.T @ covariance @ own)
        steps = (axes * np.sqrt(np.maximum(variance, 0.0))).T
        middle, ahead = problem.numbers(here), problem.numbers(here + steps)
        behind = 2 * middle - ahead if is_linear else problem.numbers(here - steps)
        slope, bend = (ahead - behind) / 2, (ahead + behind) / 2 - middle
        spread = slope.T @ slope + bend.T @ bend
        pair = problem.pair_of(here, spread, problem.scale, amplitude=amplitude)
        apart = np.hypot(*x[[2, 3]])
        turned = np.sqrt(np.trace(covariance[2:4, 2:4]) / 2) / (2 * apart)
        return replace(pair, turned_std_rad=float(min(turned, np.pi / np.sqrt(12))))
