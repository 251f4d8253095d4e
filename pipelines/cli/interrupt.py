"""Interrupts by Ctrl-C or by the system: clean up, and report what was written."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # where the system has them
_REPEAT_S = 1.0  # a shell and a launcher may both pass on one Ctrl-C


class Interrupted(BaseException):
    """A signal to stop; not an `Exception`, so that no handler takes it for a failure."""

    def __init__(self, signal_number: int) -> None:
        super().__init__(signal_number)
        self.signal_number = signal_number
        self.outcome = "nothing was written"  # for the message

    @property
    def exit_code(self) -> int:
        """Exit code by the convention of shells: 130 for Ctrl-C, 143 for a termination."""
        return 128 + self.signal_number


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise `Interrupted` for signals to stop while the block runs.

    A signal that the parent process ignored, as ``nohup`` does, stays ignored. Repeats within a
    second are ignored, so that the clean-up is not cut short. Outside the main thread signals
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
        if received:  # a library swallowed `Interrupted` and failed later
            raise Interrupted(received[0][1]) from error
        raise
    finally:
        for number in caught:
            signal.signal(number, earlier[number])


@contextmanager
def reporting_outcome(place: Path) -> Iterator[None]:
    """If the block is interrupted, let the message state whether `place` was written."""
    before = _identity(place)
    try:
        yield
    except Interrupted as interrupted:
        after = _identity(place)
        if after != before:
            interrupted.outcome = f"{place} is complete"
        elif after is not None:
            interrupted.outcome = "the earlier result is unchanged"
        raise


def _identity(place: Path) -> tuple[int, int] | None:
    """Identity of a file or folder; None if it is missing or an empty folder."""
    try:
        status = place.stat()
        if place.is_dir() and not any(place.iterdir()):
            return None
    except OSError:
        return None
    return status.st_dev, status.st_ino
