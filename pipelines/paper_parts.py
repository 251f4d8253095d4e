"""What a reproduction is made of: tables of numbers, drawings, and statements put to the test."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipelines.figures_style import data_uri, png
from pipelines.numbers import DASH, number, signed, value_with_std
from pipelines.report.blocks import Paragraph, Picture, Table

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
class Drawing:
    """A figure, with a name under which it becomes a file.

    Parameters
    ----------
    name : str
        Name of its PNG file without ending.
    content : bytes
        PNG.
    alternative, caption : str
        What it shows, and what to look for.
    """

    name: str
    content: bytes
    alternative: str
    caption: str

    @property
    def block(self) -> Picture:
        """The figure on the page."""
        return Picture(data_uri(self.content), self.alternative, self.caption, wide=True)


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
    parts: tuple[Paragraph | NumberTable | Drawing, ...]
    statements: tuple[Statement, ...]


def drawing(name: str, figure: Figure, alternative: str, caption: str) -> Drawing:
    """Take a figure as it is drawn now."""
    return Drawing(name, png(figure), alternative, caption)


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
