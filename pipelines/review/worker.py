"""Work beside the page: one thread for all fits, campaigns processed, recordings read again."""

from __future__ import annotations

import ctypes
import logging
import os
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import pyarrow as pa

from ema.core.edits import Edit, EditKind, of_kind
from ema.core.errors import InputError, SupersededError
from pipelines.process.refit import of_blocks
from pipelines.process.ring import options_of
from pipelines.process.run import process
from pipelines.results.edits_file import Record
from pipelines.results.result import Result
from pipelines.results.store import load

_LOG = logging.getLogger(__name__)

Stop = Callable[[], bool]

_PATIENCE_S = 2.0  # with a fit that is to stop: steps take less

_MMAP_THRESHOLD, _LARGE_BYTES = -3, 2**18  # M_MMAP_THRESHOLD of malloc.h
_ARENA_MAX = -8  # M_ARENA_MAX of malloc.h
_RESULT = "result"  # name of the result folder in a campaign's


def return_large_arrays() -> None:
    """Have arrays of fits given back to the system when they are freed.

    glibc raises its limit for that with every large array, and a server that fits for hours then
    holds what it once needed: some 40 MB of fragments. Every thread that answers pages would have
    fragments of its own.
    """
    if os.name == "posix" and hasattr(library := ctypes.CDLL(None), "mallopt"):
        library.mallopt(_MMAP_THRESHOLD, _LARGE_BYTES)
        library.mallopt(_ARENA_MAX, 1)


def loaded(folder: Path) -> Result:
    """A result, without what Arrow keeps of reading it: as much again."""
    result = load(folder)
    pa.default_memory_pool().release_unused()
    return result


class Work(Protocol):
    """What the thread works on: it is asked what there is to do as long as there is anything."""

    def is_urgent(self) -> bool:
        """Whether somebody waits for its next step."""

    def step(self, stop: Stop) -> bool:
        """Do one step, ended early where `stop` gives true; whether there is more to do."""

    def failed(self, error: Exception) -> None:
        """Learn of an error that no step should have."""


class Worker:
    """A thread that fits, one step at a time."""

    def __init__(self) -> None:
        return_large_arrays()
        self._changed = threading.Condition()
        self._waiting: list[Work] = []  # the last one was asked for last
        self._calls: deque[tuple[Callable[[Stop], Any], Future[Any]]] = deque()
        self._current: Work | None = None
        self._stop = threading.Event()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="fits", daemon=True)
        self._thread.start()

    def wake(self, work: Work) -> None:
        """There is something new to do; it comes before all else."""
        with self._changed:
            self._waiting = [*(each for each in self._waiting if each is not work), work]
            if self._current is work or (self._current and not self._current.is_urgent()):
                self._stop.set()
            self._changed.notify()

    def call(self, function: Callable[[Stop], Any]) -> Future[Any]:
        """Call a function in the thread, before any fit that nobody waits for."""
        future: Future[Any] = Future()
        with self._changed:
            self._calls.append((function, future))
            if self._current is not None and not self._current.is_urgent():
                self._stop.set()
            self._changed.notify()
        return future

    def end(self) -> None:
        """Stop the fit and the thread.

        An automatic identification cannot be stopped and takes minutes on large campaigns; it
        writes nothing, and `is_alive` tells that it goes on.
        """
        with self._changed:
            self._ended = True
            self._stop.set()
            for _, future in self._calls:
                future.cancel()
            self._changed.notify()
        self._thread.join(_PATIENCE_S)

    @property
    def is_alive(self) -> bool:
        """Whether the thread has not ended."""
        return self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._ended or self._calls or self._waiting)
                if self._ended:
                    return
                self._stop.clear()
                call = self._next_call()
                self._current = None if call else self._waiting[-1]
            if call is not None:
                _answer(*call, self._stop.is_set)
            else:
                self._step()

    def _next_call(self) -> tuple[Callable[[Stop], Any], Future[Any]] | None:
        urgent = bool(self._waiting) and self._waiting[-1].is_urgent()
        return self._calls.popleft() if self._calls and not urgent else None

    def _step(self) -> None:
        work = self._current
        assert work is not None
        try:
            more = work.step(self._stop.is_set)
        except SupersededError:
            more = True
        except Exception as error:  # noqa: BLE001 - told to the page, and logged with its traceback
            _LOG.exception("a fit of the review failed")
            work.failed(error)
            more = True
        with self._changed:
            self._current = None
            if not more and not self._stop.is_set():
                self._waiting = [each for each in self._waiting if each is not work]


def _answer(function: Callable[[Stop], Any], future: Future[Any], stop: Stop) -> None:
    try:
        future.set_result(function(stop))
    except Exception as error:  # noqa: BLE001 - it belongs to whoever waits for the answer
        future.set_exception(error)


class Jobs:
    """Processes that were started here.

    Parameters
    ----------
    changed : callable
        Called from any thread when one of them says something or ends.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._lock = threading.Lock()
        self._running: dict[Path, subprocess.Popen[str]] = {}
        self._told: dict[Path, dict[str, Any]] = {}

    @property
    def told(self) -> Mapping[Path, Mapping[str, Any]]:
        """What is known of each campaign's job."""
        with self._lock:
            return {path: dict(job) for path, job in self._told.items()}

    def start(self, campaign: Path) -> None:
        """Process a campaign into a folder inside it; `InputError` where that is impossible."""
        target = campaign / _RESULT
        with self._lock:
            if campaign in self._running:
                rule, remedy = "a campaign is processed once at a time", "Wait for its end"
                raise InputError(campaign.name, "being processed", rule, remedy)
            if target.exists():
                rule, remedy = "nothing is replaced", f"Move {target.name} away"
                raise InputError(str(target), "it exists already", rule, remedy)
            command = [sys.executable, "-m", "ringmodal", "process", str(campaign)]
            process = subprocess.Popen(
                [*command, "--out", str(target)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
            )
            self._running[campaign] = process
            self._told[campaign] = {"state": "running", "text": "Starting …"}
        threading.Thread(target=self._follow, args=(campaign, process), daemon=True).start()
        self._changed()

    def close(self) -> None:
        """End all; a process that is ended leaves no half-written result."""
        with self._lock:
            running = list(self._running.values())
        for each in running:
            each.terminate()
            each.wait()

    def _follow(self, campaign: Path, process: subprocess.Popen[str]) -> None:
        assert process.stderr is not None
        last = ""
        with process.stderr as lines:
            for line in lines:
                last = line.strip() or last
                self._tell(campaign, "running", last)
        code = process.wait()
        with self._lock:
            del self._running[campaign]
        self._tell(campaign, "failed" if code else "done", last)

    def _tell(self, campaign: Path, state: str, text: str) -> None:
        with self._lock:
            self._told[campaign] = {"state": state, "text": text}
        self._changed()


def recordings_of(result: Result) -> list[Path]:
    """The manifest, or else all recordings; nothing where one is missing."""
    paths = [Path(each.get("path", "")) for each in result.provenance.get("inputs", ())]
    if not paths or not all(path.is_file() for path in paths):
        return []
    manifests = [path for path in paths if path.suffix == ".toml"]
    return manifests or paths


def reread(result: Result, edits: Sequence[Edit]) -> Result:
    """The result without edits but those of settings, from its recordings in other blocks."""
    settings = tuple(
        replace(edit, settings=of_blocks([edit]))
        for edit in of_kind(edits, EditKind.SETTINGS)
        if of_blocks([edit])
    )
    options = replace(options_of(result), tune=False)
    return process(_required(result), options, edits=record(result, settings))


def replayed(result: Result, edits: Sequence[Edit]) -> Result:
    """The result with edits, from its recordings."""
    return process(_required(result), options_of(result), edits=record(result, edits))


def record(result: Result, edits: Sequence[Edit]) -> Record:
    """Edits with what else was chosen on the way to a result."""
    return Record(tuple(edits), processing=result.provenance.get("given_processing", {}))


def _required(result: Result) -> list[Path]:
    paths = recordings_of(result)
    if not paths:
        rule, remedy = "other blocks and windows need them", "Put them back where they were"
        raise InputError(result.name, "its recordings are gone", rule, remedy)
    return paths
