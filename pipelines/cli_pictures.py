"""Figures and PDF that a command writes beside its result: refused early, written late."""

from __future__ import annotations

from pathlib import Path

from ema.errors import InputError


def require_pictures(figures: Path | None, result_folder: Path, *, force: bool) -> None:
    """Refuse a folder for figures before an hour of processing, not after.

    Raises
    ------
    InputError
        If it lies in the result's own folder, or holds pictures and may not be replaced.
    """
    if figures is None:
        return
    if figures.resolve().is_relative_to(result_folder.resolve()):
        raise InputError(
            f"--figures {figures}",
            "inside the result's folder",
            "that holds the files of the result alone",
            "Choose a folder beside it",
        )
    if not force and any(any(figures.glob(f"*.{ending}")) for ending in ("png", "svg")):
        raise InputError(
            f"--figures {figures}",
            "earlier pictures",
            "they are not overwritten unasked",
            "Choose another folder, or replace them with --force",
        )


def require_pdf(*, pdf: bool) -> None:
    """Refuse to make a PDF where what prints it is missing.

    Raises
    ------
    InputError
        Says what to install.
    """
    if not pdf:
        return
    from pipelines.report.paper import printing_library

    printing_library("--pdf")
