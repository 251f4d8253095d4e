"""What makes a comparison doubtful, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

from pipelines.compare.conditions import BAND, NO_TYRE, Contrast, same_recordings
from pipelines.compare.modes import LOWEST_MAC, MatchedMode
from pipelines.results.check import accepted_notes
from pipelines.results.labels import short
from pipelines.results.result import Result


def doubts(
    first: Result,
    second: Result,
    modes: Sequence[MatchedMode],
    conditions: Sequence[Contrast],
    processing: Sequence[Contrast],
) -> tuple[str, ...]:
    """Say what a reader must know before he takes a difference for an effect."""
    return (
        *_accepted_changes(first, second),
        *_same_data(first, second),
        *_other_tyre(first, second),
        *_other_boundary(conditions),
        *_other_band(first, second),
        *_other_processing(processing),
        *_other_shapes(modes),
        *_nothing_tested(modes),
    )


def _accepted_changes(first: Result, second: Result) -> list[str]:
    sides = (first, "The first result"), (second, "The second result")
    return [f"{note}." for each, name in sides for note in accepted_notes(each.provenance, name)]


def _same_data(first: Result, second: Result) -> list[str]:
    if not same_recordings(first, second):
        return []
    return [
        "Both results rest on the same recordings. Their noise is common and mostly drops out of "
        "the differences: σ is too large, z too small. What is left is the processing."
    ]


def _other_tyre(first: Result, second: Result) -> list[str]:
    one, two = (NO_TYRE if each.tyre is None else each.tyre.designation for each in (first, second))
    if one == two:
        return []
    return [
        f"Different tyres: {short(one)} and {short(two)}. Differences are those of construction "
        "and of everything else that was changed."
    ]


def _other_boundary(conditions: Sequence[Contrast]) -> list[str]:
    return [
        f"The tyre was held differently: {each.change}. This alone moves the low orders."
        for each in conditions
        if each.boundary and each.differs
    ]


def _other_band(first: Result, second: Result) -> list[str]:
    one, two = first.modal_model.band_hz, second.modal_model.band_hz
    if one == two:
        return []
    return [
        f"Different bands: {one[0]:g} to {one[1]:g} Hz and {two[0]:g} to {two[1]:g} Hz. What the "
        "ends of the band do to each mode is counted in σ; modes outside one band have no partner."
    ]


def _other_processing(processing: Sequence[Contrast]) -> list[str]:
    differing = [
        each.name for each in processing if each.counts and each.differs and each.name != BAND
    ]
    if not differing:
        return []
    return [
        f"Processed differently ({', '.join(differing)}). Process both alike before small "
        "differences are taken for real."
    ]


def _other_shapes(modes: Sequence[MatchedMode]) -> list[str]:
    unlike = [mode for mode in modes if mode.mac < LOWEST_MAC]
    if not unlike:
        return []
    named = ", ".join(f"{mode.name} (MAC {mode.mac:.2f})" for mode in unlike)
    return [
        f"Shapes differ: {named}. Either these are not the same modes, or the tyre sits turned on "
        "its rim, or the shaker stands elsewhere."
    ]


def _nothing_tested(modes: Sequence[MatchedMode]) -> list[str]:
    if not modes:
        return ["No mode of one result was found in the other."]
    untested = [mode.name for mode in modes if not mode.frequency.std > 0]
    if not untested:
        return []
    return [
        f"σ is unknown for {', '.join(untested)}: their differences cannot be judged. One average "
        "a run gives no σ; shorter blocks do."
    ]
