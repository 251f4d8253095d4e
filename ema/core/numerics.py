"""Arrays that cannot be changed, and small numerical helpers of the whole package."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from operator import attrgetter
from threading import Lock
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
import scipy
import threadpoolctl
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from ema.core.errors import SupersededError

if TYPE_CHECKING:
    import pandas as pd

_ARRAY = re.compile(r"NDArray\[np\.(\w+)\]")
# Answers kept for one object: two bands for two estimators, four draws of the noise.
_KEPT_ANSWERS = 8
# Steps towards a fixed point that differ by less than this share of the largest are alike.
_ALIKE = 1e-3
# A variable of the context: fits in other threads are not stopped.
_STOP: ContextVar[Callable[[], bool] | None] = ContextVar("stop", default=None)


def readonly(values: ArrayLike, dtype: Any = float) -> NDArray[Any]:
    """Copy `values` into a new array of type `dtype` that cannot be written to.

    What is of that type and cannot be written to by anyone already is taken as it is.
    """
    if isinstance(values, np.ndarray) and values.dtype == dtype and _is_frozen(values):
        return values
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


class ReadonlyArrays:
    """Base of frozen data classes: arrays become read-only and of the type they are declared as."""

    def __post_init__(self) -> None:
        for name, declared in type(self).__annotations__.items():
            if match := _ARRAY.fullmatch(declared):
                dtype = np.dtype(getattr(np, match[1]))
                object.__setattr__(self, name, readonly(getattr(self, name), dtype))


def constant(value: float, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Read-only array that holds one number everywhere, and takes the memory of one."""
    return np.broadcast_to(readonly(value), shape)


def stacked(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Rows of all parts in one read-only array; one part alone is not copied.

    Parts that `constant` made of one number stay such.
    """
    if len(parts) == 1:
        return readonly(parts[0], parts[0].dtype)
    if all(part.size and not any(part.strides) for part in parts):
        numbers = np.unique([part.flat[0] for part in parts])
        if len(numbers) == 1:
            n_rows = sum(len(part) for part in parts)
            return constant(numbers[0], (n_rows, *parts[0].shape[1:]))
    array = np.concatenate(parts)
    array.setflags(write=False)
    return array


def columns_of(rows: Iterable[Any], parts: Mapping[str, str]) -> dict[str, list[Any]]:
    """Columns of a table by name; `parts` are the attributes of the rows that they have."""
    found = list(rows)
    return {name: list(map(attrgetter(part), found)) for name, part in parts.items()}


def frame_of(columns: Mapping[Any, Any], whole: Sequence[str] = ()) -> pd.DataFrame:
    """Table with a copy of each column; those in `whole` are integers, with None where unknown."""
    import pandas as pd  # takes 0.2 s to load: only those who want a DataFrame wait

    def column(name: Any, values: Any) -> Any:
        if name in whole:
            return pd.array(values, dtype="Int64")
        return np.array(values) if isinstance(values, np.ndarray) else list(values)

    return pd.DataFrame({name: column(name, values) for name, values in columns.items()})


def towards_fixed_point(
    tried: Sequence[NDArray[Any]], found: Sequence[NDArray[Any]], size: NDArray[np.float64]
) -> NDArray[Any]:
    """Where to look next for x = g(x), from some x that were tried and g of each (Anderson 1965).

    Going on from each g(x) is slow where x runs round in circles on its way. `size` is how much
    of each number counts alike.
    """
    steps = (np.array(found) - np.array(tried)) / size
    if len(steps) < 2:
        return found[-1]
    steps = np.concatenate([steps.real, steps.imag], axis=1).reshape(len(steps), -1)
    share = np.linalg.lstsq(np.diff(steps, axis=0).T, steps[-1], rcond=_ALIKE)[0]
    return np.asarray(found[-1] - np.tensordot(share, np.diff(found, axis=0), 1))


def _is_frozen(array: NDArray[Any]) -> bool:
    """Whether neither the array nor one whose memory it shows can be written to."""
    owner: object = array
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            return False
        owner = owner.base
    return owner is None


Arguments = ParamSpec("Arguments")
Answer = TypeVar("Answer")
Of = TypeVar("Of")


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


def kept_with(
    function: Callable[Concatenate[Of, Arguments], Answer],
) -> Callable[Concatenate[Of, Arguments], Answer]:
    """Keep a function's last answers for its first argument as long as that lives."""
    kept: WeakKeyDictionary[Of, dict[object, Answer]] = WeakKeyDictionary()

    @wraps(function)
    def cached(of: Of, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Answer:
        known, key = kept.setdefault(of, {}), (args, tuple(kwargs.items()))
        if key in known:
            return known[key]
        answer = function(of, *args, **kwargs)
        while len(known) >= _KEPT_ANSWERS:
            known.pop(next(iter(known)), None)
        known[key] = answer
        return answer

    return cached


class _SharedLimit:
    """One thread of linear algebra, from the first user's start to the last one's end."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._n_users = 0
        self._limits: threadpool_limits | None = None

    def __enter__(self) -> None:
        with self._lock:
            if self._limits is None:
                _ = scipy.linalg  # loads what it has beneath it: only what is there is limited
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
    openblas = getattr(threadpoolctl, "OpenBLASController", None)
    clear = getattr(openblas, "clear_controlling_thread", None)
    if clear is not None:
        clear(force=True)


_ONE_BLAS_THREAD = _SharedLimit()


@contextmanager
def stoppable(stop: Callable[[], bool] | None) -> Iterator[None]:
    """Let `stop` end the searches inside, once it gives true."""
    before = _STOP.set(stop)
    try:
        yield
    finally:
        _STOP.reset(before)


def end_if_stopped() -> None:
    """Raise `SupersededError` where the fit is not wanted any more; searches ask at every step."""
    stop = _STOP.get()
    if stop is not None and stop():
        raise SupersededError("the fit was stopped, as another one takes its place")
