"""The workers of a Dask cluster, which somebody else has started, and who may reach it."""

from __future__ import annotations

import ipaddress
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from ema.core.errors import InputError
from pipelines.batch.state import Record
from pipelines.batch.task import Task, Work, given_up
from pipelines.results.provenance import software_version

EXTRA = "cluster"
ALLOW = "--allow-unencrypted"
_CONNECT_S = 20.0
_ENCRYPTED = ("tls", "wss")
_WITHIN = "inproc"  # a scheduler in this very process


def on_cluster(
    tasks: Sequence[Task],
    work: Work,
    address: str,
    say: Callable[[str], None],
    *,
    allow_unencrypted: bool = False,
) -> Iterator[Record]:
    """Share the tasks among the workers of a scheduler.

    Certificates are those of Dask's own configuration, ``distributed.comm.tls``.

    Parameters
    ----------
    tasks : sequence of Task
        Their folders are under the same paths on all machines.
    work : callable
    address : str
        For example ``tls://login1:8786``.
    say : callable
        Called with what is waited for and what is risky.
    allow_unencrypted : bool
        Whether to take a scheduler without TLS although other machines reach it.

    Yields
    ------
    Record
        As tasks end.

    Raises
    ------
    InputError
        If the scheduler cannot be reached or anybody could, or its workers run another version.
    """
    distributed = _imported()
    _require_encryption(address, say, allowed=allow_unencrypted)
    try:
        client = distributed.Client(address, timeout=_CONNECT_S)
    except (OSError, ValueError, TypeError) as error:  # a timeout; an address; no certificates
        rule = "no scheduler answers there"
        remedy = "Check the address, which `dask scheduler` and SLURMCluster print"
        if _is_encrypted(address):
            remedy += ", and the certificates under `distributed.comm.tls` of Dask's configuration"
        raise InputError(f"--scheduler {address}", str(error), rule, remedy) from error
    with client:
        if not client.scheduler_info()["workers"]:
            say(f"Waiting for workers at {address} …")
        _require_same_version(client, address)
        yield from _shared(client, tasks, work)


def _imported() -> Any:
    """The optional dask.distributed."""
    if find_spec("distributed") is None:
        rule = "the workers of a cluster need dask.distributed"
        remedy = f'Install it with `pip install "ringmodal[{EXTRA}]"`, or use --jobs'
        raise InputError("--scheduler", "dask.distributed is not installed", rule, remedy)
    return import_module("distributed")


def _require_encryption(address: str, say: Callable[[str], None], *, allowed: bool) -> None:
    """Refuse a scheduler that any machine of the network can use; warn of one any user here can.

    Who reaches the port of a Dask scheduler without TLS runs code as whoever started its workers,
    and as whoever takes results from it.
    """
    if allowed or _is_encrypted(address) or _scheme(address) == _WITHIN:
        return
    if _is_this_machine(address):
        say(
            f"Warning: {address} is not encrypted: every user of this machine can run code in "
            f"its workers and in this batch. Start the scheduler with TLS (docs: Many campaigns), "
            f"or confirm with {ALLOW}."
        )
        return
    raise InputError(
        f"--scheduler {address}",
        "a connection without TLS",
        "whoever reaches such a scheduler can run code in its workers and in this batch",
        f"Start it with TLS and use tls://HOST:PORT, or confirm with {ALLOW}",
    )


def _is_encrypted(address: str) -> bool:
    return _scheme(address) in _ENCRYPTED


def _scheme(address: str) -> str:
    return address.partition("://")[0].lower()


def _is_this_machine(address: str) -> bool:
    """Whether an address is the loopback interface's, which other machines do not reach."""
    scheme, found, place = address.partition("://")
    place = place if found else scheme
    host = place.rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


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
    """Records as tasks end; what has not ended when this is closed is taken back."""
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
        return given_up(task, "workers died")
    return record
