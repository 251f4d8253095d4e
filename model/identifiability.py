"""What a fit determines: sensitivities, standard deviations, correlations, verdicts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, ReadonlyArrays, whole_orders
from model.coefficients import PressureLoad
from model.parameters import RingParameters
from model.ring import natural_frequencies_hz

GIVEN = "given"
IDENTIFIED = "identified"
NOT_IDENTIFIED = "not identified"
AT_BOUND = "at bound"

#: A standard deviation above this share of the value means that the data do not determine it: two
#: of them are then half the value.
LARGEST_RELATIVE_STD = 0.25
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
    its standard deviation exceeds a quarter of its value.
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
