"""The report: one HTML file that needs no network.

Sections are built in Python from a `Result`, block by block; the template only sets them.
"""

from __future__ import annotations

from pathlib import Path

from pipelines.report import (
    animation,
    closing,
    identification,
    measurement,
    responses,
    ring,
)
from pipelines.report import measurement as identity
from pipelines.report.blocks import Section
from pipelines.report.page import render_page
from pipelines.results.result import Result

__all__ = [
    "KIND",
    "SECTIONS",
    "render_page",
    "render_report",
    "report_sections",
    "subject_of",
    "write_report",
]

KIND = "Modal report"
SECTIONS = (
    closing.summary,
    identity.identity,
    measurement.setup,
    measurement.quality,
    identification.stability,
    identification.modes,
    responses.responses,
    animation.shapes,
    ring.validation,
    ring.parameters,
    closing.warnings,
    closing.origin,
    closing.definitions,
)


def report_sections(result: Result) -> tuple[Section, ...]:
    """All sections of the report in their order."""
    return tuple(build(result) for build in SECTIONS)


def render_report(result: Result, *, paper: bool = False) -> str:
    """Render a result as one self-contained HTML page.

    Parameters
    ----------
    result : Result
    paper : bool
        Whether everything that moves is replaced by its drawing, so that no script is needed.

    Returns
    -------
    str
        HTML with styles, scripts and pictures inside; texts from files appear as text.
    """
    sections = report_sections(result)
    return render_page(KIND, subject_of(result), sections, paper=paper, signed=True)


def subject_of(result: Result) -> str:
    """What the report is about: the tyre, or the campaign of a structure."""
    return result.tyre.designation if result.tyre is not None else result.name


def write_report(result: Result, path: str | Path) -> Path:
    """Write the report to `path` and return it.

    Examples
    --------
    >>> import ringmodal as rm
    >>> rm.write_report(rm.retune("result"), "report.html").name
    'report.html'
    """
    target = Path(path)
    target.write_text(render_report(result), encoding="utf-8")
    return target
