"""Poles of a structure that several forces drive, each force in a proportion of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.fitting.pole_fit import Lines
from ema.fitting.variable_projection import Complex, Real, in_parts

# Poles within so many half-widths share one.
_SHARED = 1.0


@dataclass(frozen=True, eq=False)
class Driven:
    """Poles, and how each force drives them.

    Parameters
    ----------
    poles : ndarray of complex, shape (n_modes,)
        rad/s, in the state at the first force.
    participation : ndarray of complex, shape (n_modes, n_forces)
        The largest of each mode is 1.
    states : ndarray, shape (n_forces, 2)
        Relative change of frequencies and of decay rates since the first force.
    """

    poles: Complex
    participation: Complex
    states: Real

    def at(self, force: int) -> Complex:
        """Poles in the state at a force."""
        shift, decay = self.states[force]
        return np.asarray(
            self.poles.real * (1 + shift + decay) + 1j * self.poles.imag * (1 + shift)
        )

    def without(self, dropped: NDArray[np.bool_]) -> Driven:
        """The others."""
        return Driven(self.poles[~dropped], self.participation[~dropped], self.states)

    @property
    def planes(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """First mode of each pole, and which of these poles each mode has."""
        return np.unique(self.poles, return_index=True, return_inverse=True)[1:]

    def scaled(self) -> tuple[Driven, NDArray[np.bool_]]:
        """With participations of which one is 1, and which of them are free.

        Modes of one pole have a plane of shapes: as many forces as modes say no more of it.
        """
        participation, free = self.participation.copy(), np.ones(self.participation.shape, bool)
        first, tied = self.planes
        for pole in range(first.size):
            group = np.flatnonzero(tied == pole)
            given = scipy.linalg.qr(participation[group], mode="r", pivoting=True)[1][: group.size]
            free[np.ix_(group, given)] = False
            largest = np.argmax(np.abs(participation[group]), axis=1)
            participation[group] /= participation[group, largest][:, None]
        return Driven(self.poles, participation, self.states), free

    @property
    def numbers(self) -> Real:
        """Frequency in Hz and damping ratio, (n_modes, 2)."""
        size = np.abs(self.poles)
        return np.column_stack([size / (2 * np.pi), -self.poles.real / size])

    @property
    def shared(self) -> NDArray[np.bool_]:
        """Which poles share a resonance, each with itself too, (n_modes, n_modes)."""
        reach = _SHARED * np.minimum.outer(-self.poles.real, -self.poles.real)
        near = np.abs(self.poles[:, None] - self.poles) < reach
        return np.asarray(near | np.eye(self.poles.size, dtype=bool))

    def functions(self, lines: Lines, force: int) -> Real:
        """What complex factors add to weighted FRFs where a force drives all modes alike.

        (2 n_lines, 4 n_modes): slopes to the poles, then the modes themselves.
        """
        poles = self.at(force)[:, None]
        away = np.asarray(1 / (1j * lines.omega - np.array([poles, poles.conj()])), dtype=complex)
        alone = -(lines.omega**2) * lines.weight * away
        rows = np.empty((4 * poles.size, 2 * lines.omega.size))
        in_parts(alone * away, rows[: 2 * poles.size])
        in_parts(alone, rows[2 * poles.size :])
        return rows.T

    def waves(self, lines: Lines, force: int) -> Real:
        """What real and imaginary parts of shapes add to weighted FRFs, (2 n_lines, 2 n_modes)."""
        own = self.functions(lines, force)[:, 2 * self.poles.size :]
        return np.asarray(self.driving(own.T, force).T)

    def driving(self, rows: Real, force: int) -> Real:
        """What factors of participations and shapes have, from what those of both have together.

        (2 n_modes, …), real and imaginary part of each mode one after the other.
        """
        shape = (-1, *[1] * (rows.ndim - 1))
        drive, turned = self.participation[:, force].reshape(shape), np.empty_like(rows)
        turned[0::2] = drive.real * rows[0::2] + drive.imag * rows[1::2]
        turned[1::2] = drive.real * rows[1::2] - drive.imag * rows[0::2]
        return turned
