"""What the command line prints about the library of parameter sets."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from math import isfinite
from typing import Any

import typer

from ema.core.display import DASH, chance_text, number, signed, value_with_std
from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.cli.screen import print_table
from pipelines.cli.terminal import echo, echo_error, print_json
from pipelines.library.history import Series, SetDifference, TyreHistory, stated, verdict_text
from pipelines.library.version import Version, values_of
from pipelines.report.ring import headings, trend_row
from pipelines.results.options import Units, with_unit
from pipelines.results.parameter_set import ParameterSet
from pipelines.results.set_basis import basis_records

FEW_WARNINGS = 5  # printed


_WORDS = {
    **RING_NAMES,
    **DAMPING_NAMES,
    "wheel_mass_kg": ("mass of the wheel", "m", "kg"),
    "wheel_inertia_kg_m2": ("inertia of the wheel", "I", "kg m²"),
}


def show_version(version: Version, standing: str, *, as_json: bool) -> None:
    """Print a version: its origin, conditions and parameters."""
    own, entry = version.parameters, version.entry
    if as_json:
        about = {"tyre": version.tyre, "version": version.number, "sha256": version.sha256}
        parts = {key: part for key, part in asdict(own).items() if part and key != "basis"}
        parts |= basis_records(own.basis)
        print_json({**about, **parts, "entry": asdict(entry), "standing": standing})
        return
    echo(f"{version.reference}: {' '.join(filter(None, (own.designation, entry.tyre_id)))}")
    echo(f"Standing: {standing}")
    echo(f"Added: {entry.created} by {entry.author}{f': {entry.note}' if entry.note else ''}")
    echo(f"Source: {own.provenance.get('campaign', 'campaign not stated')}, {entry.source}")
    show_parameters(own)
    show_verdict(own)


def show_verdict(parameters: ParameterSet, *, doubts_only: bool = False) -> None:
    """Print the verdict on a set and its warnings; doubts go to standard error."""
    basis = parameters.basis
    if basis.is_in_doubt:
        echo_error(f"Verdict: {verdict_text(parameters)}")
    elif not doubts_only:
        echo(f"Verdict: {verdict_text(parameters)}")
    for warning in basis.warnings[:FEW_WARNINGS]:
        echo_error(f"Warning: {warning}")
    if more := basis.warnings[FEW_WARNINGS:]:
        echo_error(f"{len(more)} more warnings are in the section [verdict] of the set.")


def accepts(parameters: ParameterSet, question: str, *, given: bool, asks: bool) -> bool:
    """Whether a verdict that is not good is accepted: by option, or by a person who is asked."""
    if given or not parameters.basis.is_in_doubt or not (asks and sys.stdin.isatty()):
        return given
    if not typer.confirm(f"{question} although the verdict is not good?"):
        echo("Nothing was written.")
        raise typer.Exit
    return True


def show_parameters(parameters: ParameterSet) -> None:
    """Print conditions and parameters, each with its ± and how it was obtained."""
    for name, value in parameters.conditions.items():
        echo(f"Condition: {name} = {stated(value)}")
    rows = []
    for name, each in values_of(parameters).items():
        title, symbol, si_unit = _WORDS.get(name, (name, "", ""))
        value, std, unit = with_unit(each.value, each.std, si_unit, Units.LAB)
        words = f"{title} {symbol}".strip()
        rows.append((words, value_with_std(value, std), unit, each.how, name))
    head = ("parameter", "value", "unit", "obtained", "name in the set")
    texts = [title for title in head if title != "value"]
    print_table("", head, rows, texts=texts, first_to_go=("name in the set",))


def show_rows(rows: Sequence[Mapping[str, Any]], *, as_json: bool) -> None:
    """Print the parameters of all versions one below the other."""
    if as_json:
        print_json(rows)
        return
    cells = []
    for row in rows:
        version = f"{row['tyre']}@{row['version']}", "yes" if row["approved"] else ""
        value = value_with_std(row["value"], row["std"])
        cells.append((*version, row["parameter"], value, row["how"]))
    head = ("tyre", "approved", "parameter", "value", "obtained")
    texts = [name for name in head if name != "value"]
    print_table("", head, cells, texts=texts, first_to_go=("approved",))


def show_tyres(histories: Sequence[TyreHistory], *, as_json: bool) -> None:
    """Print all tyres with their versions, the approved one and the pressures."""
    if as_json:
        print_json([_tyre_content(each) for each in histories])
        return
    if not histories:
        echo("No tyres yet. `ringmodal tyre add RESULT` adds one.")
        return
    rows = [
        (
            each.tyre.name,
            _designation(each),
            str(each.tyre.newest),
            str(each.approved.number) if each.approved else "none",
            ", ".join(number(pressure, 3) for pressure in each.pressures_bar),
            each.lines[-1].version.entry.created[:10] if each.lines else "",
        )
        for each in histories
    ]
    head = ("tyre", "designation", "versions", "approved", "pressures in bar", "last added")
    texts = ("tyre", "designation", "pressures in bar", "last added")
    folding = ("pressures in bar",)
    print_table("", head, rows, texts=texts, folding=folding, first_to_go=("designation",))


def show_history(history: TyreHistory, *, as_json: bool) -> None:
    """Print a tyre's versions: when, by whom, why, and what changed most."""
    if as_json:
        lines = [
            {"version": line.version.number}
            | {name: getattr(line.version.entry, name) for name in ("created", "author", "note")}
            | {"approval": line.approval, "changed_most": line.change}
            | {"verdict": line.version.parameters.basis.state}
            for line in history.lines
        ]
        print_json(_tyre_content(history) | {"history": lines})
        return
    rows = [
        (
            str(line.version.number),
            line.version.entry.created[:16].replace("T", " "),
            line.version.entry.author,
            line.approval,
            line.version.parameters.basis.state or DASH,
            line.change,
            line.version.entry.note,
        )
        for line in history.lines
    ]
    head = ("version", "date (UTC)", "author", "approved", "verdict", "changed most", "note")
    title, texts, folding = history.tyre.name, head[1:], head[5:]
    print_table(title, head, rows, texts=texts, folding=folding, first_to_go=("author",))


def show_difference(found: SetDifference, *, as_json: bool) -> None:
    """Print two parameter sets side by side, with the significance of each difference."""
    if as_json:
        conditions = [
            {"name": name, "first": one, "second": two} for name, one, two in found.conditions
        ]
        changes = [_change(each, independent=found.independent) for each in found.changes]
        content = {"first": found.first.name, "second": found.second.name}
        about = {"conditions": conditions, "parameters": changes, "notes": found.notes}
        print_json({**content, **about})
        return
    echo(f"A: {found.first.name}")
    echo(f"B: {found.second.name}")
    for name, one, two in found.conditions:
        echo(f"Condition: {name}: {stated(one)} in A, {stated(two)} in B")
    head = ("parameter", "A", "B", "B − A", "in %", "z", "p", "verdict")
    rows = [_change_cells(each, independent=found.independent) for each in found.changes]
    texts, first_to_go = ("parameter", "verdict"), ("B − A", "p", "A")
    print_table("", head, rows, texts=texts, folding=texts[1:], first_to_go=first_to_go)
    for note in found.notes:
        echo_error(f"Note: {note}")


def show_series(series: Series, unit: str, *, as_json: bool) -> None:
    """Print the straight line of each parameter over pressure."""
    if as_json:
        print_json({"tyre": series.tyre, "trends": [_trend(each) for each in series.trends]})
    else:
        rows = [trend_row(trend, unit) for trend in series.trends]
        title, texts = f"{series.tyre} over inflation pressure", ("parameter", "versions")
        first_to_go = ("versions", "scatter / σ")
        print_table(title, headings(unit), rows, texts=texts, first_to_go=first_to_go)
    for note in series.notes:
        echo_error(f"Note: {note}")


def _designation(history: TyreHistory) -> str:
    return history.lines[-1].version.parameters.designation if history.lines else ""


def _tyre_content(history: TyreHistory) -> dict[str, Any]:
    return {
        "tyre": history.tyre.name,
        "designation": _designation(history),
        "versions": history.tyre.newest,
        "approved": history.approved.number if history.approved else None,
        "pressures_bar": history.pressures_bar,
        "damage": [str(error) for error in history.damage],
    }


def _change_cells(change: Any, *, independent: bool) -> tuple[str, ...]:
    delta = change.difference
    has_test = change.is_tested and isfinite(delta.z)
    verdict = f"{change.status} ({change.hows})"
    if change.is_tested:
        verdict = str(change.status) if independent else "not tested (same recordings)"
    return (
        change.name,
        value_with_std(delta.first, change.first_std),
        value_with_std(delta.second, change.second_std),
        value_with_std(delta.value, delta.std),
        signed(delta.percent, 1),
        signed(delta.z, 1) if has_test else "",
        chance_text(delta.p_value) if has_test else "",
        verdict,
    )


def _change(change: Any, *, independent: bool) -> dict[str, Any]:
    delta = change.difference
    z, p = (delta.z, delta.p_value) if change.is_tested else (None, None)
    second = {"second": delta.second, "second_std": change.second_std}
    return {
        "parameter": change.name,
        **{"first": delta.first, "first_std": change.first_std, "first_how": change.first_how},
        **{**second, "second_how": change.second_how},
        **{"difference": delta.value, "difference_std": delta.std, "percent": delta.percent},
        **{"z": z, "p": p, "p_adjusted": delta.adjusted_p_value},
        "verdict": change.status if independent else "not tested",
    }


def _trend(trend: Any) -> dict[str, Any]:
    line = trend.line
    points = {name: list(getattr(trend, name)) for name in ("pressure_pa", "value", "std")}
    fitted = {"at_pressure_pa": line.centre, "value": line.value, "value_std": line.value_std}
    slope = {"slope_per_pa": line.slope, "slope_per_pa_std": line.slope_std}
    about = {"parameter": trend.name, **points, "version": trend.version}
    return about | {"line": {**fitted, **slope, "scatter": line.scatter}}
