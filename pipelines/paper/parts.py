"""Parts of the reproduction: tables of numbers, statements and their verdicts, the page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.reference import DESIGNATION
from pipelines.plots.chart import Chart
from pipelines.plots.style import data_uri
from pipelines.report.blocks import Block, Listing, Paragraph, Picture, Section, Table
from pipelines.report.closing import origin
from pipelines.report.page import render_page
from pipelines.results.result import Result
from pipelines.storage.rounding import DASH, number, signed, value_with_std

AGREES, DIFFERS, OWN_DATA = "agrees", "differs", "agrees on simulated data"
Values = Sequence[Any] | NDArray[Any]


@dataclass(frozen=True, eq=False)
class Column:
    """A column of a table, as numbers for a file and as text for a page.

    Parameters
    ----------
    title : str
        Its title on the page, with the unit.
    name : str
        Its name in the file.
    values : sequence or ndarray
        Numbers or texts.
    std : sequence of float, optional
        Standard deviations; a column of their own in the file.
    show : callable
        Turns a number into text, unless it is whole or has a standard deviation.
    """

    title: str
    name: str
    values: Values
    std: Sequence[float] | None = None
    show: Callable[[float], str] = number

    @property
    def cells(self) -> tuple[str, ...]:
        """The column on the page."""
        if self.std is not None:
            return tuple(map(value_with_std, self.values, self.std))
        return tuple(
            str(value) if isinstance(value, str | int | np.integer) else self.show(float(value))
            for value in self.values
        )

    @property
    def is_text(self) -> bool:
        """Whether it holds words."""
        return any(isinstance(value, str) and value != DASH for value in self.values)


@dataclass(frozen=True)
class NumberTable:
    """A table, with a name under which it becomes a file.

    Parameters
    ----------
    name : str
        Name of its CSV file without ending.
    caption : str
    columns : tuple of Column
        Of equal length.
    """

    name: str
    caption: str
    columns: tuple[Column, ...]

    @property
    def block(self) -> Table:
        """The table on the page."""
        return Table(
            self.caption,
            tuple(column.title for column in self.columns),
            tuple(zip(*(column.cells for column in self.columns), strict=True)),
            words=tuple(k for k, column in enumerate(self.columns) if column.is_text),
        )

    @property
    def file_columns(self) -> tuple[str, ...]:
        """Column names of the file."""
        names: list[str] = []
        for column in self.columns:
            names += [column.name] if column.std is None else [column.name, f"{column.name}_std"]
        return tuple(names)

    @property
    def file_rows(self) -> list[tuple[Any, ...]]:
        """Rows of the file."""
        values: list[Values] = []
        for column in self.columns:
            values += [column.values] if column.std is None else [column.values, column.std]
        return list(zip(*(np.asarray(one).tolist() for one in values), strict=True))


@dataclass(frozen=True)
class Statement:
    """A sentence of the paper, and what the computation says to it.

    Parameters
    ----------
    place : str
        Section, table or figure.
    printed : str
        What is printed there.
    found : str
        What was computed.
    verdict : str
        ``"agrees"``, ``"differs"`` or ``"agrees on simulated data"``.
    """

    place: str
    printed: str
    found: str
    verdict: str


@dataclass(frozen=True)
class Chapter:
    """One theme: text, tables and figures in reading order, and the statements it tests."""

    anchor: str
    title: str
    parts: tuple[Paragraph | NumberTable | Chart, ...]
    statements: tuple[Statement, ...]


def verdict(holds: bool, *, own_data: bool = False) -> str:
    """Verdict on a statement; `own_data` where simulated data stand for the paper's."""
    if not holds:
        return DIFFERS
    return OWN_DATA if own_data else AGREES


def places(count: int) -> Callable[[float], str]:
    """Show numbers with `count` digits after the point."""
    return lambda value: f"{value:.{count}f}" if np.isfinite(value) else DASH


def with_unit(name: tuple[str, str, str]) -> str:
    """Symbol and unit of a parameter from its title, symbol and unit."""
    _, symbol, unit = name
    return symbol if unit == "1" else f"{symbol} / ({unit})"


def with_sign(count: int) -> Callable[[float], str]:
    """Show numbers with their sign and `count` digits after the point."""
    return lambda value: signed(value, count)


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


def paper_page(chapters: Sequence[Chapter], result: Result, pictures: Mapping[str, bytes]) -> str:
    """The page as self-contained HTML.

    Parameters
    ----------
    chapters : sequence of Chapter
    result : Result
        The processed campaign in place of the paper's recordings.
    pictures : mapping of str to bytes
        Each figure by its name, as PNG.
    """
    sections = (
        _summary(chapters),
        *(_section(chapter, pictures) for chapter in chapters),
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


def _section(chapter: Chapter, pictures: Mapping[str, bytes]) -> Section:
    def block(part: Paragraph | NumberTable | Chart) -> Block:
        if isinstance(part, Chart):
            picture = data_uri(pictures[part.name])
            return Picture(picture, part.alternative, part.caption, wide=True)
        return part.block if isinstance(part, NumberTable) else part

    return Section(chapter.anchor, chapter.title, tuple(map(block, chapter.parts)))


#: Order whose waves Figs. 5, 7, 8 and 10 show.
WAVE_ORDER = 3
#: Angular speed of Figs. 7, 8, 10 and 12, rad/s; 80 km/h.
SPEED_RAD_S = 67.3
#: Angles of force and response in Figs. 3, 11 and 12, degrees; the response is at node 20.
FORCE_DEG, RESPONSE_DEG = 0.0, 100.0
#: End of the cycle in Fig. 5, s.
CYCLE_S = 0.008
#: Largest deviation of the tuned frequencies, percent, and the exception, Hz (section 4).
FREQUENCY_LIMIT_PERCENT, FIRST_MODE_OFF_HZ = 1.0, 3.0
#: Lowest MAC of the seven modes (section 4, Fig. 4b).
LOWEST_MAC = 0.8
#: Orders in Fig. 6a and 6b.
FIGURE_6_ORDERS = ((1, 2), (3, 4))
#: Upper end of the frequency range of interest, Hz (section 2).
HIGHEST_HZ = 300.0

# What the text says, in few words.
MODES = "seven modes between 78.73 and 224.40 Hz with damping ratios from 0.039 to 0.018"
PRELOAD = "the preload by the inflation pressure matters much for the dynamics"
GROWTH = "the steady radial displacement grows with the speed"
TUNED = "the tuned frequencies are within 1 % of the identified ones; mode 1 is 3 Hz off"
OPTIMAL = "the values are optimal"
MINIMISED = "the values minimise the sum of squares of eq 18"
SHAPES = "MAC above 0.8 for all seven modes"
LINEAR = "the bifurcation of n = 1 is linear"
RISING = "the frequencies of the regressive waves always grow with the speed"
MINIMUM = "for n > 1 those of the progressive waves have a minimum"
STANDING = "at rest the two waves form a standing wave; a cycle of n = 3 ends at 0.008 s"
RATIOS_ALIKE = "B of the regressive and of the progressive wave are very similar"
ROTATES = "seen from the rolling tyre the pattern turns"
ABSOLUTE = "seen from space it turns as well"
STANDS = "seen from the stationary reference system it stands"
DAMPING = "the damping is estimated from the modal analysis"
MATCHING = "the ring's inertance matches the measured one well in frequency and amplitude"
HIDDEN = "the bifurcation is hardly seen: damping couples the frequencies"
LOW_PEAKS = "rotation raises the peaks at low frequencies"
