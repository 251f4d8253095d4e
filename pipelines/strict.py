"""A strict run: what is a warning otherwise ends it."""

from __future__ import annotations

from collections.abc import Sequence

from ema.errors import InputError
from ema.quality import OK, Finding

_SHOWN = 3


def refuse_warnings(findings: Sequence[Finding]) -> None:
    """Raise where any finding is a warning or tells that something was left out.

    Parameters
    ----------
    findings : sequence of Finding

    Raises
    ------
    InputError
        Names the first findings and how many more there are.
    """
    doubtful = [finding for finding in findings if finding.verdict != OK]
    if not doubtful:
        return
    more = len(doubtful) - _SHOWN
    texts = [_text(finding) for finding in doubtful[:_SHOWN]]
    raise InputError(
        "--strict",
        "; ".join(texts) + (f"; and {more} more" if more > 0 else ""),
        "a strict run accepts no warnings",
        "Mend the recordings or leave them out, or run without --strict: quality.csv lists all",
    )


def _text(finding: Finding) -> str:
    place = " ".join(part for part in (finding.run, finding.channel) if part)
    return f"{finding.check}, {place}: {finding.detail}" if place else finding.detail
