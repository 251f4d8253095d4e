"""The report on paper: a PDF with page numbers, drawn figures and texts that can be copied."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

from ema.core.errors import InputError, visible
from pipelines.report.blocks import Beside, Block, Paragraph, Picture, Section, Table
from pipelines.report.page import on_paper, render_page
from pipelines.report.write import KIND, report_sections, subject_of
from pipelines.results.labels import short
from pipelines.results.result import Result
from pipelines.storage.atomic import file_written_whole

STYLE = Path(__file__).parent / "paper.css"
MOST_FOLDED_ROWS = 30  # of a table that is folded on the screen: longer ones stay there
INSTALL = (
    'Install it with pip install "ringmodal[pdf]"; it needs the library Pango as well: on Windows '
    "from MSYS2 (pacman -S mingw-w64-ucrt-x86_64-pango), on macOS brew install pango, on Debian "
    "and Ubuntu apt install libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0. Without it, "
    "open the HTML report and print it to a PDF"
)


def write_pdf(result: Result, path: str | Path) -> Path:
    """Write the report as PDF, A4, with a line for the signature.

    Parameters
    ----------
    result : Result
    path : path
        Written whole or not at all; an earlier file is replaced.

    Returns
    -------
    Path
        `path`.

    Raises
    ------
    InputError
        Where WeasyPrint or what it needs is not installed, or the file cannot be written.
    """
    target = Path(path)
    weasyprint = printing_library(str(target))
    sections = tuple(map(_for_paper, on_paper(report_sections(result))))
    page = render_page(KIND, subject_of(result), sections, signed=True)
    with file_written_whole(target) as partial:
        partial.write_bytes(_printed(weasyprint, page, _running_texts(result)))
    return target


def printing_library(where: str) -> Any:
    """Load what prints pages.

    Parameters
    ----------
    where : str
        File or option that needs it, for the message.

    Raises
    ------
    InputError
        Where it is not installed; a library that it needs in turn is missed as an OSError.
    """
    try:
        return import_module("weasyprint")
    except (ImportError, OSError) as error:
        found = f"no PDF can be made ({str(error).splitlines()[0]})"
        raise InputError(where, found, "WeasyPrint makes it", INSTALL) from error


def _printed(weasyprint: Any, page: str, style: str) -> bytes:
    # Everything is inside the page: no other address is ever asked.
    inside = weasyprint.URLFetcher(allowed_protocols=["data"])
    document = weasyprint.HTML(string=page, url_fetcher=inside)
    sheets = [weasyprint.CSS(filename=STYLE), weasyprint.CSS(string=style)]
    return bytes(document.write_pdf(stylesheets=sheets, pdf_tags=True))


def _for_paper(section: Section) -> Section:
    blocks = (shown for block in section.blocks for shown in _rearranged(block))
    return replace(section, blocks=tuple(blocks))


def _rearranged(block: Block) -> tuple[Block, ...]:
    """A long table becomes a sentence where the screen folds it; wide pictures get a row each."""
    if isinstance(block, Table) and block.folded and len(block.rows) > MOST_FOLDED_ROWS:
        return (Paragraph(f"{block.caption}: the {len(block.rows)} rows are in the HTML report."),)
    if isinstance(block, Beside):
        wide = tuple(one for one in block.blocks if isinstance(one, Picture) and one.wide)
        narrow = tuple(one for one in block.blocks if one not in wide)
        return (*wide, *((Beside(narrow),) if narrow else ()))
    return (block,)


def _running_texts(result: Result) -> str:
    """Style with the texts at the head and foot of each page."""
    created = str(result.provenance.get("created", ""))[:10]
    version = result.provenance.get("software", {}).get("ringmodal", "")
    title = f"{KIND} – {short(subject_of(result), 60)}"
    return (
        "@page {"
        f" @top-left {{ content: {_quoted(title)} }}"
        f" @top-right {{ content: {_quoted(created)} }}"
        f" @bottom-left {{ content: {_quoted(f'ringmodal {version}'.strip())} }}"
        " }"
    )


def _quoted(text: Any) -> str:
    """A text as CSS writes it: whatever it holds, nothing of it is taken for style."""
    return '"' + "".join(f"\\{ord(character):06x}" for character in visible(text)) + '"'
