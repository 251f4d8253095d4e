"""Who does the work of a batch on this machine: this process, or workers on pipes of its own.

Nothing listens anywhere, so nobody else on the machine can reach a batch: tasks and records travel
through one anonymous pipe for each worker.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any

from ema.core.errors import InputError
from pipelines.batch.state import Record
from pipelines.batch.task import LIVES, Task, Work, given_up, sweep

ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def in_this_process(tasks: Sequence[Task], work: Work) -> Iterator[Record]:
    """Do one task after the other."""
    yield from map(work, tasks)


def on_this_machine(tasks: Sequence[Task], work: Work, n_workers: int) -> Iterator[Record]:
    """Share the tasks among processes with one thread of linear algebra each.

    Even a single one keeps what may happen to it away from this process. A task whose worker dies
    is tried again after the others.

    Yields
    ------
    Record
        As tasks end.

    Raises
    ------
    InputError
        If worker processes cannot start.
    """
    crew = _Crew(tasks, work, n_workers)
    try:
        yield from crew.records()
    finally:
        crew.dismiss()


@dataclass
class _Worker:
    """A worker process; it has one task at a time, so that no other is blamed for its death."""

    process: SpawnProcess
    pipe: Connection
    task: Task | None = None
    is_ready: bool = False


class _Crew:
    """Worker processes, what each of them does, and what waits."""

    def __init__(self, tasks: Sequence[Task], work: Work, n_workers: int) -> None:
        self._waiting = deque(tasks)
        self._work = work
        self._n_workers = n_workers
        self._workers: list[_Worker] = []
        self._deaths: Counter[str] = Counter()
        self._stillborn = 0  # killed one after the other, before they could take a task

    def records(self) -> Iterator[Record]:
        """Records as tasks end."""
        while self._waiting or self._busy():
            self._fill()
            self._hand_out()
            for pipe in wait([worker.pipe for worker in self._workers]):
                worker = next(each for each in self._workers if each.pipe is pipe)
                record = self._heard(worker)
                if record is not None:
                    yield record

    def dismiss(self) -> None:
        """End all workers at once: what they finished is on disk, what they did not is lost."""
        for worker in self._workers:
            worker.process.kill()
        for worker in self._workers:
            worker.process.join()
            worker.process.close()
            worker.pipe.close()
        self._workers.clear()

    def _busy(self) -> int:
        return sum(worker.task is not None for worker in self._workers)

    def _fill(self) -> None:
        """Start workers as long as there is a task for one more."""
        wanted = min(self._n_workers, len(self._waiting) + self._busy())
        while len(self._workers) < wanted:
            self._workers.append(_started(self._work))

    def _hand_out(self) -> None:
        for worker in self._workers:
            if self._waiting and worker.is_ready and worker.task is None:
                worker.task = self._waiting.popleft()
                with suppress(OSError):  # it is dead, which its pipe will say next
                    worker.pipe.send(worker.task)

    def _heard(self, worker: _Worker) -> Record | None:
        """Take what a worker says: that it is ready, a record, or by its silence that it died."""
        try:
            record: Record | None = worker.pipe.recv()
        except (EOFError, OSError):  # it may die within a record
            return self._buried(worker)
        worker.task, worker.is_ready, self._stillborn = None, True, 0
        self._hand_out()  # before the record is looked at
        return record

    def _buried(self, worker: _Worker) -> Record | None:
        """Put the task of a dead worker back, or give it up."""
        self._workers.remove(worker)
        worker.pipe.close()
        worker.process.join()
        how = _ending(worker.process.exitcode)
        is_killed = (worker.process.exitcode or 0) < 0
        worker.process.close()
        if not worker.is_ready:
            self._stillborn += 1
            if not is_killed or self._stillborn == LIVES:
                raise _cannot_start(how)
        task = worker.task
        if task is None:
            return None
        sweep(task)
        self._deaths[task.campaign.name] += 1
        if self._deaths[task.campaign.name] < LIVES:
            self._waiting.append(task)
            return None
        return given_up(task, f"workers died ({how})")


def _started(work: Work) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=serve, args=(theirs, work), daemon=True)
    with _one_thread(), _no_interrupt():
        process.start()
    theirs.close()  # what is left is the worker's alone: its death closes the pipe
    return _Worker(process, ours)


def _ending(code: int | None) -> str:
    """How a process ended, in words."""
    if code is None or code >= 0:
        return f"exit code {code}"
    return f"signal {-code}"


def _cannot_start(how: str) -> InputError:
    rule = "each worker is a process of its own"
    remedy = (
        'Run the batch with fewer --jobs; a script that calls it needs `if __name__ == "__main__":`'
    )
    return InputError("--jobs", f"a worker process ended as it started ({how})", rule, remedy)


@contextmanager
def _one_thread() -> Iterator[None]:
    """One thread for the linear algebra of what is started, whatever this machine sets."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Start what is started with Ctrl-C held back: it comes here, and the batch ends its workers.

    Windows cannot hold it back; there a worker ignores it from its first line on.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return

    resource_tracker.ensure_running()  # as it starts it lets Ctrl-C through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve(pipe: Connection, work: Callable[[Any], Any]) -> None:
    """Say that it is ready, then answer each task with its record.

    Parameters
    ----------
    pipe : Connection
        To the batch.
    work : callable
    """
    _leave_interrupts_to_the_batch()
    threading.Thread(target=_end_with_the_batch, daemon=True).start()
    pipe.send(None)
    while True:
        pipe.send(work(pipe.recv()))


def _leave_interrupts_to_the_batch() -> None:
    """Ctrl-C reaches every process of a terminal; the batch ends its workers itself."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # held back as it started


def _end_with_the_batch() -> None:
    """Leave at once when the batch is gone, however that happened."""
    batch = multiprocessing.parent_process()
    if batch is not None:
        batch.join()
        os._exit(1)
