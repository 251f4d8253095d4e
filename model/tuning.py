"""From measured natural frequencies to the parameters of a ring (section 4, eqs 16–18)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from model.arrays import finite_array, require_one_each, require_positive, whole_orders
from model.identifiability import (
    AT_BOUND,
    GIVEN,
    IDENTIFIED,
    NOT_IDENTIFIED,
    Correlation,
    LinearFit,
    correlation,
    error_level,
    verdicts,
)
from model.parameters import RING_NAMES, RingParameters
from model.sensitivity import frequency_sensitivity
from model.steady_state import PressureLoad
from model.tuning_problem import AXIAL, PARAMETERS, TuningProblem
from model.tuning_result import TuningResult
from model.tuning_search import Search, plan_search

_NOMINAL = 0.005  # relative frequency error that judges identifiability where none is known
_MORE_GROWTH = 0.1  # share of the assumed one: shows how much hangs on it
_SMALL = 1e-3  # share of the growth over which that is linear


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
    pressure_load: PressureLoad = "dead",
) -> TuningResult:
    """Tune ρh, k_r, k_θ and D on natural frequencies at Ω = 0.

    K follows k_r by eq 16 from the radial growth of the belt on inflation. The frequencies of
    n ≥ 1 hardly depend on K (d ln f / d ln K below 0.02), so without a measured growth, a given K
    or the breathing frequency (order 0) K is a placeholder and marked "not identified".

    Parameters
    ----------
    orders : array_like of int, shape (n_orders,)
        Circumferential orders, each once; 0 is the breathing mode.
    frequencies_hz : array_like, shape (n_orders,)
        Measured undamped natural frequencies, Hz.
    mean_radius_m, inflation_pressure_pa : float
        Mean radius a and pressure p_o; they set the scale, which no frequency can.
    frequency_std_hz : array_like, shape (n_orders,), or None
        Standard deviations of the frequencies, Hz. They set the parameters' standard deviations
        unless the model's misfit asks for larger ones; they do not weigh the fit.
    belt_width_m : float or None
        Belt width b, kept with the ring.
    objective : {"frequency", "paper"}
        Sum of squares of relative frequency deviations, or of eq 18. The latter weighs n = 7 about
        200 times as much as n = 1.
    given : mapping of str to float, or None
        Parameters of `RingParameters` that are known and stay.
    start : mapping of str to float, or None
        Further starting values; without them several are derived from the data.
    bounds : mapping of str to (float, float), or None
        Bounds of free parameters in place of the default ones.
    radial_growth_m : float or None
        Measured radial growth u_r° of the belt on inflation: determines K by eq 16.
    pressure_load : {"dead", "follower"}
        Pressure load the ring is tuned for; use the same one with it later.

    Returns
    -------
    TuningResult
        The ring and what is known about each of its parameters.

    Raises
    ------
    ParameterError
        For fewer than two frequencies, values that make no sense, or contradictory arguments.

    References
    ----------
    Section 4 of the paper, eqs 16 (K from u_r°), 17 and 18 (objective).

    Examples
    --------
    >>> import ringmodal as rm
    >>> tuned = rm.tune_ring(
    ...     [1, 2, 3, 4, 5, 6, 7],
    ...     [78.73, 100.31, 121.40, 145.45, 170.78, 196.52, 224.40],
    ...     mean_radius_m=0.33,
    ...     inflation_pressure_pa=2.2e5,
    ... )
    >>> bool(abs(tuned.model_hz / tuned.measured_hz - 1).max() < 0.01)
    True
    >>> tuned.how["radial_stiffness_n_m3"]
    'identified'
    """
    numbers, measured, relative_given = _checked(orders, frequencies_hz, frequency_std_hz)
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
    )

    with threadpool_limits(1, user_api="blas"):  # small matrices: threads only wait for each other
        search = plan_search(problem)
        values, found = search.run()
    ring = search.ring(values)
    fit = _linear_fit(search, values)
    how, std, relations, relative, source = _judge(search, fit, ring, relative_given)
    return TuningResult(
        ring=ring,
        std=std,
        how=how,
        orders=numbers,
        measured_hz=measured,
        model_hz=problem.frequencies_hz(ring),
        relative_std=relative,
        correlation=relations,
        sensitivity=frequency_sensitivity(ring, numbers, pressure_load=pressure_load),
        objective=objective,
        notes=(*_remarks(search, fit, ring, how), source, found),
    )


def _checked(
    orders: ArrayLike, frequencies_hz: ArrayLike, std_hz: ArrayLike | None
) -> tuple[NDArray[np.int_], NDArray[np.float64], NDArray[np.float64] | None]:
    numbers = np.atleast_1d(whole_orders(orders))
    measured = np.atleast_1d(finite_array("frequencies_hz", frequencies_hz))
    require_one_each("frequencies_hz", numbers, measured)
    require_positive("frequencies_hz", measured)
    if std_hz is None:
        return numbers, measured, None
    deviations = np.atleast_1d(finite_array("frequency_std_hz", std_hz))
    require_one_each("frequency_std_hz", numbers, deviations)
    require_positive("frequency_std_hz", deviations)
    return numbers, measured, deviations / measured


def _linear_fit(search: Search, values: NDArray[np.float64]) -> LinearFit:
    """The tuning, linearised at its solution; parameters on a bound stay there."""
    inner = ~search.at_bound(values)
    names = tuple(name for name, kept in zip(search.free, inner, strict=True) if kept)
    slope = search.residual_slope(values)[:, inner]
    return LinearFit(names, values[inner], slope, search.problem.data_slope(search.ring(values)))


def _judge(
    search: Search,
    fit: LinearFit,
    ring: RingParameters,
    relative_given: NDArray[np.float64] | None,
) -> tuple[dict[str, str], dict[str, float], Correlation, NDArray[np.float64], str]:
    """How each parameter was obtained, with standard deviations and correlations."""
    problem = search.problem
    relative, source = error_level(fit, problem.residual(ring), relative_given)
    covariance = fit.covariance(np.where(np.isfinite(relative), relative, _NOMINAL))
    if search.assumed:
        covariance = covariance + fit.spread(_assumption_slope(search, ring))
    found, std = verdicts(fit, covariance, fit.undetermined())
    how = dict.fromkeys(("mean_radius_m", "inflation_pressure_pa"), GIVEN)
    if problem.belt_width_m is not None:
        how["belt_width_m"] = GIVEN
    for name in PARAMETERS:
        how[name] = found.get(name) or _obtained(search, name)
    known = std if np.all(np.isfinite(relative)) else {}
    return how, known, correlation(fit.names, covariance), relative, source


def _assumption_slope(search: Search, ring: RingParameters) -> NDArray[np.float64]:
    """Change of the residuals if each assumed parameter were wrong by its own size."""
    names = tuple(search.assumed)
    sizes = np.array(list(search.assumed.values()))
    others = {name: getattr(ring, name) for name in search.free}
    wider = replace(
        search,
        free=names,
        assumed=others,
        scale=sizes,
        lower=np.zeros(sizes.size),
        upper=np.full(sizes.size, np.inf),
    )
    return np.asarray(wider.residual_slope(sizes) * sizes)


def _obtained(search: Search, name: str) -> str:
    """How a parameter was obtained that the fit did not move freely."""
    if name in search.problem.given:
        return GIVEN
    if name in search.free:
        return AT_BOUND
    by_growth = name == AXIAL and search.problem.radial_growth_m is not None
    return IDENTIFIED if by_growth else NOT_IDENTIFIED


def _remarks(
    search: Search, fit: LinearFit, ring: RingParameters, how: dict[str, str]
) -> list[str]:
    """Sentences on what the frequencies do not tell."""
    problem = search.problem
    remarks = []
    if how[AXIAL] == NOT_IDENTIFIED and AXIAL not in search.free:
        remarks.append(
            "These frequencies do not determine the axial stiffness K: it follows by eq 16 from an "
            f"assumed radial growth of {1e3 * problem.growth_m:.2f} mm on inflation"
            f"{_influence_of_growth(search, fit, ring)}. Give K (axial_stiffness_n_m), the "
            "measured growth or the breathing frequency to determine it."
        )
    for name, value in search.assumed.items():
        remarks.append(
            f"{problem.orders.size} frequencies are fewer than the unknowns: the {_title(name)} "
            f"was assumed to be {value:g} {RING_NAMES[name][2]}, uncertain by its own size."
        )
    for name in search.free:
        if how[name] == NOT_IDENTIFIED:
            remarks.append(
                f"The {_title(name)} is not identified: its standard deviation exceeds half its "
                "value, or other parameters can stand in for it."
            )
        if how[name] == AT_BOUND:
            remarks.append(
                f"The {_title(name)} ended on a bound of its range; the other standard deviations "
                "hold with it fixed there."
            )
    return remarks


def _influence_of_growth(search: Search, fit: LinearFit, ring: RingParameters) -> str:
    """How far the fitted parameters hang on the growth that was assumed."""
    if not fit.names:
        return ""
    problem = search.problem
    larger = replace(problem, radial_growth_m=(1 + _SMALL) * problem.growth_m)
    stiffness = larger.axial_stiffness_n_m(ring.radial_stiffness_n_m3)
    elsewhere = replace(ring, axial_stiffness_n_m=stiffness)
    moved = fit.moved(problem.residual(elsewhere) - problem.residual(ring))
    share = moved / fit.values * (_MORE_GROWTH / _SMALL)
    listed = ", ".join(
        f"{RING_NAMES[name][1]} by {100 * part:+.2f} %".replace("-", "−")
        for name, part in zip(fit.names, share, strict=True)
    )
    more = f"{100 * _MORE_GROWTH:.0f} % more growth would change"
    return f", and every ± holds for that; {more} {listed}"


def _title(name: str) -> str:
    title, symbol, _ = RING_NAMES[name]
    return f"{title} {symbol}"
