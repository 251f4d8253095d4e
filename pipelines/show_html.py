"""How a whole result shows itself: one line in a terminal, its tables in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ema._html import facts, table
from ema._show import findings_html, modes_html

if TYPE_CHECKING:
    from pipelines.result import Result, Validation


def result_line(result: Result) -> str:
    """Name, modes, ring and warnings."""
    n_modes = len(result.modal_model.modes)
    ring = "no ring" if result.tuning is None else "ring tuned"
    n_warnings = sum(finding.verdict != "ok" for finding in result.findings)
    return f"<Result {result.name}: {n_modes} modes, {ring}, {n_warnings} warnings>"


def result_html(result: Result) -> str:
    """Modes, ring, validation, and what a reader has to know."""
    title = result.name if result.tyre is None else f"{result.name}, {result.tyre.designation}"
    low, high = result.modal_model.band_hz
    parts = [modes_html(result.modal_model.modes, f"{title}: modes, {low:g} to {high:g} Hz")]
    if result.tuning is not None:
        parts.append(result.tuning._repr_html_())
    if result.validation is not None:
        parts.append(_shapes(result.validation))
    parts.append(findings_html(result.findings))
    if result.notes:
        parts.append(facts("Notes", [("", note) for note in result.notes]))
    return "".join(parts)


def _shapes(found: Validation) -> str:
    """What the frequencies of the tuning do not say: damping and likeness of the shapes."""
    rows = [
        (str(order), f"{100 * measured:.2f}", f"{100 * ring:.2f}", f"{found.mac[row, row]:.3f}")
        for row, (order, measured, ring) in enumerate(
            zip(found.order, found.measured_damping, found.model_damping, strict=True)
        )
    ]
    head = ("order n", "measured damping / %", "ring damping / %", "MAC of the shapes")
    return table("Validation", head, rows, words=())
