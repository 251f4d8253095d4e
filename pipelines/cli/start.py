"""First steps: ``demo``, ``inspect`` with its tables, ``init``."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from rich import filesize

from ema.core.display import counted
from ema.core.finding import Check, Finding
from ema.core.frf import FRF
from ema.signals.signal_checks import SignalSummary
from pipelines.cli import options as opt
from pipelines.cli.result import show
from pipelines.cli.screen import print_table
from pipelines.cli.streams import reporting_outcome
from pipelines.cli.terminal import echo, echo_error, print_json
from pipelines.prepare.inspection import (
    ChannelReport,
    FileReport,
    Inspection,
    Layout,
    inspect_files,
)
from pipelines.prepare.manifest_template import draft_manifest, write_draft
from pipelines.process.run import process
from pipelines.report.page import read_template
from pipelines.report.write import save
from pipelines.simulate.campaign import sample_campaign
from pipelines.storage.atomic import named

PLACES = "Sensor positions"
_SHOWN_NAMES = 6  # channels that one message lists
_MOST_DETAILS = 2  # of one kind of finding that are told one by one

# On a narrow screen; the unit tells the quantity.
_FIRST_TO_GO = ("quantity", "crest", "peak\n(SI)", "DC\n(SI)", "clipped", "angle", "hum")


def demo(
    out: Annotated[Path, opt.option("Folder to write.", metavar="DIR")] = Path("demo"),
    units: opt.UnitSystem = None,
    as_json: opt.Json = False,
    quiet: opt.Quiet = False,
    verbose: opt.Verbose = False,
) -> None:
    """Process the sample campaign and write its report.

    Example:
      ringmodal demo --out demo
    """
    looks, folder = read_template(None, units), out / "result"
    with reporting_outcome(folder):
        # From the project's folder; where that is missing, it is written first.
        result = process(sample_campaign(out / "campaign"))
        save(result, folder, force=True, template=looks)
    told: dict[str, Any] = {"as_json": as_json, "quiet": quiet, "units": looks.units}
    show(result, folder, report=True, **told)


def inspect(
    files: Annotated[
        list[Path], opt.argument("FILE…", "Recordings, folders of recordings, or a campaign.toml.")
    ],
    headers: Annotated[bool, opt.flag("--headers", "Read headers only.")] = False,
    strict: Annotated[bool, opt.flag("--strict", "Exit code 2 if anything looks wrong.")] = False,
    as_json: opt.Json = False,
) -> None:
    """Show channels, units, rates, lengths and levels of recordings, and what looks wrong.

    Examples:
      ringmodal inspect measurements/tyre_7
      ringmodal inspect config_1.uff config_2.uff --headers
    """  # noqa: D406, D407 - a heading of the help
    inspection = inspect_files(files, levels=not headers)
    if inspection.files:
        show_inspection(inspection, as_json=as_json)
    for error in inspection.errors:
        echo_error(f"Error: {error}")
    if inspection.errors or (strict and inspection.looks_wrong):
        raise typer.Exit(2)


def init(
    folder: Annotated[Path, opt.argument("FOLDER", "Folder with recordings.")],
    spacing_deg: Annotated[
        float | None,
        opt.option(
            "Evenly spaced sensors: degrees from one to the next, in the order of their channels. "
            "The first one of the first run is at 0.",
            PLACES,
            "DEG",
        ),
    ] = None,
    step_deg: Annotated[
        float, opt.option("Degrees that the sensors move from run to run.", PLACES, "DEG")
    ] = 0.0,
    reference: Annotated[
        str | None,
        opt.option("Sensor that stays in place. Default: REF or similar.", PLACES, "CHANNEL"),
    ] = None,
    force: Annotated[bool, opt.replacing("an existing manifest")] = False,
    as_json: opt.Json = False,
) -> None:
    """Write a campaign.toml template from the recordings in a folder, and list what to fill in.

    Examples:
      ringmodal init measurements/tyre_7
      ringmodal init measurements/tyre_7 --spacing-deg 30 --step-deg 5 --reference A13
    """  # noqa: D406, D407 - a heading of the help
    if step_deg and spacing_deg is None:
        raise typer.BadParameter("--step-deg requires --spacing-deg. Use both.")
    layout = None if spacing_deg is None else Layout(spacing_deg, step_deg)
    draft = draft_manifest(folder, layout=layout, reference=reference)
    for text in draft.left_out:
        echo_error(f"Left out: {text}")
    path = write_draft(folder, draft, force=force)
    if as_json:
        print_json({"draft": str(path), "to_fill_in": draft.missing, "left_out": draft.left_out})
        return
    echo(f"Template: {path}")
    for text in draft.missing:
        echo(f"To fill in: {text}")
    echo(f"Next: check {path}, then ringmodal process {folder} --out result")


_MOST_FRFS, _FIRST_FRFS = 20, 6  # FRFs that are listed, and how many of them where there are more


def show_inspection(inspection: Inspection, *, as_json: bool) -> None:
    """Print what is in recordings and what looks wrong, file by file."""
    if as_json:
        print_json([row for report in inspection.files for row in _rows(report)])
        return
    for report in inspection.files:
        echo(_heading(report))
        if report.channels:
            _print_channels(report.channels)
        if report.frf is not None:
            _print_frfs(report.frf, report.frf_names)
        for line in _lines("Looks wrong", report.wrong) + _lines("Note", report.notes):
            echo(line)
        echo("")
    if any(row.signal for report in inspection.files for row in report.channels):
        echo("Levels in m/s^2, N, m/s, m or V; rms and crest factor are about the mean (DC).")
    echo(f"Verdict: {_verdict(inspection)}")


def _verdict(inspection: Inspection) -> str:
    """What to do next."""
    files, unread = inspection.files, len(inspection.errors)
    if unread:
        return f"{counted(unread, 'file')} of {len(files) + unread} cannot be read."
    wrong = sum(len(_by_check(report.wrong)) for report in files)
    if wrong:
        return f"readable; look at {counted(wrong, 'finding')} above before you process."
    kinds = {each.check for report in files for each in report.notes}
    if kinds & {Check.UNIT, Check.SAMPLING_RATE}:
        return "readable; a manifest can add what the notes name (ringmodal init FOLDER)."
    return "nothing looks wrong."


def _heading(report: FileReport) -> str:
    kind = report.path.name.removesuffix(".gz").rpartition(".")[2].upper()
    parts = [f"{kind}, {filesize.decimal(report.size_bytes)}"]
    if report.channels:
        n_samples, rate_hz = report.channels[0].channel.n_samples, report.sampling_rate_hz
        parts.append(f"{counted(len(report.channels), 'channel')} of {n_samples} samples")
        if rate_hz > 0:
            parts[-1] += f" at {rate_hz:.10g} Hz, {n_samples / rate_hz:.6g} s"
    if report.frf is not None:
        lines_hz, frfs = report.frf.frequency_hz, counted(report.frf.n_positions, "FRF")
        band = f"{lines_hz[0]:.4g} to {lines_hz[-1]:.4g} Hz"
        parts.append(f"{frfs} of {lines_hz.size} lines, {band}")
    if len(parts) == 1:
        parts.append("neither time series nor FRFs")
    return f"{report.path}: {'; '.join(parts)}"


def _number(value: float, form: str = ".4g") -> str:
    return "" if math.isnan(value) else f"{value:{form}}"


def _share(value: float) -> str:
    return f"{100 * value:.2g} %" if value else ""


def _node(node: int | None) -> str:
    return "" if node is None or node < 0 else str(node)


def _angle(angle_deg: float | None) -> str:
    return "" if angle_deg is None or math.isnan(angle_deg) else f"{angle_deg:.4g}°"


def _hum(signal: SignalSummary) -> str:
    if signal.hum is None:
        return ""
    return f"{signal.hum.frequency_hz:g} Hz {_share(signal.hum.rms / signal.rms_ac)}"


_LEVELS: dict[str, Callable[[SignalSummary], str]] = {
    "rms\n(SI)": lambda signal: _number(signal.rms_ac),
    "peak\n(SI)": lambda signal: _number(signal.peak),
    "crest": lambda signal: _number(signal.crest_factor, ".1f"),
    "DC\n(SI)": lambda signal: _number(signal.mean),
    "clipped": lambda signal: _share(signal.clipped_share),
    "hum": _hum,
    "missing": lambda signal: str(signal.n_missing or ""),
}


def _print_channels(rows: Sequence[ChannelReport]) -> None:
    numbered = any(row.channel.node for row in rows)  # node 0 everywhere: not numbered
    cells = []
    for row in rows:
        channel, signal = row.channel, row.signal
        place = _node(channel.node) if numbered else "", _angle(channel.angle_deg)
        levels = ("" if signal is None else tell(signal) for tell in _LEVELS.values())
        cells.append((channel.name, channel.quantity, channel.unit, *place, *levels))
    texts = ("channel", "quantity", "unit in\nthe file")
    head = (*texts, "node", "angle", *_LEVELS)
    print_table("", head, cells, texts=texts, folding=texts[:1], first_to_go=_FIRST_TO_GO)


def _print_frfs(frf: FRF, names: Sequence[str]) -> None:
    places = zip(names, frf.node, frf.position_deg, strict=True)
    cells = [(name, _node(int(node)), _angle(float(angle))) for name, node, angle in places]
    shown = cells if len(cells) <= _MOST_FRFS else cells[:_FIRST_FRFS]
    print_table("", ("FRF", "node", "angle"), shown, texts=("FRF",), folding=("FRF",))
    if len(shown) < len(cells):
        echo(f"and {len(cells) - len(shown)} more, to {cells[-1][0]}")


def _by_check(findings: Sequence[Finding]) -> dict[str, list[Finding]]:
    found: dict[str, list[Finding]] = {}
    for finding in findings:
        found.setdefault(finding.check, []).append(finding)
    return found


def _lines(title: str, findings: Sequence[Finding]) -> list[str]:
    """One line for each kind of finding: its first detail, and the channels that it concerns."""
    lines = []
    for check, alike in _by_check(findings).items():
        details = list(dict.fromkeys(each.detail for each in alike))
        names = list(dict.fromkeys(each.channel for each in alike if each.channel))
        if len(details) > _MOST_DETAILS:
            details = [f"{details[0]} (and {len(details) - 1} more like it: --json)"]
        for detail in details:
            about = [each.channel for each in alike if each.detail == detail and each.channel]
            where = f"{named(list(dict.fromkeys(about or names)), _SHOWN_NAMES)}: " if names else ""
            lines.append(f"{title}: {where}{check}: {detail}")
    return lines


def _rows(report: FileReport) -> list[dict[str, Any]]:
    """Rows of ``--json``: channels and FRFs, and the file itself where it has findings."""
    file = {"file": report.path.name, "path": str(report.path)}
    rows = [file | _channel_row(row, report.sampling_rate_hz) for row in report.channels]
    rows += [file | row for row in _frf_rows(report)]
    if report.findings or not rows:
        about = {"kind": "file", "channel": None, "size_bytes": report.size_bytes}
        rows.append(file | about | {"findings": _as_json(report.findings)})
    return rows


def _channel_row(row: ChannelReport, rate_hz: float) -> dict[str, Any]:
    channel, signal = row.channel, row.signal
    content: dict[str, Any] = {"kind": "time series", "channel": channel.name}
    content |= {name: getattr(channel, name) for name in ("node", "angle_deg", "quantity", "unit")}
    content |= {"sampling_rate_hz": rate_hz, "n_samples": channel.n_samples}
    if signal is not None:
        names = (
            *("rms", "rms_ac", "peak", "crest_factor", "mean", "lowest", "highest"),
            *("clipped_share", "n_missing", "first_missing", "longest_hold"),
        )
        content |= {name: getattr(signal, name) for name in names}
        hum = signal.hum
        content |= {"hum_hz": hum and hum.frequency_hz, "hum_rms": hum and hum.rms}
    return content | {"findings": _as_json(row.findings)}


def _frf_rows(report: FileReport) -> list[dict[str, Any]]:
    frf = report.frf
    if frf is None:
        return []
    about = {"quantity": "inertance", "unit": "(m/s^2)/N", "n_lines": frf.frequency_hz.size}
    about |= {"lowest_hz": frf.frequency_hz[0], "highest_hz": frf.frequency_hz[-1], "findings": []}
    places = zip(report.frf_names, frf.node, frf.position_deg, strict=True)
    return [
        {"kind": "FRF", "channel": name, "node": None if node < 0 else node, "angle_deg": angle}
        | about
        for name, node, angle in places
    ]


def _as_json(findings: Sequence[Finding]) -> list[dict[str, str]]:
    names = ("check", "verdict", "detail")
    return [{name: getattr(each, name) for name in names} for each in findings]
