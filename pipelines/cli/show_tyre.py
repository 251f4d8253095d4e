"""What the command line says of the library of parameter sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from typing import TYPE_CHECKING, Any

from pipelines.cli.terminal import (
    Column,
    columns_of,
    complain,
    print_json,
    print_table,
    say,
    screen,
)
from pipelines.export.tir_update import RingFromTir, TirChange, TirUpdate
from pipelines.library.version import values_of
from pipelines.report.pressure_series import headings, trend_row
from pipelines.storage.rounding import DASH, chance_text, number, signed, value_with_std

if TYPE_CHECKING:
    from pipelines.library.history import SetDifference, TyreHistory
    from pipelines.library.series import Series
    from pipelines.library.version import Version
    from pipelines.results.parameter_set import ParameterSet


def show_version(version: Version, standing: str, *, as_json: bool) -> None:
    """Print a version: what it is, its conditions, its parameters and where they come from."""
    if as_json:
        print_json(_version_content(version) | {"standing": standing})
        return
    own, entry = version.parameters, version.entry
    say(f"{version.reference}: {' '.join(filter(None, (own.designation, entry.tyre_id)))}")
    say(f"Standing: {standing}")
    say(f"Added: {entry.created} by {entry.author}{f': {entry.note}' if entry.note else ''}")
    say(f"Source: {own.provenance.get('campaign', 'no campaign stated')}, {entry.source}")
    show_parameters(own)


def show_parameters(parameters: ParameterSet) -> None:
    """Print conditions and parameters, each with its ± and how it was obtained."""
    for name, value in parameters.conditions.items():
        say(f"Condition: {name} = {_stated(value)}")
    found = values_of(parameters)
    columns = (
        Column("parameter", list(found), is_text=True),
        Column("value", [value_with_std(each.value, each.std) for each in found.values()]),
        Column("obtained", [each.how for each in found.values()], is_text=True),
    )
    print_table(screen(), "", columns)


def show_rows(rows: Sequence[Mapping[str, Any]], *, as_json: bool) -> None:
    """Print the parameters of all versions one beneath the other."""
    if as_json:
        print_json(rows)
        return
    columns = (
        Column("tyre", [f"{row['tyre']}@{row['version']}" for row in rows], is_text=True),
        Column("approved", ["yes" if row["approved"] else "" for row in rows], is_text=True),
        Column("parameter", [row["parameter"] for row in rows], is_text=True),
        Column("value", [value_with_std(row["value"], row["std"]) for row in rows]),
        Column("obtained", [row["how"] for row in rows], is_text=True),
    )
    print_table(screen(), "", columns, first_to_go=("approved",))


def show_tyres(histories: Sequence[TyreHistory], *, as_json: bool) -> None:
    """Print all tyres with their versions, the approved one and the pressures."""
    if as_json:
        print_json([_tyre_content(each) for each in histories])
        return
    columns = (
        Column("tyre", [each.tyre.name for each in histories], is_text=True),
        Column("designation", [_designation(each) for each in histories], is_text=True),
        Column("versions", [str(each.tyre.newest) for each in histories]),
        Column("approved", [_approved(each) for each in histories]),
        Column("pressures in bar", [_pressures(each) for each in histories], True, folds=True),
        Column("last added", [_last(each) for each in histories], is_text=True),
    )
    if histories:
        print_table(screen(), "", columns, first_to_go=("designation",))
    else:
        say("No tyres yet. `ringmodal tyre add RESULT` adds one.")


def show_history(history: TyreHistory, *, as_json: bool) -> None:
    """Print a tyre's versions: when, by whom, why, and what changed most."""
    if as_json:
        print_json(_tyre_content(history) | {"history": [_line(each) for each in history.lines]})
        return
    lines = history.lines
    entries = [line.version.entry for line in lines]
    columns = (
        Column("version", [str(line.version.number) for line in lines]),
        Column("date (UTC)", [entry.created[:16].replace("T", " ") for entry in entries], True),
        Column("author", [entry.author for entry in entries], is_text=True),
        Column("approved", [line.approval for line in lines], is_text=True),
        Column("changed most", [line.change for line in lines], is_text=True, folds=True),
        Column("note", [entry.note for entry in entries], is_text=True, folds=True),
    )
    print_table(screen(), history.tyre.name, columns, first_to_go=("author",))


def show_difference(found: SetDifference, *, as_json: bool) -> None:
    """Print two parameter sets side by side, with the significance of each difference."""
    if as_json:
        print_json(_difference_content(found))
        return
    changes = found.changes
    deltas, tested = [change.difference for change in changes], _tested(found)
    first = [value_with_std(each.difference.first, each.first_std) for each in changes]
    second = [value_with_std(each.difference.second, each.second_std) for each in changes]
    columns = (
        Column("parameter", [change.name for change in changes], is_text=True),
        Column("A", first),
        Column("B", second),
        Column("B − A", [value_with_std(each.value, each.std) for each in deltas]),
        Column("in %", [signed(each.percent, 1) for each in deltas]),
        Column("z", [signed(each.z, 1) if known else "" for each, known in tested]),
        Column("p", [chance_text(each.p_value) if known else "" for each, known in tested]),
        Column("verdict", [_verdict(change, found) for change in changes], True, folds=True),
    )
    say(f"A: {found.first.name}")
    say(f"B: {found.second.name}")
    for name, one, two in found.conditions:
        say(f"Condition: {name}: {_stated(one)} in A, {_stated(two)} in B")
    print_table(screen(), "", columns, first_to_go=("B − A", "p", "A"))
    for note in found.notes:
        complain(f"Note: {note}")


def show_series(series: Series, unit: str, *, as_json: bool) -> None:
    """Print the straight line of each parameter over pressure."""
    if as_json:
        print_json({"tyre": series.tyre, "trends": [_trend(each) for each in series.trends]})
    else:
        rows = [trend_row(trend, unit) for trend in series.trends]
        columns = columns_of(headings(unit), rows, ("parameter", "versions"))
        title = f"{series.tyre} over inflation pressure"
        print_table(screen(), title, columns, first_to_go=("versions", "scatter / σ"))
    for note in series.notes:
        complain(f"Note: {note}")


def _verdict(change: Any, found: SetDifference) -> str:
    if change.is_tested:
        return str(change.status) if found.independent else "not tested (same recordings)"
    return f"{change.status} ({change.hows})"


def _tested(found: SetDifference) -> list[tuple[Any, bool]]:
    return [
        (each.difference, each.is_tested and isfinite(each.difference.z)) for each in found.changes
    ]


def _stated(value: Any) -> str:
    if value is None:
        return "not stated"
    return f"{value:.10g}" if isinstance(value, int | float) else str(value)


def _designation(history: TyreHistory) -> str:
    return history.lines[-1].version.parameters.designation if history.lines else ""


def _approved(history: TyreHistory) -> str:
    return str(history.approved.number) if history.approved else "none"


def _last(history: TyreHistory) -> str:
    return history.lines[-1].version.entry.created[:10] if history.lines else ""


def _pressures(history: TyreHistory) -> str:
    return ", ".join(number(pressure, 3) for pressure in history.pressures_bar)


def _version_content(version: Version) -> dict[str, Any]:
    told = {"tyre": version.tyre, "version": version.number, "sha256": version.sha256}
    parts = {key: part for key, part in asdict(version.parameters).items() if part}
    return {**told, **parts, "entry": asdict(version.entry)}


def _tyre_content(history: TyreHistory) -> dict[str, Any]:
    return {
        "tyre": history.tyre.name,
        "designation": _designation(history),
        "versions": history.tyre.newest,
        "approved": history.approved.number if history.approved else None,
        "pressures_bar": history.pressures_bar,
        "damage": [str(error) for error in history.damage],
    }


def _line(line: Any) -> dict[str, Any]:
    entry = line.version.entry
    return {
        "version": line.version.number,
        "created": entry.created,
        "author": entry.author,
        "note": entry.note,
        "approval": line.approval,
        "changed_most": line.change,
    }


def _difference_content(found: SetDifference) -> Mapping[str, Any]:
    return {
        "first": found.first.name,
        "second": found.second.name,
        "conditions": [
            {"name": name, "first": one, "second": two} for name, one, two in found.conditions
        ],
        "parameters": [_change(each, independent=found.independent) for each in found.changes],
        "notes": found.notes,
    }


def _change(change: Any, *, independent: bool) -> dict[str, Any]:
    delta = change.difference
    return {
        "parameter": change.name,
        "first": delta.first,
        "first_std": change.first_std,
        "first_how": change.first_how,
        "second": delta.second,
        "second_std": change.second_std,
        "second_how": change.second_how,
        "difference": delta.value,
        "difference_std": delta.std,
        "percent": delta.percent,
        "z": delta.z if change.is_tested else None,
        "p": delta.p_value if change.is_tested else None,
        "p_adjusted": delta.adjusted_p_value,
        "verdict": change.status if independent else "not tested",
    }


def _trend(trend: Any) -> dict[str, Any]:
    line = trend.line
    return {
        "parameter": trend.name,
        "pressure_pa": list(trend.pressure_pa),
        "value": list(trend.value),
        "std": list(trend.std),
        "version": trend.version,
        "line": {
            "at_pressure_pa": line.centre,
            "value": line.value,
            "value_std": line.value_std,
            "slope_per_pa": line.slope,
            "slope_per_pa_std": line.slope_std,
            "scatter": line.scatter,
        },
    }


def show_update(update: TirUpdate, source: str) -> None:
    """Print old and new values in the file's units, what stays, and why."""
    changes = update.changes
    columns = (
        Column("key", [change.key for change in changes], is_text=True),
        Column("line", [str(change.line or "new") for change in changes]),
        Column("old", [_shown(change.old) for change in changes]),
        Column("new", [_shown(change.new) for change in changes]),
        Column("±", [_shown(change.std, 2) for change in changes]),
        Column("in %", [_percent(change) for change in changes]),
        Column("unit", [change.unit for change in changes], is_text=True),
        Column("from", [change.basis for change in changes], is_text=True, folds=True),
    )
    say(f"{update.before.name} from {source}:")
    if changes:
        print_table(screen(), "", columns)
    if update.unchanged:
        say(f"Up to date: {', '.join(update.unchanged)}")
    if update.missing:
        say(f"Not in the file: {', '.join(update.missing)}; --add adds them")
    for key, reason in update.open_ones.items():
        say(f"Not determined: {key}: {reason}")
    for reason, keys in update.left_alone.items():
        say(f"Left alone: {', '.join(keys)}: {reason}")
    for note in update.notes:
        complain(f"Note: {note}")


def update_content(update: TirUpdate, source: str) -> dict[str, Any]:
    """An update for programs."""
    return {
        "source": source,
        "changes": [_change_content(change) for change in update.changes],
        "unchanged": update.unchanged,
        "missing": update.missing,
        "not_determined": dict(update.open_ones),
        "left_alone": {key: why for why, keys in update.left_alone.items() for key in keys},
        "notes": update.notes,
    }


def show_ring(made: RingFromTir, out: str | None, *, as_json: bool) -> None:
    """Print the parameters of a ring out of a tyre property file."""
    if as_json:
        ring = {
            name: {"value": entry.value, "how": entry.how}
            for name, entry in made.parameters.ring.items()
        }
        content = {"conditions": made.parameters.conditions, "ring": ring, "notes": made.notes}
        print_json({"file": out, "designation": made.parameters.designation, **content})
        return
    show_parameters(made.parameters)
    for note in made.notes:
        complain(f"Note: {note}")
    if out:
        say(f"Written: {out}")


def _shown(value: float | None, digits: int = 6) -> str:
    """A value much as it stands in the file."""
    return DASH if value is None else f"{value:.{digits}g}"


def _percent(change: TirChange) -> str:
    return DASH if change.percent is None else signed(change.percent, 1)


def _change_content(change: TirChange) -> dict[str, Any]:
    return {
        "key": change.key,
        "section": change.section,
        "line": change.line,
        "old": change.old,
        "new": change.new,
        "std": change.std,
        "percent": change.percent,
        "unit": change.unit,
        "from": change.basis,
        "not_identified": change.doubts,
    }
