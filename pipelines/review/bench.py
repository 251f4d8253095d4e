"""A result under review: session, draft and fits together, safe to use from several threads."""

from __future__ import annotations

import getpass
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import asdict, fields, replace
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

import ema
from ema.core.edits import Edit
from ema.core.errors import FitError, InputError
from ema.core.modes import ModalModel
from ema.core.settings import CheckSettings, IdentificationSettings
from ema.identify import Identification
from ema.refit import EditCost, edit_cost, refit_modes
from pipelines.results.store import load
from pipelines.review import draft as drafts
from pipelines.review.session import Session, key, settings_of
from pipelines.review.sight import Sight
from pipelines.review.state import REREADS, edit_text, refusal, state
from pipelines.review.worker import Stop, Worker

_KEPT_FITS = 24  # undo and redo among these asks for no fit
_KEPT_BASES = 3  # automatic identifications with other settings


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
        self.result = load(folder)
        self._worker, self._publish = worker, publish
        self._draft = drafts.opened(folder)
        self._lock = threading.RLock()
        self._bases: OrderedDict[str, Identification] = OrderedDict()
        self._fits: OrderedDict[str, Identification] = OrderedDict()
        self._shown: Identification | None = None
        self._error: dict[str, str] | None = None
        self._failed = False
        worker.wake(self)

    @property
    def session(self) -> Session:
        """Edits, and how many are in force."""
        return self._draft.session

    def sight(self) -> Sight:
        """The newest numbers."""
        with self._lock:
            current = self._fits.get(key(self.session.edits))
            found = current or self._shown
            return Sight(self.result, self.session, self._automatic(), found, found is current)

    def state(self) -> dict[str, Any]:
        """Everything that the page shows but curves."""
        with self._lock:
            told = state(self.sight())
            stage = self._stage()
            told |= {"id": self.name, "stage": stage.value, "error": self._error}
            return told | {"by": _user(), "can_reread": False}

    def applied(self, revision: int, edit: Edit) -> dict[str, Any]:
        """With one more edit, which is on disk when this returns."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self._require_settings(edit)
        return self._changed(
            revision, lambda old: old.applied(replace(edit, by=edit.by or _user(), at=now))
        )

    def moved(self, revision: int, cursor: int) -> dict[str, Any]:
        """Undone or redone."""
        return self._changed(revision, lambda old: old.moved(cursor))

    def explained(self, revision: int, index: int, reason: str) -> dict[str, Any]:
        """With the reason of an edit."""
        return self._changed(revision, lambda old: old.explained(index, reason))

    def tried(self, revision: int, edit: Edit) -> dict[str, Any]:
        """What an edit would cost."""
        with self._lock:
            self._require(revision)
            edits = self.session.edits
            found = self._fits.get(key(edits)) or self._base(edits)
        if found is None:
            raise StaleError("the result is being opened")

        def asked(stop: Stop) -> EditCost:
            start = (
                found if key(found.edits) == key(edits) else refit_modes(found, edits, live=True)
            )
            return edit_cost(start, (*edits, edit), stop=stop)

        cost = self._worker.call(asked).result()
        return _cost_record(cost, edit_text(edit, self.sight()))

    def close(self) -> None:
        """Let other processes review the result."""
        self._draft.close()

    # What the worker asks.

    def is_urgent(self) -> bool:
        """Whether a page waits for a fit."""
        with self._lock:
            return key(self.session.edits) not in self._fits and not self._failed

    def step(self, stop: Stop) -> bool:
        """Do the next fit."""
        with self._lock:
            edits, failed = self.session.edits, self._failed
            base, fit = self._base(edits), self._fits.get(key(edits))
        if failed or (fit is not None and not fit.is_preview):
            return False
        try:
            if base is None:
                self._keep_base(edits, self._identified(settings_of(edits)))
            else:
                start = fit or self._nearest(edits, base)
                self._keep(edits, refit_modes(start, edits, live=fit is None, stop=stop))
        except (InputError, FitError) as error:
            self._refuse(edits, refusal(error))
        self._publish(self.state())
        return True

    def failed(self, error: Exception) -> None:
        """Say that a fit ended with an internal error; the last edit is taken back."""
        text = f"{type(error).__name__}: {error}"
        told = {"where": "internal error", "found": text, "rule": "this is a fault of the program"}
        self._refuse(self.session.edits, {**told, "remedy": "Please report it"})
        self._publish(self.state())

    def _changed(self, revision: int, change: Callable[[Session], Session]) -> dict[str, Any]:
        with self._lock:
            self._require(revision)
            self._draft.record(change(self.session))
            self._error, self._failed = None, False
            told = self.state()
        self._publish(told)
        self._worker.wake(self)
        return told

    def _require(self, revision: int) -> None:
        if revision != self.session.revision:
            raise StaleError(f"revision {revision}, now {self.session.revision}")

    def _require_settings(self, edit: Edit) -> None:
        known = {*REREADS, "method", "max_order", "estimator", "band_hz"}
        for name in edit.settings:
            if name not in known:
                rule = f"settings are {', '.join(sorted(known))}"
                raise InputError("settings", repr(name), rule, "Choose one of them")

    def _stage(self) -> Stage:
        if self._failed:
            return Stage.FAILED
        fit = self._fits.get(key(self.session.edits))
        if fit is not None:
            return Stage.PREVIEW if fit.is_preview else Stage.FINAL
        return Stage.OPENING if not self._bases else Stage.FITTING

    def _automatic(self) -> ModalModel:
        first = next(iter(self._bases.values()), None)
        return self.result.modal_model if first is None else first.model

    def _base(self, edits: tuple[Edit, ...]) -> Identification | None:
        return self._bases.get(_settings_key(edits))

    def _nearest(self, edits: tuple[Edit, ...], base: Identification) -> Identification:
        """The fit of the longest beginning of the edits: what changed since is least."""
        with self._lock:
            for stop in range(len(edits) - 1, 0, -1):
                if _settings_key(edits[:stop]) != _settings_key(edits):
                    break
                if (known := self._fits.get(key(edits[:stop]))) is not None:
                    return known
        return base

    def _identified(self, settings: Mapping[str, Any]) -> Identification:
        """The automatic identification with other settings."""
        record, result = self.result.provenance, self.result
        options, stored = record.get("options", {}), record.get("settings", {})
        identification = stored.get("identification", {})
        return ema.identify_modes(
            result.measured,
            tuple(settings.get("band_hz") or result.modal_model.band_hz),
            sensor_mass=result.sensor_mass,
            max_order=int(settings.get("max_order") or options.get("max_order") or 60),
            method=settings.get("method") or options.get("method") or "lsce",
            settings=IdentificationSettings(**_known(IdentificationSettings, identification)),
            checks=CheckSettings(**_known(CheckSettings, stored.get("checks", {}))),
        )

    def _keep_base(self, edits: tuple[Edit, ...], base: Identification) -> None:
        with self._lock:
            self._bases[_settings_key(edits)] = base
            while len(self._bases) > _KEPT_BASES:
                second = list(self._bases)[1]  # the first one is the automatic result
                del self._bases[second]
            self._shown = self._shown or base

    def _keep(self, edits: tuple[Edit, ...], fit: Identification) -> None:
        with self._lock:
            self._fits[key(edits)] = fit
            self._fits.move_to_end(key(edits))
            if key(edits) == key(self.session.edits):
                self._shown = fit
            while len(self._fits) > _KEPT_FITS:
                self._fits.popitem(last=False)

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


def _settings_key(edits: tuple[Edit, ...]) -> str:
    return repr(sorted(settings_of(edits).items()))


def _known(kind: Any, stored: Mapping[str, Any]) -> dict[str, Any]:
    """Settings as stored, without those that this version does not have."""
    names = {each.name for each in fields(kind)}
    return {name: value for name, value in stored.items() if name in names}


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


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):  # a user without a name
        return ""
