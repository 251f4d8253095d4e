"""What the command line reads and prints."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from ema.errors import InputError

if TYPE_CHECKING:
    from pipelines.result import Result


def numbers(option: str, text: str | None) -> tuple[float, ...]:
    """Numbers of a comma-separated option."""
    if text is None:
        return ()
    try:
        return tuple(float(part) for part in text.split(",") if part.strip())
    except ValueError as error:
        raise InputError(
            option, repr(text), "it must be numbers separated by commas", "Write e.g. 78.7,100.3"
        ) from error


def assignments(option: str, texts: list[str] | None) -> dict[str, float]:
    """Values of a repeated NAME=VALUE option."""
    values = {}
    for text in texts or []:
        name, _, value = text.partition("=")
        try:
            values[name.strip()] = float(value)
        except ValueError as error:
            raise InputError(
                option, repr(text), "it must be NAME=NUMBER", "Write e.g. mass_per_area_kg_m2=19.7"
            ) from error
    return values


def complain(message: str) -> None:
    """Print one message on standard error."""
    print(printable(message), file=sys.stderr)  # noqa: T201


def printable(text: str) -> str:
    """A text from a file as a terminal may show it: in one line, without control sequences."""
    return "".join(
        sign if sign.isprintable() else " " if sign.isspace() else "\ufffd" for sign in text
    )


def file_trouble(error: OSError) -> str:
    """Message for a file that cannot be read or written any more."""
    return (
        f"Error: {error.filename}: {error.strerror}; it could be neither read nor written. "
        "Check that the drive is there and what it permits."
    )


def out_of_memory(error: MemoryError) -> str:
    """Message for recordings that are too large for the machine."""
    detail = f" ({error})" if str(error) else ""
    return (
        f"Error: not enough memory{detail}. "
        "Close other programs, take shorter blocks or a narrower band, or use a larger machine."
    )


def report_fault(
    kind: type[BaseException], fault: BaseException, _: TracebackType | None = None
) -> None:
    """Say in one line that the program is at fault; Python ends it with exit code 1."""
    complain(
        f"Fault of the program: {kind.__name__}: {fault}. Please report it "
        "with the command and this line; `ringmodal --debug …` or RINGMODAL_DEBUG=1 shows where."
    )


def tuned_again(
    folder: Path,
    objective: str | None = None,
    given: dict[str, float] | None = None,
    *,
    strict: bool = False,
) -> Result:
    """Load a result and determine its ring again; what is not chosen stays as it was."""
    from pipelines.options import Options
    from pipelines.process import tune
    from pipelines.store import load
    from pipelines.strict import refuse_warnings

    result = load(folder)
    if strict:
        refuse_warnings(result.findings)
    earlier = result.provenance.get("options", {})
    try:
        options = Options(
            tune=True if objective is not None else earlier["tune"],
            objective=objective or earlier["objective"],
            given=earlier["given"] if given is None else given,
        )
    except (KeyError, TypeError) as error:
        place = f"{folder}, provenance.json, options"
        rule = "the options of the earlier run are needed"
        raise InputError(place, f"no {error}", rule, "Process it again") from error
    chosen = {"tune": options.tune, "objective": options.objective, "given": options.given}
    again = tune(result, options)
    return replace(again, provenance={**result.provenance, "options": {**earlier, **chosen}})


def show(result: Result, folder: Path, *, as_json: bool, report: bool) -> None:
    """Print the modes and where everything is; warnings go to standard error."""
    if as_json:
        print(json.dumps(summary(result, folder), indent=2, allow_nan=False))  # noqa: T201
        return
    from rich.console import Console
    from rich.text import Text

    output, errors = Console(), Console(stderr=True)
    output.print(_modes_table(result))
    if result.tuning is not None:
        output.print(_ring_table(result))
    for text in warnings(result):
        errors.print(Text(printable(f"Warning: {text}"), style="yellow"))
    for note in result.notes:
        errors.print(Text(printable(f"Note: {note}")))
    output.print(Text(printable(f"Result: {folder}")), soft_wrap=True)
    if report:
        output.print(Text(printable(f"Report: {folder / 'report.html'}")), soft_wrap=True)


def warnings(result: Result) -> list[str]:
    """Findings that are not in order, one line for each check that found any."""
    by_check: dict[str, list[str]] = {}
    for finding in result.findings:
        if finding.verdict != "ok":
            where = " ".join(part for part in (finding.run, finding.channel) if part)
            text = f"{where}: {finding.detail}" if where else finding.detail
            by_check.setdefault(finding.check, []).append(text)
    return [
        f"{check}: {found[-1]}"
        + (f" (and {len(found) - 1} more, see quality.csv)" if len(found) > 1 else "")
        for check, found in by_check.items()
    ]


def summary(result: Result, folder: Path) -> dict[str, Any]:
    """Content of ``--json``: modes, ring, damping, warnings."""
    from pipelines import tables

    modes = [dict(zip(tables.MODES, row, strict=True)) for row in tables.modes_rows(result)]
    ring: dict[str, Any] = {}
    if result.tuning is not None:
        for name, how in result.tuning.how.items():
            value = getattr(result.tuning.ring, name)
            ring[name] = {"value": value, "how": how, "std": result.tuning.std.get(name)}
    content: dict[str, Any] = plain(
        {
            "result": str(folder),
            "modes": modes,
            "ring": ring,
            "warnings": [f.detail for f in result.findings if f.verdict != "ok"],
            "notes": list(result.notes),
        }
    )
    return content


def empty_table(title: str) -> Any:
    """A table as the command line prints it, without columns yet."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    title_text = Text(printable(title), style="table.title")
    return Table(title=title_text, box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title_justify="left")


def _modes_table(result: Result) -> Any:
    from pipelines.numbers import value_with_std

    table = empty_table(f"Modes of {result.name}")
    for heading in ("mode", "order", "frequency in Hz", "damping in %", "purity", "status"):
        is_text = heading == "status"
        table.add_column(heading, justify="left" if is_text else "right", no_wrap=not is_text)
    for number, mode in enumerate(result.modal_model.modes, start=1):
        table.add_row(
            str(number),
            "" if mode.order is None else f"{mode.order}{mode.member}",
            value_with_std(mode.frequency_hz, mode.frequency_std_hz),
            value_with_std(100 * mode.damping_ratio, 100 * mode.damping_std),
            "" if mode.order is None else f"{mode.order_purity:.3f}",
            mode.status,
        )
    return table


def _ring_table(result: Result) -> Any:
    from pipelines.numbers import value_with_std

    table = empty_table("Ring")
    for heading in ("parameter", "value", "obtained"):
        table.add_column(heading, justify="right" if heading == "value" else "left", no_wrap=True)
    if result.tuning is None:
        return table
    for name, how in result.tuning.how.items():
        value, std = getattr(result.tuning.ring, name), result.tuning.std.get(name, float("nan"))
        table.add_row(name, value_with_std(value, std), how)
    return table


def plain(value: Any) -> Any:
    """Values as JSON has them: it knows neither NaN nor infinity, nor numpy's numbers."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
