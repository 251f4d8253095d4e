"""A review: edits in their order, how many are in force, and their draft on disk."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

from filelock import FileLock, Timeout

from ema.core.edits import Edit, EditKind
from ema.core.errors import InputError
from pipelines.results.edits_file import edits_of
from pipelines.results.result import edit_records
from pipelines.storage.atomic import MARKER
from pipelines.storage.checksums import sha256

_REMEDY = "Reload the page"
FOLDER = ".ringmodal-review"
_STATE = "XDG_STATE_HOME", "LOCALAPPDATA"
_SCHEMA = 1


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


def keys(edits: Iterable[Edit]) -> list[str]:
    """A text for each beginning of the edits, which differs where the numbers may.

    Who, when and why do not count, nor do notes.
    """
    digest = hashlib.sha256()
    found = [digest.hexdigest()]
    for edit in edits:
        if edit.kind is not EditKind.NOTE:
            records = edit_records([replace(edit, by="", at="", reason="")])
            digest.update(json.dumps(records).encode())
        found.append(digest.hexdigest())
    return found


def key(edits: Iterable[Edit]) -> str:
    """A text that differs where the numbers of a fit with these edits may."""
    return keys(edits)[-1]


@dataclass
class Draft:
    """An open draft; no other process opens it until it is closed.

    Parameters
    ----------
    path : Path
        JSON, one change a line: a kill in the middle of one leaves those before it.
    session : Session
        As the draft has it.
    misfits : dict of str to float
        Reduced χ² of the final fits, by `key` of their edits.
    """

    path: Path
    session: Session
    misfits: dict[str, float]
    _file: BinaryIO
    _lock: FileLock

    def record(self, session: Session) -> None:
        """Append what leads from the present session to another, and wait until it is on disk."""
        _write(self._file, _change(self.session, session))
        self.session = session

    def fitted(self, misfits: Mapping[str, float]) -> None:
        """Append what fits came to, so that the history has it after a restart."""
        _write(self._file, {"misfits": dict(misfits)})
        self.misfits.update(misfits)

    def discard(self) -> None:
        """Remove the draft, as its edits are signed."""
        self.close()
        with suppress(OSError):  # it is ignored from now on, as its session is empty
            self.path.unlink()

    def close(self) -> None:
        """Let other processes open it."""
        self._file.close()
        self._lock.release()


def opened(result: Path, edits: tuple[Edit, ...] = ()) -> Draft:
    """The draft of a result folder, begun with `edits` where there is none.

    Raises
    ------
    InputError
        If another process reviews the result.
    """
    path = _place(result)
    lock = FileLock(path.with_suffix(".lock"), thread_local=False)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        rule, remedy = "one process reviews a result", "Close the other one"
        raise InputError(str(result), "under review already", rule, remedy) from None
    base = sha256(result / MARKER)
    known = _read(path, base)
    if known is None:
        _set_aside(path)
    file = path.open("ab")
    if known is None:
        head = {"schema": _SCHEMA, "base": base, "edits": edit_records(edits)}
        _write(file, head | {"cursor": len(edits)})
    session, misfits = known or (Session(edits, len(edits)), {})
    return Draft(path, session, misfits, file, lock)


def n_drafted(result: Path) -> int:
    """How many edits the draft of a result has, 0 where there is none."""
    for folder in _folders(result):
        path = folder / _name(result, folder)
        if path.is_file():
            known = _read(path, sha256(result / MARKER), repair=False)
            return 0 if known is None else known[0].cursor
    return 0


def _folders(result: Path) -> Iterator[Path]:
    """Where the draft may be: beside the result, or among the user's own files."""
    yield result.parent / FOLDER
    home = next((os.environ[name] for name in _STATE if os.environ.get(name)), None)
    state = Path(home) if home else Path.home() / ".local" / "state"
    yield state / "ringmodal" / "review"


def _name(result: Path, folder: Path) -> str:
    if folder.parent == result.parent:
        return f"{result.name}.jsonl"
    return f"{hashlib.sha256(os.fsencode(result)).hexdigest()[:32]}.jsonl"


def _place(result: Path) -> Path:
    """Path of the draft in the first folder that can be written."""
    for folder in _folders(result):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            probe = folder / f".{os.getpid()}.probe"
            probe.touch()
            probe.unlink()
        except OSError as error:
            reason = error.strerror or str(error)
        else:
            return folder / _name(result, folder)
    remedy = "Check permissions, or name a folder in XDG_STATE_HOME"
    raise InputError(
        str(result), reason, "a draft is kept beside it or in the user's folder", remedy
    )


def _read(path: Path, base: str, *, repair: bool = True) -> tuple[Session, dict[str, float]] | None:
    """Session and misfits of a draft of this very result; a line cut by a kill is removed."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    whole = content[: content.rfind(b"\n") + 1]
    try:
        head, *changes = [json.loads(line) for line in whole.splitlines()]
        if head["schema"] != _SCHEMA or head["base"] != base:
            return None
        session = Session(edits_of(path.name, head["edits"]), head["cursor"])
        misfits: dict[str, float] = {}
        for change in changes:
            if "misfits" in change:
                misfits |= {str(name): float(each) for name, each in change["misfits"].items()}
            else:
                session = _changed(session, change)
    except (ValueError, LookupError, TypeError, AttributeError):  # also `InputError`
        return None
    if repair and whole != content:
        with path.open("r+b") as file:
            file.truncate(len(whole))
    return session, misfits


def _set_aside(path: Path) -> None:
    """Keep a draft that is not of this result under another name."""
    if path.exists():
        names = (path.with_suffix(f".kept-{number}.jsonl") for number in count(1))
        path.rename(next(name for name in names if not name.exists()))


def _write(file: BinaryIO, line: Mapping[str, Any]) -> None:
    file.write(json.dumps(line, ensure_ascii=False).encode() + b"\n")
    file.flush()
    os.fsync(file.fileno())


def _change(before: Session, after: Session) -> Mapping[str, Any]:
    """What leads from one session to the next: the tail of the history that differs."""
    pairs = zip(before.history, after.history, strict=False)
    same = next((k for k, (one, other) in enumerate(pairs) if one != other), None)
    if same is None:
        same = min(len(before.history), len(after.history))
    tail = edit_records(after.history[same:])
    return {"keep": same, "then": tail, "cursor": after.cursor, "revision": after.revision}


def _changed(session: Session, change: Mapping[str, Any]) -> Session:
    history = (*session.history[: change["keep"]], *edits_of("draft", change["then"]))
    cursor = change["cursor"]
    if not 0 <= cursor <= len(history):
        raise ValueError("cursor")
    return Session(history, cursor, change["revision"])
