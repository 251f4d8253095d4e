"""What a report is made of: sections of paragraphs, facts, tables, charts and pictures.

The template has a macro for each class, called as the class in lower case.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pipelines.plots.chart import Chart


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of text."""

    text: str
    tone: str = "plain"  # "plain", "good" (a verdict in favour) or "warning"


@dataclass(frozen=True)
class Listing:
    """Sentences one below the other."""

    items: tuple[str, ...]
    tone: str = "plain"


@dataclass(frozen=True)
class Facts:
    """Pairs of a name and a value with its unit."""

    rows: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads to another file, by its path from the page."""

    text: str
    target: str


@dataclass(frozen=True)
class Table:
    """A table of cells as printed; column titles have units."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str | Link, ...], ...]
    words: tuple[int, ...] = ()  # columns with words, set flush left; all others hold numbers
    folded: bool = False  # shown on demand only; what is open is printed

    @classmethod
    def of_columns(
        cls, caption: str, columns: Mapping[str, Iterable[str]], words: tuple[int, ...] = ()
    ) -> Table:
        """A table from its columns by their titles."""
        return cls(caption, tuple(columns), tuple(zip(*columns.values(), strict=True)), words)


@dataclass(frozen=True)
class Picture:
    """A figure with its caption, which says what to look for."""

    source: str  # data URI
    alternative: str  # what the picture shows, for readers who cannot see it
    caption: str
    wide: bool = False  # whether it needs the full width of the page


@dataclass(frozen=True)
class Chooser:
    """A chart whose curves follow a choice; the page fills them in from `content`."""

    chart: Chart
    label: str  # what is chosen
    options: tuple[str, ...]
    chosen: int  # index of what is shown first
    content: Mapping[str, Any]
    printed: Callable[[], tuple[Chart, ...]]  # gives the charts for paper


@dataclass(frozen=True)
class Animation:
    """Shapes that move; the page draws them from `content`."""

    name: str  # unique in the page
    options: tuple[str, ...]  # names of the shapes
    content: Mapping[str, Any]
    caption: str
    printed: Callable[[], tuple[Chart, ...]]  # gives the charts for paper


Alone = Paragraph | Listing | Facts | Table | Picture | Chart | Chooser | Animation


@dataclass(frozen=True)
class Beside:
    """Blocks side by side where the page is wide enough."""

    blocks: tuple[Alone, ...]


Block = Alone | Beside


@dataclass(frozen=True)
class Section:
    """A section of the report."""

    anchor: str
    title: str
    blocks: tuple[Block, ...]
