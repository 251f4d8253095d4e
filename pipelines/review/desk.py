"""What is open in one server: results under review, the thread that fits, and who listens."""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipelines.review.bench import Bench
from pipelines.review.worker import Worker

Event = dict[str, Any] | None  # None ends a stream
_ID_BYTES = 6


class Desk:
    """Everything that one server has open.

    Parameters
    ----------
    root : Path
        Nothing outside of it is opened.
    """

    def __init__(self, root: Path) -> None:
        self.root = root.resolve()
        self._worker = Worker()
        self._lock = threading.Lock()
        self._places: dict[str, Path] = {}
        self._benches: dict[str, Bench] = {}
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
        if path is None:
            return None
        with self._lock:
            if name not in self._benches:
                bench = Bench(name, path, self._worker, self._tell_state)
                self._benches[name] = bench
            return self._benches[name]

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
        """End fits, and free the drafts."""
        self._worker.end()
        for bench in self._benches.values():
            bench.close()

    def _tell_state(self, state: dict[str, Any]) -> None:
        self.tell({"kind": "state", "id": state["id"], "state": state})
