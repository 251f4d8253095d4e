"""Parameters of two tuned rings side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from model.identifiability import GIVEN, IDENTIFIED
from model.tuning_problem import PARAMETERS
from pipelines.compare.significance import Difference, judged
from pipelines.results.parameter_set import DAMPING_NAMES, RING_NAMES
from pipelines.results.result import Result

NOT_TESTED = "not tested"


@dataclass(frozen=True)
class ParameterChange:
    """A parameter of ring or damping in two results.

    Parameters
    ----------
    name : str
        As in ``tyre.toml``.
    first_std, second_std : float
        Standard deviations of both; NaN where unknown.
    first_how, second_how : str
        How each was obtained: given, identified, not identified or at bound.
    difference : Difference
        In the parameter's unit.
    alike : bool
        Whether the same parameters were given to both rings. If not, the one was fitted to what
        the other one found, and the difference is not one of the tyres.
    """

    name: str
    first_std: float
    second_std: float
    first_how: str
    second_how: str
    difference: Difference
    alike: bool = True

    @property
    def status(self) -> str:
        """Verdict on the difference; ``"not tested"`` unless both were identified."""
        return self.difference.status if self.is_tested else NOT_TESTED

    @property
    def is_tested(self) -> bool:
        """Whether both values come from the measurements."""
        return self.alike and self.first_how == self.second_how == IDENTIFIED

    @property
    def hows(self) -> str:
        """How both were obtained, for a difference that is not tested."""
        if not self.alike and self.first_how == self.second_how == IDENTIFIED:
            return "other parameters given"
        return " and ".join(dict.fromkeys((self.first_how, self.second_how)))


def given_alike(first_how: Mapping[str, str], second_how: Mapping[str, str]) -> bool:
    """Whether the same ring parameters were given to two tunings."""
    return all(
        (first_how.get(name) == GIVEN) == (second_how.get(name) == GIVEN) for name in PARAMETERS
    )


def parameter_changes(first: Result, second: Result) -> tuple[ParameterChange, ...]:
    """Parameters that both results have; the identified ones are tested together.

    Standard deviations of both are added as independent. Where they rest on the misfit of the
    ring model, which is much the same for two similar tyres, this is on the safe side: a
    significant change is one, a change that is not may still be real.

    Parameters
    ----------
    first, second : Result
        Tuned; without a ring in both there is nothing to compare.
    """
    if first.tuning is None or second.tuning is None:
        return ()
    changes = _changes(
        RING_NAMES,
        (first.tuning.ring, second.tuning.ring),
        (first.tuning.std, second.tuning.std),
        (first.tuning.how, second.tuning.how),
    )
    if first.damping is not None and second.damping is not None:
        changes += _changes(
            DAMPING_NAMES,
            (first.damping.damping, second.damping.damping),
            (first.damping.std, second.damping.std),
            (first.damping.how, second.damping.how),
        )
    alike = given_alike(first.tuning.how, second.tuning.how)
    changes = [replace(change, alike=alike) for change in changes]
    verdicts = iter(judged([change.difference for change in changes if change.is_tested]))
    return tuple(
        replace(change, difference=next(verdicts)) if change.is_tested else change
        for change in changes
    )


def _changes(
    names: tuple[str, ...],
    values: tuple[Any, Any],
    std: tuple[Mapping[str, float], Mapping[str, float]],
    how: tuple[Mapping[str, str], Mapping[str, str]],
) -> list[ParameterChange]:
    changes = []
    for name in names:
        one, two = (getattr(each, name) for each in values)
        if one is None or two is None:
            continue
        first_std, second_std = (each.get(name, float("nan")) for each in std)
        first_how, second_how = (each.get(name, GIVEN) for each in how)
        difference = Difference(float(one), float(two), math.hypot(first_std, second_std))
        changes.append(
            ParameterChange(name, first_std, second_std, first_how, second_how, difference)
        )
    return changes
