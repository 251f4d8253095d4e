"""Text of a file piece by piece: unpacked, decoded, with one kind of line ends."""

from __future__ import annotations

import codecs
import gzip
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from ema.errors import RecordingFormatError

_HEAD_BYTES = 1 << 20
_SMALLEST_SECTION = 1 << 18
_LARGEST_SECTION = 1 << 23
_LONGEST_LINE = 1 << 26
_MOST_PACKED = 50  # digits pack 3 to 10 times; what packs far better is a bomb or no measurement
_UTF_16 = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
_COPY_AGAIN = "Copy or export it again"


class TextSource:
    """A text file that is open for reading, once from its beginning to its end.

    The bytes it hands out are text in `encoding`, a superset of ASCII, with lines that end in LF
    or CR LF; UTF-16 arrives as UTF-8, and a byte-order mark is left out.

    Attributes
    ----------
    path : Path
        The file, for messages.
    head : str
        Its beginning, up to a megabyte.
    is_whole : bool
        Whether `head` is all of it.
    encoding : str
        How the bytes of `sections` encode text.
    """

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self.path = path
        self._file = file
        self._size = os.fstat(file.fileno()).st_size
        self._packed = path.name.lower().endswith(".gz")
        self._stream = cast(BinaryIO, gzip.GzipFile(fileobj=file)) if self._packed else file
        self._unpacked = 0
        self._decoder: codecs.IncrementalDecoder | None = None
        self._has_cr_alone = False
        self._bytes = self._beginning()
        self.is_whole = self._unpacked < _HEAD_BYTES
        self.head, self.encoding = _decoded(self._bytes)

    def sections(self, start: int) -> Iterator[bytes]:
        """Whole lines from character `start` of `head` on, some of them at a time.

        A last line that does not end comes by itself. `head` is given up, for memory.
        """
        rest = self._bytes[len(self.head[:start].encode(self.encoding)) :]
        self._bytes, self.head = b"", ""
        size = min(max(self._size // 4, _SMALLEST_SECTION), _LARGEST_SECTION)
        carried = b""
        for piece in self._pieces(rest, size):
            end = piece.rfind(b"\n") + 1
            if end:
                yield b"".join((carried, memoryview(piece)[:end]))
                carried = b""
            carried += piece[end:]
            if len(carried) > _LONGEST_LINE:
                rule = "a row of a table is no longer than that"
                found = f"a line of over {_LONGEST_LINE >> 20} MB"
                raise RecordingFormatError(self.path.name, found, rule, _COPY_AGAIN)
        if carried:
            yield carried

    def share_read(self) -> float:
        """How much of the file has been read, above 0 and up to 1."""
        return min(max(self._file.tell(), 1) / max(self._size, 1), 1.0)

    def _pieces(self, rest: bytes, size: int) -> Iterator[bytes]:
        for start in range(0, len(rest), size):
            yield rest[start : start + size]
        while piece := self._read(size):
            yield piece

    def _beginning(self) -> bytes:
        raw = self._raw(_HEAD_BYTES)
        codec = _UTF_16.get(raw[:2])
        if codec is not None:
            self._decoder = codecs.getincrementaldecoder(codec)()
            raw = self._in_utf_8(raw[2:])
        raw = raw.removeprefix(codecs.BOM_UTF8)
        self._has_cr_alone = b"\r" in raw and b"\n" not in raw
        return raw.replace(b"\r", b"\n") if self._has_cr_alone else raw

    def _read(self, size: int) -> bytes:
        raw = self._raw(size)
        if self._decoder is not None:
            raw = self._in_utf_8(raw)
        return raw.replace(b"\r", b"\n") if self._has_cr_alone else raw

    def _raw(self, size: int) -> bytes:
        try:
            raw = self._stream.read(size)
        except (gzip.BadGzipFile, EOFError, zlib.error) as error:
            rule = "a file ending in .gz is packed by gzip, as a whole"
            raise RecordingFormatError(self.path.name, str(error), rule, _COPY_AGAIN) from error
        except OSError as error:
            raise _unreadable(self.path, error) from error
        self._unpacked += len(raw)
        if self._packed and self._unpacked > _MOST_PACKED * self._size + _HEAD_BYTES:
            found = f"over {self._unpacked} bytes of text in {self._size}"
            rule = f"measured numbers do not pack more than {_MOST_PACKED} times"
            raise RecordingFormatError(self.path.name, found, rule, "Unpack it, if you trust it")
        return raw

    def _in_utf_8(self, raw: bytes) -> bytes:
        assert self._decoder is not None
        try:
            return self._decoder.decode(raw, final=not raw).encode()
        except UnicodeDecodeError as error:
            rule = "the file begins as UTF-16 and does not go on so"
            raise RecordingFormatError(self.path.name, str(error), rule, _COPY_AGAIN) from error


@contextmanager
def open_text(path: Path) -> Iterator[TextSource]:
    """Open a text file, packed by gzip where its name ends in ``.gz``.

    Raises
    ------
    RecordingFormatError
        If it cannot be read, is damaged, or unpacks to far more than any measurement.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise _unreadable(path, error) from error
    with file:
        yield TextSource(path, file)


def _unreadable(path: Path, error: OSError) -> RecordingFormatError:
    rule = "it must be a file that can be read"
    reason = error.strerror or str(error)
    return RecordingFormatError(str(path), reason, rule, "Check name and rights")


def _decoded(raw: bytes) -> tuple[str, str]:
    """Text and encoding of a file's beginning, which may end within a character."""
    try:
        return codecs.getincrementaldecoder("utf-8")().decode(raw), "utf-8"
    except UnicodeDecodeError:
        pass
    try:
        return raw.decode("cp1252"), "cp1252"
    except UnicodeDecodeError:
        return raw.decode("latin-1"), "latin-1"
