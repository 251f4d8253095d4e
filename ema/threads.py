"""How many threads numerical work may use."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")


def available_cores() -> int:
    """Cores this process may use."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return cores or 1


def available_threads() -> int:
    """Cores this process may use, or fewer where ``OMP_NUM_THREADS`` says so.

    That variable already limits the linear algebra beneath numpy; batch systems set it.
    """
    cores = available_cores()
    stated = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(cores, int(stated) if stated.isdecimal() else cores))


def one_blas_thread(function: Callable[Arguments, Answer]) -> Callable[Arguments, Answer]:
    """Let a function's linear algebra use one thread.

    Its matrices are small: several threads wait for each other more than they work, and on a busy
    machine that takes fifty times as long.
    """

    @wraps(function)
    def limited(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Answer:
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
