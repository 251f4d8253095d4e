"""What a worker on this machine does first: leave Ctrl-C to the batch, which ends its workers."""

from __future__ import annotations

import signal


def dask_setup(_worker: object) -> None:
    """Called by dask as the worker starts."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
