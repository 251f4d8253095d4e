"""Parts of the reproduction: tables of numbers, statements and their verdicts, the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.core.display import DASH, number, signed, value_with_std
from model.parameters import DESIGNATION
from pipelines.plots.chart import Chart
from pipelines.plots.draw import data_uri
from pipelines.plots.plot import Curve, Plot
from pipelines.report.page import Block, Listing, Paragraph, Picture, Section, Table, render_page
from pipelines.report.summary import origin
from pipelines.results.result import Result

AGREES, DIFFERS, OWN_DATA = "agrees", "differs", "agrees on simulated data"
Values = Sequence[Any] | NDArray[Any]
KIND = "The paper's tables and figures, computed"
SUBJECT = f"A theoretical model for a rolling tyre, {DESIGNATION}"
INTRODUCTION = (
    "“A theoretical model for investigating the structural dynamics of a rolling tyre”: every "
    "table and figure with results, computed with the equations as corrected in the documentation "
    "of the model and set beside what is printed. The paper's figures are not reproduced here; "
    "what its text says about them is tested."
)

#: Order whose waves Figs. 5, 7, 8 and 10 show.
WAVE_ORDER = 3
#: Angular speed of Figs. 7, 8, 10 and 12, rad/s; 80 km/h.
SPEED_RAD_S = 67.3
#: Orders in Fig. 6a and 6b.
FIGURE_6_ORDERS = ((1, 2), (3, 4))
#: Upper end of the frequency range of interest, Hz (section 2).
HIGHEST_HZ = 300.0


@dataclass(frozen=True, eq=False)
class Column:
    """A column of a table, as numbers for a file and as text for a page."""

    title: str  # on the page, with the unit
    name: str  # in the file
    values: Values
    std: Sequence[float] | None = None  # standard deviations; a separate column in the file
    show: Callable[[float], str] | int = number  # or digits after the point; not used with std

    @property
    def cells(self) -> tuple[str, ...]:
        """The column on the page."""
        if self.std is not None:
            return tuple(map(value_with_std, self.values, self.std))
        return tuple(map(self._cell, self.values))

    def _cell(self, value: Any) -> str:
        if isinstance(value, str | int | np.integer):
            return str(value)
        if not isinstance(self.show, int):
            return self.show(float(value))
        return f"{value:.{self.show}f}" if np.isfinite(value) else DASH

    @property
    def is_text(self) -> bool:
        """Whether it has words."""
        return any(isinstance(value, str) and value != DASH for value in self.values)


def deviation(name: str, found: ArrayLike, printed: ArrayLike, digits: int) -> Column:
    """A column of deviations from what is printed, in percent."""
    percent = 100.0 * (np.asarray(found) / np.asarray(printed) - 1.0)
    return Column("deviation / %", name, percent, show=lambda value: signed(value, digits))


@dataclass(frozen=True)
class NumberTable:
    """A table, with a name under which it becomes a CSV file; its columns have one length."""

    name: str
    caption: str
    columns: tuple[Column, ...]

    @property
    def block(self) -> Table:
        """The table on the page."""
        titles = tuple(column.title for column in self.columns)
        rows = tuple(zip(*(column.cells for column in self.columns), strict=True))
        words = tuple(k for k, column in enumerate(self.columns) if column.is_text)
        return Table(self.caption, titles, rows, words)

    @property
    def file_columns(self) -> dict[str, Values]:
        """The table for a file; standard deviations are separate columns."""
        columns: dict[str, Values] = {}
        for column in self.columns:
            columns[column.name] = column.values
            if column.std is not None:
                columns[f"{column.name}_std"] = column.std
        return columns


@dataclass(frozen=True)
class Statement:
    """A statement of the paper, and what was computed."""

    place: str  # section, table or figure
    printed: str
    found: str
    verdict: str  # AGREES, DIFFERS or OWN_DATA


@dataclass(frozen=True)
class Chapter:
    """One theme: text, tables and figures in reading order, and the statements it tests."""

    anchor: str
    title: str
    parts: tuple[Paragraph | NumberTable | Chart, ...]
    statements: tuple[Statement, ...]


def verdict(holds: bool, *, own_data: bool = False) -> str:
    """Verdict on a statement; `own_data` where simulated data replace the paper's."""
    if not holds:
        return DIFFERS
    return OWN_DATA if own_data else AGREES


def with_unit(name: tuple[str, str, str]) -> str:
    """Symbol and unit of a parameter from its title, symbol and unit."""
    _, symbol, unit = name
    return symbol if unit == "1" else f"{symbol} / ({unit})"


def relabelled(plot: Plot, names: Mapping[str, str]) -> Plot:
    """The plot with other names in its legend."""
    panels = []
    for panel in plot.panels:
        series = (
            replace(one, name=names.get(one.name, one.name)) if isinstance(one, Curve) else one
            for one in panel.series
        )
        panels.append(replace(panel, series=tuple(series)))
    return replace(plot, panels=tuple(panels))


def statements_table(chapters: Sequence[Chapter]) -> NumberTable:
    """All statements of all chapters."""
    every = [statement for chapter in chapters for statement in chapter.statements]
    columns = (
        Column("place", "place", [one.place for one in every]),
        Column("the paper", "paper", [one.printed for one in every]),
        Column("computed here", "computed", [one.found for one in every]),
        Column("verdict", "verdict", [one.verdict for one in every]),
    )
    return NumberTable("statements", "Statements of the paper, and what was computed", columns)


def paper_page(chapters: Sequence[Chapter], result: Result, pictures: Mapping[str, bytes]) -> str:
    """The page as self-contained HTML; `pictures` are the figures as PNG by name."""
    sections = (_section(chapter, pictures) for chapter in chapters)
    return render_page(KIND, SUBJECT, (_summary(chapters), *sections, origin(result)))


def _summary(chapters: Sequence[Chapter]) -> Section:
    every = [statement for chapter in chapters for statement in chapter.statements]
    apart = [one for one in every if one.verdict == DIFFERS]
    simulated = sum(one.verdict == OWN_DATA for one in every)
    counts = f"Of {len(every)} statements, {len(every) - len(apart)} hold; {simulated} of these"
    text = f"{counts} could only be tested on simulated recordings."
    blocks: list[Block] = [Paragraph(INTRODUCTION), Paragraph(text, "good")]
    if apart:
        both = (f"{one.place}. The paper: {one.printed}. Computed: {one.found}" for one in apart)
        text = f"{len(apart)} do not hold as printed. Both sides are shown:"
        blocks += [Paragraph(text), Listing(tuple(both), "warning")]
    return Section("summary", "Summary", (*blocks, statements_table(chapters).block))


def _section(chapter: Chapter, pictures: Mapping[str, bytes]) -> Section:
    def block(part: Paragraph | NumberTable | Chart) -> Block:
        if isinstance(part, Chart):
            picture = data_uri(pictures[part.name])
            return Picture(picture, part.alternative, part.caption, wide=True)
        return part.block if isinstance(part, NumberTable) else part

    return Section(chapter.anchor, chapter.title, tuple(map(block, chapter.parts)))


#: Angles of force and response in Figs. 3, 11 and 12, degrees; the response is at node 20.
FORCE_DEG, RESPONSE_DEG = 0.0, 100.0
