"""Tables as files: columns by name written as CSV and Parquet; Parquet read with checks.

A table is a dictionary of columns: arrays, lists, or Arrow's own. pandas takes 0.2 s to load, and
`pyarrow.array` loads it to look at its argument: results are written without both.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from ema.core.errors import InputError, inert
from ema.core.files import require_regular
from pipelines.storage.atomic import file_written_whole

Columns = Mapping[str, Any]

# Columns that repeat few values; to search the others for repetitions takes most of the time.
_REPEATING = ("position_deg", "frequency_hz", "node", "order", "row")
# No number of a result is as large in SI units, and its fourth power is still a double.
_MOST_DIGITS = 10  # of a node
LARGEST = 1e30
REMEDY = "Process the recordings again"


def plain_rows(table: Columns) -> list[tuple[Any, ...]]:
    """Rows of a table for JSON: Python's own types, None for unknown values."""
    return list(zip(*map(_cells, table.values()), strict=True))


def _cells(column: Any) -> list[Any]:
    values = column.tolist() if hasattr(column, "tolist") else column
    return [None if value != value else value for value in values]


def typed(rows: Iterable[Mapping[str, Any]], types: Mapping[str, str]) -> Columns:
    """Columns of these types of Arrow; what a row does not have, and NaN, is null."""
    table = list(rows)
    return {
        name: pa.array([row.get(name) for row in table], kind, from_pandas=True)
        for name, kind in types.items()
    }


def write_table(path: Path, table: Columns, metadata: Mapping[str, str] | None = None) -> None:
    """Write a table atomically, by the ending as CSV, or as Parquet with the metadata."""
    with file_written_whole(path) as partial:
        if path.suffix.lower() == ".csv":
            write_csv(partial, table)
        else:
            write_parquet(partial, table, metadata)


def write_csv(path: Path, table: Columns, *, decimal_comma: bool = False) -> None:
    """Write a table as CSV; unknown values become empty cells, floats keep every digit.

    With a decimal comma, cells are separated by semicolons, and a mark at the beginning tells Excel
    that the text is UTF-8.

    Texts are inert: a spreadsheet takes none for a formula, and a terminal for a command.
    """
    separator, encoding = (";", "utf-8-sig") if decimal_comma else (",", "utf-8")

    def shown(value: Any) -> Any:
        is_number = decimal_comma and isinstance(value, float)
        return repr(value).replace(".", ",") if is_number else inert(value)

    with path.open("w", encoding=encoding, newline="") as file:
        writer = csv.writer(file, delimiter=separator, lineterminator="\n")
        writer.writerow(map(inert, table))
        writer.writerows(map(shown, row) for row in plain_rows(table))


def write_parquet(path: Path, table: Columns, metadata: Mapping[str, str] | None = None) -> None:
    """Write a table as Parquet; NaN stays NaN, None becomes null."""
    columns = {name: _arrow(column) for name, column in table.items()}
    content = pa.table(columns).replace_schema_metadata(dict(metadata or {}))
    texts = [
        name
        for name, column in columns.items()
        if not (_is_number(column.type) or pa.types.is_boolean(column.type))
    ]
    pq.write_table(
        content,
        path,
        use_dictionary=[name for name in columns if name in _REPEATING or name in texts],
        # The first and last of millions of texts that repeat: nobody asks, and it takes long.
        write_statistics=[name for name in columns if name not in texts],
    )


def repeating(numbers: NDArray[Any], texts: Sequence[str]) -> pa.Array:
    """A column of few texts for Parquet: for each row the number of its text, from 0."""
    encoded = [text.encode() for text in texts]
    ends = pa.py_buffer(np.cumsum([0, *map(len, encoded)], dtype=np.int32))
    known = pa.StringArray.from_buffers(len(encoded), ends, pa.py_buffer(b"".join(encoded)))
    return pa.DictionaryArray.from_arrays(_numbers(numbers.astype(np.int32, copy=False)), known)


def _arrow(column: Any) -> pa.Array:
    if isinstance(column, pa.Array):
        return column
    if isinstance(column, np.ndarray) and column.dtype.kind in "biuf":
        return _numbers(column)
    return pa.array(column)


def _numbers(values: NDArray[Any]) -> pa.Array:
    """Arrow's view of an array."""
    bits = np.packbits(values, bitorder="little") if values.dtype == bool else values
    buffer = pa.py_buffer(np.ascontiguousarray(bits))
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), values.size, [None, buffer])


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))


class Table:
    """Columns of a Parquet file; taking one checks its type and values."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
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

    def stated(self, name: str) -> int:
        """A whole number of the file's metadata; 0 where it states none."""
        text = (self._table.schema.metadata or {}).get(name.encode(), b"0")
        if not text.isdigit() or len(text) > _MOST_DIGITS:
            raise self.unusable(f"{name} {text[:20]!r}", "it must be a whole number")
        return int(text)

    def numbers(self, name: str, *, unknown: bool = False) -> NDArray[Any]:
        """A column of numbers without gaps; NaN only where `unknown` permits it."""
        column = self._column(name)
        if not _is_number(column.type) or column.null_count:
            raise self.unusable(f"column {name} of {column.type}", "it must hold numbers, no gaps")
        values = np.asarray(column.to_numpy())
        with np.errstate(invalid="ignore"):
            good = (np.abs(values) <= LARGEST) | (np.isnan(values) & unknown)
        if not np.all(good):
            found = f"{values[~good][0]:g} in column {name}"
            raise self.unusable(found, f"numbers must be finite and at most {LARGEST:g}")
        return values

    def flags(self, name: str) -> NDArray[np.bool_]:
        """A column of true and false."""
        column = self._column(name)
        if not pa.types.is_boolean(column.type) or column.null_count:
            raise self.unusable(f"column {name} of {column.type}", "it must hold true and false")
        return np.asarray(column.to_numpy(zero_copy_only=False))

    def texts(self, name: str) -> tuple[NDArray[np.int_], list[str]]:
        """A column of texts: for each row the index of its text, and the texts."""
        column = self._column(name)
        if not pa.types.is_dictionary(column.type):
            column = column.dictionary_encode()
        if not pa.types.is_string(column.type.value_type) or column.null_count:
            raise self.unusable(f"column {name} of {column.type}", "it must hold texts")
        try:
            return np.asarray(column.indices.to_numpy(), dtype=int), column.dictionary.to_pylist()
        except UnicodeDecodeError as error:
            raise self.unusable(f"column {name}: {error}", "texts must be UTF-8") from error

    def row_order(self) -> NDArray[np.intp]:
        """Rows in the order of column ``row``."""
        number = self.numbers("row").astype(int)
        order = np.argsort(number, kind="stable")
        if not np.array_equal(number[order], np.arange(self.n_rows)):
            raise self.unusable("rows missing, doubled or misnumbered", "they must count 0, 1, 2 …")
        return order

    def unusable(self, found: str, rule: str) -> InputError:
        """The error for a table that is not as it was written."""
        return InputError(str(self.path), found, rule, REMEDY)

    def _column(self, name: str) -> Any:
        if self.names.count(name) != 1:
            raise self.unusable(f"columns {', '.join(self.names)}", f"it needs one column {name}")
        column = self._table[name]
        return column.chunk(0) if column.num_chunks else column.combine_chunks()
