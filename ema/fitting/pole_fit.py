"""Bounded pole fit, with one state of the tyre or one per run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.drift import LONGEST_LEVER, lever_at
from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.settings import IdentificationSettings
from ema.fitting.variable_projection import Complex, Projection, Real, descend, project, stacked
from ema.poles.estimators import widened_band
from ema.signals.leakage import noise_level

_NOTHING_LEFT = 1e-4  # of χ²
# Bounds of a drift: of frequency, its slope and curvature, of damping beside that.
_LARGEST_DRIFT = (0.03, 0.05, 0.05, 0.3)
_SMALL_DRIFT = (1e-3, 1e-3, 1e-3, 1e-2)
_FACTORS = 0.5, 2.0  # far below the orders the law of a drift would make poles grow
N_DRIFT = 4
_ALIKE = 0.1  # share by which the members of a pair differ in their decay rate, about
#: The last poles of a fit stand for modes above the lines.
N_STAND_INS = 2
_STAND_IN_DAMPING = 0.02
# What lies beyond the lines disturbs those next to it: their weight falls to this at the ends.
_END_WEIGHT = 0.05
# Frequencies stay above this share of their start, however broad the pole: none becomes negative.
_LEAST_FREQUENCY = 0.1


@dataclass(frozen=True, eq=False)
class Lines:
    """What is fitted: lines of all positions and their weights.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
    values : ndarray of complex, shape (n_positions, n_frequencies)
        Inertances.
    weight : ndarray, shape (n_frequencies,)
        1/σ over frequency, shared by the positions.
    scale : ndarray, shape (n_positions,)
        Weight of each position beside the common one.
    run : ndarray of int, shape (n_positions,)
        Run each position was measured in, 0 … n_runs − 1.
    importance : ndarray, shape (n_frequencies,)
        What `weight` holds beside 1/σ: 1 in the band, less towards the ends of the margins.
    """

    frequency_hz: Real
    values: Complex
    weight: Real
    scale: Real
    run: NDArray[np.int_]
    importance: Real

    @cached_property
    def target(self) -> Real:
        """Weighted values as real columns, (2 n_frequencies, n_positions)."""
        return stacked(self.values, self.weight)

    @cached_property
    def power(self) -> Real:
        """Sum of squares of each column of `target`."""
        return np.asarray(np.sum(self.target**2, axis=0))

    @property
    def omega(self) -> Real:
        """Lines in rad/s."""
        return np.asarray(2 * np.pi * self.frequency_hz)

    @property
    def n_runs(self) -> int:
        """Number of runs."""
        return int(self.run.max()) + 1

    @property
    def middle_hz(self) -> float:
        """Middle of the upper four fifths of the lines, where the drift is stated."""
        return float(
            np.sqrt(max(self.frequency_hz[0], 0.2 * self.frequency_hz[-1]) * self.frequency_hz[-1])
        )

    def lever(self, poles: Complex) -> Real:
        """What a change of the foundation moves more than the middle: (f_middle/f)² − 1."""
        return lever_at(np.abs(poles) / (2 * np.pi), self.middle_hz)

    def drift_factors(self, poles: Complex, drift: Real) -> tuple[Real, Real]:
        """Factors of frequencies and of decay rates in a drifted state, none beyond two."""
        lever = self.lever(poles)
        shift = np.clip(1 + drift[0] + drift[1] * lever + drift[2] * lever**2, *_FACTORS)
        return shift, np.clip(shift + drift[3], *_FACTORS)

    def drifted(self, poles: Complex, drift: Real) -> Complex:
        """Poles in another state of the tyre.

        Tension moves a frequency by 1 − φ and the foundation by φ times its own change, φ being
        the foundation's share of ω², which falls nearly like 1/ω² from order to order; what it
        falls otherwise (mass and circumferential stiffness at n = 1) is left to a curvature.

        Parameters
        ----------
        poles : ndarray of complex
        drift : ndarray, shape (4,)
            Shift of frequencies at `middle_hz`, its slope and curvature along `lever`, and
            relative change of the decay rates beside it.
        """
        shift, decay = self.drift_factors(poles, drift)
        return np.asarray(poles.real * decay + 1j * poles.imag * shift)


@dataclass(frozen=True, eq=False)
class PoleFit:
    """Fitted poles of the first run's state, and what each group of positions says.

    Parameters
    ----------
    lines : Lines
    poles : ndarray of complex, shape (n_modes,)
        rad/s, in the state of the first run.
    drift : ndarray, shape (n_groups, 4)
        State of each group against the first, see `Lines.drifted`; the first is 0.
    groups : tuple of ndarray of int
        Positions of each group: all together, or run by run.
    parts : tuple of Projection
        Linear solution of each group.
    at_bound : ndarray of bool, shape (2 n_modes,)
        Decay rates and frequencies that ended on a bound, mode by mode.
    pairs : tuple of (int, int)
        Poles that are members of one pair, and therefore damped alike.
    locked : tuple of int
        Poles that stay where they are: nothing depends on them, and they have no uncertainty.
    """

    lines: Lines
    poles: Complex
    drift: Real
    groups: tuple[NDArray[np.int_], ...]
    parts: tuple[Projection, ...]
    at_bound: NDArray[np.bool_]
    pairs: tuple[tuple[int, int], ...] = ()
    locked: tuple[int, ...] = ()

    @property
    def n_parameters(self) -> int:
        """Nonlinear parameters: two per pole and the drift of each group but the first."""
        return 2 * self.poles.size + N_DRIFT * (len(self.groups) - 1)

    def in_run(self, number: int) -> Complex:
        """Poles in the state of a run."""
        return self.lines.drifted(self.poles, self.drift[number if len(self.drift) > 1 else 0])

    @property
    def residues(self) -> Complex:
        """Residues of all positions, (n_positions, n_modes)."""
        return self._gathered(lambda part: part.residues)

    @property
    def lower(self) -> Real:
        """Residual terms L, (n_positions,)."""
        return self._gathered(lambda part: part.lower)

    @property
    def upper(self) -> Real:
        """Residual terms U, (n_positions,)."""
        return self._gathered(lambda part: part.upper)

    @property
    def noise(self) -> Real:
        """RMS of each position's weighted residuals, (n_positions,)."""
        return self._gathered(lambda part: np.sqrt(np.mean(part.misfit**2, axis=0)))

    @cached_property
    def chi_square(self) -> float:
        """Weighted sum of squared residuals."""
        scale, power = self.lines.scale, self.lines.power
        return sum(
            part.chi_square(power[rows], scale[rows])
            for part, rows in zip(self.parts, self.groups, strict=True)
        )

    @cached_property
    def cost(self) -> float:
        """What the search makes small: `chi_square` and the squares of `unlikeness`."""
        return self.chi_square + float(np.sum(self.unlikeness**2))

    @property
    def misfit(self) -> float:
        """Reduced χ², 1 where the residuals are as large as the noise."""
        n_data = 2 * self.lines.scale.size * float(np.sum(self.lines.importance**2))
        n_linear = self.lines.scale.size * (2 * self.poles.size + 2)
        return self.chi_square / max(n_data - n_linear - self.n_parameters, 1)

    def transform(self, group: int) -> Real:
        """Derivative of a group's (Re s, Im s) to all parameters, (2 n_modes, n_parameters)."""
        n = 2 * self.poles.size
        matrix = np.zeros((n, self.n_parameters))
        drift, real, imag = self.drift[group], self.poles.real, self.poles.imag
        shift, decay = self.lines.drift_factors(self.poles, drift)
        lever = self.lines.lever(self.poles)
        steep = (drift[1] + 2 * drift[2] * lever) * (lever < LONGEST_LEVER)
        steep *= -2 * (2 * np.pi * self.lines.middle_hz) ** 2 / np.abs(self.poles) ** 4
        first, second = np.arange(0, n, 2), np.arange(1, n, 2)
        matrix[first, first] = decay + steep * real**2
        matrix[first, second] = matrix[second, first] = steep * real * imag
        matrix[second, second] = shift + steep * imag**2
        matrix[:, _parameters_of(self.locked)] = 0.0
        if group:
            own = n + N_DRIFT * (group - 1)
            whole = _interleaved(self.poles)
            for power in (0, 1, 2):
                matrix[:, own + power] = np.repeat(lever, 2) ** power * whole
            matrix[0::2, own + 3] = real
        return matrix

    @cached_property
    def transforms(self) -> tuple[Real, ...]:
        """`transform` of each group."""
        return tuple(map(self.transform, range(len(self.groups))))

    def normal_matrix(self) -> Real:
        """JᵀJ of all parameters."""
        total = np.zeros((self.n_parameters, self.n_parameters))
        for t, part, rows in zip(self.transforms, self.parts, self.groups, strict=True):
            total += t.T @ part.normal_matrix(self.lines.scale[rows]) @ t
        slope = self.likeness_slope()
        return np.asarray(total + slope.T @ slope)

    def gradient(self) -> Real:
        """Jᵀr of all parameters."""
        total = np.zeros(self.n_parameters)
        for t, part, rows in zip(self.transforms, self.parts, self.groups, strict=True):
            total += t.T @ part.gradient(self.lines.scale[rows])
        return np.asarray(total + self.likeness_slope().T @ self.unlikeness)

    @property
    def unlikeness(self) -> Real:
        """How unlike the members of each pair are damped, in standard deviations of `_ALIKE`."""
        first, second = np.array(self.pairs, dtype=int).reshape(-1, 2).T
        return np.asarray(np.log(self.poles[first].real / self.poles[second].real) / _ALIKE)

    def likeness_slope(self) -> Real:
        """Derivative of `unlikeness` to all parameters, (n_pairs, n_parameters)."""
        slope = np.zeros((len(self.pairs), self.n_parameters))
        for row, (first, second) in enumerate(self.pairs):
            slope[row, 2 * first] = 1 / (_ALIKE * self.poles[first].real)
            slope[row, 2 * second] = -1 / (_ALIKE * self.poles[second].real)
        slope[:, _parameters_of(self.locked)] = 0.0
        return slope

    def _gathered(self, of: Callable[[Projection], NDArray[Any]]) -> NDArray[Any]:
        pieces = [of(part) for part in self.parts]
        whole = np.empty((self.lines.scale.size, *pieces[0].shape[1:]), dtype=pieces[0].dtype)
        for piece, rows in zip(pieces, self.groups, strict=True):
            whole[rows] = piece
        return whole


def evaluate(
    lines: Lines,
    poles: Complex,
    drift: Real,
    pairs: tuple[tuple[int, int], ...] = (),
    locked: tuple[int, ...] = (),
) -> PoleFit:
    """Solve the linear problem of each group for given poles and drift.

    A single row of drift puts all positions into one group.
    """
    groups: tuple[NDArray[np.int_], ...] = (np.arange(lines.scale.size),)
    targets = [lines.target]
    if len(drift) > 1:
        groups = tuple(np.flatnonzero(lines.run == number) for number in range(len(drift)))
        targets = [lines.target[:, rows] for rows in groups]
    parts = tuple(
        project(lines.omega, target, lines.weight, lines.drifted(poles, shift))
        for target, shift in zip(targets, drift, strict=True)
    )
    nowhere = np.zeros(2 * poles.size, dtype=bool)
    return PoleFit(lines, poles, drift, groups, parts, nowhere, pairs, locked)


def fit_poles(
    lines: Lines,
    start: Complex,
    lower: Real,
    upper: Real,
    drift: Real | None = None,
    *,
    pairs: tuple[tuple[int, int], ...] = (),
    locked: tuple[int, ...] = (),
    tries: int = 60,
) -> PoleFit:
    """Poles within bounds that leave the smallest weighted misfit over all positions.

    Parameters
    ----------
    lines : Lines
    start : ndarray of complex, shape (n_modes,)
        Poles from the stability diagram.
    lower, upper : ndarray, shape (2 n_modes,)
        Bounds of (decay rate −Re s, frequency Im s), mode by mode, in rad/s.
    drift : ndarray, shape (n_runs, 4), optional
        Start values of the drift from run to run; without it the runs share one state.
    pairs : tuple of (int, int)
        Poles that are members of one pair. Turning a tyre turns its modes, so that the members
        differ in frequency but hardly in damping: that they are alike within 10 % (one standard
        deviation) counts as much as any measured value, and helps where one is hardly driven.
    locked : tuple of int
        Poles that stay where they start.
    tries : int
        Most steps of the search.

    Raises
    ------
    FitError
        If the fit diverges.
    """
    n, decay = 2 * start.size, slice(0, 2 * start.size, 2)
    shifts = np.zeros(0) if drift is None else (drift[1:] - drift[0]).ravel()
    n_moving = shifts.size // N_DRIFT
    low, high = lower.copy(), upper.copy()
    low[decay], high[decay] = -upper[decay], -lower[decay]  # the search moves Re s itself
    widths = np.clip(-start.real, lower[decay], upper[decay])
    reach = np.tile(_LARGEST_DRIFT, n_moving)

    def at(x: Real) -> PoleFit:
        poles = x[0:n:2] + 1j * x[1:n:2]
        poles[list(locked)] = start[list(locked)]
        return evaluate(lines, poles, _states(x[n:]), pairs, locked)

    x, found = descend(
        at,
        np.concatenate([_interleaved(start), shifts]),
        np.concatenate([low, -reach]),
        np.concatenate([high, reach]),
        size=np.concatenate([np.repeat(widths, 2), np.tile(_SMALL_DRIFT, n_moving)]),
        # χ² is of the order of the number of values: what is left to gain is far below 1.
        gain=_NOTHING_LEFT / lines.values.size,
        tries=tries,
    )
    if not np.all(np.isfinite(x)):
        raise FitError("the curve fit diverged. Pin the frequencies or narrow the band.")
    near = 1e-3 * (high - low)
    bound = (x[:n] - low < near) | (high - x[:n] < near)
    bound[_parameters_of(locked)] = False
    return replace(found, at_bound=bound)


def _states(shifts: Real) -> Real:
    """Drift of all groups, that of the first being 0."""
    return np.vstack([np.zeros(N_DRIFT), shifts.reshape(-1, N_DRIFT)])


def _parameters_of(poles: tuple[int, ...]) -> NDArray[np.int_]:
    return np.ravel([(2 * k, 2 * k + 1) for k in poles]).astype(int)


def _interleaved(poles: Complex) -> Real:
    return np.ravel(np.column_stack([poles.real, poles.imag]))


# Free poles just above the lines stand for all modes farther up: two residual terms alone cost
# 0.6 % of damping in the lowest mode of a tyre. Each pole has a range of its own: in one place they
# reach less far up, and twelve sensors see order 11 like order 1, different from run to run like a
# drift (benchmarks/laboratory.py). A third one costs more in noise than it gives.
_STAND_INS, _STAND_IN_REACH = (1.04, 1.2), ((1.002, 1.1), (1.1, 1.6))


def lines_to_fit(frf: FRF, band_hz: tuple[float, float]) -> Lines:
    """Lines of the band and a margin, with weights from their noise."""
    chosen = widened_band(frf, band_hz)
    level = noise_level(frf, chosen)
    common = np.exp(np.mean(np.log(level), axis=0))
    own = np.exp(np.mean(np.log(level / common), axis=1))
    names = frf.run_names
    run = np.array([names.index(name) for name in frf.run])
    frequency_hz = frf.frequency_hz[chosen]
    importance = _importance(frequency_hz, band_hz)
    return Lines(frequency_hz, frf.values[:, chosen], importance / common, 1 / own, run, importance)


def _importance(
    frequency_hz: NDArray[np.float64], band_hz: tuple[float, float]
) -> NDArray[np.float64]:
    """Weight 1 in the band, falling along the margins on either side."""
    low, high = frequency_hz[[0, -1]]
    below = (band_hz[0] - frequency_hz) / max(band_hz[0] - low, 1e-12)
    above = (frequency_hz - band_hz[1]) / max(high - band_hz[1], 1e-12)
    outside = np.clip(np.maximum(below, above), 0, 1)
    return np.asarray(_END_WEIGHT ** (outside**2))


def starting_poles(
    poles: NDArray[np.complex128], lines: Lines, band_hz: tuple[float, float]
) -> NDArray[np.complex128]:
    """Poles that the lines show on both sides, and the stand-in for everything above."""
    frequency_hz = np.abs(poles) / (2 * np.pi)
    low, high = lines.frequency_hz[[0, -1]]
    half_width_hz = -poles.real / (2 * np.pi)
    in_band = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    shown = (frequency_hz - low > half_width_hz) & (high - frequency_hz > half_width_hz)
    if not np.any(in_band):
        none = f"no pole between {band_hz[0]:g} and {band_hz[1]:g} Hz to start the curve fit from"
        raise FitError(f"{none}. Pin frequencies or change the band.")
    return with_stand_ins(poles[in_band | shown], lines)


def with_stand_ins(poles: NDArray[np.complex128], lines: Lines) -> NDArray[np.complex128]:
    """Poles and, at the end, start values of those that stand for all modes above the lines."""
    omega = 2 * np.pi * lines.frequency_hz[-1] * np.array(_STAND_INS)
    return np.append(poles, omega * (-_STAND_IN_DAMPING + 1j))


def fit_bounded(
    lines: Lines,
    start: NDArray[np.complex128],
    settings: IdentificationSettings,
    drift: NDArray[np.float64] | None = None,
    around: NDArray[np.complex128] | None = None,
    pairs: tuple[tuple[int, int], ...] = (),
    locked: tuple[int, ...] = (),
    tries: int = 60,
) -> PoleFit:
    """Fit poles within the bounds that suit start values from a stability diagram.

    A fit that goes on from an earlier one keeps its bounds `around` the diagram's poles.
    """
    lower, upper = _bounds(start if around is None else around, lines.frequency_hz[-1], settings)
    return fit_poles(lines, start, lower, upper, drift, pairs=pairs, locked=locked, tries=tries)


def _bounds(
    start: NDArray[np.complex128], highest_hz: float, settings: IdentificationSettings
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    decay, frequency = -start.real, start.imag
    reach = np.maximum(settings.frequency_reach, decay / frequency) * frequency
    low = np.maximum(frequency - reach, _LEAST_FREQUENCY * frequency)
    lower = np.column_stack([decay / settings.damping_reach, low])
    upper = np.column_stack([decay * settings.damping_reach, frequency + reach])
    stand_ins = slice(-len(_STAND_INS), None)
    reach_hz = highest_hz * np.array(_STAND_IN_REACH).T
    lower[stand_ins, 1], upper[stand_ins, 1] = 2 * np.pi * reach_hz
    return lower.ravel(), upper.ravel()
