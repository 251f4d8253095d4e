"""Parquet tables from columns of numbers and words."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import InputError, inert
from ema.core.files import require_regular

if TYPE_CHECKING:
    import pyarrow as pa

# Columns that repeat few values; to look for repetitions in the others takes most of the time.
_REPEATING = ("position_deg", "frequency_hz", "node", "order", "row")
# No number of a result is as large in SI units, and its fourth power is still a double.
LARGEST = 1e30


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


class Table:
    """Columns of a Parquet file, each checked for what it must hold as it is taken.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        If it is no Parquet file, or is damaged.
    """

    def __init__(self, path: Path) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        self.path = path
        try:  # `pyarrow.parquet.read_table` would load pandas to look for datasets
            with pq.ParquetFile(require_regular(path)) as file:
                self._table = file.read().combine_chunks()
        except (pa.ArrowException, OSError, ValueError) as error:
            raise self.unusable(f"unreadable ({error})", "it must be a Parquet file") from error

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return list(self._table.column_names)

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return int(self._table.num_rows)

    def numbers(self, name: str, *, unknown: bool = False) -> NDArray[Any]:
        """A column of numbers without gaps; NaN only where `unknown` permits it.

        Raises
        ------
        InputError
            If there is no such column, or it holds anything else or what no measurement gives.
        """
        import pyarrow as pa

        column = self._column(name)
        kind = column.type
        if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)) or column.null_count:
            raise self.unusable(f"column {name} of {kind}", "the column holds numbers, none empty")
        values = np.asarray(column.to_numpy())
        with np.errstate(invalid="ignore"):
            good = (np.abs(values) <= LARGEST) | (np.isnan(values) & unknown)
        if not np.all(good):
            found = f"{values[~good][0]:g} in column {name}"
            raise self.unusable(found, f"numbers are finite and at most {LARGEST:g}")
        return values

    def flags(self, name: str) -> NDArray[np.bool_]:
        """A column of true and false.

        Raises
        ------
        InputError
            If there is no such column, or it holds anything else.
        """
        import pyarrow as pa

        column = self._column(name)
        if not pa.types.is_boolean(column.type) or column.null_count:
            raise self.unusable(f"column {name} of {column.type}", "the column is true or false")
        return np.asarray(column.to_numpy(zero_copy_only=False))

    def texts(self, name: str) -> tuple[NDArray[np.int_], list[str]]:
        """A column of texts: for each row the index of its text, and the texts.

        Raises
        ------
        InputError
            If there is no such column, or it holds anything else.
        """
        import pyarrow as pa

        column = self._column(name)
        if not pa.types.is_dictionary(column.type):
            column = column.dictionary_encode()
        if not pa.types.is_string(column.type.value_type) or column.null_count:
            raise self.unusable(f"column {name} of {column.type}", "the column holds texts")
        try:
            return np.asarray(column.indices.to_numpy(), dtype=int), column.dictionary.to_pylist()
        except UnicodeDecodeError as error:
            raise self.unusable(f"column {name}: {error}", "texts are UTF-8") from error

    def row_order(self, size: int = 1) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Rows in the order they were written in, and the number in column ``row`` of each.

        Tables of version 0.1.0 have no such column: their rows count as they come, `size` at a
        time.

        Raises
        ------
        InputError
            If the numbers are not 0, 1, 2 … with `size` rows each.
        """
        if "row" not in self.names:
            number = np.arange(self.n_rows) // size
        else:
            number = self.numbers("row").astype(int)
        order = np.argsort(number, kind="stable")
        if not np.array_equal(number[order], np.arange(self.n_rows) // size):
            rule = f"rows are numbered 0, 1, 2 …, {size} of each number"
            raise self.unusable("rows missing, doubled or misnumbered", rule)
        return order, number[order]

    def unusable(self, found: str, rule: str) -> InputError:
        """The error for a table that is not what it must be."""
        return InputError(str(self.path), found, rule, "Process the recordings again")

    def _column(self, name: str) -> Any:
        if self.names.count(name) != 1:
            raise self.unusable(f"columns {', '.join(self.names)}", f"it has one column {name}")
        column = self._table[name]
        return column.chunk(0) if column.num_chunks else column.combine_chunks()


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


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Row]) -> None:
    """Write a table; None and NaN become empty cells, floats keep every digit.

    Texts are inert: none is taken for a formula, and nothing in them acts on a terminal.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([inert(column) for column in columns])
        writer.writerows([_cell(value) for value in row] for row in rows)


Row = tuple[Any, ...]


def _cell(value: Any) -> Any:
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return ""
    return repr(float(value)) if isinstance(value, float) else inert(value)
