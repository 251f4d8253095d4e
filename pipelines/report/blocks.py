"""What a report is made of: sections of paragraphs, facts, tables, charts and pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pipelines.plots.chart import Chart


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of text.

    Parameters
    ----------
    text : str
    tone : str
        ``"plain"``, ``"good"`` (a verdict in favour) or ``"warning"``.
    """

    text: str
    tone: str = "plain"
    kind: ClassVar[str] = "paragraph"


@dataclass(frozen=True)
class Listing:
    """Sentences one below the other."""

    items: tuple[str, ...]
    tone: str = "plain"
    kind: ClassVar[str] = "listing"


@dataclass(frozen=True)
class Facts:
    """Pairs of a name and a value with its unit."""

    rows: tuple[tuple[str, str], ...]
    kind: ClassVar[str] = "facts"


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads to another file, by its path from the page."""

    text: str
    target: str


@dataclass(frozen=True)
class Table:
    """A table.

    Parameters
    ----------
    caption : str
        What the table holds.
    head : tuple of str
        Column titles with units.
    rows : tuple of tuple of str or Link
        Cells, as printed.
    words : tuple of int
        Columns with words, set flush left; all others hold numbers.
    folded : bool
        Whether it is shown on demand only; what is open is printed.
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str | Link, ...], ...]
    words: tuple[int, ...] = ()
    folded: bool = False
    kind: ClassVar[str] = "table"


@dataclass(frozen=True)
class Picture:
    """A figure with its caption.

    Parameters
    ----------
    source : str
        Data URI.
    alternative : str
        What the picture shows, for readers who cannot see it.
    caption : str
        What to look for.
    wide : bool
        Whether it needs the whole width of the page.
    """

    source: str
    alternative: str
    caption: str
    wide: bool = False
    kind: ClassVar[str] = "picture"


@dataclass(frozen=True)
class Chooser:
    """A chart whose curves follow a choice.

    Parameters
    ----------
    chart : Chart
        Its traces are filled in by the page.
    label : str
        What is chosen.
    options : tuple of str
        What there is to choose from.
    chosen : int
        Index of what is shown first.
    content : mapping
        What the page draws from.
    printed : callable
        Gives the charts that are printed instead.
    """

    chart: Chart
    label: str
    options: tuple[str, ...]
    chosen: int
    content: Mapping[str, Any]
    printed: Callable[[], tuple[Chart, ...]]
    kind: ClassVar[str] = "chooser"


@dataclass(frozen=True)
class Animation:
    """Shapes that move.

    Parameters
    ----------
    name : str
        Unique in the page.
    options : tuple of str
        Names of the shapes.
    content : mapping
        What the page draws from.
    caption : str
        What to look for.
    printed : callable
        Gives the charts that are printed instead.
    """

    name: str
    options: tuple[str, ...]
    content: Mapping[str, Any]
    caption: str
    printed: Callable[[], tuple[Chart, ...]]
    kind: ClassVar[str] = "animation"


Alone = Paragraph | Listing | Facts | Table | Picture | Chart | Chooser | Animation


@dataclass(frozen=True)
class Beside:
    """Blocks side by side where the page is wide enough."""

    blocks: tuple[Alone, ...]
    kind: ClassVar[str] = "beside"


Block = Alone | Beside


@dataclass(frozen=True)
class Section:
    """A section of the report."""

    anchor: str
    title: str
    blocks: tuple[Block, ...]
