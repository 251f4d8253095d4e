"""The first screen of the report and its last: verdict, modes, parameters; where all came from."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ema.core.display import DASH, band_text, counted, value_with_std
from ema.core.modes import ModalModel
from model.identifiability import AT_BOUND, GIVEN, NOT_IDENTIFIED
from model.parameters import DAMPING_NAMES, RING_NAMES
from pipelines.plots.measurement import reference_verdict
from pipelines.report.measurement import flatten, not_stated
from pipelines.report.page import (
    Alone,
    Beside,
    Block,
    Facts,
    Lamp,
    Listing,
    Paragraph,
    Pointer,
    Section,
    Table,
)
from pipelines.results.options import Units, parameter_rows
from pipelines.results.result import Result
from pipelines.results.verdict import (
    SIGNS,
    Remark,
    judge,
    order_is_mixed,
    orders_in_doubt,
    ring_is_usable,
)

_MOST_REMARKS = 3
_MOST_MODES = 14  # rows that fit on the first screen
_TITLES = {  # of the sections that a remark leads to
    "quality": "data quality",
    "stability": "stability diagram",
    "modes": "modes",
    "frf": "FRFs",
    "parameters": "ring parameters",
}
_TEXTS = tomllib.loads(Path(__file__).with_name("definitions.toml").read_text(encoding="utf-8"))
DEFINITIONS: dict[str, str] = _TEXTS["definitions"]


def summary(result: Result, units: Units = Units.LAB) -> Section:
    """Verdict, the most important remarks, and the tables of modes and parameters in short."""
    overall = judge(result)
    blocks: list[Block] = [
        Lamp(overall.state, SIGNS[overall.state], overall.line),
        *_remarks(overall.remarks),
    ]
    tables = (_modes(result), *_ring(result, units))
    blocks.append(Beside(tuple(each for each in tables if each is not None)))
    return Section("summary", "Summary", (*blocks, Paragraph(_basis(result))))


def _remarks(remarks: tuple[Remark, ...]) -> tuple[Block, ...]:
    if not remarks:
        return (Paragraph("Nothing stands out."),)
    shown = [Pointer(each.text, each.section, _TITLES[each.section]) for each in remarks]
    listing = Listing(tuple(shown[:_MOST_REMARKS]), "findings")
    more = Listing(tuple(shown[_MOST_REMARKS:]), "findings", f"{len(shown) - _MOST_REMARKS} more")
    return (listing, more) if more.items else (listing,)


def _modes(result: Result) -> Alone | None:
    """Modes with ± and pair; orders only where they can be trusted."""
    model = result.modal_model
    if not model.modes:
        return None
    columns = _columns(model, with_orders=not orders_in_doubt(result))
    columns = {title: cells for title, cells in columns.items() if set(cells) != {DASH}}
    head, n_modes = tuple(columns), len(model.modes)
    rows = tuple(zip(*columns.values(), strict=True))[:_MOST_MODES]
    words = tuple(head.index(name) for name in ("pair", "status") if name in head)
    more = f"; {_MOST_MODES} of {n_modes}, all are below" if n_modes > _MOST_MODES else ""
    return Table(f"Modes, {band_text(model.band_hz)}{more}", head, rows, words)


def _columns(model: ModalModel, *, with_orders: bool) -> dict[str, list[str]]:
    modes = model.modes
    known = [with_orders and m.order is not None and not order_is_mixed(m) for m in modes]
    return {
        "order" if any(known) else "mode": [
            f"{mode.order}{mode.member}" if is_known else DASH if any(known) else str(number)
            for number, (mode, is_known) in enumerate(zip(modes, known, strict=True), 1)
        ],
        "frequency / Hz": [value_with_std(m.frequency_hz, m.frequency_std_hz, 5) for m in modes],
        "damping / %": [
            value_with_std(100 * m.damping_ratio, 100 * m.damping_std, 3) for m in modes
        ],
        "pair": [m.pair.value or DASH if with_orders else DASH for m in modes],
        "status": [m.status if m.doubtful else DASH for m in modes],
    }


def _ring(result: Result, units: Units) -> tuple[Alone, ...]:
    """Parameters with ± that may be trusted; those that may not are named without a value."""
    tuning, damping = result.tuning, result.damping
    if tuning is None:
        return ()
    if not ring_is_usable(result):
        text = "Ring parameters are withheld: see the findings above."
        return (Paragraph(text, "bad"),)
    rows = parameter_rows(tuning.ring, tuning, RING_NAMES, units)
    if damping is not None:
        rows += parameter_rows(damping.damping, damping, DAMPING_NAMES, units)
    shown = tuple(map(_row, rows))
    return (Table("Ring parameters", ("parameter", "value", "unit"), shown, (0, 2)),)


def _row(row: tuple[str, str, str, str, str]) -> tuple[str, ...]:
    title, symbol, value, unit, how = row
    if how in (NOT_IDENTIFIED, AT_BOUND):
        return f"{title} {symbol}", how, ""
    return f"{title} {symbol}{', given' if how == GIVEN else ''}", value, unit


def _basis(result: Result) -> str:
    """What the result rests on, in a line."""
    model = result.modal_model
    parts = [counted(result.frf.n_positions, "position")]
    if model.frac.size:
        parts.append(f"FRAC {np.median(model.frac):.4f} (median), {np.min(model.frac):.4f} lowest")
    if result.reference is not None:
        parts.append(f"reference sensor: {reference_verdict(result.reference)}")
    if result.tuning is not None and ring_is_usable(result):
        parts.append(f"pressure as {result.tuning.pressure_load} load")
    return f"{'; '.join(parts)}. ± is one standard deviation."


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
