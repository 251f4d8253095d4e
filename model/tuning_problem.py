"""The tuning problem (measured, given, objective) and the search for its free parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls

from model.arrays import Array, ReadonlyArrays, require_number, require_one_of
from model.coefficients import PressureLoad, harmonics, require_pressure_load
from model.errors import ParameterError
from model.parameters import LARGEST_THICKNESS_RATIO, RingParameters
from model.ring import natural_frequencies_hz

MASS = "mass_per_area_kg_m2"
RADIAL = "radial_stiffness_n_m3"
CIRCUMFERENTIAL = "circumferential_stiffness_n_m3"
AXIAL = "axial_stiffness_n_m"
BENDING = "bending_stiffness_n_m"
PARAMETERS = (MASS, RADIAL, CIRCUMFERENTIAL, AXIAL, BENDING)
OBJECTIVES = ("frequency", "paper")

#: Radial growth of a belt on inflation over its radius, where it was not measured.
TYPICAL_GROWTH = 0.00277
#: Values of a passenger-car tyre: they scale the search and replace what cannot be determined.
TYPICAL = {MASS: 20.0, RADIAL: 8e6, CIRCUMFERENTIAL: 1e6, BENDING: 8.0}
#: Assumed in this order where frequencies are fewer than unknowns; D has the smallest effect.
FIRST_ASSUMED = (BENDING, MASS)

_START_MASSES = (6.0, 12.0, 20.0, 45.0)
_AT_BOUND = 1e-4  # distance to a bound, over the parameter's scale, that counts as on it
# ftol and xtol of the search: relative change of χ² and of the parameters.
_COST_TOLERANCE, _STEP_TOLERANCE = 1e-14, 1e-9
_MOST_EVALUATIONS = 500


@dataclass(frozen=True, eq=False)
class TuningProblem(ReadonlyArrays):
    """Measured frequencies of a tyre and what else is known about it.

    Fields are the arguments of `tune_ring`. Unknown names, values that are not positive and
    contradictions raise `ParameterError`.
    """

    orders: NDArray[np.int_]
    measured_hz: Array
    mean_radius_m: float
    inflation_pressure_pa: float
    belt_width_m: float | None = None
    objective: str = "frequency"
    given: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    radial_growth_m: float | None = None
    pressure_load: PressureLoad = "dead"

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("given", "start", "bounds"):
            object.__setattr__(self, name, dict(getattr(self, name)))
            for parameter in getattr(self, name):
                require_one_of(name, parameter, PARAMETERS)
        for name in ("mean_radius_m", "inflation_pressure_pa", "radial_growth_m"):
            require_number(name, getattr(self, name))
        require_pressure_load(self.pressure_load)
        require_one_of("objective", self.objective, OBJECTIVES)
        if self.objective == "paper" and 0 in self.orders:
            raise ParameterError("orders", "0", "eq 18 is for n ≥ 1", "Use objective='frequency'")
        if self.radial_growth_m is not None and (AXIAL in self.given or 0 in self.orders):
            found = f"{self.radial_growth_m:g}"
            rule = "K would be determined twice: by eq 16 and by a given K or the breathing mode"
            raise ParameterError("radial_growth_m", found, rule, "Give one of the two")

    @property
    def growth_m(self) -> float:
        """Radial growth u_r° on inflation: the measured one, or a typical one."""
        if self.radial_growth_m is not None:
            return self.radial_growth_m
        return TYPICAL_GROWTH * self.mean_radius_m

    def ring(self, parameters: Mapping[str, float]) -> RingParameters:
        """Ring with these `parameters`; K by eq 16 where it is not among them."""
        complete = dict(parameters)
        if AXIAL not in complete:
            complete[AXIAL] = self.axial_stiffness_n_m(complete[RADIAL])
        return RingParameters(
            mean_radius_m=self.mean_radius_m,
            inflation_pressure_pa=self.inflation_pressure_pa,
            belt_width_m=self.belt_width_m,
            **complete,
        )

    def axial_stiffness_n_m(self, radial_stiffness_n_m3: float) -> float:
        """K from the radial growth u_r° (eq 16 at Ω = 0), N/m."""
        a, w = self.mean_radius_m, self.growth_m
        follows = 1.0 + w / a if self.pressure_load == "follower" else 1.0
        carried = self.inflation_pressure_pa * follows - radial_stiffness_n_m3 * w
        return carried / (w**3 / (2.0 * a**4) + 3.0 * w**2 / (2.0 * a**3) + w / a**2)

    def frequencies_hz(self, ring: RingParameters) -> Array:
        """Natural frequencies of `ring` for the measured orders, Hz."""
        return natural_frequencies_hz(ring, self.orders, pressure_load=self.pressure_load)

    def residual(self, ring: RingParameters) -> Array:
        """Deviation per order: relative frequency, or FUN_n of eq 18."""
        if self.objective == "frequency":
            return self.frequencies_hz(ring) / self.measured_hz - 1.0
        squared, (a3, a2, _, a0) = self._squared_and_polynomial(ring)
        return np.asarray((a3 * squared + a2) * squared + a0)

    def data_slope(self, ring: RingParameters) -> Array:
        """Slope of each residual over the logarithm of its measured frequency."""
        if self.objective == "frequency":
            return -self.frequencies_hz(ring) / self.measured_hz
        squared, (a3, a2, _, _) = self._squared_and_polynomial(ring)
        return np.asarray((4.0 * a3 * squared + 2.0 * a2) * squared)

    def _squared_and_polynomial(self, ring: RingParameters) -> tuple[Any, tuple[Any, ...]]:
        terms = harmonics(ring, self.orders, pressure_load=self.pressure_load)
        return (2.0 * np.pi * self.measured_hz) ** 2, terms.polynomial


@dataclass(frozen=True, eq=False)
class Search(ReadonlyArrays):
    """Free parameters of a tuning with typical size and bounds, and the values of the others.

    `assumed` holds parameters that too few frequencies cannot determine.
    """

    problem: TuningProblem
    free: tuple[str, ...]
    assumed: dict[str, float]
    scale: Array
    lower: Array
    upper: Array

    def ring(self, values: Array) -> RingParameters:
        """Ring with the free parameters at `values`."""
        found = dict(zip(self.free, map(float, values), strict=True))
        return self.problem.ring({**self.problem.given, **self.assumed, **found})

    def residual_slope(self, values: Array) -> Array:
        """Slopes of the residuals over the free parameters, central, shape (n_orders, n_free)."""
        columns = []
        for step in np.diag(1e-5 * self.scale):
            ahead = np.minimum(values + step, self.upper)
            behind = np.maximum(values - step, self.lower)
            rise = self._residual(ahead) - self._residual(behind)
            columns.append(rise / (ahead - behind).sum())
        return np.column_stack(columns)

    def at_bound(self, values: Array) -> NDArray[np.bool_]:
        """Which free parameters lie on a bound."""
        return self._near(values, self.lower) | self._near(values, self.upper)

    def run(self) -> tuple[Array, str]:
        """Best solution from all starts, on a bound where close to it, and a note on them."""
        starts = self._starts()
        solutions = [self._solution(start) for start in starts]
        cost = np.array([np.sum(self._residual(values) ** 2) for values in solutions])
        values = solutions[int(np.argmin(cost))]
        for bound in (self.lower, self.upper):
            values = np.where(self._near(values, bound), bound, values)
        agreeing = int(np.sum(cost <= 1.01 * cost.min() + 1e-12 * self._size() ** 2))
        return values, f"{agreeing} of {len(starts)} starting points led to this solution."

    def _solution(self, start: Array) -> Array:
        size = self._size()
        found = least_squares(
            lambda x: self._residual(x * self.scale) / size,
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

    def _residual(self, values: Array) -> Array:
        return self.problem.residual(self.ring(values))

    def _size(self) -> float:
        """Residual that a relative frequency error of one would leave; scales eq 18 to one."""
        return float(np.abs(self.problem.data_slope(self.ring(self._starts()[0]))).max())

    def _near(self, values: Array, bound: Array) -> NDArray[np.bool_]:
        return np.abs(values - bound) <= _AT_BOUND * self.scale

    def _starts(self) -> list[Array]:
        """Starting points inside the bounds: the user's, then linear solutions."""
        guesses = [_linear_solution(self, mass) for mass in (None, *_START_MASSES)]
        if self.problem.start:
            guesses.insert(0, guesses[0] | dict(self.problem.start))
        margin = np.minimum(1e-2 * self.scale, 0.25 * (self.upper - self.lower))
        inside = [np.array([guess[name] for name in self.free]) for guess in guesses]
        return [np.clip(point, self.lower + margin, self.upper - margin) for point in inside]


def plan_search(problem: TuningProblem) -> Search:
    """Decide what is free and within which bounds."""
    open_ones = [name for name in PARAMETERS if name not in problem.given and name != AXIAL]
    if AXIAL not in problem.given and 0 in problem.orders:
        open_ones.append(AXIAL)
    assumed: dict[str, float] = {}
    for name in FIRST_ASSUMED:
        if len(open_ones) > problem.orders.size and name in open_ones:
            open_ones.remove(name)
            assumed[name] = problem.start.get(name, TYPICAL[name])
    if not open_ones:
        rule = "at least one parameter must be free"
        raise ParameterError("given", "every parameter", rule, "Leave one parameter out")
    if problem.orders.size < len(open_ones):
        rule = f"fewer than the unknowns {', '.join(open_ones)}"
        remedy = "Measure more orders or give more parameters"
        raise ParameterError("frequencies_hz", f"{problem.orders.size} values", rule, remedy)
    typical = TYPICAL | {AXIAL: _typical_axial(problem)}
    box = _default_bounds(problem) | dict(problem.bounds)
    lower, upper = (np.array([box[name][side] for name in open_ones]) for side in (0, 1))
    for name, low, high in zip(open_ones, lower, upper, strict=True):
        if not 0 <= low < high:
            where, found = f"bounds of {name}", f"({low:g}, {high:g})"
            raise ParameterError(where, found, "must satisfy 0 ≤ lower < upper", "Correct them")
    scale = np.array([typical[name] for name in open_ones])
    return Search(problem, tuple(open_ones), assumed, scale, lower, upper)


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
    normal = problem.inflation_pressure_pa / problem.mean_radius_m
    tension = normal * (n2 - 1.0) ** 2
    if problem.pressure_load == "follower":
        tension = tension + normal * (n2 - 1.0)
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
    axial = _typical_axial(problem)
    if 0 in problem.orders:
        breathing = 2.0 * np.pi * float(problem.measured_hz[~used][0])
        excess = max(solution[MASS] * breathing**2 - solution[RADIAL], 0.0)
        axial = excess * problem.mean_radius_m**2
    return {AXIAL: axial} | solution
