"""How many threads numerical work may use."""

from __future__ import annotations

import os


def available_threads() -> int:
    """Cores this process may use, or fewer where ``OMP_NUM_THREADS`` says so.

    That variable already limits the linear algebra beneath numpy; batch systems set it.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    stated = os.environ.get("OMP_NUM_THREADS", "")
    return max(1, min(cores or 1, int(stated) if stated.isdecimal() else cores or 1))
