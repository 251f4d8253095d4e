"""Read columnar tables: Parquet, Feather and Arrow IPC, one channel for each column of numbers."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pyarrow.types as types

from ema.core.errors import RecordingFormatError
from ema.io.columns import Column, content_of_columns, name_and_unit
from ema.io.content import (
    EXPORT_AGAIN,
    FileContent,
    check_expansion,
    left_out,
    reading,
    refuse_result,
    states_scale,
)
from ema.io.frf_table import frf_content, with_frequency_first
from ema.io.variables import stated_rate

ReadColumn = Callable[[int], pa.ChunkedArray]

_SCALED = "Save the scaled numbers"
_FEATHER_1 = b"FEA1"
_ARROW_FILE = b"ARROW1"
_BEFORE_STREAM = 8  # bytes of the padded magic; what follows in a file is a stream
_NOT_COMPRESSED = -1


def read(path: Path) -> FileContent:
    """Read the time series of a Parquet, Feather or Arrow file: columns are in docs/recordings.md.

    Missing values become NaN. A Feather file without compression and in one piece stays on disk as
    a memory map. `RecordingFormatError` if the file is missing or damaged, claims to be far larger
    than it is, has no column of numbers, or time is uneven.
    """
    with reading(path, "a Parquet or Arrow file"), path.open("rb") as file:
        head = file.read(6)
    named = path.suffix.lower() == ".parquet"
    parquet = head.startswith(b"PAR1") or (named and head != b"ARROW1")
    with reading(path, "a Parquet file" if parquet else "a Feather or Arrow file"):
        schema, read_column = _parquet(path) if parquet else _ipc(path)
        refuse_result(path, schema.names)
        kept = _kept(path, schema)
        columns = [_column(path.name, schema.field(i), read_column(i)) for i in kept]
        metadata = {key.decode("latin-1"): value for key, value in (schema.metadata or {}).items()}
    others = [name for index, name in enumerate(schema.names) if index not in kept]
    findings = left_out(path, dict.fromkeys(others, "a column of something other than numbers"))
    if (of_frfs := with_frequency_first(path, columns)) is not None:
        return frf_content(path, of_frfs, findings, metadata)
    rate = stated_rate(path, metadata)
    return content_of_columns(path, columns, rate=rate, findings=findings, statements=metadata)


def _parquet(path: Path) -> tuple[pa.Schema, ReadColumn]:
    """Columns, and a function that reads one of them: one at a time, to save memory."""
    file = pq.ParquetFile(path)
    schema = file.schema_arrow
    width = sum(schema.field(index).type.bit_width // 8 for index in _kept(path, schema))
    check_expansion(path.name, path, width * file.metadata.num_rows)
    return schema, lambda index: file.read([schema.names[index]]).column(0)


def _ipc(path: Path) -> tuple[pa.Schema, ReadColumn]:
    """The same for the two kinds of Arrow files: with a table of contents, or a mere stream."""
    source = pa.memory_map(str(path))
    magic = source.read(_BEFORE_STREAM)
    if magic.startswith(_FEATHER_1):
        rule = "Feather of version 1 is no longer written by any program"
        raise RecordingFormatError(path.name, "Feather version 1", rule, EXPORT_AGAIN)
    is_file = magic.startswith(_ARROW_FILE)
    source.seek(_BEFORE_STREAM if is_file else 0)
    messages = pa.ipc.MessageReader.open_stream(source)
    check_expansion(path.name, path, sum(_unpacked_bytes(each) for each in messages))
    source.seek(0)
    table = (pa.ipc.open_file if is_file else pa.ipc.open_stream)(source).read_all()
    return table.schema, table.column


def _kept(path: Path, schema: pa.Schema) -> list[int]:
    """Columns of numbers or time."""
    kept = []
    for index, field in enumerate(schema):
        is_number = types.is_integer(field.type) or types.is_floating(field.type)
        is_index = field.name.startswith("__index_level_")  # added by pandas
        if not _is_stamp(field) and (is_index or not is_number):
            continue
        if schema.names.count(field.name) > 1:
            found, rule = f"two columns {field.name!r}", "column names must be unique"
            raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
        kept.append(index)
    return kept


def _is_stamp(field: pa.Field) -> bool:
    return bool(types.is_timestamp(field.type) or types.is_duration(field.type))


def _column(where: str, field: pa.Field, values: pa.ChunkedArray) -> Column:
    values.validate()  # until then, lengths are what the file claims
    if _is_stamp(field):  # time since the first stamp, exact for any date
        stamps = values.to_numpy()
        return Column("time", "s", (stamps - stamps[:1]) / np.timedelta64(1, "s"))
    name, unit = name_and_unit(field.name)
    about = {k.decode("utf-8", "replace"): v for k, v in (field.metadata or {}).items()}
    stated = about.get("unit", b"").decode("utf-8", "replace")
    scales = [key for key in about if states_scale(key)]
    if scales and types.is_integer(field.type):
        rule = "integers must be in the unit they state"
        raise RecordingFormatError(f"{where}, {name}", f"{scales[0]} of integers", rule, _SCALED)
    # One piece without gaps is a view of the file where that is mapped.
    samples = values.chunk(0) if values.num_chunks == 1 else values
    return Column(name, unit or stated.strip(), np.asarray(samples))


# pyarrow unpacks a compressed batch in full before it can be asked how large it is. The sizes are
# in front of the packed buffers, whose places are in a FlatBuffers table of the message.
_HEADER_OF_MESSAGE, _BATCH_OF_DICTIONARY, _BUFFERS, _COMPRESSION = 2, 1, 2, 3  # numbers of fields


def _unpacked_bytes(message: pa.Message) -> int:
    """Bytes that the buffers of a message take when unpacked; 0 where nothing is packed."""
    if message.type not in ("record batch", "dictionary"):
        return 0
    data = memoryview(message.metadata)
    (root,) = struct.unpack_from("<I", data, 0)
    batch = _target(data, root, _HEADER_OF_MESSAGE)
    if message.type == "dictionary":
        batch = _target(data, batch, _BATCH_OF_DICTIONARY)
    if not batch or not _field(data, batch, _COMPRESSION):
        return 0
    buffers = _target(data, batch, _BUFFERS)
    if not buffers:
        return 0
    body = memoryview(message.body or b"")
    (count,) = struct.unpack_from("<I", data, buffers)
    total = 0
    for number in range(count):
        offset, length = struct.unpack_from("<qq", data, buffers + 4 + 16 * number)
        if length >= 8:
            (claimed,) = struct.unpack_from("<q", body, offset)
            total += length if claimed == _NOT_COMPRESSED else max(claimed, 0)
    return total


def _field(data: memoryview, table: int, number: int) -> int:
    """Place of a field of the table at `table`; 0 where the table leaves it out."""
    layout = table - struct.unpack_from("<i", data, table)[0]
    entry = 4 + 2 * number
    if entry + 2 > struct.unpack_from("<H", data, layout)[0]:
        return 0
    (offset,) = struct.unpack_from("<H", data, layout + entry)
    return table + int(offset) if offset else 0


def _target(data: memoryview, table: int, number: int) -> int:
    """Place that a field refers to; 0 where the table leaves it out."""
    place = table and _field(data, table, number)
    return place and place + int(struct.unpack_from("<I", data, place)[0])
