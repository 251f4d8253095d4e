"""The tuning problem (measured, known, objective) and the search for its free parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from model.arguments import (
    Array,
    ReadonlyArrays,
    require_inputs,
    require_names,
    require_number,
    require_one_of,
)
from model.coefficients import PressureLoad, harmonics, require_pressure_load
from model.errors import ParameterError
from model.parameters import (
    GROWTH,
    GROWTH_STD,
    LARGEST_THICKNESS_RATIO,
    ManyRings,
    ModalMasses,
    RingParameters,
    TuningPriors,
)
from model.ring import modal_mass_kg, natural_frequencies_hz

MASS, WIDTH = "mass_per_area_kg_m2", "belt_width_m"
RADIAL, CIRCUMFERENTIAL = "radial_stiffness_n_m3", "circumferential_stiffness_n_m3"
AXIAL, BENDING = "axial_stiffness_n_m", "bending_stiffness_n_m"
RADIAL_GROWTH = "radial_growth_m"
PARAMETERS = (MASS, RADIAL, CIRCUMFERENTIAL, AXIAL, BENDING)
OBJECTIVES = ("frequency", "paper")

#: Radial growth of the paper's belt on inflation over its radius.
PAPER_GROWTH = 0.00277
#: Values of a passenger-car tyre: they scale the search and replace what cannot be determined.
TYPICAL = {MASS: 20.0, RADIAL: 8e6, CIRCUMFERENTIAL: 1e6, BENDING: 8.0}
#: Assumed in this order where frequencies are fewer than unknowns; D has the smallest effect.
FIRST_ASSUMED = (BENDING, MASS)

_START_MASSES = (6.0, 12.0, 20.0, 45.0)
_AT_BOUND = 1e-4  # distance to a bound, over the parameter's scale, that counts as on it
# ftol and xtol of the search: relative change of χ² and of the parameters.
_COST_TOLERANCE, _STEP_TOLERANCE = 1e-14, 1e-9
_MOST_EVALUATIONS = 500
_GROWTHS = (1e-4, 0.02)  # growth over radius, far beyond any tyre
_LEAST_CARRIED = 0.1  # share of the pressure that the belt carries at least, the bed the rest


@dataclass(frozen=True, eq=False)
class TuningProblem(ReadonlyArrays):
    """Measured frequencies of a tyre and what else is known: the arguments of `tune_ring`.

    Unknown names, values that are not positive and contradictions raise `ParameterError`.
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
    relative_std: Array | None = None  # of the frequencies
    masses: ModalMasses | None = None
    torsion_hz: tuple[float, float] | None = None  # with its standard deviation
    priors: TuningPriors = field(default_factory=TuningPriors)
    left_out: tuple[int, ...] = ()  # orders

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("given", "start", "bounds"):
            object.__setattr__(self, name, dict(getattr(self, name)))
        free = (MASS, RADIAL, CIRCUMFERENTIAL, BENDING, RADIAL_GROWTH)
        require_names("given", self.given, PARAMETERS)
        require_names("start", self.start, free)
        require_names("bounds", self.bounds, free)
        require_names("priors", self.priors.parameters, (*free, AXIAL))
        require_inputs(self.given, self.start, self.bounds)
        for name in ("mean_radius_m", "inflation_pressure_pa"):
            require_number(name, np.nan if getattr(self, name) is None else getattr(self, name))
        require_number("radial_growth_m", self.radial_growth_m)
        require_pressure_load(self.pressure_load)
        require_one_of("objective", self.objective, OBJECTIVES)
        if self.objective == "paper" and 0 in self.orders:
            raise ParameterError("orders", "0", "eq 18 is for n ≥ 1", "Use objective='frequency'")
        if self.radial_growth_m is not None and (AXIAL in self.given or 0 in self.orders):
            rule = "K would be determined twice: by eq 16 and by a given K or the breathing mode"
            found = f"{self.radial_growth_m:g}"
            raise ParameterError("radial_growth_m", found, rule, "Give one of the two")

    @property
    def growth_m(self) -> float:
        """Radial growth u_r° on inflation: measured, the paper's for its objective, or typical."""
        if self.radial_growth_m is not None:
            return self.radial_growth_m
        if RADIAL_GROWTH in self.priors.parameters:
            return self.priors.parameters[RADIAL_GROWTH][0]
        return self.mean_radius_m * (PAPER_GROWTH if self.objective == "paper" else GROWTH)

    @cached_property
    def used(self) -> NDArray[np.bool_]:
        """Which orders the ring is tuned on."""
        return ~np.isin(self.orders, self.left_out)

    @cached_property
    def frequency_errors(self) -> Array:
        """Relative standard deviation of each frequency, with that of the model form."""
        own = np.zeros(self.orders.size) if self.relative_std is None else self.relative_std
        return np.hypot(own, self.priors.model_form_std)

    @cached_property
    def single_errors(self) -> Array:
        """Relative standard deviations of the frequencies used, then that of the torsion."""
        errors = self.frequency_errors[self.used]
        if self.torsion_hz is None:
            return errors
        measured, std = self.torsion_hz
        return np.append(errors, np.hypot(std / measured, self.priors.model_form_std))

    def prior_of(self, name: str) -> tuple[float, float] | None:
        """Value and standard deviation of a prior; the growth has one unless the data give K."""
        stated = self.priors.parameters.get(name)
        known = AXIAL in self.priors.parameters or 0 in self.orders[self.used]
        if stated is None and name == RADIAL_GROWTH and not known:
            return GROWTH * self.mean_radius_m, GROWTH_STD * self.mean_radius_m
        return stated

    def ring(self, parameters: Mapping[str, float]) -> RingParameters:
        """Ring with these `parameters`; K by eq 16 where it is not among them.

        Columns (n_rings, 1) make many rings.
        """
        complete: dict[str, Any] = {WIDTH: self.belt_width_m, **parameters}
        growth_m = complete.pop(RADIAL_GROWTH, None)
        if AXIAL not in complete:
            complete[AXIAL] = self.axial_stiffness_n_m(parameters[RADIAL], growth_m)
        many = any(np.ndim(value) for value in parameters.values())
        return (ManyRings if many else RingParameters)(
            mean_radius_m=self.mean_radius_m,
            inflation_pressure_pa=self.inflation_pressure_pa,
            **complete,
        )

    def axial_stiffness_n_m(
        self, radial_stiffness_n_m3: float, growth_m: float | None = None
    ) -> float:
        """K from the radial growth u_r° (eq 16 at Ω = 0), N/m."""
        a, w = self.mean_radius_m, self.growth_m if growth_m is None else growth_m
        follows = 1.0 + w / a if self.pressure_load == "follower" else 1.0
        load = self.inflation_pressure_pa * follows
        carried = np.maximum(load - radial_stiffness_n_m3 * w, _LEAST_CARRIED * load)
        found = carried / (w**3 / (2.0 * a**4) + 3.0 * w**2 / (2.0 * a**3) + w / a**2)
        return found if np.ndim(found) else float(found)

    def frequencies_hz(self, ring: RingParameters) -> Array:
        """Natural frequencies of `ring` for the measured orders, Hz."""
        return natural_frequencies_hz(ring, self.orders, pressure_load=self.pressure_load)

    def relative_deviations(self, ring: RingParameters) -> Array:
        """Relative deviation of each frequency of `ring` from the measured one."""
        return self.frequencies_hz(ring) / self.measured_hz - 1.0

    def residual(self, ring: RingParameters) -> Array:
        """Deviation per order: relative frequency, or FUN_n of eq 18."""
        if self.objective == "frequency":
            return self.relative_deviations(ring)
        squared, (a3, a2, _, a0) = self._squared_and_polynomial(ring)
        return np.asarray((a3 * squared + a2) * squared + a0)

    def data_slope(self, ring: RingParameters) -> Array:
        """Slope of each residual over the logarithm of its measured frequency."""
        if self.objective == "frequency":
            return -self.frequencies_hz(ring) / self.measured_hz
        squared, (a3, a2, _, _) = self._squared_and_polynomial(ring)
        return np.asarray((4.0 * a3 * squared + 2.0 * a2) * squared)

    def deviations(self, ring: RingParameters) -> Array:
        """What the search minimises: eq 18, or deviations over their standard deviations."""
        single = [self.residual(ring)[..., self.used]]
        if self.objective == "paper":
            return single[0]
        if self.torsion_hz is not None:
            single.append(self.torsion_of(ring) / self.torsion_hz[0] - 1.0)
        parts = [np.concatenate(single, axis=-1) / self.single_errors]
        if self.masses is not None:
            deviations = self.mass_deviations(ring).T
            whitened = scipy.linalg.solve_triangular(self._mass_root, deviations, lower=True)
            parts.append(whitened.T)
        return np.concatenate(parts, axis=-1)

    def torsion_of(self, ring: RingParameters) -> Array:
        """Torsion of `ring`, Hz, (1,); zero where a pressure of this kind would make it turn."""
        stiffness = harmonics(ring, [0], pressure_load=self.pressure_load).m22
        turning = np.maximum(stiffness, 0.0) / ring.mass_per_area_kg_m2
        return np.asarray(np.sqrt(turning) / (2.0 * np.pi))

    def mass_deviations(self, ring: RingParameters) -> Array:
        """Logarithm of each modal mass of the ring over the measured one."""
        if (masses := self.masses) is None:
            return np.empty(0)
        found = modal_mass_kg(ring, masses.orders, pressure_load=self.pressure_load)
        return np.log(found / masses.mass_kg)

    @cached_property
    def _mass_errors(self) -> Array:
        """Independent errors of the modal masses; see `ModalMasses.errors`."""
        assert self.masses is not None
        return self.masses.errors(self.priors, width_given=self.belt_width_m is not None)

    @cached_property
    def _mass_root(self) -> Array:
        covariance = self._mass_errors @ self._mass_errors.T
        return np.asarray(scipy.linalg.cholesky(covariance, lower=True))

    def data_errors(self, ring: RingParameters) -> Array:
        """Change of `deviations` by errors of the data, last the width's, (n_data, n_errors)."""
        if self.objective == "paper":
            errors = np.diag((self.data_slope(ring) * self.frequency_errors)[self.used])
            return np.column_stack([errors, np.zeros(errors.shape[0])])
        n_single = self.single_errors.size
        if self.masses is None:
            return np.eye(n_single, n_single + 1)
        masses = scipy.linalg.solve_triangular(self._mass_root, self._mass_errors, lower=True)
        return np.asarray(scipy.linalg.block_diag(np.eye(n_single), masses))

    def _squared_and_polynomial(self, ring: RingParameters) -> tuple[Any, tuple[Any, ...]]:
        terms = harmonics(ring, self.orders, pressure_load=self.pressure_load)
        return (2.0 * np.pi * self.measured_hz) ** 2, terms.polynomial


@dataclass(frozen=True, eq=False)
class Search(ReadonlyArrays):
    """Free parameters of a tuning with typical size and bounds, and the values of the others.

    `held` has value and standard deviation of parameters that are neither free nor exactly known.
    """

    problem: TuningProblem
    free: tuple[str, ...]
    held: dict[str, tuple[float, float]]
    scale: Array
    lower: Array
    upper: Array

    def ring(self, values: Array, problem: TuningProblem | None = None) -> RingParameters:
        """Ring with the free parameters at `values`; many rings with a row of them for each."""
        found = dict(zip(self.free, _by_name(values), strict=True))
        held = {name: value for name, (value, _) in self.held.items()}
        return (problem or self.problem).ring({**self.problem.given, **held, **found})

    @cached_property
    def priors(self) -> dict[str, tuple[float, float]]:
        """Value and standard deviation of free parameters that have a prior."""
        if self.problem.objective == "paper":
            return {}
        few = len(self.free) - (RADIAL_GROWTH in self.free) - (WIDTH in self.free)
        spare = int(self.problem.used.sum()) - few
        assumed = [name for name in FIRST_ASSUMED if name in self.free][: max(0, -spare)]
        found = {}
        for name in (*self.free, *({AXIAL} if RADIAL_GROWTH in self.free else ())):
            start = self.problem.start.get(name, TYPICAL.get(name, 0.0))
            prior = self.problem.prior_of(name)
            if prior is None and name in assumed:
                prior = start, start
            if prior is not None:
                found[name] = prior
        return found

    def residual(self, values: Array, problem: TuningProblem | None = None) -> Array:
        """What the search minimises: deviations of the data, then those from the priors.

        A row of it for each row of `values` where there are many.
        """
        ring = self.ring(values, problem)
        data = (problem or self.problem).deviations(ring)
        at = {AXIAL: ring.axial_stiffness_n_m} | dict(zip(self.free, _by_name(values), strict=True))
        own = [np.atleast_1d((at[name] - x) / std) for name, (x, std) in self.priors.items()]
        return np.concatenate([data, *own], axis=-1)

    def with_slope(self, values: Array) -> Array:
        """Residuals, then their central slopes, as columns: many rings take the time of one."""
        steps = np.diag(1e-5 * self.scale)
        ahead = np.minimum(values + steps, self.upper)
        behind = np.maximum(values - steps, self.lower)
        own, *moved = self.residual(np.concatenate([values[None], ahead, behind]))
        slopes = np.subtract(*np.split(np.array(moved), 2)).T / (ahead - behind).sum(axis=1)
        return np.column_stack([own, slopes])

    def at_bound(self, values: Array) -> NDArray[np.bool_]:
        """Which free parameters lie on a bound."""
        return self._near(values, self.lower) | self._near(values, self.upper)

    def run(self, most: int | None = None) -> tuple[Array, str]:
        """Best solution from all or the first starts, and a note on them."""
        starts = self._starts()[:most]
        solutions = [self.solution(start) for start in starts]
        cost = np.sum(self.residual(np.array(solutions)) ** 2, axis=1)
        agreeing = int(np.sum(cost <= 1.01 * cost.min() + 1e-12 * self._size() ** 2))
        best = solutions[int(np.argmin(cost))]
        return best, f"{agreeing} of {len(starts)} starting points led to this solution."

    def solution(self, start: Array) -> Array:
        """Solution from one start, on a bound where close to it."""
        scale = np.append(1.0, self.scale) / self._size()
        # Slopes are asked for where the residuals were.
        at = lru_cache(1)(lambda x: self.with_slope(np.frombuffer(x) * self.scale) * scale)
        found = scipy.optimize.least_squares(
            lambda x: at(x.tobytes())[:, 0],
            self._inside(start) / self.scale,
            lambda x: at(x.tobytes())[:, 1:],
            (self.lower / self.scale, self.upper / self.scale),
            x_scale="jac",
            ftol=_COST_TOLERANCE,
            xtol=_STEP_TOLERANCE,
            gtol=_COST_TOLERANCE,
            max_nfev=_MOST_EVALUATIONS,
        )
        values = np.clip(found.x * self.scale, self.lower, self.upper)
        values = np.where(self._near(values, self.lower), self.lower, values)
        return np.where(self._near(values, self.upper), self.upper, values)

    def _size(self) -> float:
        """Residual that a relative frequency error of one would leave; scales eq 18 to one."""
        if self.problem.objective == "frequency":
            return 1.0 / float(self.problem.frequency_errors.max())
        return float(np.abs(self.problem.data_slope(self.ring(self._starts()[0]))).max())

    def _near(self, values: Array, bound: Array) -> NDArray[np.bool_]:
        return np.abs(values - bound) <= _AT_BOUND * self.scale

    def _inside(self, start: Array) -> Array:
        margin = np.minimum(1e-2 * self.scale, 0.25 * (self.upper - self.lower))
        return np.asarray(np.clip(start, self.lower + margin, self.upper - margin))

    def _starts(self) -> list[Array]:
        """Starting points inside the bounds: the user's, then linear solutions."""
        guesses = [_linear_solution(self, mass) for mass in (None, *_START_MASSES)]
        if self.problem.start:
            guesses.insert(0, guesses[0] | dict(self.problem.start))
        own = list(zip(self.free, self.scale, strict=True))
        return [self._inside(np.array([each.get(n, t) for n, t in own])) for each in guesses]


def _by_name(values: Array) -> list[Any]:
    """Each free parameter: a number, or a column where `values` has many rows."""
    return values.tolist() if values.ndim == 1 else list(values.T[:, :, None])


def plan_search(problem: TuningProblem) -> Search:
    """Decide what is free and within which bounds."""
    free = [name for name in PARAMETERS if name not in problem.given and name != AXIAL]
    held: dict[str, tuple[float, float]] = {}
    if not free and (AXIAL in problem.given or 0 not in problem.orders):
        rule = "at least one parameter must be free"
        raise ParameterError("given", "every parameter", rule, "Leave one parameter out")
    n_orders = int(problem.used.sum())
    few = [name for name in FIRST_ASSUMED if name in free][: max(0, len(free) - n_orders)]
    if n_orders < len(free) - len(few):
        rule = f"fewer than the unknowns {', '.join(n for n in free if n not in few)}"
        remedy = "Measure more orders or give more parameters"
        raise ParameterError("frequencies_hz", f"{n_orders} values", rule, remedy)
    if problem.masses and problem.belt_width_m is None and problem.objective == "frequency":
        free.append(WIDTH)  # follows from the modal masses
    growth = problem.growth_m, GROWTH_STD * problem.mean_radius_m
    if AXIAL not in problem.given and problem.radial_growth_m is None:
        if problem.objective == "paper":
            held[RADIAL_GROWTH] = growth
        else:
            free.append(RADIAL_GROWTH)
    if problem.objective == "paper":  # eq 18 has no place for a prior
        for name in few:
            free.remove(name)
            value = problem.start.get(name, TYPICAL[name])
            held[name] = value, value
    box = _default_bounds(problem) | dict(problem.bounds)
    lower, upper = (np.array([box[name][side] for name in free]) for side in (0, 1))
    for name, low, high in zip(free, lower, upper, strict=True):
        if not 0 <= low < high:
            where, found = f"bounds of {name}", f"({low:g}, {high:g})"
            raise ParameterError(where, found, "must satisfy 0 ≤ lower < upper", "Correct them")
    typical = TYPICAL | {RADIAL_GROWTH: problem.growth_m, WIDTH: 0.2}
    scale = np.array([typical[name] for name in free])
    return Search(problem, tuple(free), held, scale, lower, upper)


def _default_bounds(problem: TuningProblem) -> dict[str, tuple[float, float]]:
    """Bounds within which every ring is a valid one, far beyond any tyre."""
    a, pressure = problem.mean_radius_m, problem.inflation_pressure_pa
    least, most = (share * a for share in _GROWTHS)
    if problem.radial_growth_m is not None:
        most = max(most, problem.radial_growth_m)
    softest = problem.given.get(AXIAL, _LEAST_CARRIED * pressure * a**2 / (2.0 * most))
    return {
        MASS: (0.5, 500.0),
        RADIAL: (0.0, 0.9 * pressure / problem.growth_m),  # eq 16 keeps K positive
        CIRCUMFERENTIAL: (0.0, 1e9),
        BENDING: (0.0, 0.99 * softest * (LARGEST_THICKNESS_RATIO * a) ** 2 / 12.0),
        RADIAL_GROWTH: (least, most),
        WIDTH: (1e-3, 5.0),
    }


def _linear_solution(search: Search, mass: float | None) -> dict[str, float]:
    """Parameters by linear least squares, for a free or an assumed mass.

    For an inextensible belt (eq 33) eq 14 is linear in the parameters:
    ω²(n² + 1)·ρh − n²(n² − 1)²·D/a⁴ − n²·k_r − k_θ = (p_o/a)(n² − 1)².
    """
    problem = search.problem
    used = (problem.orders > 0) & problem.used
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
    known = {**problem.given, **{name: value for name, (value, _) in search.held.items()}}
    if mass is not None:
        known.setdefault(MASS, mass)
    wanted = [name for name in columns if name not in known]
    right = tension - sum(columns[name] * value for name, value in known.items() if name in columns)
    scale = np.array([TYPICAL[name] for name in wanted])
    matrix = np.column_stack([columns[name] for name in wanted]) * scale / inertia[:, None]
    found = scipy.optimize.nnls(matrix, right / inertia)[0] * scale
    solution = {**known, **dict(zip(wanted, map(float, found), strict=True))}
    growth_m = problem.growth_m
    if 0 in problem.orders:
        breathing = 2.0 * np.pi * float(problem.measured_hz[problem.orders == 0][0])
        membrane = max(solution[MASS] * breathing**2 - solution[RADIAL], 1.0)
        growth_m = problem.inflation_pressure_pa / membrane
    return {RADIAL_GROWTH: growth_m} | solution
