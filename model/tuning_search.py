"""The search behind a tuning: what is free, within which bounds, from which starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls

from model.arrays import readonly
from model.errors import ParameterError
from model.parameters import LARGEST_THICKNESS_RATIO, RingParameters
from model.tuning_problem import (
    AXIAL,
    BENDING,
    CIRCUMFERENTIAL,
    MASS,
    PARAMETERS,
    RADIAL,
    TYPICAL_GROWTH,
    TuningProblem,
)

#: Sizes of a passenger-car tyre: they scale the search and stand in for what is left open.
TYPICAL = {MASS: 20.0, RADIAL: 8e6, CIRCUMFERENTIAL: 1e6, BENDING: 8.0}
#: What is assumed, in this sequence, where there are fewer frequencies than unknowns: D first, it
#: moves frequencies least.
FIRST_ASSUMED = (BENDING, MASS)

_START_MASSES = (6.0, 12.0, 20.0, 45.0)
_AT_BOUND = 1e-4  # distance to a bound, over the parameter's scale, that counts as on it
# The search ends where a step gains less than this share of χ², or moves less than this share.
_COST_TOLERANCE, _STEP_TOLERANCE = 1e-14, 1e-9
_MOST_EVALUATIONS = 500


@dataclass(frozen=True, eq=False)
class Search:
    """Free parameters of a tuning with their bounds, and the values of the others.

    Parameters
    ----------
    problem : TuningProblem
        What is asked.
    free : tuple of str
        Parameters to find.
    assumed : dict of str to float
        Parameters that too few frequencies leave open, at assumed values.
    scale, lower, upper : ndarray, shape (n_free,)
        Typical size and bounds.
    """

    problem: TuningProblem
    free: tuple[str, ...]
    assumed: dict[str, float]
    scale: NDArray[np.float64]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("scale", "lower", "upper"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    def ring(self, values: NDArray[np.float64]) -> RingParameters:
        """Ring with the free parameters at `values`."""
        found = dict(zip(self.free, map(float, values), strict=True))
        return self.problem.ring({**self.problem.given, **self.assumed, **found})

    def residual_slope(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Slopes of the residuals over the free parameters, central, shape (n_orders, n_free)."""
        columns = []
        for step in np.diag(1e-5 * self.scale):
            ahead = np.minimum(values + step, self.upper)
            behind = np.maximum(values - step, self.lower)
            rise = self.problem.residual(self.ring(ahead)) - self.problem.residual(
                self.ring(behind)
            )
            columns.append(rise / (ahead - behind).sum())
        return np.column_stack(columns)

    def at_bound(self, values: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which free parameters lie on a bound."""
        return self._near(values, self.lower) | self._near(values, self.upper)

    def run(self) -> tuple[NDArray[np.float64], str]:
        """Search from every start.

        Returns
        -------
        values : ndarray, shape (n_free,)
            The best solution; a parameter within reach of a bound is put on it.
        note : str
            How many starts ended there, as a sentence.
        """
        starts = self._starts()
        solutions = [self._descend(start) for start in starts]
        cost = np.array([self._cost(values) for values in solutions])
        values = solutions[int(np.argmin(cost))]
        for bound in (self.lower, self.upper):
            values = np.where(self._near(values, bound), bound, values)
        agreeing = int(np.sum(cost <= 1.01 * cost.min() + 1e-12 * self._size() ** 2))
        return values, f"{agreeing} of {len(starts)} starting points led to this solution."

    def _descend(self, start: NDArray[np.float64]) -> NDArray[np.float64]:
        size = self._size()
        found = least_squares(
            lambda x: self.problem.residual(self.ring(x * self.scale)) / size,
            start / self.scale,
            lambda x: self.residual_slope(x * self.scale) * self.scale / size,
            (self.lower / self.scale, self.upper / self.scale),
            x_scale="jac",
            ftol=_COST_TOLERANCE,
            xtol=_STEP_TOLERANCE,
            gtol=_COST_TOLERANCE,
            max_nfev=_MOST_EVALUATIONS,
        )
        return np.asarray(np.clip(found.x * self.scale, self.lower, self.upper))

    def _cost(self, values: NDArray[np.float64]) -> float:
        return float(np.sum(self.problem.residual(self.ring(values)) ** 2))

    def _size(self) -> float:
        """Residual that a relative frequency error of one would leave; scales eq 18 to one."""
        middle = self._starts()[0]
        return float(np.abs(self.problem.data_slope(self.ring(middle))).max())

    def _near(self, values: NDArray[np.float64], bound: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.abs(values - bound) <= _AT_BOUND * self.scale

    def _starts(self) -> list[NDArray[np.float64]]:
        """Starting points inside the bounds: the user's, then linear solutions."""
        guesses = [_linear_solution(self, mass) for mass in (None, *_START_MASSES)]
        if self.problem.start:
            guesses.insert(0, guesses[0] | dict(self.problem.start))
        margin = np.minimum(1e-2 * self.scale, 0.25 * (self.upper - self.lower))
        inside = [np.array([guess[name] for name in self.free]) for guess in guesses]
        return [np.clip(point, self.lower + margin, self.upper - margin) for point in inside]


def plan_search(problem: TuningProblem) -> Search:
    """Decide what is free and within which bounds.

    Raises
    ------
    ParameterError
        Where nothing is left to find, frequencies are too few, or bounds cross.
    """
    open_ones = [name for name in PARAMETERS if name not in problem.given and name != AXIAL]
    if AXIAL not in problem.given and 0 in problem.orders:
        open_ones.append(AXIAL)
    assumed: dict[str, float] = {}
    for name in FIRST_ASSUMED:
        if len(open_ones) > problem.orders.size and name in open_ones:
            open_ones.remove(name)
            assumed[name] = problem.start.get(name, TYPICAL[name])
    _require_enough(problem, open_ones)
    typical = TYPICAL | {AXIAL: _typical_axial(problem)}
    box = _default_bounds(problem) | dict(problem.bounds)
    lower, upper = (np.array([box[name][side] for name in open_ones]) for side in (0, 1))
    for name, low, high in zip(open_ones, lower, upper, strict=True):
        if not 0 <= low < high:
            raise ParameterError(
                f"bounds of {name}", f"({low:g}, {high:g})", "0 ≤ lower < upper", "Correct them"
            )
    scale = np.array([typical[name] for name in open_ones])
    return Search(problem, tuple(open_ones), assumed, scale, lower, upper)


def _require_enough(problem: TuningProblem, open_ones: list[str]) -> None:
    if not open_ones:
        raise ParameterError(
            "given", "every parameter", "nothing is left to tune", "Leave one parameter out"
        )
    if problem.orders.size < len(open_ones):
        raise ParameterError(
            "frequencies_hz",
            f"{problem.orders.size} values",
            f"fewer than the unknowns {', '.join(open_ones)}",
            "Measure more orders or give more parameters",
        )


def _typical_axial(problem: TuningProblem) -> float:
    return problem.inflation_pressure_pa * problem.mean_radius_m / TYPICAL_GROWTH


def _default_bounds(problem: TuningProblem) -> dict[str, tuple[float, float]]:
    """Bounds within which every ring is a valid one, far beyond any tyre."""
    axial = _typical_axial(problem)
    stiffest_bed = 0.9 * problem.inflation_pressure_pa / problem.growth_m  # eq 16 keeps K positive
    softest_belt = min(problem.given.get(AXIAL, np.inf), 0.1 * axial)
    if AXIAL not in problem.given and 0 not in problem.orders:
        softest_belt = min(softest_belt, problem.axial_stiffness_n_m(stiffest_bed))
    thickness = LARGEST_THICKNESS_RATIO * problem.mean_radius_m
    return {
        MASS: (0.5, 500.0),
        RADIAL: (0.0, stiffest_bed),
        CIRCUMFERENTIAL: (0.0, 1e9),
        AXIAL: (0.1 * axial, 1e3 * axial),
        BENDING: (0.0, 0.99 * softest_belt * thickness**2 / 12.0),
    }


def _linear_solution(search: Search, mass: float | None) -> dict[str, float]:
    """Parameters by linear least squares, for a free or an assumed mass.

    For an inextensible belt (eq 33) eq 14 is linear in the parameters:
    ω²(n² + 1)·ρh − n²(n² − 1)²·D/a⁴ − n²·k_r − k_θ = (p_o/a)(n² − 1)².
    """
    problem = search.problem
    used = problem.orders > 0
    n2 = problem.orders[used].astype(float) ** 2
    inertia = (2.0 * np.pi * problem.measured_hz[used]) ** 2 * (n2 + 1.0)
    tension = problem.inflation_pressure_pa / problem.mean_radius_m * (n2 - 1.0) ** 2
    if problem.pressure_load == "follower":
        tension = tension + problem.inflation_pressure_pa / problem.mean_radius_m * (n2 - 1.0)
    columns = {
        MASS: inertia,
        RADIAL: -n2,
        CIRCUMFERENTIAL: -np.ones(n2.size),
        BENDING: -n2 * (n2 - 1.0) ** 2 / problem.mean_radius_m**4,
    }
    known = {**problem.given, **search.assumed}
    if mass is not None:
        known.setdefault(MASS, mass)
    wanted = [name for name in columns if name not in known]
    right = tension - sum(columns[name] * value for name, value in known.items() if name in columns)
    scale = np.array([TYPICAL[name] for name in wanted])
    matrix = np.column_stack([columns[name] for name in wanted]) * scale / inertia[:, None]
    found = nnls(matrix, right / inertia)[0] * scale
    solution = {**known, **dict(zip(wanted, map(float, found), strict=True))}
    solution.setdefault(AXIAL, _axial_from_breathing(problem, solution))
    return solution


def _axial_from_breathing(problem: TuningProblem, solution: Mapping[str, float]) -> float:
    if 0 not in problem.orders:
        return _typical_axial(problem)
    breathing = 2.0 * np.pi * float(problem.measured_hz[problem.orders == 0][0])
    a = problem.mean_radius_m
    return max(solution[MASS] * breathing**2 - solution[RADIAL], 0.0) * a**2
