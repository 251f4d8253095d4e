"""Options that several commands share, each defined once."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer

from ema.core.campaign import Processing
from model.tuning_problem import PARAMETERS
from pipelines.cli import values as value
from pipelines.library.library import VARIABLE
from pipelines.results.options import Options

# Headings of the help
FILES, PROCESSING = "Input and output", "Processing"
POLES, RING, SCREEN = "Poles", "Ring", "Screen"
LIBRARY = "Library"
_HZ = "HZ,HZ,…"


def option(
    name: str, text: str, panel: str | None = None, metavar: str | None = None, **more: Any
) -> Any:
    """An option of a command: its name, its help, and the heading that lists it."""
    return typer.Option(name, help=text, rich_help_panel=panel, metavar=metavar, **more)


def one_of(name: str, values: Sequence[str], text: str, panel: str) -> Any:
    """An option that takes one of several names, which the shell completes."""
    return option(name, text, panel, "NAME", autocompletion=value.completing(values))


def replacing(what: str) -> Any:
    """The option ``--force`` of a command."""
    return option("--force", f"Replace {what}.", FILES)


def argument(metavar: str, text: str) -> Any:
    """An argument of a command."""
    return typer.Argument(metavar=metavar, help=text, show_default=False)


ResultFolder = Annotated[Path, argument("DIR", "Folder of an earlier result.")]
Out = Annotated[Path, option("--out", "Folder for the result; written atomically.", FILES, "DIR")]
Force = Annotated[bool, replacing("an earlier result")]
NoReport = Annotated[bool, option("--no-report", "Stop before the report.", FILES)]
Figures = Annotated[
    Path | None,
    option("--figures", "Write each figure of the report as PNG and SVG.", FILES, "DIR"),
]
Pdf = Annotated[bool, option("--pdf", "Also write report.pdf; needs the optional part pdf.", FILES)]
AcceptChanges = Annotated[
    bool,
    option("--accept-changes", "Use a result whose files were changed later; recorded.", FILES),
]
Strict = Annotated[
    bool, option("--strict", "Refuse recordings that give any warning; write nothing.", FILES)
]
Json = Annotated[bool, option("--json", "Print the result as JSON on standard output.", SCREEN)]
Quiet = Annotated[
    bool, option("--quiet", "Print only errors and, on standard output, the result.", SCREEN)
]
Objective = Annotated[
    str,
    one_of(
        "--objective",
        value.OBJECTIVES,
        "What the tuning minimises: frequency (relative errors) or paper (eq. 18).",
        RING,
    ),
]
Given = Annotated[
    list[str] | None,
    option(
        "--given",
        "A known ring parameter in SI units, such as mass_per_area_kg_m2=19.7; may be repeated.",
        RING,
        "NAME=VALUE",
        autocompletion=value.completing([f"{name}=" for name in PARAMETERS]),
    ),
]


def processing_options(
    *,
    band_hz: Annotated[
        tuple[float, float] | None,
        option(
            "--band-hz",
            "Band in Hz. Default: where coherence is good; for a tyre 20 300 at most.",
            PROCESSING,
            "FROM TO",
        ),
    ] = None,
    averages: Annotated[
        int | None, option("--averages", "Averages; sets the block length.", PROCESSING, "N", min=1)
    ] = None,
    block_seconds: Annotated[
        float | None,
        option(
            "--block-seconds",
            "Block length in s. Default: 4, or a quarter of a shorter recording.",
            PROCESSING,
            "S",
        ),
    ] = None,
    window: Annotated[
        str | None,
        one_of("--window", value.WINDOWS, "Any window of scipy. Default: hann.", PROCESSING),
    ] = None,
    overlap: Annotated[
        float | None,
        option(
            "--overlap",
            "Overlap as a share of a block. Default: 0.5; for boxcar 0.",
            PROCESSING,
            "SHARE",
            min=0.0,
            max=0.95,
        ),
    ] = None,
    estimator: Annotated[
        str, one_of("--estimator", value.ESTIMATORS, "FRF estimator: H1, H2 or Hv.", PROCESSING)
    ] = "H1",
    max_order: Annotated[
        int, option("--max-order", "Highest model order of the poles.", POLES, "N", min=4, max=200)
    ] = 60,
    method: Annotated[
        str,
        one_of("--method", value.METHODS, "lsce or plscf; the other is the cross-check.", POLES),
    ] = "lsce",
    pin: Annotated[
        list[str] | None,
        option("--pin", "Take only modes at these frequencies in Hz; repeatable.", POLES, _HZ),
    ] = None,
    exclude: Annotated[
        list[str] | None,
        option("--exclude", "Leave out modes at these frequencies in Hz; repeatable.", POLES, _HZ),
    ] = None,
    objective: Objective = "frequency",
    given: Given = None,
    no_tune: Annotated[
        bool, option("--no-tune", "Stop at the modes: no ring parameters.", RING)
    ] = False,
    strict: Strict = False,
) -> Options:
    """Options for the processing of a campaign, from the command line."""
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
    """Replace the parameter ``options`` of a command by those of `processing_options`."""
    shared = inspect.signature(processing_options, eval_str=True).parameters
    own = inspect.signature(command, eval_str=True).parameters

    @wraps(command)
    def taking(**values: Any) -> None:
        options = processing_options(**{name: values.pop(name) for name in shared})
        command(options=options, **values)

    parameters = [
        each.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for each in (*own.values(), *shared.values())
        if each.name != "options"
    ]
    taking.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    taking.__annotations__ = {each.name: each.annotation for each in parameters}
    return taking


Library = Annotated[
    Path | None, option("--library", "Folder of the library.", LIBRARY, "DIR", envvar=VARIABLE)
]
Name = Annotated[str, argument("NAME", "Tyre: its name in `tyre list`, or its designation.")]
Reference = Annotated[
    str,
    argument("NAME[@VERSION]", "E.g. 225-55R17@3. Default: the approved version, or the newest."),
]
AnySet = argument("SET", "NAME@VERSION, a result folder or a tyre.toml.")
Note = Annotated[str, option("--note", "Reason; stored with it.", LIBRARY, "TEXT")]
Author = Annotated[str, option("--author", "Default: your login name.", LIBRARY, "NAME")]
