"""From measured natural frequencies to the parameters of a ring (section 4, eqs 16–18)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from model.adequacy import judge_tuning
from model.arguments import Array, ReadonlyArrays, measured_orders, require_type
from model.coefficients import PressureLoad
from model.display import plot, table, value_with_std
from model.identifiability import (
    AT_BOUND,
    GIVEN,
    IDENTIFIED,
    LARGEST_RELATIVE_STD,
    NOT_IDENTIFIED,
    ORDER_1_STD,
    Correlation,
    Sensitivity,
    Spread,
    calibrated,
    chances_of_half,
    frequency_sensitivity,
    order_1_is_tested,
    posterior_spread,
)
from model.model_form import model_form, with_model_form
from model.parameters import (
    RING_NAMES,
    RingParameters,
    TuningPriors,
    as_typed,
    listed_parameters,
    modal_masses,
)
from model.tuning_problem import (
    AXIAL,
    MASS,
    PARAMETERS,
    RADIAL,
    RADIAL_GROWTH,
    WIDTH,
    Search,
    TuningProblem,
)
from model.verdict import RingVerdict

if TYPE_CHECKING:
    import pandas as pd

#: Probability of an error beyond half the value up to which a parameter is identified: that of a
#: standard deviation of a fifth where the model form is known.
_LARGEST_CHANCE = 2.0 * NormalDist().cdf(-0.5 / LARGEST_RELATIVE_STD)
_NARROWED = 0.5  # posterior over prior standard deviation up to which the data determine a value


@dataclass(frozen=True, eq=False)
class TuningResult(ReadonlyArrays):
    """A ring tuned on measured natural frequencies.

    Parameters
    ----------
    ring : RingParameters
        The tuned ring.
    std : dict of str to float
        Standard deviation of each parameter in its unit; absent where unknown.
    how : dict of str to str
        ``"given"``, ``"identified"``, ``"not identified"`` or ``"at bound"``, per parameter.
    orders : ndarray of int, shape (n_orders,)
        Circumferential orders measured; `verdict` names those that were left out.
    measured_hz, model_hz : ndarray, shape (n_orders,)
        Measured natural frequencies and those of the tuned ring at Ω = 0.
    relative_std : ndarray, shape (n_orders,)
        Relative standard deviation of each frequency behind `std`, with that of the model form.
    correlation : Correlation
        Of the parameters that were not given.
    sensitivity : Sensitivity
        d ln f / d ln parameter at the solution.
    objective : str
        ``"frequency"`` or ``"paper"``.
    notes : tuple of str
        Remarks for the reader, in sentences.
    verdict : RingVerdict
        Whether the ring describes the tyre.
    pressure_load : {"dead", "follower"}
        Pressure model that the parameters belong to.
    covariance : ndarray, shape (n_parameters, n_parameters)
        Posterior covariance of the parameters that `std` names, in its order, SI.

    Examples
    --------
    >>> import ringmodal as rm
    >>> tyre = {"mean_radius_m": 0.33, "inflation_pressure_pa": 2.2e5}
    >>> tuned = rm.tune_ring([1, 2, 3, 4, 5], [78.73, 100.31, 121.40, 145.45, 170.78], **tyre)
    >>> tuned.how["radial_stiffness_n_m3"], tuned.how["axial_stiffness_n_m"]
    ('identified', 'not identified')
    """

    ring: RingParameters
    std: dict[str, float]
    how: dict[str, str]
    orders: NDArray[np.int_]
    measured_hz: Array
    model_hz: Array
    relative_std: Array
    correlation: Correlation
    sensitivity: Sensitivity
    objective: str
    notes: tuple[str, ...]
    verdict: RingVerdict
    pressure_load: PressureLoad
    covariance: Array

    @property
    def error_percent(self) -> Array:
        """Deviation of the model from the measurement, percent of the measured frequency."""
        return 100.0 * (self.model_hz / self.measured_hz - 1.0)

    def to_frame(self) -> pd.DataFrame:
        """Table of the ring's parameters, one row for each.

        Returns
        -------
        pandas.DataFrame
            ``parameter``, ``value``, ``std`` (NaN where unknown), ``unit`` (of both) and ``how``
            (given, identified, not identified or at bound).

        Examples
        --------
        >>> import model
        >>> tyre = {"mean_radius_m": 0.33, "inflation_pressure_pa": 2.2e5}
        >>> ring = model.tune_ring([2, 3, 4, 5], [106.5, 130.0, 152.5, 177.0], **tyre)
        >>> table = ring.to_frame().set_index("parameter")
        >>> table.loc["mean_radius_m", ["unit", "how"]].to_list()
        ['m', 'given']
        """
        import pandas as pd  # takes 0.3 s to load, which only tables need

        keys, _, _, values, units = zip(*listed_parameters(self.ring), strict=True)
        std = np.array([self.std.get(key, np.nan) for key in keys], dtype=float)
        how = [self.how.get(key, GIVEN) for key in keys]
        columns = {"parameter": keys, "value": values, "std": std, "unit": units, "how": how}
        return pd.DataFrame(columns)

    def plot(self, ax: Any = None) -> Any:
        """Draw measured frequencies and those of the ring over the order; return the axes."""
        return plot(self, ax)

    def __repr__(self) -> str:
        identified = [RING_NAMES[name][1] for name, how in self.how.items() if how == IDENTIFIED]
        orders = ", ".join(str(order) for order in self.orders)
        worst = float(np.max(np.abs(self.error_percent)))
        against = "".join(f"; {each.reason.meaning}" for each in self.verdict.against)
        return (
            f"<TuningResult: orders {orders}, largest deviation {worst:.2f} %, "
            f"identified {', '.join(identified) or 'nothing'}{against}>"
        )

    def _repr_html_(self) -> str:
        """Every parameter with ± and how it was obtained, then the frequencies order by order."""
        rows = []
        for key, name, symbol, value, unit in listed_parameters(self.ring):
            how = self.how.get(key, "–")
            text = as_typed(value) if how == GIVEN else value_with_std(value, self.std.get(key))
            rows.append((name, symbol, text, unit, how))
        head = ("parameter", "symbol", "value", "unit", "how obtained")
        columns = zip(self.orders, self.measured_hz, self.model_hz, self.error_percent, strict=True)
        by_order = [
            (str(order), f"{measured:.2f}", f"{ring:.2f}", f"{error:+.2f}".replace("-", "−"))
            for order, measured, ring, error in columns
        ]
        heads = ("order n", "measured / Hz", "ring / Hz", "deviation / %")
        parameters = table("Tuned ring", head, rows, words=(0, 1, 3, 4))
        return parameters + table("Frequencies it was tuned to", heads, by_order, words=())


def tune_ring(
    orders: ArrayLike,
    frequencies_hz: ArrayLike,
    *,
    mean_radius_m: float,
    inflation_pressure_pa: float,
    frequency_std_hz: ArrayLike | None = None,
    belt_width_m: float | None = None,
    objective: str = "frequency",
    given: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    radial_growth_m: float | None = None,
    radial_growth_std_m: float | None = None,
    pressure_load: PressureLoad = "dead",
    modal_mass_kg: ArrayLike | None = None,
    modal_mass_std_kg: ArrayLike | None = None,
    torsion_hz: float | None = None,
    torsion_std_hz: float = 0.0,
    rim_hz: Sequence[float] = (),
    rim_torsion_hz: Sequence[float] = (),
    priors: TuningPriors | None = None,
) -> TuningResult:
    """Tune ρh, k_r, k_θ and D on natural frequencies at Ω = 0 (section 4, eqs 16 to 18).

    What else is known enters with its uncertainty (`priors`): growth on inflation, pressure,
    radius, belt width, calibration, and how well a ring describes a tyre. K follows k_r by eq 16
    from the radial growth. The frequencies of n ≥ 1 hardly depend on K (d ln f / d ln K below
    0.02): without a measured growth, a given K, modal masses or the breathing frequency (order 0)
    K is an assumption and marked "not identified".

    Parameters
    ----------
    orders : array_like of int, shape (n_orders,)
        Circumferential orders, each once; 0 is the breathing mode.
    frequencies_hz : array_like, shape (n_orders,)
        Measured undamped natural frequencies, Hz.
    mean_radius_m, inflation_pressure_pa : float
        Mean radius a and pressure p_o; they set the scale, which frequencies do not determine.
    frequency_std_hz : array_like, shape (n_orders,), or None
        Standard deviations of the frequencies, Hz.
    belt_width_m : float or None
        Belt width b. Without one it follows from modal masses, where these are given.
    objective : {"frequency", "paper"}
        Sum of squares of relative frequency deviations, or of eq 18. The latter weighs n = 7 about
        200 times as much as n = 1.
    given : mapping of str to float, or None
        Parameters of `RingParameters` that are known and kept.
    start : mapping of str to float, or None
        Further starting values; without them several are derived from the data.
    bounds : mapping of str to (float, float), or None
        Bounds of free parameters in place of the default ones.
    radial_growth_m : float or None
        Measured radial growth u_r° of the belt on inflation: determines K by eq 16.
    radial_growth_std_m : float or None
        Its standard deviation, m.
    pressure_load : {"dead", "follower"}
        Pressure load the ring is tuned for; use the same one with it later.
    modal_mass_kg, modal_mass_std_kg : array_like, shape (n_orders,), or None
        Modal masses of radial shapes cos nθ of unit amplitude and standard deviations, kg. Masses
        that contradict the frequencies are not used, and the verdict says so.
    torsion_hz, torsion_std_hz : float
        Torsion of order 0 on a fixed rim, as tangential sensors detect it, Hz.
    rim_hz : sequence of float
        Further modes of order 1, Hz: the rim moves, and order 1 is left out.
    rim_torsion_hz : sequence of float
        Further torsions, Hz: the rim turns, and the torsion is not used.
    priors : TuningPriors or None
        What else is known, and how well.

    Returns
    -------
    TuningResult
        The ring, and how each of its parameters was obtained.

    Raises
    ------
    ParameterError
        For fewer than two frequencies, invalid values or contradictory arguments.

    Examples
    --------
    >>> import ringmodal as rm
    >>> frequencies_hz = [78.73, 100.31, 121.40, 145.45, 170.78, 196.52, 224.40]
    >>> tyre = {"mean_radius_m": 0.33, "inflation_pressure_pa": 2.2e5}
    >>> tuned = rm.tune_ring([1, 2, 3, 4, 5, 6, 7], frequencies_hz, **tyre)
    >>> bool(abs(tuned.model_hz / tuned.measured_hz - 1).max() < 0.01)
    True
    >>> tuned.how["radial_stiffness_n_m3"]
    'identified'
    """
    numbers, measured, relative = measured_orders(
        "frequencies_hz", orders, frequencies_hz, "frequency_std_hz", frequency_std_hz
    )
    known = priors or TuningPriors()
    require_type("priors", known, TuningPriors)
    if known.order_1_std:
        own = np.zeros(numbers.size) if relative is None else relative
        relative = np.hypot(own, known.order_1_std * (numbers == 1))
    for name, mapping in (("given", given), ("start", start), ("bounds", bounds)):
        require_type(name, mapping or {}, Mapping)
    if radial_growth_m is not None and radial_growth_std_m:
        prior = {RADIAL_GROWTH: (radial_growth_m, radial_growth_std_m)}
        known, radial_growth_m = replace(known, parameters={**known.parameters, **prior}), None
    problem = TuningProblem(
        numbers,
        measured,
        mean_radius_m,
        inflation_pressure_pa,
        belt_width_m,
        objective,
        given or {},
        start or {},
        bounds or {},
        radial_growth_m,
        pressure_load,
        relative,
        modal_masses(numbers, modal_mass_kg, modal_mass_std_kg),
        None if torsion_hz is None else (torsion_hz, torsion_std_hz),
        known,
    )
    with threadpool_limits(1, user_api="blas"):  # threads slow small matrices down
        return _tuned(problem, rim_hz, rim_torsion_hz)


def _tuned(problem: TuningProblem, *of_rim: Sequence[float]) -> TuningResult:
    search, values, starts, verdict = judge_tuning(problem, *of_rim)
    form, tested = model_form(search, values), order_1_is_tested(search, values)
    search = with_model_form(search, form.std)
    problem = search.problem
    values = search.solution(values)
    ring = search.ring(values)
    wider = with_model_form(search, 2.0 * form.std)
    order_1_std = 0.0 if tested else ORDER_1_STD
    near, far = (
        posterior_spread(each, values, order_1_std=order_1_std) for each in (search, wider)
    )
    spread = calibrated(near, far, form)
    how = _how(search, values, spread, chances_of_half(vars(ring), near, far, form))
    return TuningResult(
        ring=ring,
        std=spread.std,
        how=how,
        orders=problem.orders,
        measured_hz=problem.measured_hz,
        model_hz=problem.frequencies_hz(ring),
        relative_std=problem.frequency_errors,
        correlation=_correlation(spread, how),
        sensitivity=frequency_sensitivity(
            ring, problem.orders, pressure_load=problem.pressure_load
        ),
        objective=problem.objective,
        notes=(*_remarks(search, how, form.std), starts),
        verdict=verdict,
        pressure_load=problem.pressure_load,
        covariance=spread.covariance,
    )


def _how(
    search: Search, values: Array, spread: Spread, of_half: Mapping[str, float]
) -> dict[str, str]:
    """How each parameter was obtained, those that were not fitted included."""
    problem = search.problem
    how = dict.fromkeys(("mean_radius_m", "inflation_pressure_pa"), GIVEN)
    if problem.belt_width_m is not None:
        how[WIDTH] = GIVEN
    bound = dict(zip(search.free, search.at_bound(values).tolist(), strict=True))
    undetermined = spread.fit.undetermined()
    no_tyre = bound.get(MASS, False) or bound.get(RADIAL, False)
    for name in (*PARAMETERS, *({WIDTH} & set(search.free))):
        source = RADIAL_GROWTH if name == AXIAL else name
        if name in problem.given:
            how[name] = GIVEN
        elif name in search.held or (name == AXIAL and RADIAL_GROWTH in search.held):
            how[name] = NOT_IDENTIFIED
        elif bound.get(source, False):
            how[name] = AT_BOUND
        else:
            vague = (
                no_tyre
                or of_half.get(name, 0.0) > _LARGEST_CHANCE
                or undetermined.get(source, False)
                or _hardly_narrowed(search, spread, source)
            )
            how[name] = NOT_IDENTIFIED if vague else IDENTIFIED
    return how


def _hardly_narrowed(search: Search, spread: Spread, name: str) -> bool:
    """Whether an assumption, not a measured value, is as good as what is known after the fit."""
    measured = name in search.problem.priors.parameters
    prior = None if measured else search.priors.get(name)
    return prior is not None and spread.free_std[name] > _NARROWED * prior[1]


def _correlation(spread: Spread, how: dict[str, str]) -> Correlation:
    names = tuple(n for n in spread.names if how.get(n, GIVEN) in (IDENTIFIED, NOT_IDENTIFIED))
    kept = [spread.names.index(name) for name in names]
    size = np.sqrt(np.diag(spread.covariance)[kept])
    return Correlation(names, spread.covariance[np.ix_(kept, kept)] / np.outer(size, size))


def _remarks(search: Search, how: dict[str, str], form: float) -> list[str]:
    """Sentences on what the frequencies do not determine."""
    problem, priors = search.problem, search.priors
    remarks = [
        f"Every ± holds the errors of the frequencies, {100 * form:.2g} % by which a ring deviates "
        f"from a tyre, and those of pressure ({100 * problem.priors.pressure_std:.2g} %) and "
        f"radius ({100 * problem.priors.radius_std:.2g} %)."
    ]
    if how[AXIAL] == NOT_IDENTIFIED:
        remarks.append(
            "These frequencies do not determine the axial stiffness K: it follows by eq 16 from an "
            f"assumed radial growth of {1e3 * problem.growth_m:.2f} mm on inflation. Give K "
            "(axial_stiffness_n_m), the measured growth, modal masses or the breathing frequency "
            "to determine it."
        )
    for name in (*search.held, *priors):
        if name in problem.priors.parameters or name == RADIAL_GROWTH:
            continue
        value, std = (priors | search.held)[name]
        remarks.append(
            f"{int(problem.used.sum())} frequencies are fewer than the unknowns: the "
            f"{_title(name)} was assumed to be {value:g} {RING_NAMES[name][2]} ± "
            f"{100 * std / value:.0f} %."
        )
    for name in search.free:
        if how.get(name) == NOT_IDENTIFIED:
            remarks.append(
                f"The {_title(name)} is not identified: an error of half its value "
                "cannot be ruled out, or other parameters can replace it."
            )
        if how.get(name) == AT_BOUND:
            remarks.append(f"The {_title(name)} is at a bound of its range.")
    return remarks


def _title(name: str) -> str:
    title, symbol, _ = RING_NAMES[name]
    return f"{title} {symbol}"
