"""Options that several commands share, each defined once."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from ema.core.campaign import Processing
from ema.core.errors import InputError
from pipelines.cli import values as value
from pipelines.results.options import Options

if TYPE_CHECKING:
    from pipelines.results.options import Options

FILES, PROCESSING = "Input and output", "Processing"
POLES, RING, SCREEN = "Poles", "Ring", "Screen"


def one_of(values: Sequence[str], panel: str, text: str, *names: str) -> Any:
    """An option that takes one of some names; the shell completes them."""
    return typer.Option(
        *names,
        metavar="NAME",
        rich_help_panel=panel,
        autocompletion=value.completing(values),
        help=text,
    )


def replacing(what: str) -> Any:
    """The option ``--force`` of a command, which replaces only when told to."""
    return typer.Option("--force", rich_help_panel=FILES, help=f"Replace {what}.")


ResultFolder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of an earlier result.", show_default=False)
]
Out = Annotated[
    Path,
    typer.Option(
        "--out",
        metavar="DIR",
        rich_help_panel=FILES,
        help="Folder for the result; written atomically.",
    ),
]
Force = Annotated[bool, replacing("an earlier result")]
NoReport = Annotated[
    bool, typer.Option("--no-report", rich_help_panel=FILES, help="Stop before the report.")
]
Figures = Annotated[
    Path | None,
    typer.Option(
        "--figures",
        metavar="DIR",
        rich_help_panel=FILES,
        help="Write each figure of the report there too, as PNG and SVG.",
    ),
]
Pdf = Annotated[
    bool,
    typer.Option(
        "--pdf",
        rich_help_panel=FILES,
        help="Write report.pdf into the result too; needs the optional part pdf.",
    ),
]
AcceptChanges = Annotated[
    bool,
    typer.Option(
        "--accept-changes",
        rich_help_panel=FILES,
        help="Use a result although files in it were changed after it was written; recorded.",
    ),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict",
        rich_help_panel=FILES,
        help="Refuse recordings that give any warning; write nothing.",
    ),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json", rich_help_panel=SCREEN, help="Print the result as JSON on standard output."
    ),
]
Quiet = Annotated[
    bool, typer.Option("--quiet", rich_help_panel=SCREEN, help="No progress messages.")
]
Objective = Annotated[
    str,
    one_of(
        value.OBJECTIVES,
        RING,
        "What the tuning minimises: frequency (relative errors) or paper (eq. 18).",
    ),
]
Given = Annotated[
    list[str] | None,
    typer.Option(
        "--given",
        metavar="NAME=VALUE",
        rich_help_panel=RING,
        autocompletion=value.ring_parameter_names,
        help="A ring parameter known from elsewhere, in SI, such as mass_per_area_kg_m2=19.7; "
        "may be repeated.",
    ),
]


def processing_options(
    *,
    band_hz: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="FROM TO",
            rich_help_panel=PROCESSING,
            help="Band in Hz in which modes are sought. Default for a tyre: 20 260.",
        ),
    ] = None,
    averages: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            rich_help_panel=PROCESSING,
            help="Number of averages; sets the block length.",
        ),
    ] = None,
    block_seconds: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            rich_help_panel=PROCESSING,
            help="Block length in s. Default: 4, or a quarter of a shorter recording.",
        ),
    ] = None,
    window: Annotated[
        str | None,
        one_of(
            value.WINDOWS,
            PROCESSING,
            "hann, boxcar, flattop or any other window of scipy. Default: hann.",
        ),
    ] = None,
    overlap: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=0.95,
            metavar="SHARE",
            rich_help_panel=PROCESSING,
            help="Overlap as a share of a block. Default: 0.5; for boxcar 0.",
        ),
    ] = None,
    estimator: Annotated[
        str,
        one_of(value.ESTIMATORS, PROCESSING, "FRF estimator: H1, H2 or Hv."),
    ] = "H1",
    max_order: Annotated[
        int,
        typer.Option(
            min=4,
            max=200,
            metavar="N",
            rich_help_panel=POLES,
            help="Highest model order of the stability diagram.",
        ),
    ] = 60,
    method: Annotated[
        str,
        one_of(
            value.METHODS, POLES, "Pole estimator, lsce or plscf; the other is the cross-check."
        ),
    ] = "lsce",
    pin: Annotated[
        list[str] | None,
        typer.Option(
            metavar="HZ,HZ,…",
            rich_help_panel=POLES,
            help="Take the modes next to these frequencies in Hz, and no others. May be repeated.",
        ),
    ] = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option(
            metavar="HZ,HZ,…",
            rich_help_panel=POLES,
            help="Leave out the modes at these frequencies in Hz. May be repeated.",
        ),
    ] = None,
    objective: Objective = "frequency",
    given: Given = None,
    no_tune: Annotated[
        bool,
        typer.Option(
            "--no-tune", rich_help_panel=RING, help="Stop at the modes: no ring parameters."
        ),
    ] = False,
    strict: Strict = False,
) -> Options:
    """What the command line chose for the processing of a campaign."""
    return Options(
        processing=Processing(averages, block_seconds, window, overlap, band_hz),
        estimator=value.choice("--estimator", estimator, value.ESTIMATORS),
        max_order=max_order,
        pinned_hz=value.numbers("--pin", pin),
        excluded_hz=value.numbers("--exclude", exclude),
        method=value.choice("--method", method, value.METHODS),
        tune=not no_tune,
        objective=value.choice("--objective", objective, value.OBJECTIVES),
        given=value.ring_parameters("--given", given),
        strict=strict,
    )


def with_processing_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of the processing; they reach it as one, named ``options``."""
    shared = inspect.signature(processing_options).parameters
    own = [
        each for each in inspect.signature(command).parameters.values() if each.name != "options"
    ]
    known = {"Options": object}  # importing it would load numpy for every ``--help``
    hints = {
        **get_type_hints(command, localns=known, include_extras=True),
        **get_type_hints(processing_options, localns=known, include_extras=True),
    }

    @wraps(command)
    def taking(**values: Any) -> None:
        options = processing_options(**{name: values.pop(name) for name in shared})
        command(options=options, **values)

    parameters = [
        each.replace(annotation=hints[each.name], kind=inspect.Parameter.KEYWORD_ONLY)
        for each in (*own, *shared.values())
    ]
    taking.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    taking.__annotations__ = {each.name: each.annotation for each in parameters}
    return taking


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
    if given is None:
        rule = "the folder of the library must be known"
        remedy = f"Give --library DIR, or set {_VARIABLE} once and for all"
        raise InputError("--library", "nothing", rule, remedy)
    return given
