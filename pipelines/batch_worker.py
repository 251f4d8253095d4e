"""What a worker process of a batch does: one task after the other, until its batch ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any


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
