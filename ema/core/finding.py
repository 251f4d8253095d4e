"""Findings: the result of one check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ema.core.display import as_typed, table


def findings_html(findings: Sequence[Finding]) -> str:
    """Findings that are not in order; nothing where all are."""
    rows = [
        (
            finding.verdict,
            finding.run,
            finding.channel,
            as_typed(finding.position_deg, "°"),
            finding.detail,
        )
        for finding in findings
        if finding.verdict != _OK
    ]
    head = ("verdict", "run", "channel", "position", "what was found")
    return table("Warnings", head, rows, words=(0, 1, 2, 4)) if rows else ""


_OK = "ok"


@dataclass(frozen=True)
class Finding:
    """One line of ``quality.csv``.

    Parameters
    ----------
    run, channel : str
        What it is about; empty where it concerns the whole campaign or run.
    position_deg : float or None
        Where the channel sits.
    check : str
        Short name of the check, e.g. ``"reference"``, ``"coherence"``.
    verdict : str
        ``"ok"``, ``"warning"`` or ``"excluded"``.
    detail : str
        The number found and the rule, in words.
    """

    run: str
    channel: str
    position_deg: float | None
    check: str
    verdict: str
    detail: str


OK = "ok"


WARNING = "warning"


EXCLUDED = "excluded"
