"""How likely chance alone makes a sum of squares this large."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from threadpoolctl import threadpool_limits


def chi_square_tail(value: ArrayLike, freedom: int) -> NDArray[np.float64]:
    """Chance that χ² of a whole number of degrees of freedom exceeds `value`.

    The finite sums of Abramowitz & Stegun (1964), eqs 26.4.4 and 26.4.5, in logarithms. The same
    as `scipy.stats.chi2.sf`, without the second that takes to load.
    """
    half = np.asarray(value, dtype=float)[..., None] / 2
    power = np.arange(freedom // 2) + freedom % 2 / 2
    factorial = np.array([math.lgamma(each + 1) for each in power])
    known = np.clip(half, 1e-300, 1e300)  # NaN stays
    tail = np.sum(np.exp(power * np.log(known) - known - factorial), axis=-1)
    if freedom % 2:
        tail = tail + np.vectorize(math.erfc, otypes=[float])(np.sqrt(known[..., 0]))
    return np.asarray(np.minimum(tail, 1.0))


def average_linkage(distance: NDArray[np.float64], cut: float) -> NDArray[np.int_]:
    """Merge the two nearest clusters until the nearest are further apart than `cut`.

    The distance of two clusters is the mean over all pairs of their members (UPGMA; Sokal and
    Michener 1958).

    Parameters
    ----------
    distance : ndarray, shape (n, n)
        Symmetric.
    cut : float

    Returns
    -------
    ndarray of int, shape (n,)
        Number of the cluster of each, from 0 in order of appearance.
    """
    between = np.array(distance, dtype=np.float64)
    np.fill_diagonal(between, np.inf)
    label = np.arange(len(between))
    size = np.ones(len(between))
    while len(between) > 1:
        one, other = divmod(int(np.argmin(between)), len(between))
        if not between[one, other] <= cut:
            break
        mean = size[one] * between[one] + size[other] * between[other]
        between[one] = between[:, one] = mean / (size[one] + size[other])
        between[one, one] = np.inf
        between[other] = between[:, other] = np.inf
        size[one] += size[other]
        label[label == other] = one
    return np.asarray(np.unique(label, return_inverse=True)[1])


def moving_mean(values: NDArray[Any], width: int) -> NDArray[np.float64]:
    """Mean of `width` (odd) neighbours along the last axis; the outermost values go on."""
    return np.asarray(np.mean(_windows(values, width), axis=-1))


def moving_median(values: NDArray[Any], width: int) -> NDArray[np.float64]:
    """Median of `width` (odd) neighbours along the last axis; the outermost values go on."""
    return np.asarray(np.median(_windows(values, width), axis=-1))


def _windows(values: NDArray[Any], width: int) -> NDArray[np.float64]:
    margins = [(0, 0)] * (np.ndim(values) - 1) + [(width // 2, width // 2)]
    extended = np.pad(np.asarray(values, dtype=np.float64), margins, mode="edge")
    return sliding_window_view(extended, width, axis=-1)


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
    machine that takes fifty times as long. The limit is the whole process's: calls that overlap in
    several threads share it, and the last one to end lifts it.
    """

    @wraps(function)
    def limited(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Answer:
        with _ONE_BLAS_THREAD:
            return function(*args, **kwargs)

    return limited


class _SharedLimit:
    """One thread of linear algebra, from the first user's start to the last one's end."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._n_users = 0
        self._limits: threadpool_limits | None = None

    def __enter__(self) -> None:
        from threadpoolctl import threadpool_limits

        with self._lock:
            if self._limits is None:
                _take_control()
                self._limits = threadpool_limits(1, user_api="blas")
            self._n_users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._n_users -= 1
            if self._n_users == 0 and self._limits is not None:
                _take_control()
                self._limits.restore_original_limits()
                self._limits = None
                _take_control()  # and leave it to whoever comes next


def _take_control() -> None:
    """Let any thread set the limit; threadpoolctl 3.8 leaves that to the first one that did."""
    import threadpoolctl

    openblas = getattr(threadpoolctl, "OpenBLASController", None)
    clear = getattr(openblas, "clear_controlling_thread", None)
    if clear is not None:
        clear(force=True)


_ONE_BLAS_THREAD = _SharedLimit()
