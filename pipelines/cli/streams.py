"""Ready before anything loads: streams that fail or end, and signals to stop."""

from __future__ import annotations

import codecs
import errno
import io
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import Any

_STANDARD = ("stdout", "stderr")
# The reader of a pipe has ended, which is not an error; Windows reports EINVAL.
_READER_ENDED = (errno.EPIPE, errno.EINVAL) if os.name == "nt" else (errno.EPIPE,)
_HANDLER = "ringmodal"
_SUPERSCRIPTS = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"
_AS_DIGITS = str.maketrans(_SUPERSCRIPTS, "-0123456789")
_SIGNS = ("−-", "±+/-", "×x", "→->", "…...", "–-", "≥>=", "≤<=", "° deg", "²^2", "³^3", "─-")
_OTHERWISE = {each[0]: each[1:] for each in _SIGNS}
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # where the system has them
_REPEAT_S = 1.0  # a shell and a launcher may both pass on one Ctrl-C


class _Tolerant(io.RawIOBase):
    """A stream that accepts everything and keeps the first error."""

    def __init__(self, stream: io.TextIOWrapper) -> None:
        # The stream is kept: when it is deleted it closes its bytes.
        self._stream, self._raw = stream, _raw(stream)
        self.error: OSError | None = None

    @property
    def name(self) -> Any:
        return self._raw.name

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return int(self._raw.fileno())

    def isatty(self) -> bool:
        return bool(self._raw.isatty())

    def write(self, data: Any) -> int | None:
        """Write as much as possible now; after an error, nothing."""
        if self.error is None:
            try:
                return self._raw.write(data)  # type: ignore[no-any-return]
            except OSError as error:
                self.error = error
        return memoryview(data).nbytes


def make_tolerant() -> None:
    """Replace the standard streams by tolerant ones, except those of a notebook or a test."""
    _fill_gaps()
    for number, name in enumerate(_STANDARD, 1):
        stream = getattr(sys, name)
        if stream is None:  # it was closed when Python started
            stream = os.fdopen(number, "w", encoding="utf-8", closefd=False)
        if type(stream) is io.TextIOWrapper and not isinstance(_raw(stream), _Tolerant):
            stream = _wrapped(stream, number)
        setattr(sys, name, stream)


def output_trouble() -> OSError | None:
    """The error that kept standard output from being written, if any."""
    for name in _STANDARD:
        with suppress(OSError, ValueError):  # a stream that is not ours
            getattr(sys, name).flush()
    raw = _raw(sys.stdout)
    error = raw.error if isinstance(raw, _Tolerant) else None
    return None if error is None or error.errno in _READER_ENDED else error


def _fill_gaps() -> None:
    """Open the null device in place of closed streams.

    Otherwise the next file that is opened gets their number, and messages of libraries go into it.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)


def _raw(stream: Any) -> Any:
    buffer = getattr(stream, "buffer", None)
    return getattr(buffer, "raw", buffer)


def _wrapped(stream: io.TextIOWrapper, number: int) -> io.TextIOWrapper:
    try:
        if stream.fileno() != number:
            return stream
        stream.flush()
    except (OSError, ValueError):
        return stream
    return io.TextIOWrapper(
        io.BufferedWriter(_Tolerant(stream)),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


def tolerant_output() -> None:
    """Replace characters that the encoding of standard output or error lacks."""
    codecs.register_error(_HANDLER, _replaced)
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)  # a notebook's streams have none
        if reconfigure is not None:
            reconfigure(errors=_HANDLER)


def lacking(encoding: str, characters: str = "±×→−⁶°²") -> str:
    """Characters of results that an encoding lacks."""
    encoded = (sign.encode(encoding, "ignore") for sign in characters)
    return "".join(sign for sign, there in zip(characters, encoded, strict=True) if not there)


def _replaced(error: UnicodeError) -> tuple[str, int]:
    """Replace signs that cannot be encoded; a superscript stays an exponent."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text, before = "", error.object[error.start - 1 : error.start]
    for sign in error.object[error.start : error.end]:
        if sign in _SUPERSCRIPTS:
            text += ("" if before in tuple(_SUPERSCRIPTS) else "^") + sign.translate(_AS_DIGITS)
        else:
            text += _OTHERWISE.get(sign, "?")
        before = sign
    return text, error.end


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
    caught = {n: known for n, known in earlier.items() if known not in (signal.SIG_IGN, None)}
    try:
        for number in caught:
            signal.signal(number, stop)
        yield
    except Exception as error:  # whatever a library raises that swallowed `Interrupted`
        if received:
            raise Interrupted(received[0][1]) from error
        raise
    finally:
        for number, handler in caught.items():
            signal.signal(number, handler)


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
