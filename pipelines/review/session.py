"""A review as a value: edits in their order, and how many of them are in force."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from math import isfinite
from typing import Any

from ema.core.edits import OF_CHANNELS, OF_POLES, ChannelName, Edit, EditKind, PoleName, of_kind
from ema.core.errors import InputError

_REMEDY = "Reload the page"
_MOST_LETTERS = 2000  # of a reason


@dataclass(frozen=True)
class Session:
    """Edits of a result; those behind the cursor are undone and can be redone.

    Parameters
    ----------
    history : tuple of Edit
    cursor : int
        How many are in force.
    revision : int
        Rises with every change, undo and redo among them: by it a page knows that it is stale.
    """

    history: tuple[Edit, ...] = ()
    cursor: int = 0
    revision: int = 0

    @property
    def edits(self) -> tuple[Edit, ...]:
        """Those in force."""
        return self.history[: self.cursor]

    def applied(self, edit: Edit) -> Session:
        """With one more edit; what was undone is gone."""
        history = (*self.edits, edit)
        return Session(history, len(history), self.revision + 1)

    def moved(self, cursor: int) -> Session:
        """Undone or redone to a place in the history."""
        if not 0 <= cursor <= len(self.history):
            rule = f"the history has 0 to {len(self.history)} edits"
            raise InputError("cursor", str(cursor), rule, _REMEDY)
        return Session(self.history, cursor, self.revision + 1)

    def explained(self, index: int, reason: str) -> Session:
        """With the reason of an edit; it changes no number."""
        if not 0 <= index < len(self.history):
            rule = f"the history has {len(self.history)} edits"
            raise InputError("index", str(index), rule, _REMEDY)
        history = list(self.history)
        history[index] = replace(history[index], reason=_text("reason", reason))
        return Session(tuple(history), self.cursor, self.revision + 1)

    def without_last(self) -> Session:
        """Without the last edit in force, which could not be carried out."""
        kept = (*self.history[: self.cursor - 1], *self.history[self.cursor :])
        return Session(kept, self.cursor - 1, self.revision + 1)


def key(edits: Iterable[Edit]) -> str:
    """A text that differs where the numbers may: who, when and why do not count."""
    return json.dumps([as_record(replace(edit, by="", at="", reason="")) for edit in edits])


def settings_of(edits: Iterable[Edit]) -> dict[str, Any]:
    """Settings in force by the edits; of several the last one counts."""
    found: dict[str, Any] = {}
    for edit in of_kind(edits, EditKind.SETTINGS):
        found |= edit.settings
    return found


def as_record(edit: Edit) -> dict[str, Any]:
    """An edit as in ``edits.toml``, without what it leaves open."""
    pole, channel = edit.pole, edit.channel
    of_pole = None
    if pole is not None:
        of_pole = _said({"method": pole.method, "order": pole.model_order, **_place(pole)})
    of_channel = {"run": edit.run} if channel is None else vars(channel)
    rest = {"value": edit.value, "settings": dict(edit.settings)}
    who = {"by": edit.by, "at": edit.at, "reason": edit.reason}
    return _said({"kind": edit.kind.value, "pole": of_pole, **of_channel, **rest, **who})


def _place(pole: PoleName) -> dict[str, float | None]:
    return {"frequency_hz": pole.frequency_hz, "damping_ratio": pole.damping_ratio}


def _said(record: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in record.items() if value not in (None, "", {})}


def edit_of(record: object) -> Edit:
    """The edit that a page or a draft states, as in ``edits.toml``.

    Raises
    ------
    InputError
        If it is not one.
    """
    content = _table("edit", record, {each.name for each in fields(Edit)})
    if content.get("kind") not in list(EditKind):
        rule = f"it is one of {', '.join(EditKind)}"
        raise InputError("kind", _shown(content.get("kind")), rule, _REMEDY)
    kind = EditKind(content["kind"])
    pole, channel, run = (content.get(name) for name in ("pole", "channel", "run"))
    if (pole is None) != (kind not in OF_POLES) or (channel is None) != (kind not in OF_CHANNELS):
        rule = "edits of poles name a pole, edits of channels a channel, others neither"
        raise InputError(f"edit {kind.value}", "a name too many or too few", rule, _REMEDY)
    run = None if run is None else _text("run", run)
    return Edit(
        kind,
        pole=None if pole is None else _pole(pole),
        channel=None if channel is None else ChannelName(_text("channel", channel), run),
        run=run if channel is None else None,
        value=None if content.get("value") is None else _number("value", content["value"]),
        settings=_table("settings", content.get("settings") or {}, None),
        **{name: _text(name, content.get(name) or "") for name in ("by", "at", "reason")},
    )


def _pole(record: object) -> PoleName:
    content = _table("pole", record, {"frequency_hz", "damping_ratio", "method", "order"})
    order, method, damping = (content.get(n) for n in ("order", "method", "damping_ratio"))
    return PoleName(
        _number("frequency_hz", content.get("frequency_hz")),
        None if damping is None else _number("damping_ratio", damping),
        None if method is None else _text("method", method),
        None if order is None else int(_number("order", order)),
    )


def _table(name: str, value: object, known: set[str] | None) -> dict[str, Any]:
    if not isinstance(value, Mapping) or (known is not None and not set(value) <= known):
        rule = "it is a table" + (f" of {', '.join(sorted(known))}" if known else "")
        raise InputError(name, _shown(value), rule, _REMEDY)
    return {str(part): content for part, content in value.items()}


def _text(name: str, value: object) -> str:
    if not isinstance(value, str) or len(value) > _MOST_LETTERS:
        rule = f"it is a text of at most {_MOST_LETTERS} letters"
        raise InputError(name, _shown(value), rule, "Shorten it")
    return value


def _number(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise InputError(name, _shown(value), "it is a finite number", _REMEDY)
    return float(value)


def _shown(value: object) -> str:
    return repr(value)[:80]
