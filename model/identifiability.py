"""What the measured frequencies determine: the spread of tuned parameters, and what stays open."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, ReadonlyArrays, whole_orders
from model.coefficients import PressureLoad
from model.model_form import IN_95, ModelForm, model_form, with_model_form
from model.parameters import RING_NAMES, RingParameters
from model.ring import natural_frequencies_hz
from model.tuning_problem import CIRCUMFERENTIAL, WIDTH, Search

GIVEN = "given"
IDENTIFIED = "identified"
NOT_IDENTIFIED = "not identified"
AT_BOUND = "at bound"

#: A standard deviation above this share of the value means that the data do not determine it. Half
#: the value is then 2.5 of them: rarely off by that much, though large values are picked.
LARGEST_RELATIVE_STD = 0.2
#: Relative error of one frequency that is wrong: the other member of a split pair, a neighbouring
#: mode, a rim that gives way. A larger one is not expected.
WRONG_VALUE = 0.05
#: The same of order 1, which alone moves the rim, 1 σ where it is not tested: a fixture with a mode
#: at 300 Hz and a rim of 10 kg lowers it by 3 %.
ORDER_1_STD = WRONG_VALUE / 2.0
#: Standard deviations from which on one value among all others is told to be wrong: 0.4 % of eight
#: right ones.
OUTLIER = 3.5
_RANK = 1e-9  # singular value over the largest one that counts as zero
#: Parameters that the frequencies of a ring depend on, besides its radius.
SENSITIVE = (
    "mass_per_area_kg_m2",
    "radial_stiffness_n_m3",
    "circumferential_stiffness_n_m3",
    "axial_stiffness_n_m",
    "bending_stiffness_n_m",
    "inflation_pressure_pa",
)
_STEP = 1e-4  # relative; central differences then err by about 1e-8
_CHANGE = 1e-4  # relative; of pressure, radius and held values


@dataclass(frozen=True, eq=False)
class Sensitivity(ReadonlyArrays):
    """Logarithmic sensitivities of natural frequencies.

    Parameters
    ----------
    orders : ndarray of int, shape (n_orders,)
        Circumferential orders, the rows.
    parameters : tuple of str
        Parameter names, the columns.
    values : ndarray, shape (n_orders, n_parameters)
        d ln f / d ln parameter, without unit; the other parameters held.
    """

    orders: NDArray[np.int_]
    parameters: tuple[str, ...]
    values: Array


def frequency_sensitivity(
    ring: RingParameters, orders: ArrayLike, *, pressure_load: PressureLoad = "dead"
) -> Sensitivity:
    """Sensitivities of the natural frequencies at Ω = 0 to every parameter of `SENSITIVE`.

    The rows add up to zero: scaling mass, stiffnesses and pressure together changes no frequency,
    which is why one of them must be given.
    """
    numbers = np.atleast_1d(whole_orders(orders))

    def log_frequency(name: str, factor: float) -> Array:
        moved = replace(ring, **{name: getattr(ring, name) * factor})
        return np.log(natural_frequencies_hz(moved, numbers, pressure_load=pressure_load))

    width = np.log1p(_STEP) - np.log1p(-_STEP)
    columns = [
        (log_frequency(name, 1.0 + _STEP) - log_frequency(name, 1.0 - _STEP)) / width
        for name in SENSITIVE
    ]
    return Sensitivity(numbers, SENSITIVE, np.column_stack(columns))


@dataclass(frozen=True, eq=False)
class Correlation(ReadonlyArrays):
    """Correlation matrix of the identified parameters."""

    parameters: tuple[str, ...]  # names, in the order of rows and columns
    values: Array  # NaN where no standard deviation is known


@dataclass(frozen=True, eq=False)
class LinearFit(ReadonlyArrays):
    """A least-squares estimate linearised at its solution, in natural logarithms of the data."""

    names: tuple[str, ...]  # free parameters that are not at a bound
    values: Array
    residual_slope: Array  # d residual / d parameter, (n_data, n_free)
    data_slope: Array  # d residual_i / d ln data_i

    def undetermined(self) -> dict[str, bool]:
        """Whether each parameter can change without changing any residual (rank of the slopes)."""
        if not self.names:
            return {}
        _, singular, rows = np.linalg.svd(self.residual_slope * self._scale, full_matrices=True)
        padded = np.zeros(len(self.names))
        padded[: singular.size] = singular
        null = rows[padded <= _RANK * padded.max()]
        share = np.sqrt((null**2).sum(axis=0))
        return {name: bool(part > 1e-3) for name, part in zip(self.names, share, strict=True)}

    def spread(self, residual_changes: Array) -> Array:
        """Covariance of the parameters for independent changes of the residuals (n_data, n)."""
        moved = self.moved(residual_changes)
        return np.asarray(moved @ moved.T)

    def moved(self, residual_changes: Array) -> Array:
        """Change of the parameters for changes of the residuals, (n_data,) or (n_data, n)."""
        inverse = np.linalg.pinv(self.residual_slope * self._scale, rcond=_RANK)
        return np.asarray(-self._scale[:, None] * inverse @ residual_changes)

    @property
    def _scale(self) -> Array:
        return np.where(self.values > 0, self.values, 1.0)


@dataclass(frozen=True, eq=False)
class Assessment:
    """How each parameter of a fit was obtained, with standard deviations and correlations."""

    how: dict[str, str]
    std: dict[str, float]
    correlation: Correlation
    relative_std: Array
    note: str


def assess(
    fit: LinearFit,
    residual: Array,
    given: Array | None,
    *,
    nominal: float,
    undetermined: dict[str, bool],
    further: Array | float = 0.0,
) -> Assessment:
    """Assess every fitted parameter from relative standard deviations of the data.

    These are `given`, or else follow from the residuals; `nominal` decides where neither is known,
    and no standard deviations are stated then. `further` is a covariance from other causes. A
    parameter is not identified where it is undetermined (see `LinearFit.undetermined`), or where
    its standard deviation exceeds a fifth of its value.
    """
    relative, note = _error_level(fit, residual, given)
    known = bool(np.all(np.isfinite(relative)))
    covariance = fit.spread(np.diag(fit.data_slope * (relative if known else nominal))) + further
    how, std = {}, {}
    for name, value, variance in zip(fit.names, fit.values, np.diag(covariance), strict=True):
        deviation = float(np.sqrt(variance))
        vague = undetermined[name] or deviation > LARGEST_RELATIVE_STD * value
        how[name] = NOT_IDENTIFIED if vague else IDENTIFIED
        if known and not undetermined[name]:
            std[name] = deviation
    size = np.sqrt(np.diag(covariance))
    with np.errstate(divide="ignore", invalid="ignore"):  # NaN where a variance is zero
        correlation = Correlation(fit.names, covariance / np.outer(size, size))
    return Assessment(how, std, correlation, relative, note)


def _error_level(fit: LinearFit, residual: Array, given: Array | None) -> tuple[Array, str]:
    """Relative standard deviation of each datum, and a note on its source.

    It is the given one, but at least that of the fit residuals; NaN where neither is known.
    """
    spare = residual.size - len(fit.names)
    measured = "Standard deviations are from those of the measured values."
    if spare <= 0:
        if given is not None:
            return given, measured
        note = "No standard deviations: the measured values have none, and no data are redundant."
        return np.full(residual.size, np.nan), note
    implied = np.sqrt(np.sum(residual**2) / spare) / np.abs(fit.data_slope)
    if given is not None and np.all(given >= implied):
        return given, measured
    note = f"Standard deviations are from the fit residuals ({100.0 * np.median(implied):.2g} %)"
    if given is None:
        return np.asarray(implied), f"{note}."
    return np.maximum(given, implied), f"{note} where these exceed those of the measured values."


_DRAWS, _LEAST_DRAWS = 4000, 100  # of a posterior that ends at a bound


@dataclass(frozen=True, eq=False)
class Spread(ReadonlyArrays):
    """Covariance of the ring's parameters around those found."""

    names: tuple[str, ...]  # parameters with a standard deviation, pressure and radius among them
    covariance: Array  # (n, n), SI
    fit: LinearFit  # the tuning linearised at its solution, without parameters at a bound
    free_std: dict[str, float]  # standard deviation of each free parameter of the search

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def posterior_spread(search: Search, values: Array, *, order_1_std: float = 0.0) -> Spread:
    """Covariance of the ring's parameters for all errors that the problem states.

    With `order_1_std`, that of k_θ has this relative error of order 1 besides.
    """
    problem, bound = search.problem, search.at_bound(values)
    slope = search.with_slope(values)[:, 1:]
    ring = search.ring(values)
    errors = problem.data_errors(ring)
    errors = scipy.linalg.block_diag(errors, np.eye(len(search.priors)))
    width = errors.shape[1] - len(search.priors) - 1
    names = tuple(name for name, held in zip(search.free, bound, strict=True) if not held)
    fit = LinearFit(names, values[~bound], slope[:, ~bound], np.ones(slope.shape[0]))
    known = _known_changes(search, values)
    if order_1_std:
        moves = order_1_share(search, values) * order_1_std * ring.circumferential_stiffness_n_m3
        known.append((np.zeros(slope.shape[0]), {CIRCUMFERENTIAL: moves}))
    moved = np.zeros((values.size, errors.shape[1] + len(known)))
    moved[~bound] = fit.moved(np.column_stack([errors, *(change for change, _ in known)]))
    if bound.any():
        cut = _cut_at_bounds(search, values, slope)
        moved[:, : errors.shape[1]] = 0.0
        moved = np.column_stack([moved, cut])
    rows = {name: row @ moved for name, row in _ring_rows(search, values).items()}
    for column, (_, own) in enumerate(known, errors.shape[1]):
        for name, change in own.items():
            rows.setdefault(name, np.zeros(moved.shape[1]))[column] += change
    if problem.belt_width_m is not None and problem.priors.width_std:
        rows[WIDTH] = np.zeros(moved.shape[1])
        rows[WIDTH][width] = problem.priors.width_std * problem.belt_width_m
    names = tuple(name for name in RING_NAMES if name in rows and np.any(rows[name]))
    total = np.array([rows[name] for name in names]).reshape(len(names), -1)
    free_std = dict(zip(search.free, np.linalg.norm(moved, axis=1).tolist(), strict=True))
    return Spread(names, total @ total.T, fit, free_std)


def calibrated(spread: Spread, wide: Spread, form: ModelForm) -> Spread:
    """The spread whose 1.96 standard deviations hold 95 %, whichever the model form is.

    Small ones are the likeliest where residuals are small, and large ones make the rms. Variances
    are linear in that of the model form; `wide` is the spread at twice its rms.
    """
    own, of_form = _parts(spread, wide)
    half = [form.half_of_95(*each) for each in zip(own, of_form, strict=True)]
    factor = np.array(half) / (IN_95 * np.sqrt(np.diag(spread.covariance)))
    return replace(spread, covariance=spread.covariance * np.outer(factor, factor))


def chances_of_half(
    values: Mapping[str, float], spread: Spread, wide: Spread, form: ModelForm
) -> dict[str, float]:
    """Probability that each parameter is off by more than half its value."""
    parts = zip(spread.names, *_parts(spread, wide), strict=True)
    return {name: form.chance_beyond(0.5 * values[name], *each) for name, *each in parts}


def _parts(spread: Spread, wide: Spread) -> tuple[Array, Array]:
    """Variance of each parameter by all but the model form, and by that."""
    total, far = np.diag(spread.covariance), np.array([wide.std[n] ** 2 for n in spread.names])
    of_form = np.clip((far - total) / 3.0, 0.0, total)
    return total - of_form, of_form


def order_1_is_tested(search: Search, values: Array) -> bool:
    """Whether the other data would tell a wrong order 1; where its error is stated, they need not.

    An error e of one value leaves √r·e in its residual, with the redundancy r that the others give
    it (Baarda 1968). The deviation of the tyre from a ring is that of the residuals.
    """
    problem = search.problem
    is_free_of_it = problem.objective == "paper" or 1 not in problem.orders[problem.used]
    if is_free_of_it or problem.priors.order_1_std is not None:
        return True
    search = with_model_form(search, model_form(search, values).std)
    wrong = _order_1_change(search, WRONG_VALUE)
    slope = search.with_slope(values)[:, 1:] * search.scale
    own = wrong - slope @ (np.linalg.pinv(slope, rcond=_RANK) @ wrong)
    return float(wrong @ own) > OUTLIER**2


def order_1_share(search: Search, values: Array) -> float:
    """Relative change of k_θ over that of the measured order 1; 0 where k_θ is not free."""
    loose = ~search.at_bound(values)
    names = tuple(name for name, kept in zip(search.free, loose, strict=True) if kept)
    if CIRCUMFERENTIAL not in names:
        return 0.0
    slope = search.with_slope(values)[:, 1:][:, loose]
    fit = LinearFit(names, values[loose], slope, np.ones(slope.shape[0]))
    place = names.index(CIRCUMFERENTIAL)
    return float(fit.moved(-_order_1_change(search, 1.0))[place] / fit.values[place])


def _order_1_change(search: Search, error: float) -> Array:
    """Change of the residuals by a relative error of order 1."""
    problem = search.problem
    place = int(np.flatnonzero(problem.orders[problem.used] == 1)[0])
    change = np.zeros(search.residual(search.scale).size)
    change[place] = error / problem.single_errors[place]
    return change


def _ring_rows(search: Search, values: Array) -> dict[str, Array]:
    """Slopes of the ring's parameters over the free ones; K follows from the growth."""

    def parameters(x: Array) -> Array:
        return np.array([getattr(search.ring(x), name) or 0.0 for name in RING_NAMES])

    columns = []
    for step in np.diag(_CHANGE * search.scale):
        ahead = np.minimum(values + step, search.upper)
        behind = np.maximum(values - step, search.lower)
        columns.append((parameters(ahead) - parameters(behind)) / (ahead - behind).sum())
    slopes = np.column_stack(columns)
    return {name: row for name, row in zip(RING_NAMES, slopes, strict=True) if np.any(row)}


def _known_changes(search: Search, values: Array) -> list[tuple[Array, dict[str, float]]]:
    """For one standard deviation of each value taken as known: residuals, ring parameters."""
    problem, priors = search.problem, search.problem.priors
    residual, ring = search.residual(values), search.ring(values)
    found = []
    for name, share in (
        ("inflation_pressure_pa", priors.pressure_std),
        ("mean_radius_m", priors.radius_std),
    ):
        off = replace(problem, **{name: getattr(problem, name) * (1.0 + _CHANGE)})
        change = (search.residual(values, off) - residual) / _CHANGE * share
        found.append((change, _moved_parameters(ring, search.ring(values, off), share)))
    for name, (value, std) in search.held.items():
        other = replace(search, held={**search.held, name: (value * (1.0 + _CHANGE), std)})
        share = std / value
        change = (other.residual(values) - residual) / _CHANGE * share
        found.append((change, _moved_parameters(ring, other.ring(values), share)))
    return [(change, own) for change, own in found if np.any(change)]


def _moved_parameters(ring: object, off: object, share: float) -> dict[str, float]:
    changes = {
        name: ((getattr(off, name) or 0.0) - (getattr(ring, name) or 0.0)) / _CHANGE * share
        for name in RING_NAMES
    }
    return {name: change for name, change in changes.items() if change}


def _cut_at_bounds(search: Search, values: Array, slope: Array) -> Array:
    """Square root of the second moment around `values` of a posterior that ends at the bounds.

    The normal distribution without bounds has its centre beyond them; what lies inside remains.
    """
    scaled = slope * search.scale
    covariance = np.linalg.pinv(scaled.T @ scaled, rcond=1e-12, hermitian=True)
    size, axes = np.linalg.eigh(covariance)
    root = axes * np.sqrt(np.maximum(size, 0.0))
    centre = values / search.scale - covariance @ (scaled.T @ search.residual(values))
    drawn = centre + np.random.default_rng(0).standard_normal((_DRAWS, values.size)) @ root.T
    low, high = search.lower / search.scale, search.upper / search.scale
    inside = drawn[np.all((drawn >= low) & (drawn <= high), axis=1)]
    if len(inside) < _LEAST_DRAWS:  # far beyond the bound: no step off it fits the data
        held = search.at_bound(values)
        root[held] = 0.0
        return np.asarray(root * search.scale[:, None])
    moment = (inside - values / search.scale).T @ (inside - values / search.scale) / len(inside)
    size, axes = np.linalg.eigh(moment)
    return np.asarray(axes * np.sqrt(np.maximum(size, 0.0)) * search.scale[:, None])
