"""Sections on what was measured: set-up and processing, data quality."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.checks.quality import ReferenceCheck
from ema.core.campaign import Tyre
from ema.core.display import DASH, number, plain, signed, value_with_std
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.modes import ModalModel
from ema.core.references import frfs_of
from pipelines.plots import measurement as plots
from pipelines.plots.chart import Chart
from pipelines.report.page import Beside, Block, Facts, Paragraph, Section, Table, Template
from pipelines.results.options import Units, quantity
from pipelines.results.result import Result
from pipelines.results.tables import KNOWN, in_band, named

FINDING_HEAD = ("run", "channel", "position", "check", "detail")
MOST_NAMED_RUNS = 12
FINDING_WORDS = (0, 1, 3, 4)
#: Keys without which a test cannot be repeated.
WANTED = ("serial", "rim", "load_n", "temperature_c", "boundary", "operator", "date")


def setup(result: Result) -> Section:
    """Positions of force and sensors, and how recordings became FRFs."""
    facts = Facts(_setup_rows(result))
    blocks: list[Block] = [facts]
    if np.isfinite(result.frf.position_deg).any():
        places = result.excitation_deg, result.reference_deg
        blocks = [Beside((plots.setup_chart(result.frf, *places), facts))]
    return Section("setup", "Set-up and processing", tuple(blocks))


def quality(result: Result) -> Section:
    """Coherence, reference sensor, drive point, drift and the findings of the checks."""
    band_hz, check = result.diagram.band_hz, result.reference
    beside = [] if check is None else [plots.reference_chart(check)]
    if (row := plots.drive_point_row(result.frf, result.excitation_deg)) is not None:
        found = (each for each in result.findings if each.check == Check.DRIVE_POINT)
        beside.append(plots.drive_point_chart(result.frf, row, band_hz, next(found, None)))
    blocks: list[Block] = [
        *_coherence(result),
        *([Beside(tuple(beside))] if beside else []),
        *_verdicts(result),
        *_drift(result.modal_model),
        *_findings(result.findings),
    ]
    return Section("quality", "Data quality", tuple(blocks))


def flatten(mapping: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Nested options as ``{"stage.option": "value"}``."""
    flat: dict[str, str] = {}
    for key, value in mapping.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{name}.")
        else:
            flat[name] = _as_text(value)
    return flat


def _as_text(value: Any) -> str:
    if value is None:
        return DASH
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return plain(value)
    if isinstance(value, list | tuple):
        return ", ".join(map(_as_text, value)) or DASH
    return str(value)


def _setup_rows(result: Result) -> tuple[tuple[str, str], ...]:
    frf = result.frf
    runs = list(dict.fromkeys(name for names in frf.run for name in names.split("+") if name))
    shown = runs
    if len(runs) > MOST_NAMED_RUNS:
        shown = [*runs[: MOST_NAMED_RUNS - 1], "…", runs[-1]]
    spacing = float(np.mean(np.diff(frf.frequency_hz)))
    low, high = result.diagram.band_hz
    lines, (first, last) = frf.frequency_hz.size, frf.frequency_hz[[0, -1]]
    forces_deg = result.excitation_deg, *(frf.excitation_deg for frf in frfs_of(result.frfs)[1:])
    rows = [
        ("Positions", f"{frf.n_positions}"),
        ("Runs", f"{len(runs)}: {', '.join(shown)}" if runs else DASH),
        ("Force", "; ".join(map(_degrees, forces_deg))),
        ("Reference sensor", _degrees(result.reference_deg)),
        ("Quantity", "inertance (acceleration over force), (m/s²)/N"),
        *_block_rows(frf),
        ("Lines", f"{lines} from {first:.6g} to {last:.6g} Hz, {spacing:.4g} Hz apart"),
        ("Band of interest", f"{low:.4g} to {high:.4g} Hz"),
    ]
    return tuple((name, text) for name, text in rows if text != DASH)


def _block_rows(frf: FRF) -> list[tuple[str, str]]:
    blocks = frf.blocks
    if blocks is None:
        return [("FRFs", "as found in the files")]
    averages = (
        f"{blocks.n_blocks} per run, of {blocks.block_s:g} s each; {blocks.window} window, overlap "
        f"{100 * blocks.overlap:g} %; equivalent to {number(frf.n_effective, 3)} independent ones"
    )
    return [("Sampling rate", f"{blocks.sampling_rate_hz:g} Hz"), ("Averages", averages)]


def _degrees(angle: float | None) -> str:
    return DASH if angle is None or np.isnan(angle) else f"at {angle:g}°"


def _coherence(result: Result) -> tuple[Chart, ...]:
    frf, band_hz = result.frf, result.diagram.band_hz
    known = np.isfinite(frf.coherence[:, in_band(frf.frequency_hz, band_hz)]).any()
    once = frf.n_effective <= 1  # where the number is unknown, the map is shown
    return () if once or not known else (plots.coherence_chart(frf, band_hz),)


def _verdicts(result: Result) -> list[Paragraph]:
    verdicts = []
    if result.frf.n_effective <= 1:
        text = "The coherence of a single average is always 1: it carries no information."
        verdicts.append(Paragraph(text))
    elif not np.isfinite(result.frf.coherence).any():
        verdicts.append(Paragraph("The coherence is unknown: the noise cannot be assessed."))
    if len(result.frf.run_names) > 1:
        judged = bool(result.modal_model.drift.run)
        verdicts.append(_reference_verdict(result.reference, judged_by_modes=judged))
    return verdicts


def _reference_verdict(check: ReferenceCheck | None, *, judged_by_modes: bool) -> Paragraph:
    if check is None:
        how = "is assessed by the modes alone" if judged_by_modes else "was not checked"
        return Paragraph(f"No reference sensor stayed in place: drift between runs {how}.")
    if not np.isfinite(check.ratio):
        text = "The noise at the reference sensor is unknown: drift between runs was not assessed."
        return Paragraph(text, "warning")
    found = (
        f"At the reference sensor the runs differ {number(check.ratio, 3)} times as much as noise "
        f"explains (1 is noise alone), by {number(100 * check.share, 2)} % of its FRF"
    )
    if check.consistent:
        return Paragraph(f"{found}: they show the same tyre.", "good")
    return Paragraph(f"{found}: the tyre or the set-up changed between runs.", "warning")


def _drift(model: ModalModel) -> tuple[Block, ...]:
    drift = model.drift
    if not drift.run:
        return ()
    low_hz, high_hz = np.min(model.frequencies_hz), np.max(model.frequencies_hz)

    def with_std(values: NDArray[np.float64], stds: NDArray[np.float64]) -> list[str]:
        pairs = zip(values.tolist(), stds.tolist(), strict=True)
        return [value_with_std(*pair, digits=2) for pair in pairs]

    columns = {
        "run": drift.run,
        f"at {low_hz:.0f} Hz / %": [signed(value, 3) for value in drift.at(low_hz)],
        f"at {drift.middle_hz:.0f} Hz / %": with_std(drift.percent, drift.std_percent),
        f"at {high_hz:.0f} Hz / %": [signed(value, 3) for value in drift.at(high_hz)],
        "damping / %": with_std(drift.damping_percent, drift.damping_std_percent),
    }
    text = "Modes are given in the state of the first run; the other runs are compared with it."
    table = Table.of_columns("Drift of frequencies and damping", columns, words=(0,))
    return (Paragraph(text), table)


def _findings(findings: tuple[Finding, ...]) -> list[Block]:
    """Tables of what was excluded, what is doubtful and what passed."""
    blocks: list[Block] = []
    for verdict, caption, none in (
        (Verdict.EXCLUDED, "Channels and runs excluded, and why", "was excluded"),
        (Verdict.WARNING, "Warnings on the data", "gave cause for a warning"),
        (Verdict.OK, "Checks passed", ""),
    ):
        rows = tuple(_finding_row(each) for each in findings if each.verdict == verdict)
        if rows:
            title, folded = f"{caption} ({len(rows)})", verdict == Verdict.OK
            blocks.append(Table(title, FINDING_HEAD, rows, FINDING_WORDS, folded))
        elif none:
            blocks.append(Paragraph(f"No channel or run {none}.", "good"))
    return blocks


def _finding_row(finding: Finding) -> tuple[str, ...]:
    angle_deg = finding.position_deg
    position = DASH if angle_deg is None else f"{angle_deg:g}°"
    return finding.run or DASH, finding.channel or DASH, position, finding.check, finding.detail


def identity(result: Result, template: Template) -> Section:
    """The tyre or structure tested and how; the introduction of the template, if any."""
    facts = Facts((*_object_rows(result, template.units), *_origin_rows(result)))
    opening = (Paragraph(template.introduction),) if template.introduction else ()
    return Section("identity", "Identity", (*opening, facts))


def _object_rows(result: Result, units: Units) -> list[tuple[str, str]]:
    tyre = result.tyre
    if tyre is None:
        return [("Object", "structure, not described as a tyre"), ("Campaign", result.name)]
    rows = [("Tyre", tyre.designation), ("Campaign", result.name)]
    if (pressure := tyre.inflation_pressure_pa) is not None:
        rows.append(("Inflation pressure", quantity(pressure, "Pa", units)))
    for name, value_m in (("Mean radius", tyre.mean_radius_m), ("Belt width", tyre.belt_width_m)):
        if value_m is not None:
            rows.append((name, quantity(value_m, "m", units)))
    order = [*(key for key in KNOWN if key in tyre.details), *tyre.details]
    return rows + [named(key, tyre.details[key]) for key in dict.fromkeys(order)]


def not_stated(tyre: Tyre | None) -> tuple[tuple[str, str], ...]:
    """What a test report should have and the manifest does not."""
    missing = [key for key in WANTED if tyre is not None and key not in tyre.details]
    names = ", ".join(named(key, "")[0].lower() for key in missing)
    keys = ", ".join(missing)
    row = ("Not stated", f"{names} (in the manifest under [tyre]: {keys})")
    return (row,) if missing else ()


def _origin_rows(result: Result) -> list[tuple[str, str]]:
    record = result.provenance
    rows = []
    if "created" in record:
        created = str(record["created"]).replace("T", " ").replace("+00:00", " UTC")
        rows.append(("Processed", created))
    if version := record.get("software", {}).get("ringmodal"):
        rows.append(("Software", f"ringmodal {version}"))
    return rows
