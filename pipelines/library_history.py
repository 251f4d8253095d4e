"""What happened to a tyre's parameters, version by version; and all tyres at a glance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan
from typing import Any

from ema.errors import InputError
from pipelines.library_approval import read_approvals
from pipelines.library_diff import difference, largest_change
from pipelines.library_seal import DamagedFile
from pipelines.library_series import PRESSURE, UNITS_PA
from pipelines.library_tyre import LibraryTyre
from pipelines.library_version import Version
from pipelines.numbers import signed
from pipelines.tyre_library import NamedSet

APPROVED, EARLIER = "approved", "was approved"


@dataclass(frozen=True)
class HistoryLine:
    """One version in a tyre's history.

    Parameters
    ----------
    version : Version
    approval : {"approved", "was approved", ""}
    change : str
        What changed most against the version before; empty for the first one.
    """

    version: Version
    approval: str
    change: str


@dataclass(frozen=True)
class TyreHistory:
    """All versions of a tyre that can be read, ascending, and every damage that was found."""

    tyre: LibraryTyre
    lines: tuple[HistoryLine, ...]
    damage: tuple[DamagedFile, ...]

    @property
    def approved(self) -> Version | None:
        """The approved version; None where there is none, or damage hides it."""
        found = [line.version for line in self.lines if line.approval == APPROVED]
        return found[0] if found else None

    @property
    def pressures_bar(self) -> list[float]:
        """Inflation pressures of the versions, ascending."""
        stated = {line.version.parameters.conditions[PRESSURE] for line in self.lines}
        return sorted(pressure_pa / UNITS_PA["bar"] for pressure_pa in stated)


def history_of(tyre: LibraryTyre) -> TyreHistory:
    """Gather a tyre's history; damage is gathered too, not raised."""
    versions, damage = tyre.versions()
    approvals, more = _approvals(tyre)
    named = {error.where for error in damage}
    more = [error for error in more if error.where not in named]
    changes = ["", *map(_change, versions[:-1], versions[1:])]
    lines = [
        HistoryLine(version, approvals.get(version.number, ""), change)
        for version, change in zip(versions, changes, strict=False)
    ]
    return TyreHistory(tyre, tuple(lines), (*damage, *more))


def _approvals(tyre: LibraryTyre) -> tuple[dict[int, str], Sequence[DamagedFile]]:
    try:
        ever = {approval.version: EARLIER for approval in read_approvals(tyre.path)}
        approved = tyre.approved()
    except DamagedFile as error:
        return {}, [error]
    return (ever | {approved.number: APPROVED} if approved else ever), []


def _change(before: Version, after: Version) -> str:
    found = difference(NamedSet("", before.parameters), NamedSet("", after.parameters))
    parts = [_condition(*each) for each in found.conditions]
    change = largest_change(found)
    if change is not None:
        z = change.difference.z
        tested = f" (z = {z:+.1f})" if change.is_tested and not isnan(z) else ""
        parts.append(f"{change.name} {signed(change.difference.percent, 1)} %{tested}")
    return "; ".join(parts) or "nothing"


def _condition(name: str, before: Any, after: Any) -> str:
    return f"{name} {_stated(before)} → {_stated(after)}"


def _stated(value: Any) -> str:
    if value is None:
        return "not stated"
    return f"{value:.10g}" if isinstance(value, int | float) else str(value)


def all_damage(histories: Sequence[TyreHistory]) -> list[InputError]:
    """Every damage of several tyres."""
    return [error for history in histories for error in history.damage]
