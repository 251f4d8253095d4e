"""A result under review: session, draft and fits together, safe to use from several threads."""

from __future__ import annotations

import asyncio
import json
import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ema.core.edits import Edit
from ema.core.errors import FitError, InputError, SupersededError
from ema.core.modes import ModalModel
from ema.core.references import mapped
from ema.identify import Identification
from ema.refit import EditCost, edit_cost, refit_modes
from ema.signals.frf_of_spectra import restated
from pipelines import review
from pipelines.library.version import login_name
from pipelines.process.refit import asked_of, of_blocks, refittable, settings_of
from pipelines.results.edits_file import edits_of
from pipelines.results.result import Result, edit_records
from pipelines.review.session import Session, key, keys, opened
from pipelines.review.sight import Sight, edit_text, refusal, state
from pipelines.review.worker import Jobs, Stop, Worker, loaded, recordings_of, reread
from pipelines.storage.atomic import MARKER

if TYPE_CHECKING:
    from pipelines.review.watch import Watch

_KEPT_FITS = 24  # undo and redo among these asks for no fit
_KEPT_FRFS = 2  # edits of channels have FRFs of their own, some 20 MB
_KEPT_POLES = 2  # edits of poles have a fit of their own, some 10 MB
_KEPT_BASES = 3  # automatic identifications with other settings
_ID_BYTES = 6
_KEPT_RESULTS = 12  # that were compared


class Stage(StrEnum):
    """What the numbers shown are."""

    OPENING = "opening"  # those of the result; what refits go on from is being computed
    FITTING = "fitting"  # those of before the last edit
    PREVIEW = "preview"
    FINAL = "final"
    FAILED = "failed"


class StaleError(RuntimeError):
    """A page that has not seen the last change wants another one."""


class Bench:
    """A result that is reviewed.

    Parameters
    ----------
    name : str
        By which pages call it.
    folder : Path
        Of the result.
    worker : Worker
    publish : callable
        Called with the state after every change, from any thread.
    """

    def __init__(
        self, name: str, folder: Path, worker: Worker, publish: Callable[[dict[str, Any]], None]
    ) -> None:
        self.name, self.folder = name, folder
        self.result = loaded(folder)
        self._worker, self._publish = worker, publish
        self._draft = opened(folder, self.result.edits)
        self._lock = threading.RLock()
        self._sources: dict[str, Result] = {_name_of({}): self.result}  # by settings of blocks
        self._bases: OrderedDict[str, Identification] = OrderedDict()  # by all settings
        self._fits: OrderedDict[str, Identification] = OrderedDict()  # by all edits
        self._shown: tuple[Result, Identification | None] = (self.result, None)
        self._error: dict[str, str] | None = None
        self._failed = self._is_seen = False

    @property
    def session(self) -> Session:
        """Edits, and how many are in force."""
        return self._draft.session

    @property
    def is_final(self) -> bool:
        """Whether the numbers shown are those of all edits in force, and no preview."""
        with self._lock:
            return self._stage() is Stage.FINAL

    def sight(self) -> Sight:
        """The newest numbers."""
        with self._lock:
            edits = self.session.edits
            current = self._fits.get(key(edits))
            source, found = self._shown
            if current is not None:
                source, found = self._source(edits) or source, current
            return Sight(source, self.session, self.automatic, found, found is current)

    def state(self) -> dict[str, Any]:
        """Everything that the page shows but curves; the first fit begins when it is known."""
        with self._lock:
            told = state(self.sight())
            told |= {"id": self.name, "stage": self._stage().value, "error": self._error}
            told["misfits"] = [self._draft.misfits.get(each) for each in keys(self.session.history)]
            told |= {"by": login_name(), "can_reread": bool(recordings_of(self.result))}
            is_new, self._is_seen = not self._is_seen, True
        if is_new:
            self._worker.wake(self)
        return told

    def applied(self, revision: int, edit: Edit) -> dict[str, Any]:
        """With one more edit, which is on disk when this returns."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        edit = replace(edit, by=edit.by or login_name(), at=now)
        (edit,) = edits_of("edit", edit_records([edit]))  # as it will be read again, or refused
        return self._changed(revision, lambda old: old.applied(edit))

    def moved(self, revision: int, cursor: int) -> dict[str, Any]:
        """Undone or redone."""
        return self._changed(revision, lambda old: old.moved(cursor))

    def explained(self, revision: int, index: int, reason: str) -> dict[str, Any]:
        """With the reason of an edit."""
        return self._changed(revision, lambda old: old.explained(index, reason))

    def tried(self, revision: int, edit: Edit) -> dict[str, Any]:
        """What an edit would cost."""
        with self._lock:
            self.require(revision)
            edits = self.session.edits
            found = self._fits.get(key(edits))
        if found is None:
            raise StaleError("the last edit is still being fitted")
        asked = self._worker.call(lambda stop: edit_cost(found, (*edits, edit), stop=stop))
        try:
            cost = asked.result()
        except (SupersededError, CancelledError):
            raise StaleError("another edit came before it was known") from None
        return _cost_record(cost, edit_text(edit, self.sight()))

    def require(self, revision: int) -> None:
        """Refuse what was decided on an older revision."""
        if revision != self.session.revision:
            raise StaleError(f"revision {revision}, now {self.session.revision}")

    def close(self) -> None:
        """Let other processes review the result."""
        self._draft.close()

    def signed(self) -> None:
        """Forget the draft, whose edits are in a result now; pages that show it learn of that."""
        with self._lock:
            old = self._draft
            old.discard()
            self._draft = opened(self.folder, self.result.edits)
            self._draft.record(replace(self.session, revision=old.session.revision + 1))
            self._draft.fitted(old.misfits)
        self._publish(self.state())
        self._worker.wake(self)

    # What the worker asks.

    def is_urgent(self) -> bool:
        """Whether a page waits for a fit."""
        with self._lock:
            return key(self.session.edits) not in self._fits and not self._failed

    def step(self, stop: Stop) -> bool:
        """Do the next fit."""
        with self._lock:
            edits, failed = self.session.edits, self._failed
            source, base = self._source(edits), self._bases.get(_name_of(settings_of(edits)))
            fit = self._fits.get(key(edits))
        if failed or (fit is not None and not fit.is_preview):
            return False
        try:
            if source is None:
                name = _name_of(of_blocks(edits))
                self._sources = {_name_of({}): self.result, name: reread(self.result, edits)}
            elif base is None:
                self._keep_base(edits, source, _identified(source, edits))
            else:
                start = fit or self._nearest(edits, base)
                found = refit_modes(start, edits, live=fit is None, stop=stop)
                self._keep(edits, source, found)
        except (InputError, FitError) as error:
            self._refuse(edits, refusal(error))
        self._publish(self.state())
        return True

    def failed(self, error: Exception) -> None:
        """Say that a fit ended with an internal error; the last edit is taken back."""
        text = f"{type(error).__name__}: {error}"
        told = {"where": "internal error", "found": text, "rule": "this is an error in ringmodal"}
        self._refuse(self.session.edits, {**told, "remedy": "Please report it"})
        self._publish(self.state())

    @property
    def automatic(self) -> ModalModel:
        """The modes without any edit; until they are found, those of the result."""
        plain = self._bases.get(_name_of({})) or next(iter(self._bases.values()), None)
        return self.result.modal_model if plain is None else plain.model

    def _changed(self, revision: int, change: Callable[[Session], Session]) -> dict[str, Any]:
        with self._lock:
            self.require(revision)
            self._draft.record(change(self.session))
            self._error, self._failed = None, False
            told = self.state()
        self._publish(told)
        self._worker.wake(self)
        return told

    def _stage(self) -> Stage:
        if self._failed:
            return Stage.FAILED
        fit = self._fits.get(key(self.session.edits))
        if fit is not None:
            return Stage.PREVIEW if fit.is_preview else Stage.FINAL
        return Stage.OPENING if not self._bases else Stage.FITTING

    def _source(self, edits: tuple[Edit, ...]) -> Result | None:
        return self._sources.get(_name_of(of_blocks(edits)))

    def _nearest(self, edits: tuple[Edit, ...], base: Identification) -> Identification:
        """The fit of the longest beginning of the edits: what changed since is least."""
        settings = settings_of(edits)
        with self._lock:
            names = keys(edits)
            for stop in range(len(edits) - 1, 0, -1):
                if settings_of(edits[:stop]) != settings:
                    break
                if (known := self._fits.get(names[stop])) is not None:
                    return known
        return base

    def _keep_base(self, edits: tuple[Edit, ...], source: Result, base: Identification) -> None:
        with self._lock:
            name = _name_of(settings_of(edits))
            self._bases[name] = base
            others = [each for each in self._bases if each not in (name, _name_of({}))]
            for other in others[: max(0, len(self._bases) - _KEPT_BASES)]:
                del self._bases[other]
            if self._shown[1] is None:
                self._shown = source, base

    def _keep(self, edits: tuple[Edit, ...], source: Result, fit: Identification) -> None:
        with self._lock:
            name = key(edits)
            self._fits[name] = fit
            self._fits.move_to_end(name)
            if not fit.is_preview and isfinite(fit.model.misfit):
                with suppress(OSError):  # it is for the history alone
                    self._draft.fitted({name: fit.model.misfit})
            if name == key(self.session.edits):
                self._shown = source, fit
            while self._holds_too_much():
                self._fits.popitem(last=False)

    def _holds_too_much(self) -> bool:
        """Whether fits take much memory; those that differ in what is listed share nearly all."""
        fits = self._fits.values()
        n_frfs = len({id(fit.frf) for fit in fits})
        bases = [(fit.references or (fit,))[0].basis for fit in fits]
        n_poles = len({id(each.shown or each.fit) for each in bases if each})
        return len(fits) > _KEPT_FITS or n_frfs > _KEPT_FRFS or n_poles > _KEPT_POLES

    def _refuse(self, edits: tuple[Edit, ...], error: dict[str, str]) -> None:
        """Take the last edit back, which cannot be carried out."""
        with self._lock:
            if self.session.edits != edits:
                return
            self._error = error
            if edits:
                self._draft.record(self.session.without_last())
            else:
                self._failed = True


def _identified(source: Result, edits: tuple[Edit, ...]) -> Identification:
    """The automatic identification with the settings in force."""
    source = refittable(source)
    assert source.setup is not None
    asked = asked_of(source).changed(settings_of(edits))
    frfs = mapped(source.frfs, lambda frf: restated(frf, asked.estimator))
    return asked.identify(frfs, source.setup.sensor_mass)


def _name_of(settings: dict[str, Any]) -> str:
    return json.dumps(settings, sort_keys=True)


def _cost_record(cost: EditCost, text: str) -> dict[str, Any]:
    shifts = [
        {"name": f"{each.order}{each.member}" if each.order is not None else "–", **asdict(each)}
        for each in cost.shifts
    ]
    return {
        **{"chi_square_before": cost.chi_square_before, "chi_square_after": cost.chi_square_after},
        **{"chi2_before": cost.misfit_before, "chi2_after": cost.misfit_after},
        **{"change": cost.change, "shifts": shifts, "text": text},
    }


Event = Mapping[str, Any] | None  # None ends a stream


class Desk:
    """Everything that one server has open.

    Parameters
    ----------
    root : Path
        Nothing outside of it is opened.
    places : mapping of str to Path, optional
        Folders that have names already.
    """

    def __init__(self, root: Path, places: Mapping[str, Path] | None = None) -> None:
        self.root = root.resolve()
        self._worker = Worker()
        self._jobs = Jobs(lambda: self.tell({"kind": "home"}))
        self._lock = threading.RLock()
        self._places = dict(places or {})
        self._benches: dict[str, Bench] = {}
        self._watches: dict[str, Watch] = {}
        self._results: dict[tuple[Path, int], Result] = {}
        self._listeners: set[tuple[asyncio.AbstractEventLoop, asyncio.Queue[Event]]] = set()

    def name_of(self, path: Path) -> str:
        """A name for a folder that says nothing about where it is; always the same for one."""
        with self._lock:
            for name, known in self._places.items():
                if known == path:
                    return name
            name = secrets.token_hex(_ID_BYTES)
            self._places[name] = path
            return name

    def place(self, name: str) -> Path | None:
        """The folder of a name; None where none was given, or a link leads out of the root."""
        path = self._places.get(name)
        if path is None or not path.resolve().is_relative_to(self.root):
            return None
        return path

    def bench(self, name: str) -> Bench | None:
        """The result of a name, opened where it is not yet."""
        path = self.place(name)
        if path is None or not (path / MARKER).is_file():
            return None
        with self._lock:
            if name not in self._benches:
                self._benches[name] = Bench(name, path, self._worker, self._tell_state)
            return self._benches[name]

    @property
    def is_busy(self) -> bool:
        """Whether a thread goes on after `close`."""
        return self._worker.is_alive

    def watch(self, name: str) -> Watch | None:
        """The campaign of a name, looked at from now on."""
        path = self.place(name)
        if path is None or (path / MARKER).is_file():
            return None
        with self._lock:
            if name not in self._watches:
                changed = {"kind": "watch", "id": name}
                self._watches[name] = review.watch.Watch(path, lambda: self.tell(changed))
            return self._watches[name]

    def result(self, name: str) -> Result | None:
        """The result of a name, to be looked at only."""
        path = self.place(name)
        if path is None or not (path / MARKER).is_file():
            return None
        key = path, (path / MARKER).stat().st_mtime_ns
        if key not in self._results:
            self._results[key] = loaded(path)
            while len(self._results) > _KEPT_RESULTS:
                del self._results[next(iter(self._results))]
        return self._results[key]

    def landing(self) -> dict[str, Any]:
        """What the landing page shows."""
        told: dict[str, Any] = review.folder.landing(self.root, self.name_of, self._jobs.told)
        return told

    def process(self, name: str) -> dict[str, Any] | None:
        """Process the campaign of a name; None where there is none."""
        path = self.place(name)
        if path is None or (path / MARKER).is_file():
            return None
        self._jobs.start(path)
        return {"job": dict(self._jobs.told[path])}

    def tell(self, event: Event) -> None:
        """Pass an event on to all pages; called from any thread."""
        for loop, queue in tuple(self._listeners):
            loop.call_soon_threadsafe(queue.put_nowait, event)

    @contextmanager
    def listening(self, loop: asyncio.AbstractEventLoop) -> Iterator[asyncio.Queue[Event]]:
        """Yield a queue of the events from now on."""
        listener = loop, asyncio.Queue[Event]()
        self._listeners.add(listener)
        try:
            yield listener[1]
        finally:
            self._listeners.discard(listener)

    def close(self) -> None:
        """End fits, watches and processes, and free the drafts."""
        self._jobs.close()
        self._worker.end()
        for watch in self._watches.values():
            watch.end()
        for bench in self._benches.values():
            bench.close()

    def _tell_state(self, state: Mapping[str, Any]) -> None:
        self.tell({"kind": "state", "id": state["id"], "state": state})
