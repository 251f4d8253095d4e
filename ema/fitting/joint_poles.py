"""Common poles of several forces, each mode with one shape and one participation of each force.

Against force r, a structure of any form answers at position i with

    H_ir = −ω² Σ_k [φ_ik L_kr/(jω − s_kr) + its conjugate's mirror image] + L_ir − ω² U_ir

so that the residues of a mode are a matrix of rank one: shape × participation. That tells poles
apart which one force sees as one: two that coincide differ in what the forces drive. Shapes,
residual terms and the stand-ins for modes above the lines are linear and eliminated as in
`ema.fitting.variable_projection`; poles, participations and what the structure's state has changed
from force to force are searched.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.fitting.driven import Driven
from ema.fitting.pole_fit import Lines
from ema.fitting.variable_projection import (
    Complex,
    Projection,
    Real,
    descend,
    orthogonalising,
    project,
)

# Frequency and decay of the structure's state, relative to that of the first force (1 σ), as of
# a ring: `ema.fitting.joint_pair`.
_STATE_STD = np.array([0.003, 0.02])
_NOTHING_LEFT = 1e-2  # of χ²: a tenth of a standard deviation
# A step of a participation beside the largest one of its mode.
_SIZE = 0.1
# Lines within this many half-widths make up a resonance.
_RESONANCE = 2.0
# Least share of a line's noise that its residual is taken to show.
_LEAST_FREE = 0.1


@dataclass(frozen=True, eq=False)
class OfForce:
    """FRFs against one force at the positions that all forces have.

    Parameters
    ----------
    lines : Lines
        Values in the state of the first run.
    own : Projection
        What is linear for this force alone: residual terms and stand-ins.
    moves : bool
        Whether the structure's state may differ from that at the first force.
    """

    lines: Lines
    own: Projection
    moves: bool

    @classmethod
    def of(cls, lines: Lines, stand_ins: Complex, moves: bool) -> OfForce:
        """With poles that stand for the modes above the lines."""
        return cls(lines, project(lines.omega, lines.target, lines.weight, stand_ins), moves)

    @cached_property
    def target(self) -> Real:
        """Weighted values without what is linear for this force, (2 n_lines, n_positions)."""
        return self.own.misfit

    def alone(self, columns: Real) -> Real:
        """Weighted functions of frequency without what is linear for this force."""
        basis = self.own.orthonormal
        return np.asarray(columns - basis @ (basis.T @ columns))


class JointLines:
    """Sum of squares of all forces, as a function of poles, participations and states.

    Parameters
    ----------
    forces : sequence of OfForce
    scale : ndarray, shape (n_positions,)
        Weight of each position beside the common one.
    """

    def __init__(self, forces: Sequence[OfForce], scale: Real) -> None:
        self.forces, self.scale = tuple(forces), scale
        self.moving = [r for r, force in enumerate(self.forces) if force.moves]
        self.n_values = sum(force.target.size for force in self.forces)

    @cached_property
    def target(self) -> Real:
        """Weighted values of all forces, one below the other."""
        return np.concatenate([force.target for force in self.forces])

    @cached_property
    def power(self) -> float:
        """Weighted sum of squares of everything."""
        return float(np.sum(np.sum(self.target**2, axis=0) * self.scale**2))

    def fit(self, start: Driven, lower: Real, upper: Real, tries: int) -> JointPoint:
        """The best poles within bounds of (decay rate, frequency), mode by mode in rad/s.

        Poles that are equal at the start stay so.
        """
        start, free = start.scaled()
        first, tied = start.planes
        n = first.size

        def at(x: Real) -> JointPoint:
            return JointPoint(self, _unpacked(x, start, free, self.moving), free, tied)

        parts = np.concatenate([start.poles[first], start.participation[free]])
        parts = np.column_stack([parts.real, parts.imag]).ravel()
        begin = np.concatenate([parts, *start.states[self.moving]])
        open_end = np.full(begin.size - 2 * n, np.inf)
        lower, upper = (each.reshape(-1, 2)[first].ravel() for each in (lower, upper))
        low, high = lower.copy(), upper.copy()
        low[0::2], high[0::2] = -upper[0::2], -lower[0::2]
        size = np.full(begin.size, _SIZE)
        size[: 2 * n] = np.repeat(-start.poles[first].real, 2)
        size[begin.size - 2 * len(self.moving) :] = np.tile(_STATE_STD, len(self.moving))
        _, found = descend(
            at,
            begin,
            np.concatenate([low, -open_end]),
            np.concatenate([high, open_end]),
            size=size,
            gain=_NOTHING_LEFT / self.n_values,
            tries=tries,
        )
        return found


def _unpacked(x: Real, start: Driven, free: NDArray[np.bool_], moving: Sequence[int]) -> Driven:
    first, tied = start.planes
    n, n_free = first.size, int(free.sum())
    parts = x[0 : 2 * (n + n_free) : 2] + 1j * x[1 : 2 * (n + n_free) : 2]
    participation = start.participation.copy()
    participation[free] = parts[n:]
    states = np.zeros((free.shape[1], 2))
    states[moving] = x[2 * (n + n_free) :].reshape(-1, 2)
    return Driven(parts[:n][tied], participation, states)


@dataclass(frozen=True, eq=False)
class JointPoint:
    """The best shapes for given poles and participations, and the slopes towards better ones."""

    problem: JointLines
    driven: Driven
    free: NDArray[np.bool_]  # participations that are searched, (n_modes, n_forces)
    tied: NDArray[np.int_]  # which of the poles that are searched each mode has

    @cached_property
    def _functions(self) -> list[Real]:
        """Those of `Driven`, force by force."""
        forces = enumerate(self.problem.forces)
        return [self.driven.functions(force.lines, r) for r, force in forces]

    @cached_property
    def _products(self) -> list[tuple[Real, Real]]:
        """Products of the functions of each force with each other and with the target.

        Everything else that a search asks for follows: waves and slopes are these functions, as
        the force drives them. The target holds nothing that is linear for the force alone.
        """
        products = list[tuple[Real, Real]]()
        for own, force in zip(self._functions, self.problem.forces, strict=True):
            alone = force.own.orthonormal.T @ own
            products.append((own.T @ own - alone.T @ alone, own.T @ force.target))
        return products

    def _as_driven(self, rows: Real, force: int) -> Real:
        """Slopes to the poles as the force drives the modes; those to participations are as is."""
        n = 2 * self.driven.poles.size
        return np.concatenate([self.driven.driving(rows[:n], force), rows[n:]])

    @cached_property
    def _columns(self) -> tuple[Real, list[Real]]:
        """Weighted functions of the shapes, of all forces, and slopes, force by force."""
        n, waves, slopes = 2 * self.driven.poles.size, list[Real](), list[Real]()
        for r, (own, force) in enumerate(zip(self._functions, self.problem.forces, strict=True)):
            alone = force.alone(own).T
            waves.append(self.driven.driving(alone[n:], r).T)
            slopes.append(self._as_driven(alone, r).T)
        return np.concatenate(waves), slopes

    @cached_property
    def _solved(self) -> tuple[Real, Real]:
        """The target in an orthonormal basis of the functions, and what makes shapes of it."""
        n, driving = 2 * self.driven.poles.size, self.driven.driving
        products, given = np.zeros((n, n)), np.zeros((n, self.problem.scale.size))
        for r, (inner, towards) in enumerate(self._products):
            products += driving(driving(inner[n:, n:], r).T, r)
            given += driving(towards[n:], r)
        size = np.sqrt(np.diag(products))
        inverse = orthogonalising(lambda: self._columns[0], products, size)
        return inverse.T @ given, inverse

    @cached_property
    def _basis(self) -> Real:
        """Orthonormal basis of the functions of the shapes."""
        return np.asarray(self._columns[0] @ self._solved[1])

    @cached_property
    def shapes(self) -> Complex:
        """Shape of each mode, (n_positions, n_modes), for a largest participation of 1."""
        inside, inverse = self._solved
        linear = inverse @ inside
        return np.asarray((linear[0::2] + 1j * linear[1::2]).T)

    @cached_property
    def unscaled(self) -> Real:
        """Inverse normal matrix of the shapes of one position at unit weight."""
        inverse = self._solved[1]
        return np.asarray(inverse @ inverse.T)

    @cached_property
    def misfit(self) -> Real:
        """Weighted residuals, (n_forces · 2 n_lines, n_positions)."""
        return np.asarray(self.problem.target - self._basis @ self._solved[0])

    @cached_property
    def chi_square(self) -> float:
        """Weighted sum of squared residuals."""
        inside, scale = self._solved[0], self.problem.scale
        return max(self.problem.power - float(np.sum(np.sum(inside**2, axis=0) * scale**2)), 0.0)

    @cached_property
    def cost(self) -> float:
        """What the search makes small: χ² and what states have to pay."""
        return self.chi_square + float(np.sum(self._strayed**2))

    @property
    def _strayed(self) -> Real:
        return np.asarray((self.driven.states[self.problem.moving] / _STATE_STD).ravel())

    @cached_property
    def _seen(self) -> Real:
        """Slopes in the basis, force by force."""
        n, seen = 2 * self.driven.poles.size, list[Real]()
        for r, (inner, _) in enumerate(self._products):
            seen.append(self._as_driven(self.driven.driving(inner[n:], r).T, r).T)
        return np.asarray(self._solved[1].T @ np.concatenate(seen, axis=1))

    @cached_property
    def _sums(self) -> tuple[Real, Real]:
        """JᵀJ and Jᵀr of poles and participations of each force, as they are."""
        products, scale = self._products, self.problem.scale
        inner = scipy.linalg.block_diag(
            *(
                self._as_driven(self._as_driven(each, r).T, r)
                for r, (each, _) in enumerate(products)
            )
        )
        inner -= self._seen.T @ self._seen
        towards = np.concatenate([self._as_driven(each, r) for r, (_, each) in enumerate(products)])
        towards -= self._seen.T @ self._solved[0]
        # Of each force, poles, then participations; mode by mode; real and imaginary part.
        n, c = self.driven.poles.size, self._coefficients * scale
        gram = (c.reshape(-1, scale.size) @ c.reshape(-1, scale.size).T).reshape(n, 2, 2, n, 2, 2)
        inner = inner.reshape(-1, n, 2, len(inner) // (2 * n), n, 2)
        normal = sum(  # einsum takes ten times
            inner[:, :, q, None, :, :, s, None] * gram[:, :, q, None, :, :, s]
            for q in (0, 1)
            for s in (0, 1)
        )
        along = (towards * scale).reshape(-1, n, 2 * scale.size).swapaxes(0, 1)
        gradient = -(along @ c.reshape(n, 2, -1).swapaxes(1, 2)).swapaxes(0, 1).ravel()
        return np.reshape(normal, (gradient.size, -1)), gradient

    @property
    def _coefficients(self) -> Real:
        """What multiplies slopes: (n_modes, 2, 2, n_positions), as in `Projection`."""
        real, imag = self.shapes.T.real, self.shapes.T.imag
        return np.stack([np.stack([real, imag], 1), np.stack([-imag, real], 1)], 1)

    @cached_property
    def transform(self) -> Real:
        """Derivative of poles and participations, force by force, to what is searched."""
        n, n_forces = self.free.shape
        moving, n_free, n_poles = (
            self.problem.moving,
            int(self.free.sum()),
            int(self.tied.max()) + 1,
        )
        matrix = np.zeros((4 * n * n_forces, 2 * (n_poles + n_free + len(moving))))
        column = np.zeros(self.free.shape, dtype=int)
        column[self.free] = 2 * (n_poles + np.arange(n_free))
        k = np.arange(n)
        for r in range(n_forces):
            shift, decay = self.driven.states[r]
            pole, drive = 4 * n * r + 2 * k, 4 * n * r + 2 * n + 2 * k
            matrix[pole, 2 * self.tied] = 1 + shift + decay
            matrix[pole + 1, 2 * self.tied + 1] = 1 + shift
            own = self.free[:, r]
            for part in (0, 1):
                matrix[drive[own] + part, column[own, r] + part] = 1.0
            if r in moving:
                state = 2 * (n_poles + n_free + moving.index(r))
                matrix[pole, state] = matrix[pole, state + 1] = self.driven.poles.real
                matrix[pole + 1, state] = self.driven.poles.imag
        return matrix

    def gradient(self) -> Real:
        """Jᵀr of the parameters searched."""
        found = self.transform.T @ self._sums[1]
        states = slice(found.size - self._strayed.size, None)
        found[states] += self._strayed / np.tile(_STATE_STD, len(self.problem.moving))
        return np.asarray(found)

    def normal_matrix(self) -> Real:
        """JᵀJ of the parameters searched."""
        found = self.transform.T @ self._sums[0] @ self.transform
        states = np.arange(len(found) - self._strayed.size, len(found))
        found[states, states] += np.tile(_STATE_STD**-2.0, len(self.problem.moving))
        np.fill_diagonal(found, np.maximum(np.diag(found), 0.0))  # whatever the rounding
        return np.asarray(found)

    @cached_property
    def n_free(self) -> int:
        """Values less parameters."""
        linear = 2 * self.driven.poles.size + sum(
            force.own.orthonormal.shape[1] for force in self.problem.forces
        )
        data = sum(2 * float(np.sum(f.lines.importance**2)) for f in self.problem.forces)
        left = (data - linear) * self.problem.scale.size - self.transform.shape[1]
        return max(int(left), 1)

    @property
    def reduced(self) -> float:
        """Reduced χ²."""
        return self.chi_square / self.n_free

    def scores(self) -> Real:
        """Score of each line of each force for the parameters searched, (n_forces, n_lines, …)."""
        basis, slopes, scale = self._basis, self._columns[1], self.problem.scale
        n_forces, (height, width) = len(slopes), slopes[0].shape
        steep = -basis @ self._seen
        for r, each in enumerate(slopes):
            steep[r * height : (r + 1) * height, r * width : (r + 1) * width] += each
        # What is linear follows its share of each line's noise.
        leverage = np.sum(basis**2, axis=1)
        leverage += np.concatenate([force.own.leverage for force in self.problem.forces])
        restored = self.misfit / np.sqrt(np.clip(1 - leverage, _LEAST_FREE, 1.0))[:, None]
        n, factors = self.driven.poles.size, self._coefficients * scale**2
        own = np.ascontiguousarray(np.moveaxis(steep.reshape(len(steep), -1, n, 2), -1, 0))
        score = np.empty((*own.shape[1:], 2))
        for part in (0, 1):
            along = [(restored @ factors[:, part, q].T)[:, None] for q in (0, 1)]
            score[..., part] = own[0] * along[0] + own[1] * along[1]  # einsum takes ten times
        lines = score.reshape(n_forces, 2, height // 2, -1).sum(axis=1)
        return np.asarray(lines @ self.transform)

    def worth(self) -> Real:
        """What χ² would be more without each mode, all other shapes found again, (n_modes,)."""
        weighted = self.shapes * self.problem.scale[:, None]
        parts = np.stack([weighted.real, weighted.imag], axis=1)
        n = self.driven.poles.size
        own = self.unscaled.reshape(n, 2, n, 2)[np.arange(n), :, np.arange(n)]
        inner = np.linalg.pinv(own, hermitian=True)
        return np.asarray(np.einsum("iqk,kqs,isk->k", parts, inner, parts))

    def near(self) -> tuple[Real, Real]:
        """χ² of what was measured, and of what is left beyond noise, in each resonance."""
        (measured, left), scale = np.zeros((2, self.driven.poles.size)), self.problem.scale
        start = 0
        for r, force in enumerate(self.problem.forces):
            omega = force.lines.omega
            stop = start + 2 * omega.size
            values = (np.abs(force.lines.values * force.lines.weight * scale[:, None]) ** 2).sum(0)
            rest = ((self.misfit[start:stop] * scale) ** 2).sum(1).reshape(2, -1).sum(0)
            rest = rest - 2 * scale.size * force.lines.importance**2
            for k, pole in enumerate(self.driven.at(r)):
                distance = np.abs(1j * omega - pole)
                lines = distance <= max(_RESONANCE * -pole.real, float(distance.min()))
                measured[k] += values[lines].sum()
                left[k] += rest[lines].sum()
            start = stop
        return measured, left

    def chance(self, correlation: float) -> Real:
        """Probability that noise alone is worth as much as each mode."""
        size = self.worth() / (correlation * max(self.reduced, np.finfo(float).eps))
        return np.asarray(scipy.special.chdtrc(2 * self.problem.scale.size, size))
