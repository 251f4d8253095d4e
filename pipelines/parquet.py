"""Parquet tables from columns of numbers and words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pyarrow as pa

# Columns that repeat few values; to look for repetitions in the others takes most of the time.
_REPEATING = ("position_deg", "frequency_hz", "node", "order")


def write_parquet(
    path: Path,
    columns: Mapping[str, NDArray[Any]],
    words: Mapping[str, Sequence[str]] | None = None,
    metadata: Mapping[str, str] | None = None,
) -> None:
    """Write a table.

    Parameters
    ----------
    path : Path
    columns : mapping of str to ndarray
        Columns of equal length.
    words : mapping of str to sequence of str, optional
        Further columns, one text for each of the equal pieces of the table.
    metadata : mapping of str to str, optional
        Kept in the file's schema.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays = {name: _numbers(values) for name, values in columns.items()}
    n_rows = len(next(iter(columns.values())))
    for name, texts in (words or {}).items():
        # Arrow fills the room of a text that comes twice with whatever was in memory before.
        number = {text: place for place, text in enumerate(dict.fromkeys(texts))}
        index = np.array([number[text] for text in texts], dtype=np.int32)
        rows = _numbers(np.repeat(index, n_rows // len(texts)))
        arrays[name] = pa.DictionaryArray.from_arrays(rows, _texts(list(number)))
    table = pa.table(arrays).replace_schema_metadata(dict(metadata or {}))
    repeating = [name for name in arrays if name in _REPEATING or name in (words or {})]
    pq.write_table(table, path, use_dictionary=repeating)


def read_parquet(path: Path) -> pa.Table:
    """Read a table; `pyarrow.parquet.read_table` would load pandas to look for datasets."""
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        return file.read()


def _numbers(values: NDArray[Any]) -> pa.Array:
    """Arrow's view of an array; `pyarrow.array` would load pandas, half a second, to look at it."""
    import pyarrow as pa

    kind = pa.from_numpy_dtype(values.dtype)
    bits = np.packbits(values, bitorder="little") if values.dtype == bool else values
    return pa.Array.from_buffers(
        kind, len(values), [None, pa.py_buffer(np.ascontiguousarray(bits))]
    )


def _texts(texts: Sequence[str]) -> pa.Array:
    import pyarrow as pa

    encoded = [text.encode() for text in texts]
    ends = np.cumsum([0, *(len(text) for text in encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(
        len(texts), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded))
    )
