"""Stopping a fit that nobody waits for any more."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from ema.core.errors import SupersededError

# A variable of the context: fits in other threads are not stopped.
_STOP: ContextVar[Callable[[], bool] | None] = ContextVar("stop", default=None)


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
