"""Sections at the end of the report: warnings, origin and options, definitions."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

from pipelines.report.measurement import flatten, not_stated
from pipelines.report.page import Facts, Listing, Paragraph, Section, Table
from pipelines.results.result import Result

_TEXTS = tomllib.loads(Path(__file__).with_name("definitions.toml").read_text(encoding="utf-8"))
DEFINITIONS: dict[str, str] = _TEXTS["definitions"]


def warnings(result: Result) -> Section:
    """Notes that no other section has."""
    listing = listed(remaining_notes(result))
    none = Paragraph("Nothing beyond the notes on modes, ring and data quality.")
    return Section("notes", "Warnings and notes", listing or (none,))


def origin(result: Result) -> Section:
    """Software, input files, options, and what the manifest does not state."""
    provenance = result.provenance
    options = tuple(flatten(provenance.get("options", {})).items())
    created = (("Processed", str(provenance["created"])),) if "created" in provenance else ()
    software = tuple(flatten(provenance.get("software", {})).items())
    times = tuple(
        (stage, f"{seconds:.2f}") for stage, seconds in provenance.get("stage_seconds", {}).items()
    )
    blocks = (
        Facts((*created, *software, *not_stated(result.tyre))),
        input_files(result),
        Table("Options in force", ("option", "value"), options, (0, 1), folded=True),
        Table("Time of each stage", ("stage", "time / s"), times, (0,), folded=True),
    )
    return Section(
        "origin", "Software, inputs and options", tuple(each for each in blocks if each.rows)
    )


def input_files(result: Result) -> Table:
    """The files that were read; no rows where they are not known."""
    rows = tuple(
        (str(entry["file"]), str(entry["bytes"]), str(entry["sha256"]))
        for entry in result.provenance.get("inputs", ())
    )
    return Table("Input files", ("file", "bytes", "SHA-256"), rows, (0, 2))


def definitions(_result: Result) -> Section:
    """Terms and references."""
    blocks = Facts(tuple(DEFINITIONS.items())), Listing(tuple(_TEXTS["references"]))
    return Section("definitions", "Definitions and references", blocks)


def listed(notes: Sequence[str]) -> tuple[Listing, ...]:
    """The notes as a list; nothing where there are none."""
    return (Listing(tuple(notes)),) if notes else ()


def remaining_notes(result: Result) -> tuple[str, ...]:
    """Notes that no other section shows: those of neither modes nor ring nor damping."""
    shown = set(result.modal_model.notes)
    for part in (result.tuning, result.damping):
        shown |= set(part.notes) if part is not None else set()
    return tuple(note for note in dict.fromkeys(result.notes) if note not in shown)
