"""Differences between parameter sets, and the history of a tyre."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan
from typing import Any

from ema.core.display import signed
from model.identifiability import IDENTIFIED
from pipelines.compare.significance import ParameterChange, parameter_changes
from pipelines.library.library import NamedSet
from pipelines.library.series import PRESSURE, UNITS_PA
from pipelines.library.version import (
    ApprovalState,
    LibraryTyre,
    Version,
    read_approvals,
    recordings,
    values_of,
)
from pipelines.results.parameter_set import ParameterSet
from pipelines.storage.checksums import DamagedFile


@dataclass(frozen=True)
class SetDifference:
    """Differences between two parameter sets, second minus first."""

    first: NamedSet
    second: NamedSet
    changes: tuple[ParameterChange, ...]  # every parameter that both have
    # name, first and second value of each condition that differs; None where not stated
    conditions: tuple[tuple[str, Any, Any], ...]
    notes: tuple[str, ...]  # caveats
    independent: bool  # whether the sets share no recording; otherwise nothing is tested

    @property
    def largest_change(self) -> ParameterChange | None:
        """The most significant change, or the largest in percent where nothing was tested."""
        changed = [change for change in self.changes if change.difference.value]
        tested = [each for each in changed if each.is_tested and not isnan(each.difference.z)]
        if tested:
            return max(tested, key=lambda change: abs(change.difference.z))
        return max(changed, key=lambda change: abs(change.difference.percent), default=None)


def difference(first: NamedSet, second: NamedSet) -> SetDifference:
    """Compare two parameter sets.

    Identified parameters are tested together, with independent errors. The errors of sets from the
    same recordings are dependent: nothing is tested then.
    """
    one, two = first.parameters, second.parameters
    a, b = values_of(one), values_of(two)
    independent = not recordings(one) & recordings(two)
    names = dict.fromkeys((*one.conditions, *two.conditions))
    stated = [(name, one.conditions.get(name), two.conditions.get(name)) for name in names]
    notes = []
    if one.designation != two.designation:
        notes.append(f"The tyres differ: {one.designation} and {two.designation}.")
    if not independent:
        notes.append(
            "Both come from the same recordings: their errors are dependent, and no difference is "
            "tested."
        )
    for which, own, other in (("first", a, b), ("second", b, a)):
        alone = [name for name in own if name not in other]
        if alone:
            notes.append(f"Only the {which} set has {', '.join(alone)}.")
    for each in (first, second):
        if each.parameters.basis.is_in_doubt:
            notes.append(f"{each.name}: verdict {verdict_text(each.parameters)}.")
    loads = {one.basis.pressure_load, two.basis.pressure_load}
    if None not in loads and len(loads) > 1:
        notes.append(
            f"The pressure is a {one.basis.pressure_load} load in the first set and a "
            f"{two.basis.pressure_load} load in the second: k_θ and k_r are not comparable."
        )
    changes = parameter_changes(a, b, independent=independent)
    conditions = tuple(each for each in stated if each[1] != each[2])
    return SetDifference(first, second, changes, conditions, tuple(notes), independent)


def verdict_text(parameters: ParameterSet) -> str:
    """The verdict on a set; that there is none, where it was identified without."""
    if (verdict := parameters.basis.verdict) is not None:
        return verdict.text()
    identified = any(each.how == IDENTIFIED for each in parameters.ring_and_damping.values())
    return "none: tuned before there were verdicts" if identified else "none: given values"


@dataclass(frozen=True)
class HistoryLine:
    """A version, its approval, and the main change against the version before."""

    version: Version
    approval: ApprovalState
    change: str


@dataclass(frozen=True)
class TyreHistory:
    """All readable versions of a tyre, ascending, and all damage found."""

    tyre: LibraryTyre
    lines: tuple[HistoryLine, ...]
    damage: tuple[DamagedFile, ...]

    @property
    def approved(self) -> Version | None:
        """The approved version; None where there is none, or it is damaged."""
        found = [each.version for each in self.lines if each.approval is ApprovalState.APPROVED]
        return found[0] if found else None

    @property
    def pressures_bar(self) -> list[float]:
        """Inflation pressures of the versions, ascending."""
        stated = {line.version.parameters.conditions[PRESSURE] for line in self.lines}
        return sorted(pressure_pa / UNITS_PA["bar"] for pressure_pa in stated)


def history_of(tyre: LibraryTyre) -> TyreHistory:
    """History of a tyre; damage is collected, not raised."""
    versions, damage = tyre.versions()
    approvals: dict[int, ApprovalState] = {}
    try:
        approved = tyre.approved()
        ever = read_approvals(tyre.path)
    except DamagedFile as error:
        if error.where not in {each.where for each in damage}:
            damage.append(error)
    else:
        approvals = {each.version: ApprovalState.EARLIER for each in ever}
        if approved:
            approvals[approved.number] = ApprovalState.APPROVED
    changes = ["", *map(_change, versions[:-1], versions[1:])]
    lines = tuple(
        HistoryLine(version, approvals.get(version.number, ApprovalState.NEVER), change)
        for version, change in zip(versions, changes, strict=False)
    )
    return TyreHistory(tyre, lines, tuple(damage))


def _change(before: Version, after: Version) -> str:
    found = difference(NamedSet("", before.parameters), NamedSet("", after.parameters))
    parts = [f"{name} {stated(one)} → {stated(two)}" for name, one, two in found.conditions]
    change = found.largest_change
    if change is not None:
        z = change.difference.z
        tested = f" (z = {z:+.1f})" if change.is_tested and not isnan(z) else ""
        parts.append(f"{change.name} {signed(change.difference.percent, 1)} %{tested}")
    return "; ".join(parts) or "nothing"


def stated(value: Any) -> str:
    """A condition as text."""
    if value is None:
        return "not stated"
    return f"{value:.10g}" if isinstance(value, int | float) else str(value)
