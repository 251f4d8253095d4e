"""Section on what a person decided, beside what came out automatically."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import TypeVar

import numpy as np

from ema.checks.corrections import Correction
from ema.core.display import DASH, counted, number, signed, value_with_std
from ema.core.edits import OF_CHANNELS, OF_POLES, Edit, EditKind
from ema.core.finding import Check, Finding
from ema.core.modes import Chosen, Mode
from pipelines.report.page import Block, Listing, Paragraph, Section, Table
from pipelines.report.summary import listed
from pipelines.results.edits_file import EDITS_NAME, Replayed
from pipelines.results.result import AutomaticMode, Result

_SAID = {
    EditKind.KEEP: "keep",
    EditKind.SET_ASIDE: "set aside",
    EditKind.PICK: "pick",
    EditKind.START: "start at",
    EditKind.LOCK: "lock",
    EditKind.ONLY_KEPT: "list nothing but what was kept or picked",
    EditKind.NO_PARTNERS: "add no second pole to an order",
    EditKind.CHANNEL_OUT: "leave out",
    EditKind.CHANNEL_IN: "use",
    EditKind.FLIP: "change the sign of",
    EditKind.GAIN: "multiply",
    EditKind.RUN_OUT: "leave out all of",
    EditKind.ORDER_IS: "give an order to",
    EditKind.SETTINGS: "settings:",
    EditKind.NOTE: "remark",
}
_REPLAYED = {
    Replayed.EXACT: ("Replayed from its record: the same to the last digit.", "good"),
    Replayed.OTHER_INPUTS: (
        "The record was made on other recordings: its decisions were resolved anew on these.",
        "warning",
    ),
    Replayed.OTHER_VERSION: (
        "The record was made by another version: its decisions were resolved anew.",
        "warning",
    ),
    Replayed.OTHER_OUTCOME: (
        "Replayed, but the outcome is not that of the record: other libraries or options.",
        "warning",
    ),
}
_AnyMode = TypeVar("_AnyMode", AutomaticMode, Mode)
# A mode is the same within this share of its half-width.
_SAME = 0.5
_MOST_PLACES = 6
# Moves and growths that a reader must know of: σ, factor of a ±, factor of the misfit.
_FAR, _WIDER, _WORSE = 3.0, 2.0, 1.2


def changed_by_hand(result: Result) -> tuple[Section, ...]:
    """Decisions with what each of them did, and the automatic modes beside the edited ones."""
    if not result.edits:
        return ()
    pairs = tuple(_pairs(result.automatic, result.modal_model.modes))
    replay = f"ringmodal process CAMPAIGN --edits {EDITS_NAME} gives this result again."
    text = f"{counted(len(result.edits), 'decision')} by {_authors(result.edits)}. {replay}"
    blocks: list[Block] = [Paragraph(text)]
    if (replayed := result.provenance.get("replayed")) in set(Replayed):
        blocks.append(Paragraph(*_REPLAYED[Replayed(replayed)]))
    if signed_by := result.provenance.get("signed"):
        said = (
            f"Signed by {signed_by.get('by')}, {signed_by.get('at')}. {signed_by.get('note', '')}"
        )
        blocks.append(Paragraph(said.strip()))
    blocks.append(_decisions(result))
    if worse := tuple(_worse(result, pairs)):
        blocks.append(Listing(worse, "warning"))
    blocks += [_beside(pairs), *listed([*_meaning(pairs), *_other_state(result)])]
    return (Section("by-hand", "Changed by hand", tuple(blocks)),)


def _time(at: str) -> str:
    """A time to the minute, as people write it."""
    return f"{datetime.fromisoformat(at):%Y-%m-%d %H:%M %Z}".strip() if at else ""


def _authors(edits: Sequence[Edit]) -> str:
    return ", ".join(sorted({edit.by for edit in edits if edit.by})) or "somebody unnamed"


def _decisions(result: Result) -> Table:
    rows = tuple(
        (
            str(row),
            _decision(edit),
            _effect(result, edit),
            edit.reason or DASH,
            ", ".join(filter(None, (edit.by, _time(edit.at)))) or DASH,
        )
        for row, edit in enumerate(result.edits, 1)
    )
    head = ("", "decision", "what it changed", "reason", "by")
    return Table("Decisions, in their order", head, rows, words=(1, 2, 3, 4))


def _decision(edit: Edit) -> str:
    named = ""
    if edit.kind in OF_POLES and edit.pole is not None:
        pole = edit.pole
        at = f" of {pole.method or 'model'} order {pole.model_order}" if pole.model_order else ""
        named = f"{pole.frequency_hz:.6g} Hz{at}"
    elif edit.kind in OF_CHANNELS and edit.channel is not None:
        named = " in ".join(filter(None, (edit.channel.channel, edit.channel.run)))
        named += f" against force {edit.channel.reference}" if edit.channel.reference else ""
    elif edit.kind is EditKind.RUN_OUT:
        named = str(edit.run)
    elif edit.kind is EditKind.SETTINGS:
        named = ", ".join(f"{name} = {_plain(value)}" for name, value in edit.settings.items())
    value = {EditKind.GAIN: "by", EditKind.ORDER_IS: ": n ="}.get(edit.kind)
    ending = f" {value} {edit.value:g}" if value and edit.value is not None else ""
    return f"{_SAID[edit.kind]} {named}{ending}".strip()


def _plain(value: object) -> str:
    return " to ".join(map(number, value)) if isinstance(value, list | tuple) else str(value)


def _effect(result: Result, edit: Edit) -> str:
    """What one decision did, as far as it can be told from the result."""
    if edit.kind in OF_POLES and edit.pole is not None:
        hz = edit.pole.frequency_hz
        before = _named(_nearest(result.automatic, hz))
        after = _nearest(result.modal_model.modes, hz)
        if edit.kind is EditKind.SET_ASIDE:
            return f"{before} is fitted, but not listed"
        return f"{_named(after)} is listed" if after else "it was overruled"
    rows = [each for each in _by_hand(result) if _is_meant(each, edit)]
    if edit.kind in OF_CHANNELS or edit.kind is EditKind.RUN_OUT:
        places = ", ".join(
            f"{each.position_deg:g}°" for each in rows if each.position_deg is not None
        )
        return f"{counted(len(rows), 'FRF')}" + (f" at {places}" if len(rows) <= 6 else "")
    before_edits = result.provenance.get("options_before_edits", {})
    if edit.kind is EditKind.SETTINGS and before_edits:
        earlier = ", ".join(f"{name} = {_plain(value)}" for name, value in before_edits.items())
        return f"instead of {earlier}"
    return DASH


def _by_hand(result: Result) -> Sequence[Correction | Finding]:
    """Rows that were decided on; of several forces the findings say which."""
    if result.further:
        return [each for each in result.findings if each.check is Check.BY_HAND]
    return [each for each in result.corrections if each.is_by_hand]


def _is_meant(row: Correction | Finding, edit: Edit) -> bool:
    if edit.kind is EditKind.RUN_OUT:
        return row.run == edit.run
    name = edit.channel
    return name is not None and row.channel == name.channel and name.run in (None, row.run)


def _nearest(modes: Sequence[_AnyMode], hz: float) -> _AnyMode | None:
    nearest = sorted(modes, key=lambda mode: abs(mode.frequency_hz - hz))
    return nearest[0] if nearest else None


def _named(mode: AutomaticMode | Mode | None) -> str:
    if mode is None:
        return "no mode"
    order = "" if mode.order is None else f"n = {mode.order}{mode.member}, "
    return f"{order}{mode.frequency_hz:.2f} Hz"


@dataclass(frozen=True)
class _Pair:
    """A mode before and after the decisions; None where it was not listed."""

    before: AutomaticMode | None
    after: Mode | None

    @property
    def hz(self) -> float:
        known = self.after or self.before
        return known.frequency_hz if known else np.nan

    def moved(self, name: str, std: str) -> float:
        """Change in σ of before; NaN where it is in one list only, 0 where nothing moved."""
        if self.before is None or self.after is None:
            return np.nan
        change = getattr(self.after, name) - getattr(self.before, name)
        size = getattr(self.before, std)
        return float(change / size) if size > 0 else 0.0 if not change else np.nan


def _pairs(before: Sequence[AutomaticMode], after: Sequence[Mode]) -> list[_Pair]:
    """Modes of both lists by frequency, the same ones side by side, the nearest first."""
    left, right = dict(enumerate(before)), dict(enumerate(after))

    def apart(k: int, j: int) -> float:
        old, new = before[k], after[j]
        width = max(old.damping_ratio * old.frequency_hz, 1e-9)
        other = old.member and new.member and old.member != new.member
        return abs(new.frequency_hz - old.frequency_hz) / width + (_SAME if other else 0.0)

    near = sorted((apart(k, j), k, j) for k in left for j in right)
    found = []
    for distance, k, j in near:
        if distance < _SAME and k in left and j in right:
            found.append(_Pair(left.pop(k), right.pop(j)))
    found += [_Pair(each, None) for each in left.values()]
    found += [_Pair(None, each) for each in right.values()]
    return sorted(found, key=lambda pair: pair.hz)


def _beside(pairs: Sequence[_Pair]) -> Table:
    head = (
        *("order n", "automatic: frequency / Hz", "edited: frequency / Hz", "Δ / σ"),
        *("automatic: damping / %", "edited: damping / %", "Δ / σ", "chosen"),
    )
    rows = tuple(
        (
            _order(pair),
            *_cells(pair, "frequency_hz", "frequency_std_hz", 1.0, 5),
            *_cells(pair, "damping_ratio", "damping_std", 100.0, 3),
            "not listed" if pair.after is None else pair.after.chosen.value,
        )
        for pair in pairs
    )
    return Table("Automatic and edited modes", head, rows, words=(7,))


def _order(pair: _Pair) -> str:
    known = pair.after or pair.before
    return DASH if known is None or known.order is None else f"{known.order}{known.member}"


def _cells(pair: _Pair, name: str, std: str, scale: float, digits: int) -> tuple[str, str, str]:
    def cell(mode: AutomaticMode | Mode | None) -> str:
        if mode is None:
            return DASH
        return value_with_std(scale * getattr(mode, name), scale * getattr(mode, std), digits)

    return cell(pair.before), cell(pair.after), signed(pair.moved(name, std), 2)


def _other_state(result: Result) -> Iterator[str]:
    """Which run the modes are those of, where a campaign drifts and the first one was left out."""
    drift, measured = result.modal_model.drift, result.measured.run_names
    if drift.applied and drift.run[0] != measured[0]:
        yield (
            f"The frequencies drift: the edited modes are those of {drift.run[0]}, the first run "
            f"that is left, the automatic ones those of {measured[0]}."
        )


def _meaning(pairs: Sequence[_Pair]) -> list[str]:
    meant = ["Δ: edited minus automatic, in standard deviations of the automatic value."]
    if any(pair.after is None for pair in pairs):
        meant.append(
            "A mode that is not listed is fitted with the rest unless its channels are gone: its "
            "response is not pressed into the others."
        )
    return meant


def _worse(result: Result, pairs: Sequence[_Pair]) -> Iterator[str]:
    """Where the decisions made the fit or a mode worse."""
    before, after = result.automatic_misfit, result.modal_model.misfit
    if np.isfinite(before) and after > _WORSE * before:
        yield (
            f"The fit leaves {number(after, 3)} times the variance of the noise, the automatic "
            f"one {number(before, 3)}."
        )
    for pair in pairs:
        if pair.before is None or pair.after is None:
            continue
        hz_moved = pair.moved("frequency_hz", "frequency_std_hz")
        damping_moved = pair.moved("damping_ratio", "damping_std")
        if max(abs(hz_moved), abs(damping_moved)) > _FAR:
            yield (
                f"{_named(pair.after)} moved by {signed(hz_moved, 1)} σ in frequency and "
                f"{signed(damping_moved, 1)} σ in damping."
            )
        elif pair.after.frequency_std_hz > _WIDER * pair.before.frequency_std_hz:
            factor = pair.after.frequency_std_hz / pair.before.frequency_std_hz
            yield f"The ± of {_named(pair.after)} became {factor:.1f} times as large."
        if pair.before.status == "ok" and pair.after.status != "ok":
            yield f"{_named(pair.after)} is no longer ok: {pair.after.status}."
    lost = [pair.before for pair in pairs if pair.after is None and pair.before is not None]
    aside = {each for each in lost if each.status == "ok"}
    for mode in sorted(aside, key=lambda each: each.frequency_hz):
        yield f"{_named(mode)} was ok automatically and is not listed."
    added = [pair.after for pair in pairs if pair.before is None and pair.after is not None]
    for new in added:
        if new.chosen is not Chosen.AUTOMATIC and new.status != "ok":
            yield f"{_named(new)} was {new.chosen} by hand; its status is {new.status}."
