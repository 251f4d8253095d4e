"""Sections at both ends of the report: summary, warnings, origin, definitions."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ema.core.finding import Verdict
from pipelines.plots.measurement import reference_verdict
from pipelines.report.measurement import flatten
from pipelines.report.page import Facts, Listing, Paragraph, Section, Table
from pipelines.results.result import Result

_TEXTS = tomllib.loads(Path(__file__).with_name("definitions.toml").read_text(encoding="utf-8"))
DEFINITIONS: dict[str, str] = _TEXTS["definitions"]


def summary(result: Result) -> Section:
    """The main results in a few lines."""
    frac = result.modal_model.frac
    fit = f"median FRAC {np.median(frac):.4f}, lowest {np.min(frac):.4f}"
    verdicts = [finding.verdict for finding in result.findings]
    concerns = (
        ("warnings on data", verdicts.count(Verdict.WARNING)),
        ("channels or runs excluded", verdicts.count(Verdict.EXCLUDED)),
        ("modes with a remark", sum(mode.doubtful for mode in result.modal_model.modes)),
    )
    attention = "; ".join(f"{what}: {count}" for what, count in concerns if count)
    ring = "left out"
    if result.validation is not None:
        error = np.abs(result.validation.error_percent)
        worst = int(np.argmax(error))
        ring = f"largest deviation {error[worst]:.2f} % at n = {result.validation.order[worst]}"
    check = result.reference
    rows = (
        ("Modes", _modes_found(result)),
        ("Fit", fit),
        *([] if check is None else [("Reference sensor", reference_verdict(check))]),
        ("Ring model", ring),
        ("Attention", attention or "nothing"),
    )
    return Section("summary", "Summary", (Facts(rows),))


def warnings(result: Result) -> Section:
    """Notes that no other section has."""
    listing = listed(remaining_notes(result))
    none = Paragraph("Nothing beyond the notes on modes, ring and data quality.")
    return Section("notes", "Warnings and notes", listing or (none,))


def origin(result: Result) -> Section:
    """Software and input files."""
    provenance = result.provenance
    created = (("Processed", str(provenance["created"])),) if "created" in provenance else ()
    software = tuple(flatten(provenance.get("software", {})).items())
    times = tuple(
        (stage, f"{seconds:.2f}") for stage, seconds in provenance.get("stage_seconds", {}).items()
    )
    blocks = (
        Facts((*created, *software)),
        input_files(result),
        Table("Time of each stage", ("stage", "time / s"), times, (0,), folded=True),
    )
    return Section("origin", "Software and inputs", tuple(each for each in blocks if each.rows))


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


def _modes_found(result: Result) -> str:
    modes = result.modal_model.modes
    low, high = result.modal_model.band_hz
    band = f"between {low:.4g} and {high:.4g} Hz"
    if not modes:
        return f"none {band}"
    text = f"{len(modes)} {band}"
    orders = sorted({mode.order for mode in modes if mode.order is not None})
    return f"{text}, orders {', '.join(map(str, orders))}" if orders else text


def listed(notes: Sequence[str]) -> tuple[Listing, ...]:
    """The notes as a list; nothing where there are none."""
    return (Listing(tuple(notes)),) if notes else ()


def remaining_notes(result: Result) -> tuple[str, ...]:
    """Notes that no other section shows: those of neither modes nor ring nor damping."""
    shown = set(result.modal_model.notes)
    for part in (result.tuning, result.damping):
        shown |= set(part.notes) if part is not None else set()
    return tuple(note for note in dict.fromkeys(result.notes) if note not in shown)
