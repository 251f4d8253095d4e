"""Every figure of the report as a file, as it is printed."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from ema.core.errors import InputError
from pipelines.plots.chart import Drawing
from pipelines.report.page import drawings
from pipelines.report.write import report_sections
from pipelines.results.result import Result
from pipelines.storage.atomic import file_written_whole

FORMATS = ("png", "svg")


def write_figures(
    result: Result,
    folder: str | Path,
    formats: Sequence[str] = FORMATS,
    *,
    force: bool = False,
) -> list[Path]:
    """Write each figure of the report as files, such as ``stability.png``.

    Parameters
    ----------
    result : Result
    folder : path
        Made where it is missing; other files in it stay.
    formats : sequence of {"png", "svg"}
        PNG with 300 dots per inch; texts in SVG stay texts.
    force : bool
        Replace existing files of the same names.

    Returns
    -------
    list of Path
        The files, figure by figure in the order of the report.

    Raises
    ------
    InputError
        For an unknown format, for a file that exists without `force`, and where nothing can be
        written.
    """
    target = Path(folder)
    _require_known(formats)
    figures = drawings(report_sections(result))
    if not force:
        _require_free(target, figures, formats)
    _make(target)
    return [path for figure in figures for path in _write(figure, target, formats)]


def _write(drawing: Drawing, folder: Path, formats: Sequence[str]) -> list[Path]:
    # Loads matplotlib, which the page on a screen does without.
    from pipelines.plots.style import figure_bytes  # loads what draws: the checks come first

    figure = drawing.draw()
    paths = []
    for file_format in formats:
        path = _path(folder, drawing, file_format)
        with file_written_whole(path) as partial:
            partial.write_bytes(figure_bytes(figure, file_format))
        paths.append(path)
    return paths


def _path(folder: Path, drawing: Drawing, file_format: str) -> Path:
    return folder / f"{drawing.name}.{file_format}"


def _require_known(formats: Sequence[str]) -> None:
    for file_format in formats:
        if file_format not in FORMATS:
            raise InputError(
                "figures",
                f"format {file_format!r}",
                f"known are {', '.join(FORMATS)}",
                "Choose one of them",
            )


def _require_free(folder: Path, figures: Sequence[Drawing], formats: Sequence[str]) -> None:
    """Refuse before the first figure is drawn, not after half of them are replaced."""
    for drawing in figures:
        for file_format in formats:
            path = _path(folder, drawing, file_format)
            if path.exists():
                raise InputError(
                    str(path),
                    "the file already exists",
                    "figures are replaced with --force only",
                    "Choose another folder, or use --force",
                )


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            str(folder),
            os.strerror(error.errno) if error.errno else str(error),
            "the folder for the figures could not be made",
            "Check permissions, or choose another place",
        ) from error
