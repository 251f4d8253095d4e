"""Options that several commands share, each defined once, and their values: parsed and checked."""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable, Iterable, Sequence
from functools import partial, wraps
from math import isfinite, nan
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
import typer
from numpy.typing import NDArray

from ema.core.campaign import Processing
from ema.core.errors import InputError, unknown
from ema.core.recording import overlap_share
from model.coefficients import PressureLoad
from model.tuning_problem import PARAMETERS, RADIAL_GROWTH
from pipelines.cli.terminal import show_logs
from pipelines.library.numbering import VARIABLE
from pipelines.results.options import Options, Units
from pipelines.storage.atomic import require_free_file

# Headings of the help
FILES, PROCESSING = "Input and output", "Processing"
POLES, RING, SCREEN = "Poles", "Ring", "Screen"
LIBRARY = "Library"
_HZ = "HZ,HZ,…"
ESTIMATORS = ("H1", "H2", "Hv")
METHODS = ("lsce", "plscf")
OBJECTIVES = ("frequency", "paper")
WINDOWS = (  # completed by the shell; any other window of scipy is accepted as well
    *("hann", "rectangular", "hamming", "blackman", "blackmanharris", "flattop"),
    *("bartlett", "bohman", "cosine", "nuttall", "parzen", "triang", "tukey"),
)
MOST_OVERLAP = 0.95
TABLE_ENDINGS, FIGURE_ENDINGS = (".csv", ".parquet"), (".png", ".svg")
# A simulation of one line or instant takes seconds and less than 200 MB for this many values.
MOST_VALUES = 100_000
MOST_ORDERS = 2000  # as many harmonics as are ever summed


def completing(values: Sequence[str]) -> Callable[[str], list[str]]:
    """Completions of an option that takes one of some values."""
    return lambda incomplete: [value for value in values if value.startswith(incomplete)]


def option(text: str, panel: str = "", metavar: str = "", *names: str, **more: Any) -> Any:
    """An option of a command: its help, the heading that lists it, and names of its own.

    Without any it has the name of its parameter.
    """
    more |= {"help": text, "rich_help_panel": panel or None, "metavar": metavar or None}
    return typer.Option(*names, **more)


def flag(name: str, text: str, panel: str = "") -> Any:
    """An option without a value."""
    return option(text, panel, "", name)


def one_of(values: Sequence[str], text: str, panel: str, *names: str) -> Any:
    """An option that takes one of several names, which the shell completes."""
    return option(text, panel, "NAME", *names, autocompletion=completing(values))


def replacing(what: str) -> Any:
    """The option ``--force`` of a command."""
    return flag("--force", f"Replace {what}.", FILES)


def target(content: str, endings: tuple[str, ...]) -> Any:
    """An option for a file to write; what cannot be written is refused before any work."""

    def checked(param: typer.CallbackParam, path: Path | None) -> Path | None:
        if path is not None:
            choice(f"--{param.name} {path}", path.suffix or "(no ending)", endings)
            require_free_file(path, force=True)
        return path

    return option(f"{content} to write: {' or '.join(endings)}.", FILES, "FILE", callback=checked)


def argument(metavar: str, text: str) -> Any:
    """An argument of a command."""
    return typer.Argument(metavar=metavar, help=text, show_default=False)


ResultFolder = Annotated[Path, argument("DIR", "Folder of an earlier result.")]
Out = Annotated[Path, option("Folder for the result; written atomically.", FILES, "DIR")]
Force = Annotated[bool, replacing("an earlier result")]
NoReport = Annotated[bool, flag("--no-report", "Stop before the report.", FILES)]
Figures = Annotated[
    Path | None, option("Write each figure of the report as PNG and SVG.", FILES, "DIR")
]
Gif = Annotated[bool, flag("--gif", "With --figures: each shape on a moving tyre as GIF.", FILES)]
Pdf = Annotated[bool, flag("--pdf", "Also write report.pdf; needs WeasyPrint.", FILES)]
Template = Annotated[
    Path | None,
    option(
        "TOML file with logo, client, texts and signatures of the report; see the documentation.",
        FILES,
        "FILE",
        envvar="RINGMODAL_TEMPLATE",
    ),
]
Xlsx = Annotated[bool, flag("--xlsx", "Also write result.xlsx, the tables for Excel.", FILES)]
AcceptChanges = Annotated[
    bool, flag("--accept-changes", "Use a result whose files were changed later; recorded.", FILES)
]
AcceptWarnings = Annotated[
    bool, flag("--accept-warnings", "Use a set whose verdict is not good; recorded.", FILES)
]
Strict = Annotated[
    bool, flag("--strict", "Refuse recordings that give any warning; write nothing.", FILES)
]
Json = Annotated[bool, flag("--json", "Print the result as JSON on standard output.", SCREEN)]
Quiet = Annotated[bool, flag("--quiet", "Print nothing but errors, and --json.", SCREEN)]
Verbose = Annotated[
    bool,
    option(
        "Also print all notes and the time of each stage.",
        *(SCREEN, "", "--verbose"),
        callback=lambda wanted: wanted and show_logs(logging.INFO),
    ),
]
UnitSystem = Annotated[
    Units | None,
    option(
        "Units of tables and report: lab (bar, mm) or si (kPa, m). Default: lab.", SCREEN, "NAME"
    ),
]
Objective = Annotated[
    str,
    one_of(
        OBJECTIVES,
        "What the tuning minimises: frequency (relative errors) or paper (eq. 18).",
        RING,
    ),
]
Given = Annotated[
    list[str] | None,
    option(
        "A known ring parameter in SI units, such as mass_per_area_kg_m2=19.7; may be repeated.",
        RING,
        "NAME=VALUE",
        autocompletion=completing([f"{name}=" for name in PARAMETERS]),
    ),
]
TuningLoad = Annotated[
    str | None,
    one_of(
        get_args(PressureLoad),
        "Pressure model of the ring: dead (as in the paper) or follower (normal to the belt).",
        RING,
    ),
]


def _about_parameters(text: str, metavar: str) -> Any:
    names = [f"{name}=" for name in (*PARAMETERS, RADIAL_GROWTH)]
    return option(text, RING, metavar, autocompletion=completing(names))


Prior = Annotated[
    list[str] | None,
    _about_parameters(
        "What is known of a parameter, with its standard deviation, such as "
        "radial_growth_m=0.0009:0.0002; may be repeated.",
        "NAME=VALUE:STD",
    ),
]
Bounds = Annotated[
    list[str] | None,
    _about_parameters("Limits of a parameter; may be repeated.", "NAME=LOWER:UPPER"),
]
Start = Annotated[
    list[str] | None,
    _about_parameters("Starting value of a parameter; may be repeated.", "NAME=VALUE"),
]


def processing_options(
    *,
    band_hz: Annotated[
        tuple[float, float] | None,
        option(
            "Band in Hz. Default: where coherence is good; for a tyre 20 to 300 at most.",
            PROCESSING,
            "FROM TO",
        ),
    ] = None,
    averages: Annotated[
        int | None, option("Averages; sets the block length.", PROCESSING, "N", min=1)
    ] = None,
    block_seconds: Annotated[
        float | None,
        option(
            "Block length in s. Default: 4, or a quarter of a shorter recording.", PROCESSING, "S"
        ),
    ] = None,
    window: Annotated[
        str | None,
        one_of(WINDOWS, "hann, rectangular, or any window of scipy. Default: hann.", PROCESSING),
    ] = None,
    overlap: Annotated[
        str | None,
        option(
            "Overlap as a share or in percent: 0.5, 50 or 50%. Default: 0.5; rectangular 0.",
            PROCESSING,
            "SHARE",
        ),
    ] = None,
    estimator: Annotated[
        str, one_of(ESTIMATORS, "FRF estimator: H1, H2 or Hv.", PROCESSING)
    ] = "H1",
    max_order: Annotated[
        int, option("Highest model order of the poles.", POLES, "N", min=4, max=200)
    ] = 60,
    method: Annotated[
        str, one_of(METHODS, "lsce or plscf; the other is the cross-check.", POLES)
    ] = "lsce",
    pin: Annotated[
        list[str] | None,
        option("Take only modes at these frequencies in Hz; repeatable.", POLES, _HZ),
    ] = None,
    exclude: Annotated[
        list[str] | None,
        option("Leave out modes at these frequencies in Hz; repeatable.", POLES, _HZ),
    ] = None,
    objective: Objective = "frequency",
    given: Given = None,
    pressure_load: TuningLoad = None,
    prior: Prior = None,
    bounds: Bounds = None,
    start: Start = None,
    no_tune: Annotated[
        bool, flag("--no-tune", "Stop at the modes: no ring parameters.", RING)
    ] = False,
    strict: Strict = False,
) -> Options:
    """Options for the processing of a campaign, from the command line."""
    return Options(
        processing=Processing(
            averages, block_seconds, window, None if overlap is None else _overlap(overlap), band_hz
        ),
        estimator=choice("--estimator", estimator, ESTIMATORS),
        max_order=max_order,
        pinned_hz=numbers("--pin", pin),
        excluded_hz=numbers("--exclude", exclude),
        method=choice("--method", method, METHODS),
        tune=not no_tune,
        objective=choice("--objective", objective, OBJECTIVES),
        given=ring_parameters("--given", given),
        tuning=tuning_table(pressure_load, prior, bounds, start),
        strict=strict,
    )


def _overlap(text: str) -> float:
    """Overlap as a share; above 95 % blocks hardly differ and take for ever."""
    share = overlap_share(text)
    if share > MOST_OVERLAP:
        rule = f"at most {100 * MOST_OVERLAP:g} % is accepted"
        raise InputError("--overlap", text, rule, "Use less")
    return share


def sharing(
    name: str, made: Callable[..., Any], command: Callable[..., None]
) -> Callable[..., Any]:
    """Replace the parameter `name` of a command by those of `made`, which gives its value."""
    shared = inspect.signature(made, eval_str=True).parameters
    own = inspect.signature(command, eval_str=True).parameters

    @wraps(command)
    def taking(**values: Any) -> None:
        value = made(**{each: values.pop(each) for each in shared})
        command(**values, **{name: value})

    parameters = [
        each.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for each in (*own.values(), *shared.values())
        if each.name != name
    ]
    taking.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    taking.__annotations__ = {each.name: each.annotation for each in parameters}
    return taking


with_processing_options = partial(sharing, "options", processing_options)


Library = Annotated[Path | None, option("Folder of the library.", LIBRARY, "DIR", envvar=VARIABLE)]
Name = Annotated[str, argument("NAME", "Tyre: its name in `tyre list`, or its designation.")]
Reference = Annotated[
    str,
    argument("NAME[@VERSION]", "E.g. 225-55R17@3. Default: the approved version, or the newest."),
]
AnySet = argument("SET", "NAME@VERSION, a result folder or a tyre.toml.")
Note = Annotated[str, option("Reason; stored with it.", LIBRARY, "TEXT")]
Author = Annotated[str, option("Default: your login name.", LIBRARY, "NAME")]


def choice(option: str, value: str, known: Sequence[str]) -> str:
    """The known value, in whatever case it was typed."""
    for each in known:
        if each.casefold() == value.casefold():
            return each
    raise unknown(option, value, f"it must be one of {', '.join(known)}", known)


def numbers(option: str, texts: Sequence[str] | None) -> tuple[float, ...]:
    """Numbers of a comma-separated option that may be repeated."""
    text = ",".join(texts or ())
    try:
        return tuple(float(part) for part in text.split(",") if part.strip())
    except ValueError as error:
        rule = "it must be numbers separated by commas"
        raise InputError(option, repr(text), rule, "Write e.g. 78.7,100.3") from error


def numbers_of(option: str, texts: Iterable[str], example: str) -> dict[str, float]:
    """Numbers of repeated ``NAME=VALUE`` texts; `InputError` if one is malformed."""
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = nan
        if not isfinite(number):
            rule = "it must be NAME=NUMBER, in the unit that the name ends with"
            raise InputError(option, repr(text), rule, f"Write e.g. {example}")
        found[name.strip()] = number
    return found


def ring_parameters(option: str, texts: Sequence[str] | None) -> dict[str, float]:
    """Values of a repeated NAME=VALUE option, by the names of ring parameters."""
    given = numbers_of(option, texts or (), "mass_per_area_kg_m2=19.7")
    return {choice(option, name, PARAMETERS): number for name, number in given.items()}


def tuning_table(
    pressure_load: str | None,
    prior: Sequence[str] | None,
    bounds: Sequence[str] | None,
    start: Sequence[str] | None,
) -> dict[str, Any]:
    """Choices of a tuning as in a manifest's ``[tuning]``."""
    table: dict[str, Any] = {}
    if pressure_load is not None:
        loads = get_args(PressureLoad)
        table["pressure_load"] = choice("--pressure-load", pressure_load, loads)
    for name, texts, keys, example in (
        ("--prior", prior, ("value", "std"), "radial_growth_m=0.0009:0.0002"),
        ("--bounds", bounds, ("lower", "upper"), "bending_stiffness_n_m=2:20"),
        ("--start", start, ("start",), "radial_stiffness_n_m3=8e6"),
    ):
        for text in texts or ():
            parameter, _, values = text.partition("=")
            known = choice(name, parameter.strip(), (*PARAMETERS, RADIAL_GROWTH))
            try:
                found = [float(part) for part in values.split(":")]
            except ValueError:
                found = []
            if len(found) != len(keys) or not all(0 <= each < np.inf for each in found):
                rule = f"it must be NAME={':'.join(keys).upper()} with numbers ≥ 0"
                raise InputError(name, repr(text), rule, f"Write e.g. {example}")
            table[known] = table.get(known, {}) | dict(zip(keys, found, strict=True))
    return table


def values_of(option: str, text: str, most: int = MOST_VALUES) -> NDArray[np.float64]:
    """Numbers from ``A``, ``A,B,C``, ``START:STOP`` or ``START:STOP:STEP``; at most `most`.

    A range has a step of 1 unless it gives one, and includes its end where a whole number of steps
    leads there.
    """
    try:
        parts = [float(part) for part in text.replace(":", ",").split(",")]
    except ValueError:
        parts = []
    is_range = ":" in text
    if not (parts and np.all(np.isfinite(parts))) or (is_range and ("," in text or len(parts) > 3)):
        rule = "it must be numbers separated by commas, or START:STOP:STEP"
        raise InputError(option, repr(text), rule, "Write e.g. 67.3, or 1,2,5, or 0:100:0.5")
    if not is_range:
        return np.array(parts)
    start, stop, step = (*parts, 1.0)[:3]
    if not (step > 0 and stop >= start):
        rule = "the step must be > 0 and the end must not be below the start"
        raise InputError(option, repr(text), rule, "Write e.g. 0:100:0.5")
    steps = (stop - start) / step
    if not steps < most:
        found, remedy = f"{text!r}, {steps:.3g} values", "Use a larger step or a narrower range"
        raise InputError(option, found, f"at most {most} values are accepted", remedy)
    return np.asarray(np.round(start + step * np.arange(int(steps + 1e-6) + 1), 12))


def orders_of(option: str, text: str) -> NDArray[np.int_]:
    """Whole numbers in the same notation."""
    values = values_of(option, text, MOST_ORDERS)
    whole = np.rint(values)
    if np.any(whole != values):
        rule = "circumferential orders must be whole numbers"
        raise InputError(option, repr(text), rule, "Write e.g. 1:7")
    return whole.astype(int)
