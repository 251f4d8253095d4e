"""What the command line prints about the content of recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from pipelines.cli.terminal import Column, print_json, print_table, printable, screen

if TYPE_CHECKING:
    from rich.console import Console

    from ema.core.finding import Finding
    from ema.core.frf import FRF
    from ema.signals.signal_checks import SignalSummary
    from pipelines.prepare.inspection import ChannelReport, FileReport, Inspection

_SHOWN_NAMES = 6
_LEGEND = "Levels in m/s^2, N, m/s, m or V; rms and crest factor are about the mean (DC)."


def show_inspection(inspection: Inspection, *, as_json: bool) -> None:
    """Print what is in recordings and what looks wrong, file by file."""
    if as_json:
        print_json([row for report in inspection.files for row in _rows(report)])
        return
    output = screen()
    for report in inspection.files:
        _say(output, _heading(report))
        if report.channels:
            print_table(output, "", _channel_columns(report.channels), _FIRST_TO_GO)
        if report.frf is not None:
            print_table(output, "", _frf_columns(report.frf, report.frf_names))
        for line in _lines("Looks wrong", report.wrong) + _lines("Note", report.notes):
            _say(output, line)
        _say(output, "")
    if any(row.signal for report in inspection.files for row in report.channels):
        _say(output, _LEGEND)


def _say(output: Console, text: str) -> None:
    output.print(printable(text), markup=False, highlight=False, soft_wrap=True)


def _heading(report: FileReport) -> str:
    kind = report.path.name.removesuffix(".gz").rpartition(".")[2].upper()
    parts = [f"{kind}, {_size(report.size_bytes)}"]
    if report.channels:
        n_samples = report.channels[0].channel.n_samples
        rate_hz = report.sampling_rate_hz
        parts.append(f"{_count(len(report.channels), 'channel')} of {n_samples} samples")
        if rate_hz > 0:
            parts[-1] += f" at {rate_hz:.10g} Hz, {n_samples / rate_hz:.6g} s"
    if report.frf is not None:
        lines_hz = report.frf.frequency_hz
        parts.append(
            f"{_count(report.frf.n_positions, 'FRF')} of {lines_hz.size} lines, "
            f"{lines_hz[0]:.4g} to {lines_hz[-1]:.4g} Hz"
        )
    if len(parts) == 1:
        parts.append("neither time series nor FRFs")
    return f"{report.path}: {'; '.join(parts)}"


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def _size(n_bytes: int) -> str:
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if n_bytes >= size:
            return f"{n_bytes / size:.3g} {unit}"
    return f"{n_bytes} bytes"


def _of_signal(tell: Callable[[SignalSummary], str]) -> Callable[[ChannelReport], str]:
    return lambda row: "" if row.signal is None else tell(row.signal)


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.4g}"


def _crest(signal: SignalSummary) -> str:
    return "" if math.isnan(signal.crest_factor) else f"{signal.crest_factor:.1f}"


def _share(value: float) -> str:
    return f"{100 * value:.2g} %" if value else ""


def _hum(signal: SignalSummary) -> str:
    if signal.hum is None:
        return ""
    return f"{signal.hum.frequency_hz:g} Hz {_share(signal.hum.rms / signal.rms_ac)}"


def _node(node: int | None) -> str:
    return "" if node is None or node < 0 else str(node)


def _angle(angle_deg: float | None) -> str:
    return "" if angle_deg is None or math.isnan(angle_deg) else f"{angle_deg:.4g}°"


_CHANNEL_COLUMNS: dict[str, Callable[[ChannelReport], str]] = {
    "channel": lambda row: row.channel.name,
    "quantity": lambda row: row.channel.quantity,
    "unit in\nthe file": lambda row: row.channel.unit,
    "node": lambda row: _node(row.channel.node),
    "angle": lambda row: _angle(row.channel.angle_deg),
    "rms\n(SI)": _of_signal(lambda signal: _number(signal.rms_ac)),
    "peak\n(SI)": _of_signal(lambda signal: _number(signal.peak)),
    "crest": _of_signal(_crest),
    "DC\n(SI)": _of_signal(lambda signal: _number(signal.mean)),
    "clipped": _of_signal(lambda signal: _share(signal.clipped_share)),
    "hum": _of_signal(_hum),
    "missing": _of_signal(lambda signal: str(signal.n_missing or "")),
}
_NAMES = ("channel", "FRF")  # take several lines where they are long
_TEXTS = (*_NAMES, "quantity", "unit in\nthe file")
# On a narrow screen; the unit tells the quantity.
_FIRST_TO_GO = ("quantity", "crest", "peak\n(SI)", "DC\n(SI)", "clipped", "angle", "hum")


def _channel_columns(rows: Sequence[ChannelReport]) -> list[Column]:
    columns = {heading: [tell(row) for row in rows] for heading, tell in _CHANNEL_COLUMNS.items()}
    if not any(row.channel.node for row in rows):  # node 0 everywhere: they are not numbered
        del columns["node"]
    return _columns(columns)


def _frf_columns(frf: FRF, names: Sequence[str]) -> list[Column]:
    return _columns(
        {
            "FRF": list(names),
            "node": [_node(int(node)) for node in frf.node],
            "angle": [_angle(float(angle)) for angle in frf.position_deg],
        }
    )


def _columns(columns: dict[str, list[str]]) -> list[Column]:
    return [
        Column(heading, cells, is_text=heading in _TEXTS, folds=heading in _NAMES)
        for heading, cells in columns.items()
    ]


def _lines(title: str, findings: Sequence[Finding]) -> list[str]:
    """Findings as lines; what is said of several channels is said once."""
    channels: dict[tuple[str, str], list[str]] = {}
    for finding in findings:
        said_of = channels.setdefault((finding.check, finding.detail), [])
        if finding.channel:
            said_of.append(finding.channel)
    lines = []
    for (check, detail), names in channels.items():
        more = f" and {len(names) - _SHOWN_NAMES} more" if len(names) > _SHOWN_NAMES else ""
        where = f"{', '.join(names[:_SHOWN_NAMES])}{more}: " if names else ""
        lines.append(f"{title}: {where}{check}: {detail}")
    return lines


def _rows(report: FileReport) -> list[dict[str, Any]]:
    """Rows of ``--json``: channels and FRFs, and the file itself where something is to be said."""
    file = {"file": report.path.name, "path": str(report.path)}
    rows = [file | _channel_row(row, report.sampling_rate_hz) for row in report.channels]
    rows += [file | row for row in _frf_rows(report)]
    if report.findings or not rows:
        about = {"kind": "file", "channel": None, "size_bytes": report.size_bytes}
        rows.append(file | about | {"findings": _as_json(report.findings)})
    return rows


def _channel_row(row: ChannelReport, rate_hz: float) -> dict[str, Any]:
    channel, signal = row.channel, row.signal
    content = {
        "kind": "time series",
        "channel": channel.name,
        "node": channel.node,
        "angle_deg": channel.angle_deg,
        "quantity": channel.quantity,
        "unit": channel.unit,
        "sampling_rate_hz": rate_hz,
        "n_samples": channel.n_samples,
    }
    if signal is not None:
        content |= {
            "rms": signal.rms,
            "rms_ac": signal.rms_ac,
            "peak": signal.peak,
            "crest_factor": signal.crest_factor,
            "mean": signal.mean,
            "lowest": signal.lowest,
            "highest": signal.highest,
            "clipped_share": signal.clipped_share,
            "n_missing": signal.n_missing,
            "first_missing": signal.first_missing,
            "longest_hold": signal.longest_hold,
            "hum_hz": None if signal.hum is None else signal.hum.frequency_hz,
            "hum_rms": None if signal.hum is None else signal.hum.rms,
        }
    return content | {"findings": _as_json(row.findings)}


def _frf_rows(report: FileReport) -> list[dict[str, Any]]:
    frf = report.frf
    if frf is None:
        return []
    return [
        {
            "kind": "FRF",
            "channel": name,
            "node": None if node < 0 else int(node),
            "angle_deg": None if math.isnan(angle) else float(angle),
            "quantity": "inertance",
            "unit": "(m/s^2)/N",
            "n_lines": frf.frequency_hz.size,
            "lowest_hz": frf.frequency_hz[0],
            "highest_hz": frf.frequency_hz[-1],
            "findings": [],
        }
        for name, node, angle in zip(report.frf_names, frf.node, frf.position_deg, strict=True)
    ]


def _as_json(findings: Sequence[Finding]) -> list[dict[str, str]]:
    return [
        {"check": each.check, "verdict": each.verdict, "detail": each.detail} for each in findings
    ]
