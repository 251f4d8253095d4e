"""The report: one HTML file that needs no network.

Sections are built in Python from a `Result`, block by block; the template only sets them.
"""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from pipelines.report import closing, identification, measurement, ring
from pipelines.report.blocks import Section
from pipelines.result import Result

LONG_WORD, PIECE = 32, 16  # characters: a checksum breaks, a file name does not
SECTIONS = (
    closing.summary,
    measurement.identity,
    measurement.setup,
    measurement.quality,
    identification.stability,
    identification.modes,
    identification.responses,
    identification.shapes,
    ring.validation,
    ring.parameters,
    closing.warnings,
    closing.origin,
    closing.definitions,
)


def report_sections(result: Result) -> tuple[Section, ...]:
    """All sections of the report in their order."""
    return tuple(build(result) for build in SECTIONS)


def render_report(result: Result) -> str:
    """Render a result as one self-contained HTML page.

    Parameters
    ----------
    result : Result

    Returns
    -------
    str
        HTML with styles and pictures inside; texts from files appear as text.
    """
    subject = result.tyre.designation if result.tyre is not None else result.name
    return render_page("Modal report", subject, report_sections(result))


def render_page(kind: str, subject: str, sections: tuple[Section, ...]) -> str:
    """Render sections as one self-contained HTML page.

    Parameters
    ----------
    kind : str
        What sort of page it is, above its title.
    subject : str
        Its title.
    sections : tuple of Section

    Returns
    -------
    str
        HTML; texts appear as text.
    """
    environment = Environment(
        loader=PackageLoader("pipelines.report", "."),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = breakable
    return environment.get_template("report.html").render(
        kind=kind, subject=subject, sections=sections
    )


def breakable(text: str) -> Markup:
    """Escaped text in which long words may break, without changing what is copied from it."""
    return Markup(" ").join(
        Markup("<wbr>").join(word[start : start + PIECE] for start in range(0, len(word), PIECE))
        if len(word) > LONG_WORD
        else word
        for word in text.split(" ")
    )


def write_report(result: Result, path: str | Path) -> Path:
    """Write the report to `path` and return it."""
    target = Path(path)
    target.write_text(render_report(result), encoding="utf-8")
    return target
