"""The reproduction as one page: what holds, what does not, then table by table."""

from __future__ import annotations

from collections.abc import Sequence

from model.reference import DESIGNATION
from pipelines.paper_parts import DIFFERS, OWN_DATA, Chapter, Column, NumberTable
from pipelines.report import render_page
from pipelines.report.blocks import Block, Listing, Paragraph, Section
from pipelines.report.closing import origin
from pipelines.result import Result

KIND = "The paper's tables and figures, computed"
SUBJECT = f"A theoretical model for a rolling tyre, {DESIGNATION}"
INTRODUCTION = (
    "“A theoretical model for investigating the structural dynamics of a rolling tyre”: every "
    "table and figure with results, computed with the equations as corrected in the documentation "
    "of the model and set beside what is printed. The paper's figures are not reproduced here; "
    "what its text says about them is put to the test."
)


def statements_table(chapters: Sequence[Chapter]) -> NumberTable:
    """All statements of all chapters."""
    every = [statement for chapter in chapters for statement in chapter.statements]
    return NumberTable(
        "statements",
        "What the paper states, and what the computation says",
        (
            Column("place", "place", [one.place for one in every]),
            Column("the paper", "paper", [one.printed for one in every]),
            Column("computed here", "computed", [one.found for one in every]),
            Column("verdict", "verdict", [one.verdict for one in every]),
        ),
    )


def paper_page(chapters: Sequence[Chapter], result: Result) -> str:
    """The whole page as self-contained HTML.

    Parameters
    ----------
    chapters : sequence of Chapter
    result : Result
        The processed campaign that stands for the paper's recordings.
    """
    sections = (
        _summary(chapters),
        *(_section(chapter) for chapter in chapters),
        origin(result),
    )
    return render_page(KIND, SUBJECT, sections)


def _summary(chapters: Sequence[Chapter]) -> Section:
    every = [statement for chapter in chapters for statement in chapter.statements]
    apart = [one for one in every if one.verdict == DIFFERS]
    simulated = sum(one.verdict == OWN_DATA for one in every)
    blocks: list[Block] = [
        Paragraph(INTRODUCTION),
        Paragraph(
            f"Of {len(every)} statements, {len(every) - len(apart)} hold; {simulated} of these "
            "could only be tested on simulated recordings.",
            "good",
        ),
    ]
    if apart:
        blocks += [
            Paragraph(f"{len(apart)} do not hold as printed. Both sides are shown:"),
            Listing(
                tuple(
                    f"{one.place}. The paper: {one.printed}. Computed: {one.found}" for one in apart
                ),
                "warning",
            ),
        ]
    return Section("summary", "Summary", (*blocks, statements_table(chapters).block))


def _section(chapter: Chapter) -> Section:
    blocks = tuple(part if isinstance(part, Paragraph) else part.block for part in chapter.parts)
    return Section(chapter.anchor, chapter.title, blocks)
