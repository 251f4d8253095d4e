"""What is open in one server: results under review, the thread that fits, and who listens."""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipelines.results.result import Result
from pipelines.results.store import load
from pipelines.review.bench import Bench
from pipelines.review.folder import landing
from pipelines.review.jobs import Jobs
from pipelines.review.watch import Watch
from pipelines.review.worker import Worker
from pipelines.storage.result_folder import MARKER

Event = Mapping[str, Any] | None  # None ends a stream
_ID_BYTES = 6
_KEPT_RESULTS = 12  # that were compared


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
        self._jobs = Jobs(lambda: self.tell({"kind": "home"}))
        self._lock = threading.RLock()
        self._places: dict[str, Path] = {}
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

    def watch(self, name: str) -> Watch | None:
        """The campaign of a name, looked at from now on."""
        path = self.place(name)
        if path is None or (path / MARKER).is_file():
            return None
        with self._lock:
            if name not in self._watches:
                changed = {"kind": "watch", "id": name}
                self._watches[name] = Watch(path, lambda: self.tell(changed))
            return self._watches[name]

    def result(self, name: str) -> Result | None:
        """The result of a name, to be looked at only."""
        path = self.place(name)
        if path is None or not (path / MARKER).is_file():
            return None
        key = path, (path / MARKER).stat().st_mtime_ns
        if key not in self._results:
            self._results[key] = load(path)
            while len(self._results) > _KEPT_RESULTS:
                del self._results[next(iter(self._results))]
        return self._results[key]

    def landing(self) -> dict[str, Any]:
        """What the landing page shows."""
        return landing(self.root, self.name_of, self._jobs.told)

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
