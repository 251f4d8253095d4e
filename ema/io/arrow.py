"""Read columnar tables: Parquet, Feather and Arrow IPC, one channel for each column of numbers."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pyarrow.types as types
from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.io.columns import Column, content_of_columns, name_and_unit
from ema.io.content import EXPORT_AGAIN, FileContent, check_expansion, reading, remark
from ema.io.sampling import stated_rate

if TYPE_CHECKING:
    import pyarrow as pa

    ReadColumn = Callable[[int], pa.ChunkedArray]

SUFFIXES = (".parquet", ".feather", ".arrow")
_FEATHER_1 = b"FEA1"
_ARROW_FILE = b"ARROW1"
_STREAM_IN_FILE = 8  # what follows the padded magic is a stream
_FILE_MARK = b"ARROW1"
_BEFORE_STREAM = 8  # the mark, padded
_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def read(path: Path) -> FileContent:
    """Read the time series of a Parquet, Feather or Arrow file.

    A column's unit stands in its name (``A01 [m/s^2]``) or in the metadata of its field under
    ``unit``. The rate follows from a column ``time`` or ``t``, from a column of time stamps, or
    from the metadata of the table (``sampling_rate_hz``, ``fs``, ``dt``). Missing values become
    NaN. A Feather file without compression and in one piece stays on disk as a memory map.

    Raises
    ------
    RecordingFormatError
        If the file is missing or damaged, claims to be far larger than it is, holds no column of
        numbers, or time is uneven.
    """
    parquet = path.suffix.lower() == ".parquet"
    with reading(path, "a Parquet file" if parquet else "a Feather or Arrow file"):
        schema, read_column = _parquet(path) if parquet else _ipc(path)
        kept, left = _split(path, schema)
        columns = [_column(schema.field(index), read_column(index)) for index in kept]
        metadata = {key.decode("latin-1"): value for key, value in (schema.metadata or {}).items()}
    content = content_of_columns(path, columns, rate_hz=stated_rate(path, metadata))
    notes = tuple(
        remark(path, name, "content", "a column of something other than numbers, left out")
        for name in left
    )
    return replace(content, findings=notes + content.findings)


def _parquet(path: Path) -> tuple[pa.Schema, ReadColumn]:
    """Columns and how one of them is read: one at a time, so that memory holds few copies."""
    file = pq.ParquetFile(path)
    schema = file.schema_arrow
    kept, _ = _split(path, schema)
    width = sum(schema.field(index).type.bit_width // 8 for index in kept)
    check_expansion(path.name, path, width * file.metadata.num_rows)
    return schema, lambda index: file.read([schema.names[index]]).column(0)


def _ipc(path: Path) -> tuple[pa.Schema, ReadColumn]:
    """The same for the two kinds of Arrow files: with a table of contents, or a mere stream."""
    source = pa.memory_map(str(path))
    magic = source.read(_STREAM_IN_FILE)
    if magic.startswith(_FEATHER_1):
        rule = "Feather of version 1 is no longer written by any program"
        raise RecordingFormatError(path.name, "Feather version 1", rule, EXPORT_AGAIN)
    is_file = magic.startswith(_ARROW_FILE)
    source.seek(_STREAM_IN_FILE if is_file else 0)
    messages = pa.ipc.MessageReader.open_stream(source)
    check_expansion(path.name, path, sum(unpacked_bytes(each) for each in messages))
    source.seek(0)
    table = (pa.ipc.open_file if is_file else pa.ipc.open_stream)(source).read_all()
    return table.schema, table.column


def _split(path: Path, schema: pa.Schema) -> tuple[list[int], list[str]]:
    """Columns of numbers or time, and the names of those that hold neither."""
    kept = [index for index, each in enumerate(schema) if _is_channel(each) or _is_stamp(each)]
    for index in kept:
        name = schema.names[index]
        if schema.names.count(name) > 1:
            rule = "column names must be unique"
            raise RecordingFormatError(path.name, f"two columns {name!r}", rule, EXPORT_AGAIN)
    return kept, [name for index, name in enumerate(schema.names) if index not in kept]


def _is_channel(field: pa.Field) -> bool:

    index = field.name.startswith("__index_level_")  # added by pandas
    return not index and bool(types.is_integer(field.type) or types.is_floating(field.type))


def _is_stamp(field: pa.Field) -> bool:

    return bool(types.is_timestamp(field.type) or types.is_duration(field.type))


def _column(field: pa.Field, values: pa.ChunkedArray) -> Column:
    values.validate()  # until then, lengths are what the file claims
    if _is_stamp(field):
        return Column("time", "s", _seconds(values, field.type.unit))
    name, unit = name_and_unit(field.name)
    stated = (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace")
    # One piece without gaps is a view of the file where that is mapped.
    samples = values.chunk(0) if values.num_chunks == 1 else values
    return Column(name, unit or stated.strip(), np.asarray(samples))


def _seconds(values: pa.ChunkedArray, unit: str) -> NDArray[np.float64]:
    """Time since the first stamp, exact for any date."""
    stamps = values.cast(pa.int64())
    first = stamps[0].as_py() if len(stamps) else None
    if first is None:
        return np.full(len(stamps), np.nan)
    since = pc.subtract(stamps, first)
    return np.asarray(since.to_numpy(), dtype=np.float64) / _PER_SECOND[unit]


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
