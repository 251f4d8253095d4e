"""What the commands print of tyres: parameter sets, and what was simulated."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import typer
from numpy.typing import ArrayLike, NDArray

from ema.core.display import DASH, chance_text, number, signed, value_with_std
from model import Bifurcation, ForcedRing, HubResponse
from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.cli.screen import print_table
from pipelines.cli.terminal import echo, echo_error, print_json
from pipelines.library.history import Series, SetDifference, TyreHistory, stated, verdict_text
from pipelines.library.library import NamedSet
from pipelines.library.version import Version, values_of
from pipelines.plots import ring as ring_plots
from pipelines.plots.draw import draw_plot, write_figure
from pipelines.plots.plot import Plot
from pipelines.report.ring import headings, trend_row
from pipelines.results.options import Units, with_unit
from pipelines.results.parameter_set import ParameterSet
from pipelines.results.verdict import accepted_verdict, basis_records
from pipelines.simulate import responses
from pipelines.storage.tables import write_table

FEW_WARNINGS = 5  # printed


_WORDS = {
    **RING_NAMES,
    **DAMPING_NAMES,
    "wheel_mass_kg": ("mass of the wheel", "m", "kg"),
    "wheel_inertia_kg_m2": ("inertia of the wheel", "I", "kg m²"),
}
FEW_LINES = 20  # printed; of more only the peaks


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
    echo(f"Verdict: {verdict_text(own)}")
    show_parameters(own)
    _show_warnings(own)


def show_verdict(parameters: ParameterSet, *, doubts_only: bool = False) -> None:
    """Print the verdict on a set and its warnings; doubts go to standard error."""
    if parameters.basis.is_in_doubt:
        echo_error(f"Verdict: {verdict_text(parameters)}")
    elif not doubts_only:
        echo(f"Verdict: {verdict_text(parameters)}")
    _show_warnings(parameters)


def _show_warnings(parameters: ParameterSet) -> None:
    basis = parameters.basis
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


def require_accepted(*sets: NamedSet, given: bool, asks: bool) -> None:
    """Refuse to write sets with a verdict that is not good, unless that is accepted."""
    for found in sets:
        given = accepts(found.parameters, f"Write {found.name}", given=given, asks=asks)
        accepted_verdict(found.name, found.parameters.basis, accept_warnings=given)


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
        content: dict[str, Any] = {}
        for which, each in (("first", found.first), ("second", found.second)):
            content |= {which: each.name, f"{which}_verdict": each.parameters.basis.state}
        about = {"conditions": conditions, "parameters": changes, "notes": found.notes}
        print_json({**content, **about})
        return
    for letter, each in (("A", found.first), ("B", found.second)):
        echo(f"{letter}: {each.name} (verdict {verdict_text(each.parameters)})")
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
        trends = [_trend(each) for each in series.trends]
        print_json({"tyre": series.tyre, "trends": trends, "notes": series.notes})
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


Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Request:
    """A tyre to simulate, files to write, and whether JSON is printed."""

    tyre: responses.SimulatedTyre
    table: Path | None
    figure: Path | None
    as_json: bool

    @property
    def screen(self) -> bool:
        """Whether a table is printed."""
        return not self.as_json and self.table is None


def frequencies(found: Bifurcation, frame: str, request: Request) -> None:
    """Show natural frequencies over speed."""
    for sentence in responses.instabilities(found):
        echo_error(sentence)
    columns = responses.frequency_columns(found)
    _write(request, columns, responses.frequency_lists(found))
    if request.screen:
        shown = {name: columns[name] for name in list(columns)[:4]}
        places = {"speed_rad_s": 2, "regressive_hz": 3, "progressive_hz": 3}
        _print_rows(f"Frequencies, {frame} frame", shown, places)
    _write_picture(request, ring_plots.frequencies_plot(found))


def inertance(found: responses.SimulatedInertance, request: Request) -> None:
    """Show an inertance; its peaks where there are many lines."""
    note = f"Inertance in {found.unit}"
    if found.unit == responses.PER_LINE_FORCE:
        note += f", per unit of belt width: {request.tyre.name} has no belt width"
        echo_error(f"{note}.")
    _write(request, found.columns, {"unit": found.unit, **found.columns}, note)
    if request.screen:
        places = {"frequency_hz": 2, "real": 5, "imag": 5, "magnitude": 5, "phase_deg": 2}
        if found.frequency_hz.size <= FEW_LINES:
            _print_rows(f"Inertance, {found.unit}", found.columns, places)
        else:
            peaks = dict(zip(("frequency_hz", "magnitude"), found.peaks, strict=True))
            _print_rows(f"Peaks of the inertance, {found.unit}", peaks, places)
    _write_picture(request, ring_plots.inertance_plot(found))


def cleat(found: responses.CleatResponse, request: Request, spectrum: Path | None) -> None:
    """Show the response to an impact, on the screen its extremes."""
    quantity, unit = found.observer.quantity, found.observer.unit
    spectra = {f"spectrum_{name}": each for name, each in found.spectrum_columns.items()}
    content = {"unit": unit, **found.columns, **spectra}
    _write(request, found.columns, content, f"{quantity} in {unit}")
    if spectrum is not None:
        write_columns(spectrum, found.spectrum_columns, f"spectrum in {unit}·s")
        _name(request, "Spectrum", spectrum)
    if request.screen:
        ends = np.array([np.argmin(found.response), np.argmax(found.response)])
        rows = {"time_s": found.time_s[ends], quantity: found.response[ends]}
        _print_rows(f"Extremes of the {quantity}, {unit}", rows, {"time_s": 4, quantity: 6})
    _write_picture(request, ring_plots.cleat_plot(found))


def loaded(found: responses.LoadedSweep, request: Request) -> None:
    """Show frequencies over load."""
    names = ("load_n", "frequency_hz", "dominant_order", "contact_deflection_m")
    static = {} if found.static is None else vars(found.static)
    _write(request, found.columns, {name: getattr(found, name) for name in names} | static)
    if not request.as_json:
        belt_mm = 1e3 * found.contact_deflection_m
        echo(f"Deflection of the belt in the contact at {found.load_n.max():g} N: {belt_mm:.2f} mm")
        if found.static is not None:
            road_mm = 1e3 * float(found.static.deflection_m[np.argmax(found.load_n)])
            tread_mm = road_mm - belt_mm
            echo(
                f"With {tread_mm:.2f} mm of the tread, the road is {road_mm:.2f} mm nearer the axle"
            )
    if request.screen and found.static is not None:
        curve = {"load_n": found.load_n, "deflection_mm": 1e3 * found.static.deflection_m}
        curve |= {"patch_length_mm": 1e3 * found.static.patch_length_m}
        curve |= {"stiffness_n_mm": 1e-3 * found.static.stiffness_n_m}
        digits = {"deflection_mm": 2, "patch_length_mm": 1, "stiffness_n_mm": 1}
        _print_rows("Deflection of belt and tread over load", curve, digits)
    if request.screen:
        shown = {name: found.columns[name] for name in list(found.columns)[:4]}
        _print_rows("Frequencies over load", shown, {"frequency_hz": 3})
    _write_picture(request, ring_plots.loaded_plot(found))


def hub(found: HubResponse, forced: ForcedRing, request: Request) -> None:
    """Show forces and moment at the hub, and frequencies of a free wheel."""
    wheel = forced.wheel
    columns = responses.hub_columns(found, free=wheel is not None)
    _write(request, columns, columns)
    if request.screen:
        places = {"largest": 4, "frequency_hz": 3}
        _print_rows("Largest at the hub per N on the belt", responses.largest_at_hub(found), places)
        if wheel is not None:
            roots = responses.free_frequencies(forced.ring, wheel, forced.speed_rad_s)
            _print_rows("Undamped, with the free wheel, seen from the tyre", roots, places)
    _write_picture(request, ring_plots.hub_plot(found))


def _write(request: Request, columns: Columns, content: Mapping[str, Any], note: str = "") -> None:
    if request.table is not None:
        write_columns(request.table, columns, note)
        _name(request, "Table", request.table)
    if request.as_json:
        print_arrays(content)


def _write_picture(request: Request, plot: Plot) -> None:
    if request.figure is not None:
        write_figure(request.figure, draw_plot(plot))
        _name(request, "Figure", request.figure)


def _name(request: Request, what: str, path: Path) -> None:
    """Name a file, on standard error where standard output is for a program."""
    (echo_error if request.as_json else echo)(f"{what}: {path}")


def write_columns(path: Path, columns: Columns, note: str = "") -> None:
    """Write columns as CSV, or as Parquet with a note, by the ending of `path`."""
    write_table(path, columns, {"note": note} if note else None)


def print_arrays(content: Mapping[str, Any]) -> None:
    """Print arrays, numbers and texts as JSON; numbers that are not finite become null."""
    print_json({name: np.asarray(value).tolist() for name, value in content.items()})


def _print_rows(title: str, columns: Mapping[str, ArrayLike], places: Mapping[str, int]) -> None:
    """Print a table, each column with its number of digits after the decimal point."""
    cells = (
        [_cell(value, places.get(name, 0)) for value in np.asarray(values)]
        for name, values in columns.items()
    )
    print_table(title, tuple(columns), zip(*cells, strict=True))


def _cell(value: Any, places: int) -> str:
    if isinstance(value, str):
        return value
    return f"{value:.{places}f}" if np.isfinite(value) else DASH
