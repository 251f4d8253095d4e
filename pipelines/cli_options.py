"""Options that several commands share, each defined once."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from pipelines import console

if TYPE_CHECKING:
    from pipelines.options import Options

Out = Annotated[
    Path, typer.Option("--out", help="Folder for the result; appears whole or not at all.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace an earlier result.")]
NoReport = Annotated[bool, typer.Option("--no-report", help="Stop before the report.")]
Strict = Annotated[
    bool, typer.Option("--strict", help="Refuse recordings that give any warning; write nothing.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="No progress messages.")]
Objective = Annotated[
    str,
    typer.Option(
        help="What the tuning minimises: 'frequency' (relative errors) or 'paper' (eq. 18)."
    ),
]
Given = Annotated[
    list[str] | None,
    typer.Option(
        "--given",
        metavar="NAME=VALUE",
        help="A ring parameter known from elsewhere, in SI, e.g. mass_per_area_kg_m2=19.7.",
    ),
]


def processing_options(
    *,
    band_hz: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Band in Hz in which modes are sought. Default for a tyre: 20 260."),
    ] = None,
    averages: Annotated[
        int | None, typer.Option(min=1, help="Number of averages; sets the block length.")
    ] = None,
    block_seconds: Annotated[
        float | None,
        typer.Option(help="Block length in s. Default: 4, or a quarter of a shorter recording."),
    ] = None,
    window: Annotated[str | None, typer.Option(help="Any scipy window name; default hann.")] = None,
    overlap: Annotated[
        float | None,
        typer.Option(min=0.0, max=0.95, help="Share of a block. Default: 0.5, boxcar 0."),
    ] = None,
    estimator: Annotated[str, typer.Option(help="H1, H2 or Hv.")] = "H1",
    max_order: Annotated[
        int, typer.Option(min=4, max=200, help="Highest model order of the stability diagram.")
    ] = 60,
    method: Annotated[
        str, typer.Option(help="Pole estimator, lsce or plscf; the other is the second opinion.")
    ] = "lsce",
    pin: Annotated[
        str | None,
        typer.Option(metavar="HZ,HZ,…", help="Take the modes next to these frequencies instead."),
    ] = None,
    exclude: Annotated[
        str | None,
        typer.Option(metavar="HZ,HZ,…", help="Leave out the modes at these frequencies."),
    ] = None,
    objective: Objective = "frequency",
    given: Given = None,
    no_tune: Annotated[
        bool, typer.Option("--no-tune", help="Stop at the modes: no ring parameters.")
    ] = False,
    strict: Strict = False,
) -> Options:
    """What the command line chose for the processing of a campaign."""
    from ema.recording import Processing
    from pipelines.options import Options

    return Options(
        processing=Processing(averages, block_seconds, window, overlap, band_hz),
        estimator=estimator,
        max_order=max_order,
        pinned_hz=console.numbers("--pin", pin),
        excluded_hz=console.numbers("--exclude", exclude),
        method=method,
        tune=not no_tune,
        objective=objective,
        given=console.assignments("--given", given),
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
