"""What the command line says of an update of a tyre property file, and of a ring out of one."""

from __future__ import annotations

from typing import Any

from pipelines.console import complain, print_json, say, screen
from pipelines.console_tables import Column, print_table
from pipelines.numbers import DASH, signed
from pipelines.tir_ring import RingFromTir
from pipelines.tir_update import TirChange, TirUpdate


def show_update(update: TirUpdate, source: str) -> None:
    """Print old and new values in the file's units, what stays, and why."""
    changes = update.changes
    columns = (
        Column("key", [change.key for change in changes], is_text=True),
        Column("line", [str(change.line or "new") for change in changes]),
        Column("old", [_shown(change.old) for change in changes]),
        Column("new", [_shown(change.new) for change in changes]),
        Column("±", [_shown(change.std, 2) for change in changes]),
        Column("in %", [_percent(change) for change in changes]),
        Column("unit", [change.unit for change in changes], is_text=True),
        Column("from", [change.basis for change in changes], is_text=True, folds=True),
    )
    say(f"{update.before.name} from {source}:")
    if changes:
        print_table(screen(), "", columns)
    if update.unchanged:
        say(f"Up to date: {', '.join(update.unchanged)}")
    if update.missing:
        say(f"Not in the file: {', '.join(update.missing)}; --add adds them")
    for key, reason in update.open_ones.items():
        say(f"Not determined: {key}: {reason}")
    for reason, keys in update.left_alone.items():
        say(f"Left alone: {', '.join(keys)}: {reason}")
    for note in update.notes:
        complain(f"Note: {note}")


def update_content(update: TirUpdate, source: str) -> dict[str, Any]:
    """An update for programs."""
    return {
        "source": source,
        "changes": [_change_content(change) for change in update.changes],
        "unchanged": update.unchanged,
        "missing": update.missing,
        "not_determined": dict(update.open_ones),
        "left_alone": {key: why for why, keys in update.left_alone.items() for key in keys},
        "notes": update.notes,
    }


def show_ring(made: RingFromTir, out: str | None, *, as_json: bool) -> None:
    """Print the parameters of a ring out of a tyre property file."""
    from pipelines.console_tyre import show_parameters

    if as_json:
        ring = {
            name: {"value": entry.value, "how": entry.how}
            for name, entry in made.parameters.ring.items()
        }
        content = {"conditions": made.parameters.conditions, "ring": ring, "notes": made.notes}
        print_json({"file": out, "designation": made.parameters.designation, **content})
        return
    show_parameters(made.parameters)
    for note in made.notes:
        complain(f"Note: {note}")
    if out:
        say(f"Written: {out}")


def _shown(value: float | None, digits: int = 6) -> str:
    """A value much as it stands in the file."""
    return DASH if value is None else f"{value:.{digits}g}"


def _percent(change: TirChange) -> str:
    return DASH if change.percent is None else signed(change.percent, 1)


def _change_content(change: TirChange) -> dict[str, Any]:
    return {
        "key": change.key,
        "section": change.section,
        "line": change.line,
        "old": change.old,
        "new": change.new,
        "std": change.std,
        "percent": change.percent,
        "unit": change.unit,
        "from": change.basis,
        "not_identified": change.doubts,
    }
