"""Being asked to stop, by Ctrl-C or by the system: clean up, and say what stands."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # not every system has all of them
_REPEAT_S = 1.0  # a shell and a launcher may both pass on one Ctrl-C


class Interrupted(BaseException):
    """A signal asks to stop; no `Exception`, so that nothing on the way takes it for a failure.

    Parameters
    ----------
    signal_number : int

    Attributes
    ----------
    outcome : str
        What the interrupted work left, in words.
    """

    def __init__(self, signal_number: int) -> None:
        super().__init__(signal_number)
        self.signal_number = signal_number
        self.outcome = "nothing was written"

    @property
    def exit_code(self) -> int:
        """Exit code by the shells' convention: 130 for Ctrl-C, 143 for a termination."""
        return 128 + self.signal_number


@contextmanager
def interruptible() -> Iterator[None]:
    """Turn signals that ask to stop into `Interrupted` as long as the block lasts.

    A signal that the parent process had ignored, as ``nohup`` does, stays ignored; repeats within
    a second count once, so that cleaning up is not cut short. Outside the main thread signals
    cannot be caught and nothing changes.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[tuple[float, int]] = []

    def stop(number: int, _: FrameType | None) -> None:
        now_s = time.monotonic()
        repeated = bool(received) and now_s - received[-1][0] < _REPEAT_S
        received.append((now_s, number))
        if not repeated:
            raise Interrupted(number)

    numbers = [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]
    earlier = {number: signal.getsignal(number) for number in numbers}
    caught = [number for number in numbers if earlier[number] not in (signal.SIG_IGN, None)]
    try:
        for number in caught:
            signal.signal(number, stop)
        yield
    except Exception as error:
        if received:  # a library took `Interrupted` for its own failure and stumbled later
            raise Interrupted(received[0][1]) from error
        raise
    finally:
        for number in caught:
            signal.signal(number, earlier[number])


@contextmanager
def stating_what_stands(place: Path) -> Iterator[None]:
    """When the block is interrupted, look at `place` and let the message tell what is there."""
    before = _identity(place)
    try:
        yield
    except Interrupted as interrupted:
        after = _identity(place)
        if after != before:
            interrupted.outcome = f"{place} is complete"
        elif after is not None:
            interrupted.outcome = "the earlier result stands"
        raise


def _identity(place: Path) -> tuple[int, int] | None:
    """What distinguishes a file or folder from one that takes its place; None for nothing."""
    try:
        status = place.stat()
        if place.is_dir() and not any(place.iterdir()):
            return None
    except OSError:
        return None
    return status.st_dev, status.st_ino
