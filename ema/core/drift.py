"""Drift: the state of the tyre in each run against that in the first."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.core.numerics import ReadonlyArrays

# Runs that second differences need.
_FEWEST_RUNS = 4
_NOTHING = np.zeros(0)
# The law of a drift is carried on down to this share of its middle, about where the orders of a
# ring end. At a rim's mode at 31 Hz it would be 34 % for orders that moved by 0.1 %.
_LOWEST = 0.5
LONGEST_LEVER = 1 / _LOWEST**2 - 1


def lever_at(frequency_hz: float | NDArray[np.float64], middle_hz: float) -> NDArray[np.float64]:
    """Lever of the law of a drift, (middle_hz/f)² − 1, no longer than `LONGEST_LEVER`."""
    return np.asarray((middle_hz / np.maximum(frequency_hz, _LOWEST * middle_hz)) ** 2 - 1)


@dataclass(frozen=True, eq=False)
class Drift(ReadonlyArrays):
    """How far the natural frequencies of each run are from those of the first, (n_runs,).

    The shift at a frequency f is quadratic in its lever, see `lever_at`: pressure moves high
    orders more than low ones.
    """

    run: tuple[str, ...]  # in the order of the campaign; empty where there is nothing to compare
    percent: NDArray[np.float64]  # shift at `middle_hz`, and its standard deviation
    std_percent: NDArray[np.float64]
    slope_percent: NDArray[np.float64]  # shift over the lever, and over its square
    curvature_percent: NDArray[np.float64]
    damping_percent: NDArray[np.float64]  # change of damping ratios, and its standard deviation
    damping_std_percent: NDArray[np.float64]
    middle_hz: float = 100.0
    applied: bool = True  # whether it is more than chance: each run was fitted in its own state
    chance: float = float("nan")  # probability of shifts as large from noise alone
    number: tuple[int, ...] = ()  # place of each run in the campaign; else one after the other

    @property
    def states(self) -> NDArray[np.float64]:
        """Shift, slope, curvature and change of damping of each run as fractions, (n_runs, 4)."""
        shift = (self.percent, self.slope_percent, self.curvature_percent)
        return np.stack([*shift, self.damping_percent], axis=1) / 100

    def at(self, frequency_hz: float | NDArray[np.float64]) -> NDArray[np.float64]:
        """Shift of each run at a frequency in percent, (n_runs,); of several, (n, 1), in rows."""
        lever = lever_at(frequency_hz, self.middle_hz)
        return np.asarray(
            self.percent + lever * self.slope_percent + lever**2 * self.curvature_percent
        )

    def is_as(self, before: Drift) -> bool:
        """Whether the runs are in the states found `before`, within the ± of this drift."""
        if not (self.applied and before.applied):
            return self.applied == before.applied
        away = np.abs(self.states - before.states)[:, [0, 3]]
        std = np.stack([self.std_percent, self.damping_std_percent], axis=1) / 100
        return bool(np.all(away <= std))

    def at_states_of(self, before: Drift) -> Drift:
        """The states found `before`, where they are applied, with evidence and ± of this drift."""
        if not self.applied:
            return self
        own = self.std_percent, self.damping_std_percent
        return replace(before, std_percent=own[0], damping_std_percent=own[1], chance=self.chance)

    def unsteadiness(self, frequency_hz: float) -> tuple[float, float]:
        """Standard deviation of a run's state from the slow change of all, both relative.

        Of a frequency and of the damping ratios, from how far each run is from a line through its
        neighbours (von Neumann 1941): what goes up and down from run to run is an error of the
        states; 0 with fewer than four runs.
        """
        if not self.applied or len(self.run) < _FEWEST_RUNS:
            return 0.0, 0.0
        states = np.array([self.at(frequency_hz), self.damping_percent])
        steps = np.diff(self.number or range(len(self.run)))
        later = steps[:-1] / (steps[:-1] + steps[1:])  # weight of the next run
        beside = (1 - later) * states[:, :-2] + later * states[:, 2:]
        variance = (states[:, 1:-1] - beside) ** 2 / (1 + (1 - later) ** 2 + later**2)
        away = np.sqrt(np.mean(variance, axis=1)) / 100
        return float(away[0]), float(away[1])

    @property
    def std_of_mean(self) -> tuple[float, float]:
        """Standard deviation of the runs' mean state against the first, both relative.

        Of frequencies and of damping ratios; all runs are compared with the same first one.
        """
        if not self.applied or not self.run:
            return 0.0, 0.0
        std = self.std_percent, self.damping_std_percent
        return float(np.mean(std[0])) / 100, float(np.mean(std[1])) / 100

    @property
    def left_out(self) -> tuple[float, float]:
        """Mean state of the runs against the first, as found but not applied, both relative.

        Shifts too small to be told from chance draw the mean of the runs, which is stated, away
        from the first one.
        """
        if self.applied or not self.run:
            return 0.0, 0.0
        return float(np.mean(self.percent)) / 100, float(np.mean(self.damping_percent)) / 100

    def poles_in(self, run: str, poles: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Poles in the state of a run."""
        if not self.applied or run not in self.run:
            return poles
        shift, slope, curvature, damping = self.states[self.run.index(run)]
        lever = lever_at(np.abs(poles) / (2 * np.pi), self.middle_hz)
        factor = 1 + shift + slope * lever + curvature * lever**2
        return np.asarray(poles.real * (factor + damping) + 1j * poles.imag * factor)


def of_runs(drift: Drift, run: tuple[str, ...]) -> Drift:
    """The drift of some of the runs, against the first of those."""
    rows = [drift.run.index(name) for name in run]

    def left(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(values[rows] - values[rows[0]])

    return replace(
        drift,
        run=run,
        number=tuple(drift.number[k] for k in rows) if drift.number else tuple(rows),
        percent=left(drift.percent),
        std_percent=drift.std_percent[rows],
        slope_percent=left(drift.slope_percent),
        curvature_percent=left(drift.curvature_percent),
        damping_percent=left(drift.damping_percent),
        damping_std_percent=drift.damping_std_percent[rows],
        applied=len(run) > 1,
    )


NO_DRIFT = Drift((), _NOTHING, _NOTHING, _NOTHING, _NOTHING, _NOTHING, _NOTHING, applied=False)
