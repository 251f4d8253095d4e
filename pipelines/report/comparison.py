"""The pages that compare results: two in detail, or several side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ema.core.display import DASH, value_with_std
from ema.core.modes import Mode
from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.compare import shape_comparison as shapes
from pipelines.compare import summary as tables
from pipelines.compare.compare import Comparison
from pipelines.compare.modes import MatchedMode
from pipelines.compare.significance import Difference
from pipelines.compare.summary import CAUTION, METHOD, change_text, findings, percent_text
from pipelines.plots.chart import Chart
from pipelines.plots.comparison import (
    change_chart,
    cross_mac_chart,
    frf_charts,
    several_changes_chart,
)
from pipelines.plots.modes import matrix_chart
from pipelines.report.page import (
    PLAIN,
    Block,
    Facts,
    Listing,
    Paragraph,
    Section,
    Table,
    render_page,
)
from pipelines.report.summary import DEFINITIONS, input_files
from pipelines.results.options import with_unit
from pipelines.results.tables import each_once, short
from pipelines.storage.atomic import file_written_whole, require_free_file

SHOWN_ANGLES_DEG = (0.0, 100.0)  # at the force, and where the literature on this test shows FRFs
WORDS = ("Inertance", "Pole, frequency, damping ratio", "Order n", "MAC, AutoMAC", "±")

_MOST_SHOWN = 30  # more columns cannot be read
_WORTH_SHOWING = 0.1  # MAC
HOW_TO_READ = (
    "Frequency differences are other minus result. A scale, sign or phase of a shape does "
    "not matter to the MAC, nor whether shapes are real or complex.",
    "MAC with pair: the modes of a symmetric ring come in pairs of one frequency, and a model may "
    "turn them around the tyre at will. Each shape is then compared with the best sum of the "
    f"other's modes within {shapes.PAIR_PERCENT:g} % of the frequency of its best match.",
    f"Same shape: a MAC of {shapes.SAME:g} or more, alone or with its pair. "
    f"Similar: {shapes.SIMILAR:g} or more.",
)
_MARK = " *"  # behind a significant change
_HOW = "Changes are against the first result, in percent; * marks those that are significant."


def comparison_sections(comparison: Comparison) -> tuple[Section, ...]:
    """All sections of the page in their order; none is empty."""
    words = tuple((word, DEFINITIONS[word]) for word in WORDS)
    unknown = Paragraph(comparison.shapes_note, "warning")
    sections = (
        _summary(comparison),
        _compared(comparison),
        *_changes(comparison),
        Section("shapes", "Shapes", (cross_mac_chart(comparison) or unknown,)),
        Section("responses", "Measured FRFs", frf_charts(comparison, SHOWN_ANGLES_DEG)),
        _parameters(comparison),
        Section("method", "How differences are tested", (Listing(METHOD), Facts(words))),
        _origin(comparison),
    )
    return tuple(section for section in sections if section.blocks)


def render_comparison(comparison: Comparison) -> str:
    """Render a comparison as one HTML page."""
    subject, sections = " → ".join(comparison.names), comparison_sections(comparison)
    return render_page("Comparison of two results", subject, sections, PLAIN)


def write_comparison(comparison: Comparison, path: Path | str, *, force: bool = False) -> Path:
    """Write the page to `path`, atomically, and return the path.

    Raises
    ------
    InputError
        If the file exists and may not be replaced, or cannot be written.
    """
    target = Path(path)
    require_free_file(target, force=force)
    page = render_comparison(comparison)
    with file_written_whole(target) as partial:
        partial.write_text(page, encoding="utf-8")
    return target


def _summary(comparison: Comparison) -> Section:
    counts = (
        f"{len(comparison.modes)} in both, {len(comparison.only_first)} in the first only, "
        f"{len(comparison.only_second)} in the second only"
    )
    first, second = (
        f"{name}, processed {created}" if (created := each.provenance.get("created")) else name
        for name, each in zip(comparison.names, (comparison.first, comparison.second), strict=True)
    )
    facts = Facts((("First", first), ("Second", second), ("Modes", counts)))
    doubts = (Listing(comparison.doubts, "warning"),) if comparison.doubts else ()
    blocks = (facts, *doubts, Listing(findings(comparison)), Paragraph(CAUTION))
    return Section("summary", "Summary", blocks)


def _compared(comparison: Comparison) -> Section:
    alike = not any(each.differs for each in comparison.processing)
    head, words = tables.CONTRAST_HEAD[1:], (0, 1, 2, 3)
    conditions = tables.contrast_rows(comparison.conditions)
    processing = tables.contrast_rows(comparison.processing)
    caption = f"Processing{': the same for both' if alike else ''}"
    blocks = (
        Table("Tyre, conditions and set-up", ("tyre and conditions", *head), conditions, words),
        Table(caption, ("processing", *head), processing, words, alike),
    )
    return Section("compared", "What is compared", blocks)


def _changes(comparison: Comparison) -> tuple[Section, ...]:
    """Frequencies and damping ratios of the modes that both results have."""
    modes = comparison.modes
    if not modes:
        return ()
    chart = change_chart("frequency-change", "frequency", modes, [m.frequency for m in modes])
    table = _mode_table("Frequencies", "Hz", tables.frequency_rows(comparison))
    frequencies: tuple[Block, ...] = (chart, table, *_remarks(modes), *_unmatched(comparison))
    chart = change_chart("damping-change", "damping ratio", modes, [m.damping for m in modes])
    table = _mode_table("Damping ratios", "%", tables.damping_rows(comparison))
    note = Paragraph(
        "Damping ratios are in percent of critical damping. The relative change is in percent of "
        "the first ratio: from 2.00 % to 2.10 % it is +5 %."
    )
    return (
        Section("frequencies", "Frequencies", frequencies),
        Section("damping", "Damping", (chart, table, note)),
    )


def _mode_table(caption: str, unit: str, rows: tuple[tables.Row, ...]) -> Table:
    mode, first, second, change, *others = tables.MODE_HEAD
    with_unit = (f"{title} / {unit}" for title in (first, second, change))
    return Table(caption, (mode, *with_unit, *others), rows, words=(0, 7))


def _remarks(modes: Sequence[MatchedMode]) -> tuple[Listing, ...]:
    """One line for each remark, with all modes that it concerns."""
    names: dict[str, list[str]] = {}
    for mode in modes:
        if mode.remark:
            names.setdefault(mode.remark, []).append(mode.name)
    lines = tuple(f"{', '.join(concerned)}: {remark}." for remark, concerned in names.items())
    return (Listing(lines),) if lines else ()


def _unmatched(comparison: Comparison) -> tuple[Table, ...]:
    only = comparison.only_first, comparison.only_second
    rows = tuple(
        (name, mode.name, f"{mode.mode.frequency_hz:.2f}", mode.reason)
        for name, modes in zip(comparison.names, only, strict=True)
        for mode in modes
    )
    head = ("only in", "mode", "frequency / Hz", "why the other may lack it")
    return (Table("Modes without a partner", head, rows, words=(0, 1, 3)),) if rows else ()


def _parameters(comparison: Comparison) -> Section:
    caption, rows = "Ring and damping parameters", tables.parameter_rows(comparison)
    tested: tuple[Block, ...] = (
        Table(caption, tables.PARAMETER_HEAD, rows, words=(0, 6)),
        Paragraph(
            "Given parameters and those that the frequencies do not determine are shown but not "
            "tested. All stiffnesses, masses and damping values are per unit of belt width."
        ),
    )
    missing = "One or both results have no ring parameters: there is nothing to compare."
    return Section("parameters", "Ring parameters", tested if rows else (Paragraph(missing),))


def _origin(comparison: Comparison) -> Section:
    results = (comparison.first, comparison.second)
    software = [result.provenance.get("software", {}) for result in results]
    rows = tuple(
        (name, *(str(versions.get(name, DASH)) for versions in software))
        for name in dict.fromkeys([*software[0], *software[1]])
    )
    files = [
        replace(input_files(result), caption=f"Input files of {name}", folded=True)
        for name, result in zip(comparison.names, results, strict=True)
    ]
    tables = (Table("Software", ("", "first", "second"), rows, (0, 1, 2)), *files)
    return Section("origin", "Software and inputs", tuple(each for each in tables if each.rows))


def write_shape_comparison(found: shapes.ShapeComparison, path: Path) -> None:
    """Write the page: best matches, the matrix, and how places were matched."""
    subject = f"{found.result.name} → {found.other.name}"
    page = render_page("Comparison of shapes", subject, shape_sections(found))
    path.write_text(page, encoding="utf-8", newline="\n")


def shape_sections(found: shapes.ShapeComparison) -> tuple[Section, ...]:
    """All sections of the page in their order."""
    result, other = found.result.name, found.other.name
    same = sum(match.verdict is shapes.Likeness.SAME_SHAPE for match in found.matches)
    count = f"{same} of {len(found.matches)} modes of {result} have the same shape as a mode of"
    words = tuple(
        place for place, heading in enumerate(shapes.MATCH_HEAD) if heading in shapes.TEXTS
    )
    caption = f"Each mode of {result} with the shape of {other} most like it."
    matches = Table(caption, shapes.MATCH_HEAD, tuple(shapes.match_rows(found)), words)
    places = Listing(tuple(f"{note}." for note in found.notes))
    return (
        Section("matches", "Best matches", (Paragraph(f"{count} {other}."), matches)),
        Section("matrix", "MAC of all shapes", (_matrix(found),)),
        Section("places", "Places and directions", (places,)),
        Section("reading", "How to read it", (Listing(HOW_TO_READ),)),
    )


def _matrix(found: shapes.ShapeComparison) -> Chart:
    # Columns that resemble a mode of the result, the best ones where there are many.
    best, n_other = found.mac.max(axis=0), found.mac.shape[1]
    shown = np.arange(n_other)
    if n_other > _MOST_SHOWN:
        highest = np.argsort(-best)[:_MOST_SHOWN]
        shown = np.sort(highest[best[highest] >= _WORTH_SHOWING])
    left_out = "" if shown.size == n_other else f" {shown.size} of {n_other} are shown."
    names = found.result.name, found.other.name
    return matrix_chart(
        found.mac[:, shown],
        found.result.mode_name,
        [found.other.mode_name[column] for column in shown],
        name="mac-shapes",
        titles=(short(names[0]), short(names[1])),
        alternative=f"MAC of the shapes of {names[0]} with {shown.size} of {names[1]}.",
        caption="MAC of all shapes. A shape and its counterpart are close to 1; where the other "
        f"modes are a pair, the two share it.{left_out}",
    )


# By number and name of the mode in the first, as the mean of a pair is not its member, then by
# comparison.
Rows = dict[tuple[int, str], dict[int, MatchedMode]]


def write_comparisons(
    comparisons: Sequence[Comparison], path: Path, *, force: bool = False
) -> Path:
    """Write the page of several comparisons with the same first result, and return its path."""
    require_free_file(path, force=force)
    names = result_names(comparisons)
    sections = several_sections(comparisons)
    page = render_page(f"Comparison of {len(names)} results", ", ".join(names), sections, PLAIN)
    with file_written_whole(path) as partial:
        partial.write_text(page, encoding="utf-8")
    return path


def result_names(comparisons: Sequence[Comparison]) -> list[str]:
    """Names of the results, the first one first; each is used once."""
    return each_once([comparisons[0].names[0], *(each.names[1] for each in comparisons)])


def several_sections(comparisons: Sequence[Comparison]) -> tuple[Section, ...]:
    """Findings, frequencies, damping and parameters, and how differences are tested."""
    names = result_names(comparisons)
    rows: Rows = {}
    for place, comparison in enumerate(comparisons):
        for mode in comparison.modes:
            rows.setdefault((mode.first_number, mode.name), {})[place] = mode
    rows = dict(sorted(rows.items()))
    told: list[Block] = []
    for name, each in zip(names[1:], comparisons, strict=True):
        told += [Paragraph(f"{name} against {names[0]}:"), Listing(findings(each))]
        told += [Listing(each.doubts, "warning")] if each.doubts else []
    quantities = (
        ("Frequencies", "frequency", "Hz", lambda mode: mode.frequency, _frequency),
        ("Damping ratios", "damping ratio", "%", lambda mode: mode.damping, _damping),
    )
    return (
        *(_quantity(names, rows, *each) for each in quantities),
        _parameters_of_all(names, comparisons),
        Section("findings", "Findings", (*told, Paragraph(CAUTION))),
        Section("method", "How differences are tested", (Listing(METHOD),)),
    )


def _frequency(mode: Mode) -> str:
    return value_with_std(mode.frequency_hz, mode.frequency_std_hz)


def _damping(mode: Mode) -> str:
    return value_with_std(100 * mode.damping_ratio, 100 * mode.damping_std)


def _quantity(
    names: Sequence[str],
    rows: Rows,
    title: str,
    quantity: str,
    unit: str,
    difference: Callable[[MatchedMode], Difference],
    value: Callable[[Mode], str],
) -> Section:
    """Chart and table of one quantity of the modes."""
    anchor = quantity.split()[0]
    labels = [next(iter(found.values())).name for found in rows.values()]
    changes = [
        [difference(found[place]) if place in found else None for found in rows.values()]
        for place in range(len(names) - 1)
    ]
    chart = several_changes_chart(f"{anchor}-changes", quantity, labels, names[1:], changes)
    cells = [
        (
            label,
            value(next(iter(found.values())).first),
            *(_cell(found.get(place), difference) for place in range(len(names) - 1)),
        )
        for label, found in zip(labels, rows.values(), strict=True)
    ]
    head = ("mode", f"{short(names[0])} / {unit}", *(f"{short(n)}, change / %" for n in names[1:]))
    table = Table(title, head, tuple(cells), (0,))
    return Section(anchor, title, (chart, table, Paragraph(_HOW)))


def _cell(found: MatchedMode | None, difference: Callable[[MatchedMode], Difference]) -> str:
    if found is None:
        return DASH
    change = difference(found)
    return percent_text(change) + (_MARK if change.is_significant else "")


def _parameters_of_all(names: Sequence[str], comparisons: Sequence[Comparison]) -> Section:
    by_name = [{change.name: change for change in each.parameters} for each in comparisons]
    rows = []
    units = comparisons[0].units
    for name, (title, symbol, si_unit) in (RING_NAMES | DAMPING_NAMES).items():
        found = [changes.get(name) for changes in by_name]
        known = [each for each in found if each is not None]
        if not known:
            continue
        value, std, unit = with_unit(known[0].difference.first, known[0].first_std, si_unit, units)
        first = value_with_std(value, std)
        cells = [
            DASH
            if each is None
            else change_text(each)
            + (_MARK if each.is_tested and each.difference.is_significant else "")
            for each in found
        ]
        rows.append((f"{title} {symbol}", unit, first, *cells))
    head = ("parameter", "unit", short(names[0]), *(f"{short(n)}, change / %" for n in names[1:]))
    text = f"{_HOW} A dash: one of the two does not determine the parameter."
    blocks = (Table("Ring and damping parameters", head, tuple(rows), (0, 1)), Paragraph(text))
    none = (Paragraph("None of the results has ring parameters."),)
    return Section("parameters", "Ring parameters", blocks if rows else none)
