"""From measured natural frequencies to the parameters of a ring (section 4, eqs 16–18)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from model.arrays import Array, ReadonlyArrays, measured_orders
from model.coefficients import PressureLoad
from model.display import table, value_with_std
from model.identifiability import (
    AT_BOUND,
    GIVEN,
    IDENTIFIED,
    NOT_IDENTIFIED,
    Correlation,
    LinearFit,
    Sensitivity,
    assess,
    frequency_sensitivity,
)
from model.parameters import RING_NAMES, RingParameters, as_typed, listed_parameters
from model.tuning_problem import AXIAL, PARAMETERS, Search, TuningProblem, plan_search

if TYPE_CHECKING:
    import pandas as pd

_NOMINAL = 0.005  # relative frequency error that decides on identifiability where none is known
_MORE_GROWTH = 0.1  # change of the assumed growth whose influence is reported, as a share
_SMALL = 1e-3  # share of the growth over which the influence is linear


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
        Circumferential orders used.
    measured_hz, model_hz : ndarray, shape (n_orders,)
        Measured natural frequencies and those of the tuned ring at Ω = 0.
    relative_std : ndarray, shape (n_orders,)
        Relative standard deviation of each frequency behind `std`; NaN where none is known.
    correlation : Correlation
        Of the free parameters.
    sensitivity : Sensitivity
        d ln f / d ln parameter at the solution.
    objective : str
        ``"frequency"`` or ``"paper"``.
    notes : tuple of str
        Remarks for the reader, in sentences.

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

    def __repr__(self) -> str:
        identified = [RING_NAMES[name][1] for name, how in self.how.items() if how == IDENTIFIED]
        orders = ", ".join(str(order) for order in self.orders)
        worst = float(np.max(np.abs(self.error_percent)))
        return (
            f"<TuningResult: orders {orders}, largest deviation {worst:.2f} %, "
            f"identified {', '.join(identified) or 'nothing'}>"
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
    pressure_load: PressureLoad = "dead",
) -> TuningResult:
    """Tune ρh, k_r, k_θ and D on natural frequencies at Ω = 0 (section 4, eqs 16 to 18).

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
        Mean radius a and pressure p_o; they set the scale, which frequencies do not determine.
    frequency_std_hz : array_like, shape (n_orders,), or None
        Standard deviations of the frequencies, Hz. They set the parameters' standard deviations
        unless the fit residuals imply larger ones; they do not weight the fit.
    belt_width_m : float or None
        Belt width b, kept with the ring.
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
    pressure_load : {"dead", "follower"}
        Pressure load the ring is tuned for; use the same one with it later.

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
    numbers, measured, relative_given = measured_orders(
        "frequencies_hz", orders, frequencies_hz, "frequency_std_hz", frequency_std_hz
    )
    tyre = mean_radius_m, inflation_pressure_pa, belt_width_m, objective
    known = given or {}, start or {}, bounds or {}
    problem = TuningProblem(numbers, measured, *tyre, *known, radial_growth_m, pressure_load)
    with threadpool_limits(1, user_api="blas"):  # threads slow small matrices down
        search = plan_search(problem)
        values, starts = search.run()
    ring = search.ring(values)
    fit = _linear_fit(search, values)
    found = assess(
        fit,
        problem.residual(ring),
        relative_given,
        nominal=_NOMINAL,
        undetermined=fit.undetermined(),
        further=fit.spread(_assumption_slope(search, ring)) if search.assumed else 0.0,
    )
    how = _how(search, found.how)
    return TuningResult(
        ring=ring,
        std=found.std,
        how=how,
        orders=numbers,
        measured_hz=measured,
        model_hz=problem.frequencies_hz(ring),
        relative_std=found.relative_std,
        correlation=found.correlation,
        sensitivity=frequency_sensitivity(ring, numbers, pressure_load=pressure_load),
        objective=objective,
        notes=(*_remarks(search, fit, ring, how), found.note, starts),
    )


def _linear_fit(search: Search, values: Array) -> LinearFit:
    """The tuning, linearised at its solution; parameters on a bound are fixed."""
    inner = ~search.at_bound(values)
    names = tuple(name for name, kept in zip(search.free, inner, strict=True) if kept)
    slope = search.residual_slope(values)[:, inner]
    return LinearFit(names, values[inner], slope, search.problem.data_slope(search.ring(values)))


def _how(search: Search, fitted: dict[str, str]) -> dict[str, str]:
    """How each parameter was obtained, those that were not fitted included."""
    problem = search.problem
    how = dict.fromkeys(("mean_radius_m", "inflation_pressure_pa"), GIVEN)
    if problem.belt_width_m is not None:
        how["belt_width_m"] = GIVEN
    for name in PARAMETERS:
        if name in problem.given:
            how[name] = GIVEN
        elif name == AXIAL and name not in search.free and problem.radial_growth_m is not None:
            how[name] = IDENTIFIED
        else:
            how[name] = fitted.get(name, AT_BOUND if name in search.free else NOT_IDENTIFIED)
    return how


def _assumption_slope(search: Search, ring: RingParameters) -> Array:
    """Change of the residuals if each assumed parameter were wrong by its own size."""
    names = tuple(search.assumed)
    sizes = np.array(list(search.assumed.values()))
    others = {name: getattr(ring, name) for name in search.free}
    lower, upper = np.zeros(sizes.size), np.full(sizes.size, np.inf)
    wider = replace(search, free=names, assumed=others, scale=sizes, lower=lower, upper=upper)
    return np.asarray(wider.residual_slope(sizes) * sizes)


def _remarks(
    search: Search, fit: LinearFit, ring: RingParameters, how: dict[str, str]
) -> list[str]:
    """Sentences on what the frequencies do not determine."""
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
            f"was assumed to be {value:g} {RING_NAMES[name][2]} ± 100 %."
        )
    for name in search.free:
        if how[name] == NOT_IDENTIFIED:
            remarks.append(
                f"The {_title(name)} is not identified: its standard deviation exceeds half its "
                "value, or other parameters can replace it."
            )
        if how[name] == AT_BOUND:
            held = "the other standard deviations hold with it fixed there"
            remarks.append(f"The {_title(name)} is at a bound of its range; {held}.")
    return remarks


def _influence_of_growth(search: Search, fit: LinearFit, ring: RingParameters) -> str:
    """How far the fitted parameters depend on the assumed growth."""
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
