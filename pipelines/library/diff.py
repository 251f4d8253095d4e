"""Two parameter sets side by side: what differs, and whether by more than the error bars allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan
from typing import Any

from pipelines.compare.significance import ParameterChange, parameter_changes
from pipelines.library.library import NamedSet
from pipelines.results.parameter_set import Parameter, ParameterSet


@dataclass(frozen=True)
class SetDifference:
    """What differs between two parameter sets; differences are second minus first.

    Parameters
    ----------
    first, second : NamedSet
    changes : tuple of ParameterChange
        Every parameter that both have.
    conditions : tuple of tuple
        Name, first and second value of each condition that differs; None where it is not stated.
    notes : tuple of str
        What a reader must know before he takes a difference for one of the tyres.
    independent : bool
        Whether no recording is behind both; nothing is tested otherwise.
    """

    first: NamedSet
    second: NamedSet
    changes: tuple[ParameterChange, ...]
    conditions: tuple[tuple[str, Any, Any], ...]
    notes: tuple[str, ...]
    independent: bool


def difference(first: NamedSet, second: NamedSet) -> SetDifference:
    """Compare two parameter sets.

    Identified parameters are tested together; their errors are taken as independent, which they
    are not where both sets come from the same recordings: nothing is tested then.
    """
    one, two = first.parameters, second.parameters
    independent = not recordings(one) & recordings(two)
    return SetDifference(
        first,
        second,
        parameter_changes(values_of(one), values_of(two), independent=independent),
        tuple(_differing_conditions(one, two)),
        tuple(_notes(one, two, independent=independent)),
        independent,
    )


def recordings(parameters: ParameterSet) -> frozenset[str]:
    """Checksums of the recordings that a parameter set was identified from."""
    inputs = parameters.provenance.get("inputs", {})
    if not isinstance(inputs, dict):
        return frozenset()
    return frozenset(str(sum_) for name, sum_ in inputs.items() if not name.endswith(".toml"))


def values_of(parameters: ParameterSet) -> dict[str, Parameter]:
    """All parameters by name; those of the wheel are called ``wheel_mass_kg`` and so on."""
    wheel = {f"wheel_{name}": Parameter(value) for name, value in parameters.wheel.items()}
    return {**parameters.ring, **parameters.damping, **wheel}


def largest_change(found: SetDifference) -> ParameterChange | None:
    """The most significant change, or the largest one in percent where nothing was tested.

    None where no parameter changed.
    """
    changed = [change for change in found.changes if change.difference.value]
    sure = [change for change in changed if change.is_tested and not isnan(change.difference.z)]
    if sure:
        return max(sure, key=lambda change: abs(change.difference.z))
    return max(changed, key=lambda change: abs(change.difference.percent), default=None)


def _differing_conditions(one: ParameterSet, two: ParameterSet) -> list[tuple[str, Any, Any]]:
    names = dict.fromkeys((*one.conditions, *two.conditions))
    pairs = [(name, one.conditions.get(name), two.conditions.get(name)) for name in names]
    return [pair for pair in pairs if pair[1] != pair[2]]


def _notes(one: ParameterSet, two: ParameterSet, *, independent: bool) -> list[str]:
    notes = []
    if one.designation != two.designation:
        notes.append(f"The tyres differ: {one.designation} and {two.designation}.")
    if not independent:
        notes.append(
            "Both come from the same recordings: their errors are not independent, and no "
            "difference is tested."
        )
    alone = _only_in(one, two), _only_in(two, one)
    for names, which in zip(alone, ("first", "second"), strict=True):
        if names:
            notes.append(f"Only the {which} set has {', '.join(names)}.")
    return notes


def _only_in(one: ParameterSet, other: ParameterSet) -> Sequence[str]:
    return [name for name in values_of(one) if name not in values_of(other)]
