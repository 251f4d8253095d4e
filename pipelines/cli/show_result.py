"""What the command line says of a result."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipelines.cli.terminal import Column, print_json, print_table, printable, say, screen
from pipelines.report.save import PDF
from pipelines.storage.rounding import jsonable, value_with_std
from pipelines.storage.tables import plain_rows

if TYPE_CHECKING:
    from rich.console import Console

    from pipelines.results.result import Result

REPORT = "report.html"
_FIRST_TO_GO = ("purity", "mode")  # modes.csv has them


def show(result: Result, folder: Path, *, as_json: bool, report: bool) -> None:
    """Print the modes and where everything is; warnings go to standard error."""
    if as_json:
        print_json(summary(result, folder, report=report))
        return
    # Not for the help, which has to be there at once.
    from rich.text import Text

    output, errors = screen(), screen(errors=True)
    _show_modes(output, result)
    if result.tuning is not None:
        _show_ring(output, result)
    for text in warnings(result):
        errors.print(Text(printable(f"Warning: {text}"), style="yellow"))
    for note in result.notes:
        errors.print(Text(printable(f"Note: {note}")))
    say(f"Result: {folder}")
    if report:
        say(f"Report: {folder / REPORT}")
    if (folder / PDF).is_file():
        say(f"PDF: {folder / PDF}")


def warnings(result: Result) -> list[str]:
    """Findings that are not in order, one line for each check that found any."""
    by_check: dict[str, list[str]] = {}
    for finding in result.findings:
        if finding.verdict != "ok":
            place = (finding.run, finding.channel if finding.channel != finding.check else "")
            where = " ".join(part for part in place if part)
            text = f"{where}: {finding.detail}" if where else finding.detail
            by_check.setdefault(finding.check, []).append(text)
    return [
        f"{check}: {found[-1]}"
        + (f" (and {len(found) - 1} more, see quality.csv)" if len(found) > 1 else "")
        for check, found in by_check.items()
    ]


def summary(result: Result, folder: Path, *, report: bool) -> dict[str, Any]:
    """Content of ``--json``: modes, ring, warnings, and where the report is, if there is one."""
    table = result.modal_model.to_frame()
    modes = [dict(zip(table.columns, row, strict=True)) for row in plain_rows(table)]
    ring: dict[str, Any] = {}
    if result.tuning is not None:
        for name, how in result.tuning.how.items():
            value = getattr(result.tuning.ring, name)
            ring[name] = {"value": value, "how": how, "std": result.tuning.std.get(name)}
    content: dict[str, Any] = jsonable(
        {
            "result": str(folder),
            "report": str(folder / REPORT) if report else None,
            "pdf": str(folder / PDF) if (folder / PDF).is_file() else None,
            "modes": modes,
            "ring": ring,
            "warnings": [f.detail for f in result.findings if f.verdict != "ok"],
            "notes": list(result.notes),
        }
    )
    return content


def _show_modes(output: Console, result: Result) -> None:

    modes = result.modal_model.modes
    columns = [
        Column("mode", [str(number) for number in range(1, len(modes) + 1)]),
        Column("order", ["" if m.order is None else f"{m.order}{m.member}" for m in modes]),
        Column(
            "frequency / Hz", [value_with_std(m.frequency_hz, m.frequency_std_hz) for m in modes]
        ),
        Column(
            "damping / %",
            [value_with_std(100 * m.damping_ratio, 100 * m.damping_std) for m in modes],
        ),
        Column("purity", ["" if m.order is None else f"{m.order_purity:.3f}" for m in modes]),
        Column("pair", [m.pair.value for m in modes], is_text=True, folds=True),
        Column("status", [m.status for m in modes], is_text=True, folds=True),
    ]
    print_table(output, f"Modes of {result.name}", columns, _FIRST_TO_GO)


def _show_ring(output: Console, result: Result) -> None:

    assert result.tuning is not None
    tuning = result.tuning
    values = [
        value_with_std(getattr(tuning.ring, name), tuning.std.get(name)) for name in tuning.how
    ]
    columns = [
        Column("parameter", list(tuning.how), is_text=True),
        Column("value", values),
        Column("obtained", list(tuning.how.values()), is_text=True, folds=True),
    ]
    print_table(output, "Ring", columns, least_width=len("identified"))
