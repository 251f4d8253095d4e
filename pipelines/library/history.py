"""What happened to a tyre's parameters, version by version; and all tyres at a glance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any

from ema.core.errors import InputError
from pipelines.library.diff import difference, largest_change, values_of
from pipelines.library.library import NamedSet
from pipelines.library.series import PRESSURE, UNITS_PA
from pipelines.library.tyre import LibraryTyre
from pipelines.library.version import Version, read_approvals
from pipelines.results.parameter_set import CONDITION_NAMES, DAMPING_NAMES, RING_NAMES, WHEEL_NAMES
from pipelines.storage.checksums import DamagedFile
from pipelines.storage.rounding import signed

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


Row = dict[str, Any]

_TEXTS = ("tyre", "designation", "tyre_id", "created", "author", "note", "campaign", "software")
CONDITIONS = ("inflation_pressure_pa", *CONDITION_NAMES)
OF_VERSION = (
    *("tyre", "designation", "tyre_id", "version", "approved", "created", "author", "note"),
    *("campaign", "software", *CONDITIONS),
)
LONG = (*OF_VERSION, "parameter", "value", "std", "how")
_PARAMETERS = (*RING_NAMES, *DAMPING_NAMES, *(f"wheel_{name}" for name in WHEEL_NAMES))
WIDE = (*OF_VERSION, *(name + end for name in _PARAMETERS for end in ("", "_std", "_how")))


def version_rows(
    tyres: Iterable[LibraryTyre], *, wide: bool = False
) -> tuple[list[Row], list[DamagedFile]]:
    """Rows of the table, tyre by tyre and version by version, and the damage that hides others.

    Parameters
    ----------
    tyres : iterable of LibraryTyre
    wide : bool
        One row per version with the columns `WIDE`, else one per version and parameter with `LONG`.
    """
    rows: list[Row] = []
    damage: list[DamagedFile] = []
    for tyre in tyres:
        versions, hidden = tyre.versions()
        number, more = _approved(tyre)
        damage += dict.fromkeys([*hidden, *more])
        for version in versions:
            told = _of_version(version, approved=version.number == number)
            rows += [told | _all(version)] if wide else [told | one for one in _each(version)]
    return rows, damage


def _approved(tyre: LibraryTyre) -> tuple[int, list[DamagedFile]]:
    """Number of the approved version, 0 for none; and the damage that hides which one it is."""
    try:
        approved = tyre.approved()
    except DamagedFile as error:
        return 0, [error]
    return (approved.number if approved else 0), []


def write_table(path: Path, rows: Sequence[Row], *, wide: bool = False) -> None:
    """Write rows as CSV or Parquet, by the ending of `path`; written atomically."""
    import pandas as pd  # half a second, which a history on the screen does not need

    from pipelines.storage.tables import write_table

    columns = WIDE if wide else LONG
    table = pd.DataFrame(rows, columns=list(columns), dtype=object)
    write_table(path, table.astype({name: _type_of(name) for name in columns}))


def _of_version(version: Version, *, approved: bool) -> Row:
    own, entry = version.parameters, version.entry
    return {
        "tyre": version.tyre,
        "designation": own.designation,
        "tyre_id": entry.tyre_id,
        "version": version.number,
        "approved": approved,
        "created": entry.created,
        "author": entry.author,
        "note": entry.note,
        "campaign": str(own.provenance.get("campaign", "")),
        "software": str(own.provenance.get("software", entry.software)),
        **{name: _number(own.conditions.get(name)) for name in CONDITIONS},
    }


def _each(version: Version) -> Iterator[Row]:
    for name, found in values_of(version.parameters).items():
        yield {"parameter": name, "value": found.value, "std": found.std, "how": found.how}


def _all(version: Version) -> Row:
    row: Row = {}
    for name, found in values_of(version.parameters).items():
        row |= {name: found.value, f"{name}_std": found.std, f"{name}_how": found.how}
    return row


def _number(value: Any) -> float | None:
    """A condition as number; a hand-written set may hold words."""
    return float(value) if isinstance(value, int | float) else None


def _type_of(name: str) -> str:
    if name in _TEXTS or name == "parameter" or name == "how" or name.endswith("_how"):
        return "string"
    return {"version": "Int32", "approved": "boolean"}.get(name, "Float64")
