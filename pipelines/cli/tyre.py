"""``ringmodal tyre``: the library of parameter sets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from ema.core.errors import InputError
from model.verdict import State
from pipelines.cli import options as opt
from pipelines.cli import show_tyre
from pipelines.cli.app import Command, group
from pipelines.cli.terminal import echo, echo_error, print_json
from pipelines.cli.tyre_tir import from_tir, modal_targets, update_tir
from pipelines.library.export import export as write
from pipelines.library.export import version_rows, write_table
from pipelines.library.history import difference, history_of, pressure_series
from pipelines.library.library import NamedSet, TyreLibrary, read_source, resolve
from pipelines.library.numbering import VARIABLE, require_version, split_reference
from pipelines.library.version import Version, login_name
from pipelines.report.ring import ENDINGS, write_series

tyre = group(
    """Parameter sets of tyres: versions, comparison, export to other programs.

    A library is a folder, e.g. on a network drive. Each tyre in it has numbered versions, which
    never change once written. Option --library or the variable RINGMODAL_LIBRARY gives the folder.

    Examples:
      ringmodal tyre add results/tyre_7 --library parameters --note "new contour"
      ringmodal tyre history 225-55R17 --library parameters
    """
)


@tyre.command(cls=Command)
def add(
    result: Annotated[Path, opt.argument("RESULT", "Result folder, or a tyre.toml.")],
    library: opt.Library = None,
    tyre_id: Annotated[
        str,
        opt.option("Name within its designation, e.g. winter-A.", opt.LIBRARY, "NAME", "--tyre"),
    ] = "",
    note: opt.Note = "",
    author: opt.Author = "",
    condition: Annotated[
        list[str] | None,
        opt.option("Condition in SI, e.g. load_n=4000.", opt.LIBRARY, "NAME=VALUE"),
    ] = None,
    accept_changes: opt.AcceptChanges = False,
    accept_warnings: opt.AcceptWarnings = False,
    as_json: opt.Json = False,
) -> None:
    """Add the parameter set of a result as a new version of its tyre.

    The first version of the first tyre creates the library's folder. Several people may add at the
    same time: each version gets its own number. A set whose verdict is bad needs --accept-warnings,
    or a yes where you are asked; a doubtful one is added with its verdict.

    Example:
      ringmodal tyre add results/tyre_7 --library parameters --note "new contour"
    """
    of, found = _library(library), read_source(result, accept_changes=accept_changes)
    show_tyre.show_verdict(found, doubts_only=True)
    is_bad = found.basis.state is State.BAD
    accepted = accept_warnings or (
        is_bad and show_tyre.accepts(found, "Add it", given=False, asks=not as_json)
    )
    added = of.add(
        result,
        tyre_id=tyre_id,
        note=note,
        author=author,
        conditions=opt.numbers_of("--condition", condition or (), "temperature_c=21.5"),
        accept_changes=accept_changes,
        accept_warnings=accepted,
    )
    _say_what_is_done("Added", added, as_json=as_json)


@tyre.command("list", cls=Command)
def list_tyres(library: opt.Library = None, as_json: opt.Json = False) -> None:
    """List all tyres with their versions, the approved one and the pressures.

    Example:
      ringmodal tyre list --library parameters
    """
    histories = [history_of(each) for each in _library(library).tyres()]
    show_tyre.show_tyres(histories, as_json=as_json)
    _complain_of([error for each in histories for error in each.damage])


@tyre.command(cls=Command)
def show(name: opt.Reference, library: opt.Library = None, as_json: opt.Json = False) -> None:
    """Show a version: conditions, parameters with ±, where they come from.

    The default is the approved version, or the newest if none is approved.

    Example:
      ringmodal tyre show 225-55R17 --library parameters
      ringmodal tyre show 225-55R17@2 --library parameters
    """
    of = _library(library)
    version = of.version(name)
    show_tyre.show_version(version, of.tyre(version.tyre).standing(version), as_json=as_json)


@tyre.command(cls=Command)
def history(name: opt.Name, library: opt.Library = None, as_json: opt.Json = False) -> None:
    """Show all versions of a tyre: when, by whom, why, and what changed most.

    Example:
      ringmodal tyre history 225-55R17 --library parameters
    """
    found = history_of(_library(library).tyre(name))
    show_tyre.show_history(found, as_json=as_json)
    _complain_of(found.damage)


@tyre.command(cls=Command)
def diff(
    first: Annotated[str, opt.AnySet],
    second: Annotated[str, opt.AnySet],
    library: opt.Library = None,
    accept_changes: opt.AcceptChanges = False,
    as_json: opt.Json = False,
) -> None:
    """Compare two parameter sets, with the significance of each difference.

    z is the difference over its standard deviation, p the p-value. Only parameters that both sets
    identified are tested; the verdict allows for testing several.

    Example:
      ringmodal tyre diff 225-55R17@1 225-55R17@2 --library parameters
      ringmodal tyre diff 225-55R17 results/tyre_7 --library parameters
    """
    one, two = (resolve(each, library, accept_changes=accept_changes) for each in (first, second))
    show_tyre.show_difference(difference(one, two), as_json=as_json)


@tyre.command(cls=Command)
def approve(
    name: Annotated[str, opt.argument("NAME@VERSION", "E.g. 225-55R17@3.")],
    library: opt.Library = None,
    note: opt.Note = "",
    author: opt.Author = "",
    accept_warnings: opt.AcceptWarnings = False,
    as_json: opt.Json = False,
) -> None:
    """Approve a version, which `show` and `export` use from now on.

    The version itself does not change: who approved it, when and why is recorded beside it. A
    version whose verdict is not good needs --accept-warnings, or a yes where you are asked.

    Example:
      ringmodal tyre approve 225-55R17@3 --library parameters --note "checked on the road"
    """
    of = _library(library)
    wanted = of.tyre(require_version(name, "approve"))
    parameters = (version := of.version(name)).parameters
    show_tyre.show_verdict(parameters, doubts_only=True)
    question = f"Approve {version.reference}"
    accepted = show_tyre.accepts(parameters, question, given=accept_warnings, asks=not as_json)
    signed = author or login_name(), note
    version = wanted.approve(version.number, *signed, accept_warnings=accepted)
    _say_what_is_done("Approved", version, as_json=as_json)


@tyre.command(cls=Command)
def rollback(
    name: Annotated[
        str,
        opt.argument("NAME[@VERSION]", "Tyre and version. Default: the version approved before."),
    ],
    library: opt.Library = None,
    note: opt.Note = "",
    author: opt.Author = "",
    as_json: opt.Json = False,
) -> None:
    """Go back to a version that was approved earlier.

    Nothing is deleted or changed: that version becomes the approved one again, and who went back,
    when and why is recorded. Later versions stay and can be approved again.

    Example:
      ringmodal tyre rollback 225-55R17 --library parameters --note "contour was not released"
    """
    of = _library(library)
    plain_name, wanted = split_reference(name)
    number = of.version(name).number if wanted else None
    version = of.tyre(plain_name).rollback(author or login_name(), number, note)
    _say_what_is_done("Rolled back to", version, as_json=as_json)


@tyre.command(cls=Command)
def export(
    name: Annotated[str, opt.AnySet],
    out: Annotated[Path, opt.option("File to write.", opt.FILES, "FILE")],
    file_format: Annotated[
        str, opt.option("toml, json, csv, … Default: by FILE.", opt.FILES, "FORMAT", "--format")
    ] = "",
    library: opt.Library = None,
    accept_changes: opt.AcceptChanges = False,
    accept_warnings: opt.AcceptWarnings = False,
    as_json: opt.Json = False,
) -> None:
    """Write a parameter set as a file for other programs.

    A set whose verdict is not good needs --accept-warnings, or a yes where you are asked.

    Example:
      ringmodal tyre export 225-55R17 --library parameters --out tyre.toml
      ringmodal tyre export 225-55R17@2 --library parameters --out tyre.json
    """
    found = resolve(name, library, accept_changes=accept_changes)
    show_tyre.show_verdict(found.parameters, doubts_only=True)
    show_tyre.require_accepted(found, given=accept_warnings, asks=not as_json)
    written = write(found.parameters, out, file_format)
    _say_file(out, as_json=as_json, set=found.name, format=written)


@tyre.command(cls=Command)
def table(
    names: Annotated[list[str] | None, opt.argument("[NAME]…", "Tyres. Default: all.")] = None,
    out: Annotated[Path | None, opt.target("Table", opt.TABLE_ENDINGS)] = None,
    wide: Annotated[
        bool, opt.flag("--wide", "One row per version, not per parameter.", opt.FILES)
    ] = False,
    library: opt.Library = None,
    as_json: opt.Json = False,
) -> None:
    """Write all versions as one table, for pandas or a spreadsheet; without --out, show them.

    Versions with damaged files are left out and named; the exit code is 2 then.

    Example:
      ringmodal tyre table --library parameters --out parameters.parquet --wide
    """
    of = _library(library)
    tyres = [of.tyre(name) for name in names] if names else of.tyres()
    rows, damage = version_rows(tyres, wide=wide and (as_json or out is not None))
    if out is None:
        show_tyre.show_rows(rows, as_json=as_json)
    else:
        write_table(out, rows, wide=wide)
        _say_file(out, as_json=as_json, rows=len(rows))
    _complain_of(damage)


@tyre.command(cls=Command)
def series(
    name: opt.Name,
    out: Annotated[Path | None, opt.target("Plot", ENDINGS)] = None,
    parameter: Annotated[
        list[str] | None, opt.option("Only this parameter; may be repeated.", metavar="NAME")
    ] = None,
    pressure_unit: Annotated[
        Literal["bar", "kPa", "Pa", "psi"], opt.option("Unit of the pressure.")
    ] = "bar",
    library: opt.Library = None,
    accept_warnings: opt.AcceptWarnings = False,
    as_json: opt.Json = False,
) -> None:
    """Follow the parameters of a tyre over inflation pressure, with a straight line for each.

    Versions identified at two or more pressures are required; of several from the same recordings
    the newest is used. Lines are weighted with 1/σ². Verdicts that are not good are named, and
    --out then needs --accept-warnings, or a yes where you are asked.

    Example:
      ringmodal tyre series 225-55R17 --library parameters --out series.png
    """
    wanted = _library(library).tyre(name)
    versions, damage = wanted.versions()
    try:
        found = pressure_series(versions or [wanted.latest_intact()], parameter or ())
    except InputError as error:  # a damaged file may be the missing one
        raise (damage[0] if damage else error) from error
    show_tyre.show_series(found, pressure_unit, as_json=as_json)
    if out is not None:
        used = (NamedSet(each.reference, each.parameters) for each in found.versions)
        show_tyre.require_accepted(*used, given=accept_warnings, asks=not as_json)
        write_series(out, found, pressure_unit)
        if not as_json:
            echo(f"Plot: {out}")
    _complain_of(damage)


for command in (update_tir, from_tir, modal_targets):
    tyre.command(cls=Command, rich_help_panel="Other programs")(command)


def _library(given: Path | None) -> TyreLibrary:
    if given is None:
        rule = "the folder of the library is required"
        remedy = f"Use --library DIR, or set {VARIABLE}"
        raise InputError("--library", "not given", rule, remedy)
    return TyreLibrary(given)


def _say_what_is_done(done: str, version: Version, *, as_json: bool) -> None:
    if as_json:
        about = {"tyre": version.tyre, "version": version.number}
        print_json({**about, "author": version.entry.author, "sha256": version.sha256})
    else:
        echo(f"{done}: {version.reference}")


def _say_file(path: Path, *, as_json: bool, **about: Any) -> None:
    if as_json:
        print_json({"file": str(path), **about})
    else:
        echo(f"Written: {path} ({', '.join(f'{key} {value}' for key, value in about.items())})")


def _complain_of(damage: Sequence[InputError]) -> None:
    """Report damaged files after the output, and end with exit code 2."""
    for error in damage:
        echo_error(f"Error: {error}")
    if damage:
        raise typer.Exit(2)
