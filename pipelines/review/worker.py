"""One thread for all fits: what is wanted now comes first, what nobody waits for is stopped."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, Protocol

from ema.core.errors import SupersededError

Stop = Callable[[], bool]


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
        """Stop the fit and the thread."""
        with self._changed:
            self._ended = True
            self._stop.set()
            for _, future in self._calls:
                future.cancel()
            self._changed.notify()
        self._thread.join()

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
        except Exception as error:  # noqa: BLE001 - the thread goes on, the page is told
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
