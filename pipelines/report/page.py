"""A page: sections of blocks, set by the template with the scripts they need and nothing else.

The template has a macro for each class of block, called as the class in lower case.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from ema.core.errors import visible
from pipelines.plots.chart import Chart, Drawn
from pipelines.report.template import Template

LONG_WORD, PIECE = 32, 16  # characters: a checksum breaks, a file name does not
LIBRARY = "vendor/plotly-cartesian.min.js"
SCRIPTS = ("charts.js", "responses.js", "torus.js", "animation.js")  # in the order they run
# In JSON these are in strings only; escaped, no text of a file can end the script.
ESCAPED = str.maketrans({c: f"\\u{ord(c):04x}" for c in "<>&"})
# An escaped backslash, or an escape of JSON for an invisible character.
JSON_ESCAPE = re.compile(r"\\\\|\\u(00[01][0-9a-f])|\\([bf])")


@dataclass(frozen=True)
class Paragraph:
    """A paragraph of text."""

    text: str
    tone: str = "plain"  # "plain", "good" (a verdict in favour) or "warning"


@dataclass(frozen=True)
class Lamp:
    """A verdict as a traffic light: its colour, a sign for who does not see it, and a line."""

    state: str  # "good", "doubtful" or "bad"
    sign: str
    text: str


@dataclass(frozen=True)
class Pointer:
    """A sentence of a listing, and the section of the page that has its details."""

    text: str
    anchor: str
    title: str


@dataclass(frozen=True)
class Listing:
    """Sentences one below the other."""

    items: tuple[str | Pointer, ...]
    tone: str = "plain"
    folded: str = ""  # under this title, shown on demand


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


Alone = Paragraph | Lamp | Listing | Facts | Table | Picture | Chart | Chooser | Animation


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


def render_page(
    kind: str, subject: str, sections: tuple[Section, ...], template: Template | None = None
) -> str:
    """Render sections as one self-contained HTML page.

    `kind` is shown above the title `subject`; a page with a `template` has its head, and ends with
    lines for signatures.
    """
    moving = any(isinstance(block, Drawn) for section in sections for block in inside(section))
    scripts = tuple(Markup(_text(name)) for name in (LIBRARY, *SCRIPTS)) if moving else ()
    page = _environment().get_template("report.html")
    content = {"kind": kind, "subject": subject, "sections": sections}
    return page.render(**content, template=template, scripts=scripts)


def drawings(sections: tuple[Section, ...]) -> tuple[Chart, ...]:
    """Every figure of the sections as it is printed, in the order of the page."""
    return tuple(
        drawing
        for section in sections
        for block in inside(section)
        if isinstance(block, Drawn)
        for drawing in block.printed()
    )


def inside(section: Section) -> Iterator[Alone]:
    """The blocks of a section; those side by side one after the other."""
    for block in section.blocks:
        yield from block.blocks if isinstance(block, Beside) else (block,)


def breakable(text: str) -> Markup:
    """Escaped text in which long words may break, without changing what is copied from it."""
    return Markup(" ").join(
        Markup("<wbr>").join(word[start : start + PIECE] for start in range(0, len(word), PIECE))
        if len(word) > LONG_WORD
        else word
        for word in shown(text).split(" ")
    )


def shown(value: Any) -> Any:
    """A text with its invisible characters named; anything else as it is."""
    return visible(value) if type(value) is str else value


def as_json(value: Any) -> Markup:
    """JSON that is safe inside a script element whatever its texts are; NaN is a ValueError."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return Markup(visible(JSON_ESCAPE.sub(_named, text)).translate(ESCAPED))


def _named(escape: re.Match[str]) -> str:
    """What a page shows for an escape of JSON: a name, or the backslash."""
    code = escape[1] or {"b": "0008", "f": "000c"}.get(escape[2] or "")
    return f"[U+{code.upper()}]" if code else escape[0]


@cache
def _text(name: str) -> str:
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("pipelines.report.write", "."),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = breakable
    environment.filters["as_json"] = as_json
    environment.filters["kind"] = lambda block: type(block).__name__.lower()
    return environment
