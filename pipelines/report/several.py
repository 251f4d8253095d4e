"""Several results against the first, as one page: what each one changes, side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ema.core.display import DASH, value_with_std
from ema.core.modes import Mode
from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.compare.compare import Comparison
from pipelines.compare.modes import MatchedMode
from pipelines.compare.significance import Difference
from pipelines.compare.summary import CAUTION, METHOD, change_text, findings, percent_text
from pipelines.plots.comparison import several_changes_chart
from pipelines.report.page import Block, Listing, Paragraph, Section, Table, render_page
from pipelines.report.template import PLAIN
from pipelines.results.labels import each_once, short
from pipelines.storage.atomic import file_written_whole, require_free_file

_MARK = " *"  # behind a significant change
_HOW = "Changes are against the first result, in percent; * marks those that are significant."

Rows = dict[int, dict[int, MatchedMode]]  # by number of the mode in the first, then by comparison


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
            rows.setdefault(mode.first_number, {})[place] = mode
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
        _parameters(names, comparisons),
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


def _parameters(names: Sequence[str], comparisons: Sequence[Comparison]) -> Section:
    by_name = [{change.name: change for change in each.parameters} for each in comparisons]
    rows = []
    for name, (title, symbol, unit) in (RING_NAMES | DAMPING_NAMES).items():
        found = [changes.get(name) for changes in by_name]
        known = [each for each in found if each is not None]
        if not known:
            continue
        first = value_with_std(known[0].difference.first, known[0].first_std)
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
