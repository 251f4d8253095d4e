"""A page: sections of blocks, set by the template with the scripts they need and nothing else.

The template has a macro for each class of block, called as the class in lower case.
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from base64 import b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cache
from importlib.util import cache_from_source
from pathlib import Path
from typing import Any

from jinja2 import BytecodeCache, Environment, PackageLoader, StrictUndefined, select_autoescape
from jinja2.bccache import Bucket
from markupsafe import Markup

from ema.core.errors import InputError, unknown, visible
from pipelines.plots.chart import Chart, Drawn
from pipelines.results.options import Units
from pipelines.storage.atomic import file_written_whole

_IMAGES = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg", ".svg": "svg+xml"}
_MOST_LOGO_BYTES = 500_000  # the page holds it: a logo is smaller than that
_KINDS: dict[str, tuple[type, str]] = {  # of values that are not texts
    "signatures": (list, "a list of texts"),
    "fields": (dict, "a table of texts"),
}
_OF_MANIFEST = ("report_number", "client")  # may differ from tyre to tyre: a key of [tyre] as well
LIBRARY = "vendor/plotly-cartesian.min.js"
SCRIPTS = ("charts.js", "responses.js", "torus.js", "animation.js")  # in the order they run
# In JSON these are in strings only; escaped, no text of a file can end the script.
ESCAPED = {sign: f"\\u{ord(sign):04x}" for sign in "<>&"}
# An escaped backslash, or an escape of JSON for an invisible character.
JSON_ESCAPE = re.compile(r"\\\\|\\u(00[01][0-9a-f])|\\([bf])")


@dataclass(frozen=True)
class Template:
    """What a laboratory adds to its reports; every key of the file is a field of this class."""

    title: str = "Modal report"  # above the name of the tyre
    report_number: str = ""
    client: str = ""
    laboratory: str = ""
    logo: str = ""  # path of a picture from the template's folder; a data URI once read
    introduction: str = ""  # after the summary
    closing: str = ""  # above the signatures
    signatures: tuple[str, ...] = ("Checked by",)  # a line for each, with date and signature
    units: Units = Units.LAB
    fields: Mapping[str, str] = field(default_factory=dict)  # more lines of the head

    @property
    def head(self) -> tuple[tuple[str, str], ...]:
        """Lines of the head: names and texts."""
        known = {
            "Report number": self.report_number,
            "Client": self.client,
            "Laboratory": self.laboratory,
        }
        return tuple((name, text) for name, text in {**known, **self.fields}.items() if text)

    def completed(self, details: Mapping[str, Any]) -> Template:
        """The template with what the manifest says of this tyre."""
        own = {name: str(details[name]) for name in _OF_MANIFEST if details.get(name)}
        return replace(self, **own)  # type: ignore[arg-type]


PLAIN = Template()


def read_template(path: Path | None, units: Units | None = None) -> Template:
    """Read a template, the plain one where there is none; `units` overrides its own."""
    template = PLAIN if path is None else _read(path)
    return template if units is None else replace(template, units=units)


def _read(path: Path) -> Template:
    try:
        content: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        rule = "a template is a TOML file"
        raise InputError(f"template {path}", str(error), rule, "Correct it") from error
    known = [each.name for each in fields(Template)]
    for name, value in tuple(content.items()):
        where = f"template {path.name}, {name}"
        if name not in known:
            raise unknown(where, name, f"known keys are {', '.join(known)}", known)
        kind, what = _KINDS.get(name, (str, "text"))
        inside = list(value.values()) if isinstance(value, dict) else value
        texts = inside if isinstance(inside, list) else [inside]
        if not isinstance(content[name], kind) or not all(isinstance(each, str) for each in texts):
            raise InputError(where, repr(value), f"it must be {what}", "Correct it")
        if name == "signatures":
            content[name] = tuple(value)
        elif name == "units":
            content[name] = _units(where, value)
        elif name == "logo":
            content[name] = _picture(where, path.parent / value)
    return Template(**content)


def _units(where: str, text: str) -> Units:
    if text not in list(Units):
        raise unknown(where, text, f"it must be one of {', '.join(Units)}", list(Units))
    return Units(text)


def _picture(where: str, path: Path) -> str:
    """A picture as data URI."""
    kind = _IMAGES.get(path.suffix.lower())
    if kind is None:
        rule = f"a logo has the ending {', '.join(_IMAGES)}"
        raise InputError(where, path.name, rule, "Convert the picture")
    try:
        content = path.read_bytes()
    except OSError as error:
        rule = "a logo is a file, with its path from the template's folder"
        raise InputError(where, f"{path}: {error.strerror}", rule, "Correct the path") from error
    if len(content) > _MOST_LOGO_BYTES:
        found, rule = (
            f"{path.name} has {len(content)} bytes",
            f"at most {_MOST_LOGO_BYTES} are read",
        )
        raise InputError(where, found, rule, "Reduce the picture")
    return f"data:image/{kind};base64,{b64encode(content).decode('ascii')}"


LONG_WORD, PIECE = 32, 16  # characters: a checksum breaks, a file name does not


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
    text = visible(JSON_ESCAPE.sub(_named, text))
    for sign, escape in ESCAPED.items():  # str.translate takes ten times as long
        text = text.replace(sign, escape)
    return Markup(text)


def _named(escape: re.Match[str]) -> str:
    """What a page shows for an escape of JSON: a name, or the backslash."""
    code = escape[1] or {"b": "0008", "f": "000c"}.get(escape[2] or "")
    return f"[U+{code.upper()}]" if code else escape[0]


@cache
def _text(name: str) -> str:
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


class _Compiled(BytecodeCache):
    """Compiled templates, kept where Python keeps compiled modules and as long as they are right.

    To compile them takes as long as to render a report.
    """

    def load_bytecode(self, bucket: Bucket) -> None:
        """Load what is kept of a template."""
        with suppress(OSError), self._path(bucket).open("rb") as file:
            bucket.load_bytecode(file)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep a compiled template, where that is possible."""
        if sys.dont_write_bytecode:
            return
        with suppress(InputError), file_written_whole(self._path(bucket)) as partial:
            partial.write_bytes(bucket.bytecode_to_string())

    def _path(self, bucket: Bucket) -> Path:
        return Path(cache_from_source(__file__)).with_name(f"{bucket.key}.template")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("pipelines.report.write", "."),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        bytecode_cache=_Compiled(),
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = breakable
    environment.filters["as_json"] = as_json
    environment.filters["kind"] = lambda block: type(block).__name__.lower()
    return environment
