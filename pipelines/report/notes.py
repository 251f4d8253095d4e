"""Notes of the stages: each stands with what it concerns, the rest at the end."""

from __future__ import annotations

from collections.abc import Sequence

from pipelines.report.blocks import Listing
from pipelines.result import Result


def listed(notes: Sequence[str]) -> tuple[Listing, ...]:
    """The notes as a list; nothing where there are none."""
    return (Listing(tuple(notes)),) if notes else ()


def remaining_notes(result: Result) -> tuple[str, ...]:
    """Notes that no other section shows: those of neither modes nor ring nor damping."""
    shown = set(result.modal_model.notes)
    for part in (result.tuning, result.damping):
        shown |= set(part.notes) if part is not None else set()
    return tuple(note for note in dict.fromkeys(result.notes) if note not in shown)
