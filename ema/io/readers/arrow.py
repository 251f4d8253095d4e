"""Read columnar tables: Parquet, Feather and Arrow IPC, one channel for each column of numbers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.errors import RecordingFormatError
from ema.io.claims import check_expansion
from ema.io.columns import EXPORT_AGAIN, Column, content_of_columns, name_and_unit
from ema.io.content import FileContent, remark
from ema.io.extras import reading
from ema.io.stated_rate import stated_rate

if TYPE_CHECKING:
    import pyarrow as pa

SUFFIXES = (".parquet", ".feather", ".arrow")
_FEATHER_1 = b"FEA1"
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
    with reading(path, "a Parquet file" if _is_parquet(path) else "a Feather or Arrow file"):
        table, left = _parquet(path) if _is_parquet(path) else _ipc(path)
        table.validate()  # until then, lengths are what the file claims
        columns = [_column(table, index) for index in range(table.num_columns)]
        metadata = {
            key.decode("latin-1"): value for key, value in (table.schema.metadata or {}).items()
        }
    content = content_of_columns(path, columns, rate_hz=stated_rate(path, metadata))
    notes = tuple(
        remark(path, name, "content", "a column of something other than numbers, left out")
        for name in left
    )
    return replace(content, findings=notes + content.findings)


def _is_parquet(path: Path) -> bool:
    return path.suffix.lower() == ".parquet"


def _parquet(path: Path) -> tuple[pa.Table, list[str]]:
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        kept, left = _split(path, file.schema_arrow)
        width = sum(field.type.bit_width // 8 for field in kept)
        check_expansion(path.name, path, width * file.metadata.num_rows)
        return file.read([field.name for field in kept]), left


def _ipc(path: Path) -> tuple[pa.Table, list[str]]:
    import pyarrow as pa

    source = pa.memory_map(str(path))
    if source.read(len(_FEATHER_1)) == _FEATHER_1:
        rule = "Feather of version 1 is no longer written by any program"
        raise RecordingFormatError(path.name, "Feather version 1", rule, EXPORT_AGAIN)
    source.seek(0)
    try:
        table = pa.ipc.open_file(source).read_all()
    except pa.ArrowInvalid:
        source.seek(0)
        table = pa.ipc.open_stream(source).read_all()
    check_expansion(path.name, path, table.nbytes)
    kept, left = _split(path, table.schema)
    return table.select([field.name for field in kept]), left


def _split(path: Path, schema: pa.Schema) -> tuple[list[pa.Field], list[str]]:
    """Fields of numbers or time, and the names of those that hold neither."""
    kept = [field for field in schema if _is_channel(field) or _is_stamp(field)]
    for field in kept:
        if schema.names.count(field.name) > 1:
            found = f"two columns {field.name!r}"
            rule = "columns are told apart by their names"
            raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    return kept, [field.name for field in schema if field not in kept]


def _is_channel(field: pa.Field) -> bool:
    import pyarrow.types as types

    index = field.name.startswith("__index_level_")  # added by pandas
    return not index and bool(types.is_integer(field.type) or types.is_floating(field.type))


def _is_stamp(field: pa.Field) -> bool:
    import pyarrow.types as types

    return bool(types.is_timestamp(field.type) or types.is_duration(field.type))


def _column(table: pa.Table, index: int) -> Column:
    field, values = table.schema.field(index), table.column(index)
    if _is_stamp(field):
        return Column("time", "s", _seconds(values, field.type.unit))
    name, unit = name_and_unit(field.name)
    stated = (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace")
    # One piece without gaps is a view of the file where that is mapped.
    samples = values.chunk(0) if values.num_chunks == 1 else values
    return Column(name, unit or stated.strip(), np.asarray(samples))


def _seconds(values: Any, unit: str) -> NDArray[np.float64]:
    """Time since the first stamp, exact for any date."""
    import pyarrow as pa
    import pyarrow.compute as pc

    stamps = values.cast(pa.int64())
    first = stamps[0].as_py() if len(stamps) else None
    if first is None:
        return np.full(len(stamps), np.nan)
    since = pc.subtract(stamps, first)
    return np.asarray(since.to_numpy(), dtype=np.float64) / _PER_SECOND[unit]
