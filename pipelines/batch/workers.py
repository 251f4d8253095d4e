"""Workers of a batch: this process, processes on this machine, or those of a Dask cluster.

Processes on this machine receive tasks and return records through one anonymous pipe each. Nothing
listens on a port, so no other user of the machine can reach a batch.
"""

from __future__ import annotations

import ipaddress
import multiprocessing
import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Any
from urllib.parse import urlsplit

from ema.core.errors import InputError
from pipelines.batch.campaigns import LIVES, Task, Work, given_up, sweep
from pipelines.batch.state import Record
from pipelines.results.provenance import software_version

ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
ALLOW = "--allow-unencrypted"
_CONNECT_S = 20.0
_ENCRYPTED = ("tls://", "wss://")
_WITHIN = "inproc://"  # a scheduler in this process


def in_this_process(tasks: Sequence[Task], work: Work) -> Generator[Record]:
    """Do one task after the other."""
    yield from map(work, tasks)


def on_this_machine(tasks: Sequence[Task], work: Work, n_workers: int) -> Generator[Record]:
    """Share the tasks among processes with one thread of linear algebra each.

    Yields records as tasks end. A task whose worker dies is tried again after the others.
    """
    crew = _Crew(tasks, work, n_workers)
    try:
        yield from crew.records()
    finally:
        crew.dismiss()


@dataclass
class _Worker:
    """A worker process; it has one task at a time, to know which one ended it."""

    process: SpawnProcess
    pipe: Connection
    task: Task | None = None
    is_ready: bool = False


class _Crew:
    """Worker processes, the task of each, and the tasks that wait."""

    def __init__(self, tasks: Sequence[Task], work: Work, n_workers: int) -> None:
        self._waiting = deque(tasks)
        self._work = work
        self._n_workers = n_workers
        self._workers: list[_Worker] = []
        self._deaths: Counter[str] = Counter()
        self._n_stillborn = 0  # killed in a row before they were ready

    def records(self) -> Generator[Record]:
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
        """End all workers at once; finished campaigns are on disk."""
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
                with suppress(OSError):  # dead: its pipe reports that next
                    worker.pipe.send(worker.task)

    def _heard(self, worker: _Worker) -> Record | None:
        """Receive from a worker: that it is ready, a record, or the end of its pipe."""
        try:
            record: Record | None = worker.pipe.recv()
        except (EOFError, OSError):  # it may die while sending
            return self._buried(worker)
        worker.task, worker.is_ready, self._n_stillborn = None, True, 0
        self._hand_out()  # before the record is processed
        return record

    def _buried(self, worker: _Worker) -> Record | None:
        """Put back the task of a dead worker, or give it up."""
        self._workers.remove(worker)
        worker.pipe.close()
        worker.process.join()
        code = worker.process.exitcode or 0
        how = f"exit code {code}" if code >= 0 else f"signal {-code}"
        worker.process.close()
        if not worker.is_ready:
            self._n_stillborn += 1
            if code >= 0 or self._n_stillborn == LIVES:
                found = f"a worker process ended as it started ({how})"
                remedy = "Use fewer --jobs; a script that calls it needs"
                remedy += ' `if __name__ == "__main__":`'
                raise InputError("--jobs", found, "each worker is a separate process", remedy)
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
    theirs.close()  # only the worker has it then: its death closes the pipe
    return _Worker(process, ours)


@contextmanager
def _one_thread() -> Iterator[None]:
    """One thread for the linear algebra of processes started in the block."""
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
    """Block Ctrl-C in processes started in the block: the batch receives it and ends its workers.

    Windows cannot block it; there a worker ignores it from its first line on.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # its start would unblock Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve(pipe: Connection, work: Callable[[Any], Any]) -> None:
    """Report that this process is ready, then answer each task with its record."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the batch ends its workers itself
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # blocked as it started
    threading.Thread(target=_end_with_the_batch, daemon=True).start()
    pipe.send(None)
    while True:
        pipe.send(work(pipe.recv()))


def _end_with_the_batch() -> None:
    """Exit at once when the batch has ended, for whatever reason."""
    batch = multiprocessing.parent_process()
    if batch is not None:
        batch.join()
        os._exit(1)


def on_cluster(
    tasks: Sequence[Task],
    work: Work,
    address: str,
    announce: Callable[[str], None],
    *,
    allow_unencrypted: bool = False,
) -> Generator[Record]:
    """Share the tasks among the workers of a scheduler; yields records as tasks end.

    The folders of the tasks are under the same paths on all machines. `announce` is called with
    messages about waiting and about risks. Certificates are those of Dask's own configuration,
    ``distributed.comm.tls``; `allow_unencrypted` permits a scheduler without TLS that other
    machines can reach.
    """
    distributed = _imported()
    _require_encryption(address, announce, allowed=allow_unencrypted)
    try:
        client = distributed.Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError, TypeError) as error:  # a timeout; an address; no certificates
        rule = "scheduler unreachable"
        remedy = "Check the address, which `dask scheduler` and SLURMCluster print"
        if _is_encrypted(address):
            remedy += ", and the certificates under `distributed.comm.tls` of Dask's configuration"
        raise InputError(f"--scheduler {address}", str(error), rule, remedy) from error
    with client:
        if not client.scheduler_info()["workers"]:
            announce(f"Waiting for workers at {address} …")
        _require_same_version(client, address)
        yield from _shared(client, tasks, work)


def _imported() -> Any:
    """The optional dask.distributed package."""
    if find_spec("distributed") is None:
        rule = "the workers of a cluster need dask.distributed"
        remedy = "Install it with `pip install distributed`, or use --jobs"
        raise InputError("--scheduler", "dask.distributed is not installed", rule, remedy)
    return import_module("distributed")


def _require_encryption(address: str, announce: Callable[[str], None], *, allowed: bool) -> None:
    """Refuse a scheduler that other machines can use; warn of one that other users here can use.

    Anyone who reaches the port of a Dask scheduler without TLS can run code in its workers and in
    this process.
    """
    if allowed or _is_encrypted(address) or address.lower().startswith(_WITHIN):
        return
    if _is_this_machine(address):
        announce(
            f"Warning: {address} is not encrypted: any user of this machine can run code in "
            f"its workers and in this batch. Start the scheduler with TLS (docs: Many campaigns), "
            f"or confirm with {ALLOW}."
        )
        return
    rule = "anyone who reaches such a scheduler can run code in its workers and in this batch"
    remedy = f"Start it with TLS and use tls://HOST:PORT, or confirm with {ALLOW}"
    raise InputError(f"--scheduler {address}", "a connection without TLS", rule, remedy)


def _is_encrypted(address: str) -> bool:
    return address.lower().startswith(_ENCRYPTED)


def _is_this_machine(address: str) -> bool:
    """Whether an address is a loopback address, which other machines cannot reach."""
    host = urlsplit(address if "://" in address else f"//{address}").hostname or ""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _require_same_version(client: Any, address: str) -> None:
    """Results of two versions would not be comparable."""
    here = software_version()
    try:
        there = client.submit(software_version, pure=False).result()
    except (ImportError, RuntimeError) as error:  # in the worker, or already in the scheduler
        raise _other_version(f"workers at {address}", str(error)) from error
    if there != here:
        raise _other_version(f"workers at {address}", f"ringmodal {there}")


def _other_version(where: str, found: str) -> InputError:
    rule = f"workers must run the same ringmodal as this machine, {software_version()}"
    return InputError(where, found, rule, "Install it where the scheduler and the workers start")


def _shared(client: Any, tasks: Sequence[Task], work: Work) -> Generator[Record]:
    """Records as tasks end; the others are cancelled when this is closed."""
    waiting = {client.submit(work, task, pure=False): task for task in tasks}
    try:
        for future in import_module("distributed").as_completed(list(waiting)):
            yield _record_of(future, waiting.pop(future))
            future.release()
    finally:
        client.cancel(list(waiting))


def _record_of(future: Any, task: Task) -> Record:
    try:
        record: Record = future.result()
    except CancelledError as error:
        rule = "scheduler unreachable, or it dropped the campaign"
        remedy = "Run the batch again; finished campaigns are not repeated"
        raise InputError(task.campaign.name, "no answer", rule, remedy) from error
    except ImportError as error:
        raise _other_version(f"the worker that took {task.campaign.name}", str(error)) from error
    except import_module("distributed").KilledWorker:
        return given_up(task, "workers died")
    return record
