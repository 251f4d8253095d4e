"""How results of a measurement show themselves: one line in a terminal, a table in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ema._html import facts, number, table, value_with_std

if TYPE_CHECKING:
    from ema.frf import FRF
    from ema.identify import Identification
    from ema.modes import ModalModel, Mode
    from ema.quality import Finding
    from ema.recording import Campaign, Run
    from ema.stability import Cluster, StabilityDiagram

_OK = "ok"


def campaign_line(campaign: Campaign) -> str:
    """Name, runs and tyre."""
    tyre = "no tyre" if campaign.tyre is None else f"tyre {campaign.tyre.designation}"
    return f"<Campaign {campaign.name}: {_content(campaign)}, {tyre}>"


def campaign_html(campaign: Campaign) -> str:
    """What the lab handed over, run by run."""
    pairs = [("content", _content(campaign))]
    if campaign.tyre is not None:
        pairs += [
            ("tyre", campaign.tyre.designation),
            ("inflation pressure", _given(campaign.tyre.inflation_pressure_pa, "Pa")),
            ("mean radius", _given(campaign.tyre.mean_radius_m, "m")),
        ]
    pairs += [
        ("grid positions", "no grid" if campaign.positions is None else str(campaign.positions)),
        ("excitation at", _given(campaign.excitation_deg, "°")),
        ("reference sensor at", _given(campaign.reference_deg, "°")),
        ("mass of one sensor", _given(campaign.sensor_mass_kg, "kg")),
    ]
    runs = table(
        "Runs",
        ("run", "rate / Hz", "length / s", "force", "sensors", "reference"),
        [_run_row(run) for run in campaign.runs],
        words=(0, 3, 5),
    )
    shown = facts(f"Campaign {campaign.name}", pairs) + (runs if campaign.runs else "")
    return shown + findings_html(campaign.findings)


def frf_line(frf: FRF) -> str:
    """Positions, lines and runs."""
    return f"<FRF: {_count(frf.n_positions, 'position')}, {_lines(frf)}, {_runs(frf)}>"


def frf_html(frf: FRF) -> str:
    """Size, averages and quality."""
    return facts(
        "FRFs: inertance in (m/s²)/N",
        [
            ("positions", f"{frf.n_positions}, {_places(frf)}"),
            ("frequencies", _lines(frf)),
            ("runs", ", ".join(frf.run_names)),
            ("independent averages", _averages(frf.n_effective)),
            ("coherence γ², median", _median(frf.coherence)),
            ("reference sensor", "no" if frf.reference is None else "yes, kept apart"),
        ],
    )


def diagram_line(diagram: StabilityDiagram) -> str:
    """Band, poles and what was kept of them."""
    kept = sum(_verdict(cluster, diagram.band_hz) == "yes" for cluster in diagram.clusters)
    highest = int(diagram.model_order.max(initial=0))
    return (
        f"<StabilityDiagram: {_band(diagram.band_hz)}, {_count(diagram.poles.size, 'pole')} up to "
        f"model order {highest}, {_count(kept, 'mode')} seen>"
    )


def diagram_html(diagram: StabilityDiagram) -> str:
    """Clusters of poles, and why each was kept or dropped."""
    rows = [
        (
            _verdict(cluster, diagram.band_hz),
            f"{cluster.frequency_hz:.2f}",
            f"{100 * cluster.damping_ratio:.2f}",
            str(cluster.size),
            cluster.reason,
        )
        for cluster in sorted(diagram.clusters, key=lambda cluster: cluster.frequency_hz)
    ]
    head = ("a mode", "frequency / Hz", "damping / %", "model orders", "why")
    return table(f"Clusters of poles, {_band(diagram.band_hz)}", head, rows, words=(0, 4))


def mode_line(mode: Mode) -> str:
    """Order, frequency and damping."""
    order = "" if mode.order is None else f"order {mode.order}{mode.member}, "
    return (
        f"<Mode: {order}{value_with_std(mode.frequency_hz, mode.frequency_std_hz)} Hz, "
        f"{_damping(mode)} %, {mode.status}>"
    )


def model_line(model: ModalModel) -> str:
    """How many modes in which band."""
    return f"<ModalModel: {_count(len(model.modes), 'mode')}, {_band(model.band_hz)}>"


def model_html(model: ModalModel) -> str:
    """The table of modes."""
    return modes_html(model.modes, f"Modes, {_band(model.band_hz)}")


def modes_html(modes: Sequence[Mode], caption: str) -> str:
    """Frequency and damping with one standard deviation, mode by mode."""
    head = ("mode", "order", "frequency / Hz", "damping / %", "MPC", "purity", "status")
    rows = [
        (
            str(number_of_mode),
            "–" if mode.order is None else f"{mode.order}{mode.member}",
            value_with_std(mode.frequency_hz, mode.frequency_std_hz),
            _damping(mode),
            f"{mode.mpc:.3f}",
            number(mode.order_purity),
            mode.status,
        )
        for number_of_mode, mode in enumerate(modes, start=1)
    ]
    return table(caption, head, rows, words=(6,))


def identification_line(found: Identification) -> str:
    """Modes and doubts."""
    doubts = sum(finding.verdict != _OK for finding in found.findings)
    return (
        f"<Identification: {_count(len(found.model.modes), 'mode')}, "
        f"{_band(found.model.band_hz)}, {_count(doubts, 'warning')}>"
    )


def identification_html(found: Identification) -> str:
    """The modes, and every finding that a reader has to know."""
    return model_html(found.model) + findings_html(found.findings)


def findings_html(findings: Sequence[Finding]) -> str:
    """Findings that are not in order; nothing where all are."""
    rows = [
        (
            finding.verdict,
            finding.run,
            finding.channel,
            _given(finding.position_deg, "°"),
            finding.detail,
        )
        for finding in findings
        if finding.verdict != _OK
    ]
    head = ("verdict", "run", "channel", "position", "what was found")
    return table("Warnings", head, rows, words=(0, 1, 2, 4)) if rows else ""


def _verdict(cluster: Cluster, band_hz: tuple[float, float]) -> str:
    """Whether a cluster becomes a mode; beyond the band it guards the band's ends at most."""
    if not band_hz[0] <= cluster.frequency_hz <= band_hz[1]:
        return "beyond the band"
    return "yes" if cluster.kept else "no"


def _run_row(run: Run) -> tuple[str, ...]:
    return (
        run.name,
        number(run.recording.sampling_rate_hz),
        number(run.recording.duration_s),
        run.force.name,
        str(len(run.responses)),
        "–" if run.reference is None else run.reference.name,
    )


def _content(campaign: Campaign) -> str:
    if campaign.frf is not None:
        return f"FRFs of {_count(campaign.frf.n_positions, 'position')}"
    sensors = sum(len(run.responses) for run in campaign.runs)
    return f"{_count(len(campaign.runs), 'run')} with {_count(sensors, 'response')}"


def _lines(frf: FRF) -> str:
    lines = frf.frequency_hz
    if lines.size < 2:
        return _count(int(lines.size), "line")
    return f"{lines[0]:g} to {lines[-1]:g} Hz in steps of {lines[1] - lines[0]:.4g} Hz"


def _places(frf: FRF) -> str:
    if np.isfinite(frf.position_deg).all() and frf.n_positions:
        return f"{frf.position_deg.min():g}° to {frf.position_deg.max():g}°"
    return "by node"


def _runs(frf: FRF) -> str:
    return _count(len(frf.run_names), "run")


def _median(values: NDArray[np.float64]) -> str:
    known = values[np.isfinite(values)]
    return f"{np.median(known):.4f}" if known.size else "unknown"


def _averages(n_effective: float) -> str:
    return f"{n_effective:.1f}" if np.isfinite(n_effective) else "unknown"


def _band(band_hz: tuple[float, float]) -> str:
    return f"{band_hz[0]:g} to {band_hz[1]:g} Hz"


def _damping(mode: Mode) -> str:
    return value_with_std(100 * mode.damping_ratio, 100 * mode.damping_std)


def _given(value: float | None, unit: str) -> str:
    """A value as a person would have typed it."""
    space = "" if unit == "°" else " "
    return "–" if value is None else f"{value:.10g}{space}{unit}"


def _count(how_many: int, noun: str) -> str:
    return f"{how_many} {noun}" if how_many == 1 else f"{how_many} {noun}s"
