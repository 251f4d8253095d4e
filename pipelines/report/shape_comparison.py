"""A comparison of shapes as one HTML page that needs no network."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipelines.compare.shape_comparison import (
    MATCH_HEAD,
    PAIR_PERCENT,
    SAME,
    SIMILAR,
    TEXTS,
    Likeness,
    ShapeComparison,
    match_rows,
)
from pipelines.plots.chart import Chart
from pipelines.plots.charts_matrix import mac_chart
from pipelines.report.blocks import Listing, Paragraph, Section, Table
from pipelines.report.page import render_page
from pipelines.results.labels import short

_MOST_SHOWN = 30  # more columns cannot be read
_WORTH_SHOWING = 0.1

HOW_TO_READ = (
    "Frequency differences are other minus result. A scale, sign or phase of a whole shape does "
    "not matter to the MAC, nor whether shapes are real or complex.",
    "MAC with pair: the modes of a symmetric ring come in pairs of one frequency, and a model may "
    "turn them around the tyre at will. Each shape is then compared with the best sum of the "
    f"other's modes within {PAIR_PERCENT:g} % of the frequency of its best match.",
    f"Same shape: a MAC of {SAME:g} or more, alone or with its pair. Similar: {SIMILAR:g} or more.",
)


def write_page(found: ShapeComparison, path: Path) -> None:
    """Write the page: best matches, the matrix, and how places were matched."""
    subject = f"{found.result.name} → {found.other.name}"
    page = render_page("Comparison of shapes", subject, sections(found))
    path.write_text(page, encoding="utf-8", newline="\n")


def sections(found: ShapeComparison) -> tuple[Section, ...]:
    """All sections of the page in their order."""
    return (
        Section("matches", "Best matches", (Paragraph(verdict(found)), _table(found))),
        Section("matrix", "MAC of all shapes", (_matrix(found),)),
        Section(
            "places", "Places and directions", (Listing(tuple(f"{note}." for note in found.notes)),)
        ),
        Section("reading", "How to read it", (Listing(HOW_TO_READ),)),
    )


def verdict(found: ShapeComparison) -> str:
    """How many modes have a counterpart, in a sentence."""
    same = sum(match.verdict is Likeness.SAME_SHAPE for match in found.matches)
    return (
        f"{same} of {len(found.matches)} modes of {found.result.name} have the same shape as a "
        f"mode of {found.other.name}."
    )


def _table(found: ShapeComparison) -> Table:
    words = tuple(place for place, heading in enumerate(MATCH_HEAD) if heading in TEXTS)
    caption = f"Each mode of {found.result.name} with the shape of {found.other.name} most like it."
    return Table(caption, MATCH_HEAD, tuple(match_rows(found)), words)


def _matrix(found: ShapeComparison) -> Chart:
    shown = _columns(found)
    n_other = found.mac.shape[1]
    left_out = "" if shown.size == n_other else f" {shown.size} of {n_other} are shown."
    names = found.result.name, found.other.name
    return mac_chart(
        found.mac[:, shown],
        found.result.mode_name,
        [found.other.mode_name[column] for column in shown],
        name="mac-shapes",
        titles=(short(names[0]), short(names[1])),
        alternative=f"MAC of the shapes of {names[0]} with {shown.size} of {names[1]}.",
        caption="MAC of all shapes. A shape and its counterpart are close to 1; where the other "
        f"modes are a pair, the two share it.{left_out}",
    )


def _columns(found: ShapeComparison) -> NDArray[np.intp]:
    """Other modes that resemble a mode of the result, the best ones where there are many."""
    best = found.mac.max(axis=0)
    if best.size <= _MOST_SHOWN:
        return np.arange(best.size)
    chosen = np.flatnonzero(best >= _WORTH_SHOWING)
    if chosen.size > _MOST_SHOWN:
        chosen = np.sort(chosen[np.argsort(-best[chosen])[:_MOST_SHOWN]])
    return chosen
