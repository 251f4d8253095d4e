"""Arguments and options that the commands on parameter sets share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

LIBRARY_PANEL = "Library"
_VARIABLE = "RINGMODAL_LIBRARY"

Library = Annotated[
    Path | None,
    typer.Option(
        "--library",
        metavar="DIR",
        envvar=_VARIABLE,
        rich_help_panel=LIBRARY_PANEL,
        help="Folder of the library.",
    ),
]
Name = Annotated[
    str,
    typer.Argument(
        metavar="NAME",
        help="Tyre: its name in `tyre list`, or its designation.",
        show_default=False,
    ),
]
Reference = Annotated[
    str,
    typer.Argument(
        metavar="NAME[@VERSION]",
        help="Tyre and version, e.g. 225-55R17@3; without version the approved one, else the "
        "newest.",
        show_default=False,
    ),
]
AnySet = typer.Argument(
    metavar="SET", help="NAME@VERSION, a result folder or a tyre.toml.", show_default=False
)
Note = Annotated[
    str,
    typer.Option(
        "--note", metavar="TEXT", rich_help_panel=LIBRARY_PANEL, help="Why; kept with it."
    ),
]
Author = Annotated[
    str,
    typer.Option(
        "--author", metavar="NAME", rich_help_panel=LIBRARY_PANEL, help="Default: your login name."
    ),
]


def library_folder(given: Path | None) -> Path:
    """The library that was named by option or environment.

    Raises
    ------
    InputError
        If none was.
    """
    from ema.errors import InputError

    if given is None:
        rule = "the folder of the library must be known"
        remedy = f"Give --library DIR, or set {_VARIABLE} once and for all"
        raise InputError("--library", "nothing", rule, remedy)
    return given
