"""How much an Arrow stream claims to unpack to, read without unpacking it.

After the Arrow columnar format, "Serialization and Interprocess Communication": each message
describes its buffers in a FlatBuffers table, and a compressed buffer begins with its length when
unpacked, which the library would reserve at once.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa

_HEADER_OF_MESSAGE = 2
_BATCH_OF_DICTIONARY = 1
_BUFFERS, _COMPRESSION = 2, 3
_NOT_COMPRESSED = -1


@dataclass(frozen=True)
class _Table:
    """A FlatBuffers table: its bytes, and where it begins in them."""

    data: memoryview
    place: int

    def field(self, number: int) -> int | None:
        """Place of a field; None where the table leaves it out."""
        (back,) = struct.unpack_from("<i", self.data, self.place)
        layout = self.place - back
        (size,) = struct.unpack_from("<H", self.data, layout)
        entry = 4 + 2 * number
        if entry + 2 > size:
            return None
        (offset,) = struct.unpack_from("<H", self.data, layout + entry)
        return self.place + offset if offset else None

    def target(self, number: int) -> int | None:
        """Place that a field refers to."""
        place = self.field(number)
        return None if place is None else place + self._offset(place)

    def table(self, number: int) -> _Table | None:
        """Table that a field refers to."""
        place = self.target(number)
        return None if place is None else _Table(self.data, place)

    def _offset(self, place: int) -> int:
        (offset,) = struct.unpack_from("<I", self.data, place)
        return int(offset)


def unpacked_bytes(message: pa.Message) -> int:
    """Bytes that the buffers of a message take when unpacked.

    Parameters
    ----------
    message : pyarrow.Message

    Raises
    ------
    struct.error
        If the message is damaged.
    """
    data = memoryview(message.metadata)
    (root,) = struct.unpack_from("<I", data, 0)
    batch = _Table(data, root).table(_HEADER_OF_MESSAGE)
    if batch is not None and message.type == "dictionary":
        batch = batch.table(_BATCH_OF_DICTIONARY)
    if batch is None or message.type not in ("record batch", "dictionary"):
        return 0
    if batch.field(_COMPRESSION) is None:
        return 0
    body = memoryview(message.body or b"")
    return sum(_unpacked(body, *each) for each in _buffers(batch))


def _buffers(batch: _Table) -> Iterator[tuple[int, int]]:
    """Offset and length of each buffer in the message's body."""
    place = batch.target(_BUFFERS)
    if place is None:
        return
    (count,) = struct.unpack_from("<I", batch.data, place)
    for number in range(count):
        yield struct.unpack_from("<qq", batch.data, place + 4 + 16 * number)


def _unpacked(body: memoryview, offset: int, length: int) -> int:
    if length < 8:
        return 0
    (claimed,) = struct.unpack_from("<q", body, offset)
    return length if claimed == _NOT_COMPRESSED else max(int(claimed), 0)
