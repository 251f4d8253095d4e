"""Standard output and error that cannot end a command: a result never hangs on who listens."""

from __future__ import annotations

import codecs
import errno
import io
import os
import sys
from contextlib import suppress
from typing import Any

_STANDARD = ("stdout", "stderr")
# A reader that ended has seen what it wanted; Windows calls the same EINVAL.
_READER_ENDED = (errno.EPIPE, errno.EINVAL) if os.name == "nt" else (errno.EPIPE,)


class _Tolerant(io.RawIOBase):
    """A stream that takes everything; what went wrong is kept.

    Parameters
    ----------
    stream : TextIOWrapper
        The text stream it takes the place of; kept, as it would close its bytes when it goes.
    """

    def __init__(self, stream: io.TextIOWrapper) -> None:
        self._stream, self._raw = stream, _raw(stream)
        self.error: OSError | None = None

    @property
    def name(self) -> Any:
        """That of the stream beneath."""
        return self._raw.name

    def writable(self) -> bool:
        """Always."""
        return True

    def fileno(self) -> int:
        """That of the stream beneath."""
        return int(self._raw.fileno())

    def isatty(self) -> bool:
        """As the stream beneath."""
        return bool(self._raw.isatty())

    def write(self, data: Any) -> int | None:
        """Write as much as can be written now; after an error, nothing any more."""
        if self.error is None:
            try:
                return self._raw.write(data)  # type: ignore[no-any-return]
            except OSError as error:
                self.error = error
        return memoryview(data).nbytes


def make_tolerant() -> None:
    """Put streams beneath `print` that survive closed ones, full drives and readers that end.

    Streams of a notebook or a test are left alone.
    """
    _fill_gaps()
    for number, name in enumerate(_STANDARD, 1):
        stream = getattr(sys, name)
        if stream is None:  # it was closed when Python started
            stream = os.fdopen(number, "w", encoding="utf-8", closefd=False)
        if type(stream) is io.TextIOWrapper and not isinstance(_raw(stream), _Tolerant):
            stream = _wrapped(stream, number)
        setattr(sys, name, stream)


def output_trouble() -> OSError | None:
    """What kept standard output from being written; nothing where the reader ended by itself."""
    for name in _STANDARD:
        with suppress(OSError, ValueError):  # a stream that is not ours
            getattr(sys, name).flush()
    raw = _raw(sys.stdout)
    error = raw.error if isinstance(raw, _Tolerant) else None
    return None if error is None or error.errno in _READER_ENDED else error


def _fill_gaps() -> None:
    """Open a device that takes everything in place of closed streams.

    Otherwise the next file that is opened gets their number, and what a library says of an error
    ends in it.
    """
    while True:
        number = os.open(os.devnull, os.O_RDWR)
        if number > 2:
            os.close(number)
            return
        os.set_inheritable(number, True)


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


_HANDLER = "ringmodal"
_SUPERSCRIPTS = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"
_AS_DIGITS = str.maketrans(_SUPERSCRIPTS, "-0123456789")
_OTHERWISE = {
    "−": "-",
    "±": "+/-",
    "×": "x",
    "→": "->",
    "…": "...",
    "–": "-",
    "≥": ">=",
    "≤": "<=",
    "°": " deg",
    "²": "^2",
    "³": "^3",
    "─": "-",
}


def tolerant_output() -> None:
    """Let standard output and error replace what their encoding lacks."""
    codecs.register_error(_HANDLER, _replaced)
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)  # a notebook's streams have none
        if reconfigure is not None:
            reconfigure(errors=_HANDLER)


def lacking(encoding: str, characters: str = "±×→−⁶°²") -> str:
    """Characters of results that an encoding lacks."""
    return "".join(sign for sign in characters if not _has(encoding, sign))


def _has(encoding: str, sign: str) -> bool:
    try:
        sign.encode(encoding)
    except UnicodeEncodeError:
        return False
    return True


def _replaced(error: UnicodeError) -> tuple[str, int]:
    """Write the signs that cannot be encoded with others: an exponent stays an exponent."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    signs = error.object[error.start : error.end]
    before = error.object[error.start - 1 : error.start]
    text = ""
    for sign in signs:
        if sign in _SUPERSCRIPTS:
            text += ("" if before in tuple(_SUPERSCRIPTS) else "^") + sign.translate(_AS_DIGITS)
        else:
            text += _OTHERWISE.get(sign, "?")
        before = sign
    return text, error.end
