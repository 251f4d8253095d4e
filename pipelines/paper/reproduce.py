"""The paper reproduced: its tables and figures computed, beside what it prints."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from pipelines.paper.checks import model_checks
from pipelines.paper.forced import forced_response
from pipelines.paper.parts import Chapter, NumberTable, paper_page, statements_table
from pipelines.paper.tables import damping, identification, tuning
from pipelines.paper.waves import waves
from pipelines.plots.chart import Chart
from pipelines.plots.style import png
from pipelines.process.run import process
from pipelines.results.result import Result
from pipelines.simulate.campaign import sample_campaign
from pipelines.storage.checksums import write_marker
from pipelines.storage.result_folder import require_free, written_whole
from pipelines.storage.tables import write_csv

PAGE = "paper.html"
FOLDER_MARKER = "paper.json"  # lists the files, by which an earlier reproduction is known


def reproduce_paper(
    folder: Path, *, force: bool = False, progress: Callable[[str], None] | None = None
) -> tuple[Chapter, ...]:
    """Compute Tables 3 to 5 and Figs. 3 to 12, and write them.

    Parameters
    ----------
    folder : Path
        Gets ``paper.html``, a CSV file per table, a PNG file per figure and ``paper.json``, which
        lists them; written atomically.
    force : bool
        Replace an earlier reproduction.
    progress : callable, optional
        Called with the name of each stage as it starts.

    Raises
    ------
    InputError
        If the folder exists and may not be replaced, or cannot be written.
    """
    require_free(folder, force=force, marker=FOLDER_MARKER)
    with TemporaryDirectory() as scratch:
        result = process(sample_campaign(Path(scratch) / "campaign"), progress=progress)
    if progress is not None:
        progress("Computing the paper's tables and figures …")
    chapters = paper_chapters(result)
    write_paper(chapters, result, folder, force=force)
    return chapters


def paper_chapters(result: Result) -> tuple[Chapter, ...]:
    """All that is computed, from a campaign in place of the paper's recordings."""
    measured = identification(result), tuning(result)
    return (*measured, model_checks(), waves(), damping(), forced_response(result))


def write_paper(
    chapters: tuple[Chapter, ...], result: Result, folder: Path, *, force: bool = False
) -> None:
    """Write page, tables and figures; the folder is written atomically."""
    parts = [part for chapter in chapters for part in chapter.parts]
    pictures = {part.name: png(part.draw()) for part in parts if isinstance(part, Chart)}
    with written_whole(folder, force=force, marker=FOLDER_MARKER) as partial:
        for part in (*parts, statements_table(chapters)):
            if isinstance(part, NumberTable):
                write_csv(partial / f"{part.name}.csv", part.frame)
        for name, picture in pictures.items():
            (partial / f"{name}.png").write_bytes(picture)
        page = paper_page(chapters, result, pictures)
        (partial / PAGE).write_text(page, encoding="utf-8", newline="\n")
        about = {key: result.provenance[key] for key in ("software", "created")}
        write_marker(partial / FOLDER_MARKER, about)
