"""Posterior spread of a tuned ring: errors of the data, of the priors and of what is held."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from model.arguments import Array, ReadonlyArrays
from model.identifiability import LinearFit
from model.parameters import RING_NAMES
from model.tuning_problem import WIDTH, Search

_STEP = 1e-4  # relative; of pressure, radius and held values
_DRAWS, _LEAST_DRAWS = 4000, 100  # of a posterior that ends at a bound
#: Weight of the prior model form, in degrees of freedom, beside the residuals.
_FORM_WEIGHT = 2.0


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


def model_form_std(search: Search, values: Array) -> float:
    """Relative deviation of ring and tyre: the prior one and the residuals' together.

    A scaled inverse χ² of two degrees of freedom is the prior: without spare data it remains.
    """
    problem = search.problem
    used, prior = problem.used, problem.priors.model_form_std
    own = np.zeros(problem.orders.size) if problem.relative_std is None else problem.relative_std
    spare = degrees_of_freedom(search)
    if spare <= 0:
        return prior
    squares = np.sum(problem.relative_deviations(search.ring(values))[used] ** 2)
    excess = max(float(squares - spare * np.mean(own[used] ** 2)), 0.0)
    return float(np.sqrt((_FORM_WEIGHT * prior**2 + excess) / (_FORM_WEIGHT + spare)))


def degrees_of_freedom(search: Search) -> int:
    """Frequencies less the parameters that only they determine."""
    with_prior = set(search.priors) | {WIDTH}
    free = sum(name not in with_prior for name in search.free)
    return int(search.problem.used.sum()) - free


def posterior_spread(search: Search, values: Array) -> Spread:
    """Covariance of the ring's parameters for all errors that the problem states."""
    problem, bound = search.problem, search.at_bound(values)
    slope = search.residual_slope(values)
    ring = search.ring(values)
    errors = problem.data_errors(ring)
    errors = block_diag(errors, np.eye(len(search.priors)))
    width = errors.shape[1] - len(search.priors) - 1
    names = tuple(name for name, held in zip(search.free, bound, strict=True) if not held)
    fit = LinearFit(names, values[~bound], slope[:, ~bound], np.ones(slope.shape[0]))
    known = _known_changes(search, values)
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


def _ring_rows(search: Search, values: Array) -> dict[str, Array]:
    """Slopes of the ring's parameters over the free ones; K follows from the growth."""

    def parameters(x: Array) -> Array:
        return np.array([getattr(search.ring(x), name) or 0.0 for name in RING_NAMES])

    columns = []
    for step in np.diag(_STEP * search.scale):
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
        off = replace(problem, **{name: getattr(problem, name) * (1.0 + _STEP)})
        change = (search.residual(values, off) - residual) / _STEP * share
        found.append((change, _moved_parameters(ring, search.ring(values, off), share)))
    for name, (value, std) in search.held.items():
        other = replace(search, held={**search.held, name: (value * (1.0 + _STEP), std)})
        share = std / value
        change = (other.residual(values) - residual) / _STEP * share
        found.append((change, _moved_parameters(ring, other.ring(values), share)))
    return [(change, own) for change, own in found if np.any(change)]


def _moved_parameters(ring: object, off: object, share: float) -> dict[str, float]:
    changes = {
        name: ((getattr(off, name) or 0.0) - (getattr(ring, name) or 0.0)) / _STEP * share
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
