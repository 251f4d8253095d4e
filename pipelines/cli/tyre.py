"""The command line's ``ringmodal tyre``: the library of parameter sets."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ema.core.errors import InputError
from pipelines.cli import show_tyre, terminal
from pipelines.cli.help import Command, Group
from pipelines.cli.options import (
    FILES,
    LIBRARY_PANEL,
    AcceptChanges,
    AnySet,
    Author,
    Json,
    Library,
    Name,
    Note,
    Reference,
    library_folder,
)
from pipelines.cli.tyre_tir import from_tir, modal_targets, update_tir
from pipelines.cli.values import TABLE_ENDINGS, require_target
from pipelines.library.export import export as write
from pipelines.library.export import version_rows, write_table
from pipelines.library.history import all_damage, difference, history_of
from pipelines.library.library import TyreLibrary, conditions_of, resolve
from pipelines.library.numbering import require_version, split_reference
from pipelines.library.series import pressure_series
from pipelines.library.version import login_name
from pipelines.report.pressure_series import ENDINGS, write_series

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ema.core.errors import InputError
    from pipelines.library.library import TyreLibrary
    from pipelines.library.version import Version

tyre = typer.Typer(
    cls=Group,
    help="""Parameter sets of tyres: kept in a library, compared, handed to other programs.

    A library is a folder, e.g. on a network drive. Each tyre in it has numbered versions, which
    never change once written. Option --library or the variable RINGMODAL_LIBRARY names the folder.

    Examples:
      ringmodal tyre add results/tyre_7 --library parameters --note "new contour"
      ringmodal tyre history 225-55R17 --library parameters
    """,
    no_args_is_help=True,
    rich_markup_mode=None,
)


class PressureUnit(StrEnum):
    """Unit of pressures that are shown."""

    bar = "bar"
    kilopascal = "kPa"
    pascal = "Pa"
    psi = "psi"


@tyre.command(cls=Command)
def add(
    result: Annotated[
        Path,
        typer.Argument(metavar="RESULT", help="Result folder, or a tyre.toml.", show_default=False),
    ],
    library: Library = None,
    tyre_id: Annotated[
        str,
        typer.Option(
            "--tyre",
            metavar="NAME",
            rich_help_panel=LIBRARY_PANEL,
            help="Tells tyres of the same designation apart, e.g. winter-A.",
        ),
    ] = "",
    note: Note = "",
    author: Author = "",
    condition: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            rich_help_panel=LIBRARY_PANEL,
            help="What else it was measured under, in SI, e.g. temperature_c=21.5 or load_n=4000.",
        ),
    ] = None,
    accept_changes: AcceptChanges = False,
    as_json: Json = False,
) -> None:
    """Add the parameter set of a result as a new version of its tyre.

    The first version of the first tyre makes the library's folder. Several people may add at the
    same time: each gets a number of their own.

    Example:
      ringmodal tyre add results/tyre_7 --library parameters --note "new contour"
    """
    added = _library(library).add(
        result,
        tyre_id=tyre_id,
        note=note,
        author=author,
        conditions=conditions_of(condition or ()),
        accept_changes=accept_changes,
    )
    _say_what_is_done("Added", added, as_json=as_json)


@tyre.command("list", cls=Command)
def list_tyres(library: Library = None, as_json: Json = False) -> None:
    """List all tyres with their versions, the approved one and the pressures.

    Example:
      ringmodal tyre list --library parameters
    """
    histories = [history_of(each) for each in _library(library).tyres()]
    show_tyre.show_tyres(histories, as_json=as_json)
    _complain_of(all_damage(histories))


@tyre.command(cls=Command)
def show(name: Reference, library: Library = None, as_json: Json = False) -> None:
    """Show a version: conditions, parameters with ±, where they come from.

    Without a version it is the approved one, and the newest where none is approved.

    Example:
      ringmodal tyre show 225-55R17 --library parameters
      ringmodal tyre show 225-55R17@2 --library parameters
    """
    of = _library(library)
    version = of.version(name)
    show_tyre.show_version(version, of.tyre(version.tyre).standing(version), as_json=as_json)


@tyre.command(cls=Command)
def history(name: Name, library: Library = None, as_json: Json = False) -> None:
    """Show all versions of a tyre: when, by whom, why, and what changed most.

    Example:
      ringmodal tyre history 225-55R17 --library parameters
    """
    found = history_of(_library(library).tyre(name))
    show_tyre.show_history(found, as_json=as_json)
    _complain_of(found.damage)


@tyre.command(cls=Command)
def diff(
    first: Annotated[str, AnySet],
    second: Annotated[str, AnySet],
    library: Library = None,
    accept_changes: AcceptChanges = False,
    as_json: Json = False,
) -> None:
    """Compare two parameter sets, with the significance of each difference.

    z is the difference over its standard deviation, p the chance of one as large from noise alone.
    Tested are parameters that both sets identified; the verdict allows for testing several.

    Example:
      ringmodal tyre diff 225-55R17@1 225-55R17@2 --library parameters
      ringmodal tyre diff 225-55R17 results/tyre_7 --library parameters
    """
    one, two = (resolve(each, library, accept_changes=accept_changes) for each in (first, second))
    found = difference(one, two)
    show_tyre.show_difference(found, as_json=as_json)


@tyre.command(cls=Command)
def approve(
    name: Annotated[
        str,
        typer.Argument(metavar="NAME@VERSION", help="E.g. 225-55R17@3.", show_default=False),
    ],
    library: Library = None,
    note: Note = "",
    author: Author = "",
    as_json: Json = False,
) -> None:
    """Make a version the approved one, which `show` and `export` take from now on.

    The version itself does not change: who approved it, when and why is written down beside it.

    Example:
      ringmodal tyre approve 225-55R17@3 --library parameters --note "checked on the road"
    """
    of = _library(library)
    wanted = of.tyre(require_version(name, "approve"))
    version = wanted.approve(of.version(name).number, author or login_name(), note)
    _say_what_is_done("Approved", version, as_json=as_json)


@tyre.command(cls=Command)
def rollback(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME[@VERSION]",
            help="Tyre, and the version to go back to. Default: the one approved before.",
            show_default=False,
        ),
    ],
    library: Library = None,
    note: Note = "",
    author: Author = "",
    as_json: Json = False,
) -> None:
    """Go back to a version that was approved earlier.

    Nothing is deleted or changed: that version becomes the approved one again, and who went back,
    when and why is written down. Later versions stay and can be approved again.

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
    name: Annotated[str, AnySet],
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", rich_help_panel=FILES, help="File to write.")
    ],
    file_format: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="FORMAT",
            rich_help_panel=FILES,
            help="toml, json, csv, … Default: the ending of FILE.",
        ),
    ] = "",
    library: Library = None,
    accept_changes: AcceptChanges = False,
    as_json: Json = False,
) -> None:
    """Write a parameter set as a file for other programs.

    Example:
      ringmodal tyre export 225-55R17 --library parameters --out tyre.toml
      ringmodal tyre export 225-55R17@2 --library parameters --out tyre.json
    """
    found = resolve(name, library, accept_changes=accept_changes)
    written = write(found.parameters, out, file_format)
    _say_file(out, as_json=as_json, told={"set": found.name, "format": written})


@tyre.command(cls=Command)
def table(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]…", help="Tyres. Default: all.", show_default=False),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE", rich_help_panel=FILES, help="A name in .parquet or .csv."
        ),
    ] = None,
    wide: Annotated[
        bool,
        typer.Option(
            "--wide",
            rich_help_panel=FILES,
            help="One row per version. Default: one per version and parameter.",
        ),
    ] = False,
    library: Library = None,
    as_json: Json = False,
) -> None:
    """Write all versions as one table, for pandas or a spreadsheet; without --out, show them.

    Versions whose files are damaged are left out and named; the exit code is 2 then.

    Example:
      ringmodal tyre table --library parameters --out parameters.parquet --wide
    """
    of = _library(library)
    if out is not None:
        require_target(out, TABLE_ENDINGS)
    tyres = [of.tyre(name) for name in names] if names else of.tyres()
    rows, damage = version_rows(tyres, wide=wide and (as_json or out is not None))
    if out is None:
        show_tyre.show_rows(rows, as_json=as_json)
    else:
        write_table(out, rows, wide=wide)
        _say_file(out, as_json=as_json, told={"rows": len(rows)})
    _complain_of(damage)


@tyre.command(cls=Command)
def series(
    name: Name,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE", rich_help_panel=FILES, help="A plot, in .png, .svg or .html."
        ),
    ] = None,
    parameter: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only this parameter; may be repeated."),
    ] = None,
    pressure_unit: Annotated[
        PressureUnit, typer.Option(help="Unit of the pressure.")
    ] = PressureUnit.bar,
    library: Library = None,
    as_json: Json = False,
) -> None:
    """Follow the parameters of a tyre over inflation pressure, with a straight line for each.

    Versions identified at two different pressures or more are needed; of several from the same
    recordings the newest counts. Lines are weighted with 1/σ².

    Example:
      ringmodal tyre series 225-55R17 --library parameters --out series.png
    """
    if out is not None:
        require_target(out, ENDINGS)
    meant = _library(library).tyre(name)
    versions, damage = meant.versions()
    try:
        found = pressure_series(versions or [meant.latest_intact()], parameter or ())
    except InputError as error:  # what is damaged may be what is missing
        raise (damage[0] if damage else error) from error
    show_tyre.show_series(found, pressure_unit.value, as_json=as_json)
    if out is not None:
        write_series(out, found, pressure_unit.value)
        if not as_json:
            terminal.say(f"Plot: {out}")
    _complain_of(damage)


for command in (update_tir, from_tir, modal_targets):
    tyre.command(cls=Command, rich_help_panel="Other programs")(command)


def _library(given: Path | None) -> TyreLibrary:

    return TyreLibrary(library_folder(given))


def _say_what_is_done(done: str, version: Version, *, as_json: bool) -> None:
    if as_json:
        told = {"tyre": version.tyre, "version": version.number}
        terminal.print_json({**told, "author": version.entry.author, "sha256": version.sha256})
    else:
        terminal.say(f"{done}: {version.reference}")


def _say_file(path: Path, *, as_json: bool, told: dict[str, object]) -> None:
    if as_json:
        terminal.print_json({"file": str(path), **told})
    else:
        terminal.say(
            f"Written: {path} ({', '.join(f'{key} {value}' for key, value in told.items())})"
        )


def _complain_of(damage: Sequence[InputError]) -> None:
    """Report damaged files after what could be read; the exit code tells of them too."""
    for error in damage:
        terminal.complain(f"Error: {error}")
    if damage:
        raise typer.Exit(2)
