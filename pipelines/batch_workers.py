"""Who does the work of a batch: this process, workers on this machine, or a cluster."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from ema.errors import InputError
from pipelines.batch_record import Record
from pipelines.batch_task import Task, failure, kept
from pipelines.versions import software_version

EXTRA = "cluster"
LIVES = 3  # a task that has ended this many workers is given up
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_CONNECT_S = 20.0
_OF_A_CLUSTER = {
    "distributed.scheduler.allowed-failures": LIVES - 1,
    # A task that waits at a worker would be blamed for the death that another one caused.
    "distributed.scheduler.worker-saturation": 1.0,
    # Memory that recordings are mapped to is given back by itself; a paused worker would hang.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.preload": ["pipelines.batch_preload"],
}

Work = Callable[[Task], Record]


def in_this_process(tasks: Sequence[Task], work: Work) -> Iterator[Record]:
    """Do one task after the other."""
    yield from map(work, tasks)


def on_this_machine(tasks: Sequence[Task], work: Work, n_workers: int) -> Iterator[Record]:
    """Share the tasks among processes with one thread and an equal part of the memory each.

    Even a single one keeps what may happen to it away from this process.

    Raises
    ------
    InputError
        If dask.distributed is not installed.
    """
    distributed = _imported("--jobs")
    with (
        _one_thread_each(),
        import_module("dask").config.set(_OF_A_CLUSTER),
        distributed.LocalCluster(
            n_workers=n_workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
            memory_limit="auto",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield from _shared(client, tasks, work)


def on_cluster(
    tasks: Sequence[Task], work: Work, address: str, say: Callable[[str], None]
) -> Iterator[Record]:
    """Share the tasks among the workers of a scheduler.

    Parameters
    ----------
    tasks : sequence of Task
        Their folders are under the same paths on all machines.
    work : callable
    address : str
        For example ``tcp://login1:8786``.
    say : callable
        Told when workers are waited for.

    Raises
    ------
    InputError
        If the scheduler cannot be reached, or its workers run another version.
    """
    distributed = _imported("--scheduler")
    try:
        client = distributed.Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError) as error:  # a timeout is an OSError
        rule = "no scheduler answers there"
        remedy = "Check the address; `dask scheduler` and SLURMCluster print it"
        raise InputError(f"--scheduler {address}", str(error), rule, remedy) from error
    with client:
        if not client.scheduler_info()["workers"]:
            say(f"Waiting for workers at {address} …")
        _require_same_version(client, address)
        yield from _shared(client, tasks, work)


def has_distributed() -> bool:
    """Whether dask.distributed is installed."""
    return find_spec("distributed") is not None


def _imported(option: str) -> Any:
    """The optional dask.distributed."""
    if not has_distributed():
        rule = "several workers need dask.distributed"
        remedy = f'Install it with `pip install "ringmodal[{EXTRA}]"`, or take --jobs 1'
        raise InputError(option, "dask.distributed is not installed", rule, remedy)
    return import_module("distributed")


def _require_same_version(client: Any, address: str) -> None:
    """Results of two versions side by side would not be comparable."""
    here = software_version()
    try:
        there = client.submit(software_version, pure=False).result()
    except (ImportError, RuntimeError) as error:  # there, or already at the scheduler
        raise _other_version(f"workers at {address}", str(error)) from error
    if there != here:
        raise _other_version(f"workers at {address}", f"ringmodal {there}")


def _other_version(where: str, found: str) -> InputError:
    rule = f"workers must run the same ringmodal as this machine, {software_version()}"
    return InputError(where, found, rule, "Install it where the scheduler and the workers start")


def _shared(client: Any, tasks: Sequence[Task], work: Work) -> Iterator[Record]:
    """Records as tasks are finished; what is not when this is closed is taken back."""
    waiting = {client.submit(work, task, pure=False): task for task in tasks}
    try:
        for future in import_module("distributed").as_completed(list(waiting)):
            yield _record_of(future, waiting.pop(future))
            future.release()
    finally:
        client.cancel(list(waiting))


def _record_of(future: Any, task: Task) -> Record:
    distributed = import_module("distributed")
    try:
        record: Record = future.result()
    except CancelledError as error:
        rule = "the scheduler is gone or dropped the campaign"
        remedy = "Run the batch again; what is done is not done again"
        raise InputError(task.campaign.name, "no answer", rule, remedy) from error
    except ImportError as error:
        raise _other_version(f"the worker that took {task.campaign.name}", str(error)) from error
    except distributed.KilledWorker:
        rule = "every worker process that took this campaign died, most likely for lack of memory"
        remedy = "Give each worker more memory, e.g. by fewer --jobs, then take --retry-failed"
        found = "workers died"
        return kept(task, failure(task, InputError(task.campaign.name, found, rule, remedy)))
    return record


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """One thread for the linear algebra of each worker, whatever this machine sets."""
    before = dict(os.environ)
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
