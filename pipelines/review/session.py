"""A review as a value: edits in their order, and how many of them are in force."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace

from ema.core.edits import Edit
from ema.core.errors import InputError
from pipelines.results.decided import edit_records

_REMEDY = "Reload the page"


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
        history[index] = replace(history[index], reason=reason)
        return Session(tuple(history), self.cursor, self.revision + 1)

    def without_last(self) -> Session:
        """Without the last edit in force, which could not be carried out."""
        kept = (*self.history[: self.cursor - 1], *self.history[self.cursor :])
        return Session(kept, self.cursor - 1, self.revision + 1)


def key(edits: Iterable[Edit]) -> str:
    """A text that differs where the numbers may: who, when and why do not count."""
    return json.dumps(edit_records(replace(edit, by="", at="", reason="") for edit in edits))
