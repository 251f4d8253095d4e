"""What a fit determines: standard deviations, correlations and a verdict on each parameter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import readonly

GIVEN = "given"
IDENTIFIED = "identified"
NOT_IDENTIFIED = "not identified"
AT_BOUND = "at bound"

#: A standard deviation above this share of the value means that the data do not determine it.
LARGEST_RELATIVE_STD = 0.5
_RANK = 1e-9  # singular value over the largest one that counts as zero


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlation matrix of the identified parameters.

    Parameters
    ----------
    parameters : tuple of str
        Names, in the order of rows and columns.
    values : ndarray, shape (n_parameters, n_parameters)
        Correlation coefficients; NaN where no standard deviation is known.
    """

    parameters: tuple[str, ...]
    values: NDArray[np.float64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", readonly(self.values))


@dataclass(frozen=True, eq=False)
class LinearFit:
    """A least-squares estimate linearised at its solution, in natural logarithms of the data.

    Parameters
    ----------
    names : tuple of str
        Free parameters that are not at a bound.
    values : ndarray, shape (n_free,)
        Their values.
    residual_slope : ndarray, shape (n_data, n_free)
        d residual / d parameter.
    data_slope : ndarray, shape (n_data,)
        d residual_i / d ln data_i.
    """

    names: tuple[str, ...]
    values: NDArray[np.float64]
    residual_slope: NDArray[np.float64]
    data_slope: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("values", "residual_slope", "data_slope"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    def undetermined(self) -> dict[str, bool]:
        """Whether each parameter can move without any residual noticing (rank of the slopes)."""
        if not self.names:
            return {}
        scaled = self._scaled_slope()
        _, singular, rows = np.linalg.svd(scaled, full_matrices=True)
        padded = np.zeros(len(self.names))
        padded[: singular.size] = singular
        null = rows[padded <= _RANK * padded.max()]
        share = np.sqrt((null**2).sum(axis=0))
        return {name: bool(part > 1e-3) for name, part in zip(self.names, share, strict=True)}

    def covariance(self, relative_std: ArrayLike) -> NDArray[np.float64]:
        """Covariance of the parameters for independent relative errors of the data."""
        return self.spread(np.diag(self.data_slope * np.asarray(relative_std, dtype=float)))

    def spread(self, residual_changes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Covariance of the parameters for independent unit causes that change the residuals.

        Parameters
        ----------
        residual_changes : ndarray, shape (n_data, n_causes)
            Change of each residual by each cause.
        """
        moved = self.moved(residual_changes)
        return np.asarray(moved @ moved.T)

    def moved(self, residual_changes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Change of the parameters, row by row, that answers changes of the residuals.

        Parameters
        ----------
        residual_changes : ndarray, shape (n_data,) or (n_data, n_causes)
        """
        gain = np.linalg.pinv(self._scaled_slope(), rcond=_RANK) * self._scale()[:, None]
        return np.asarray(-gain @ residual_changes)

    def _scale(self) -> NDArray[np.float64]:
        return np.where(self.values > 0, self.values, 1.0)

    def _scaled_slope(self) -> NDArray[np.float64]:
        return np.asarray(self.residual_slope * self._scale())


def correlation(names: tuple[str, ...], covariance: NDArray[np.float64]) -> Correlation:
    """Normalise a covariance; NaN where a variance is zero or unknown."""
    std = np.sqrt(np.diag(covariance))
    product = np.outer(std, std)
    known = np.where(product > 0, product, 1.0)
    return Correlation(names, np.where(product > 0, covariance / known, np.nan))


def verdicts(
    fit: LinearFit, covariance: NDArray[np.float64], free: dict[str, bool]
) -> tuple[dict[str, str], dict[str, float]]:
    """How each fitted parameter was obtained, and its standard deviation where it has one.

    Not identified is a parameter that is undetermined (`free`, see `LinearFit.undetermined`), or
    whose standard deviation exceeds half its value.
    """
    how: dict[str, str] = {}
    std: dict[str, float] = {}
    for name, value, variance in zip(fit.names, fit.values, np.diag(covariance), strict=True):
        deviation = float(np.sqrt(variance))
        vague = free[name] or deviation > LARGEST_RELATIVE_STD * value
        how[name] = NOT_IDENTIFIED if vague else IDENTIFIED
        if not free[name]:
            std[name] = deviation
    return how, std


def error_level(
    fit: LinearFit, residual: NDArray[np.float64], given: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], str]:
    """Relative standard deviation of each datum: the given one, never below the misfit's.

    Parameters
    ----------
    fit : LinearFit
        The fit; its free parameters are subtracted from the number of data.
    residual : ndarray, shape (n_data,)
        What the fit leaves, in the measure that it minimised.
    given : ndarray, shape (n_data,), or None
        Relative standard deviations of the measurement.

    Returns
    -------
    relative_std : ndarray, shape (n_data,)
        NaN where neither source says anything.
    note : str
        Which of the two it rests on, as a sentence.
    """
    spare = residual.size - len(fit.names)
    if spare <= 0 and given is None:
        return np.full(residual.size, np.nan), (
            "No standard deviations: as many data as parameters leave no misfit to judge by, and "
            "the measured values came without any."
        )
    if spare <= 0 and given is not None:
        return np.array(given), "Standard deviations follow from those of the measured values."
    implied = np.sqrt(np.sum(residual**2) / spare) / np.abs(fit.data_slope)
    if given is not None and np.all(given >= implied):
        return np.array(given), "Standard deviations follow from those of the measured values."
    level = f"the model's misfit ({100.0 * np.median(implied):.2g} %)"
    if given is None:
        return np.asarray(implied), f"Standard deviations follow from {level}."
    return np.maximum(given, implied), (
        f"Standard deviations follow from {level}, where it exceeds those of the measured values."
    )
