"""How far a tyre may be from a ring: what the residuals of a tuning leave of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from model.arguments import Array, ReadonlyArrays
from model.tuning_problem import WIDTH, Search, TuningProblem, plan_search

#: Largest over smallest model form that is likely before the data, each size as likely as another:
#: from a ring in a computer, exact but for hundredths of a hertz, to a tyre whose rim or bead gives
#: way. From a fiftieth on, the ± of D of such rings were twice too wide.
_FORM_RANGE = 500.0
_FORM_SIZES = 100  # that are compared
#: An order whose own error exceeds the median this often says nothing of the model form.
_LARGE_ERROR = 4.0
IN_95 = 1.959964  # standard deviations to either side that hold 95 % of a normal distribution
_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, eq=False)
class ModelForm(ReadonlyArrays):
    """How far a tyre may be from a ring, relative, as the residuals leave it of the prior.

    The prior is uniform in the logarithm and has the stated value as its rms, which remains without
    spare data. Few residuals that happen to be small narrow it little: large ones stay possible.
    """

    size: Array
    probability: Array

    @property
    def std(self) -> float:
        """Root mean square."""
        return float(np.sqrt(self.probability @ self.size**2))

    def chance_beyond(self, limit: float, own: float, of_form: float) -> float:
        """Probability of an error beyond a limit, of variance `own` and, at the rms, `of_form`."""
        variance = own + of_form * (self.size / max(self.std, _TINY)) ** 2
        beyond = 2.0 * scipy.special.ndtr(-limit / np.sqrt(np.maximum(variance, _TINY)))
        return float(self.probability @ beyond)

    def half_of_95(self, own: float, of_form: float) -> float:
        """Half the width within which such an error is with a probability of 95 %."""
        share = (self.size[[0, -1]] / max(self.std, _TINY)) ** 2
        least, most = IN_95 * np.sqrt(own + of_form * share) * (0.99, 1.01)

        def excess(limit: float) -> float:
            return self.chance_beyond(limit, own, of_form) - 0.05

        return float(scipy.optimize.brentq(excess, least, most))


def model_form(search: Search, values: Array) -> ModelForm:
    """Deviation of ring and tyre that the residuals of a tuning leave."""
    problem = search.problem
    used, prior = problem.used, problem.priors.model_form_std
    own = np.zeros(problem.orders.size) if problem.relative_std is None else problem.relative_std
    telling = used & (own <= _LARGE_ERROR * np.median(own[used]))
    spare = degrees_of_freedom(search) - int(used.sum() - telling.sum())
    if spare <= 0 or not prior:
        return ModelForm(np.array([prior]), np.ones(1))
    own_variance = float(np.mean(own[telling] ** 2))
    squares = float(np.sum(problem.relative_deviations(search.ring(values))[telling] ** 2))
    size = np.geomspace(1.0 / _FORM_RANGE, 1.0, _FORM_SIZES)
    size *= prior / np.sqrt(np.mean(size**2))
    variance = size**2 + own_variance
    logarithm = -0.5 * (spare * np.log(variance) + squares / variance)
    likely = np.exp(logarithm - logarithm.max())
    form = ModelForm(size, likely / likely.sum())
    excess = max(squares / spare - own_variance, 0.0)  # may be beyond all that is likely
    return ModelForm(np.sqrt([excess]), np.ones(1)) if excess > form.std**2 else form


def restarted(problem: TuningProblem, search: Search, values: Array) -> tuple[Search, Array]:
    """Tune a similar problem from the solution of another."""
    other = plan_search(problem)
    start = dict(zip(search.free, values.tolist(), strict=True))
    near = [start.get(name, size) for name, size in zip(other.free, other.scale, strict=True)]
    return other, other.solution(np.array(near))


def with_model_form(search: Search, std: float) -> Search:
    """The search with another deviation of the tyre from a ring."""
    problem = search.problem
    priors = replace(problem.priors, model_form_std=std)
    return replace(search, problem=replace(problem, priors=priors))


def degrees_of_freedom(search: Search) -> int:
    """Frequencies less the parameters that only they determine."""
    with_prior = set(search.priors) | {WIDTH}
    free = sum(name not in with_prior for name in search.free)
    return int(search.problem.used.sum()) - free
