"""The tables over all campaigns, in the order of their names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ema.core.files import require_regular
from pipelines.batch.state import BatchFolder, Record
from pipelines.results.tables import MODES
from pipelines.storage.atomic import file_written_whole

PARAMETERS = ("parameter", "value", "std", "how")
_OF_CAMPAIGN: list[tuple[str, Any]] = [
    ("campaign", pa.string()),
    ("designation", pa.string()),
    ("inflation_pressure_pa", pa.float64()),
]
_TEXT = ("member", "status", "parameter", "how")
_WHOLE = ("mode", "order")
_CAMPAIGNS: list[tuple[str, Any]] = [
    *_OF_CAMPAIGN,
    ("status", pa.string()),
    ("message", pa.string()),
    ("seconds", pa.float64()),
    ("n_modes", pa.int32()),
    ("n_warnings", pa.int32()),
    ("fingerprint", pa.string()),
    ("traceback", pa.string()),
]


def write_modes_and_parameters(records: Sequence[Record], folder: BatchFolder) -> None:
    """Write ``modes.parquet`` and ``parameters.parquet``.

    Raises
    ------
    InputError
        If one cannot be written; the earlier one stands then.
    """
    modes = [(*_campaign(each), *row) for each in records for row in each.modes]
    parameters = [(*_campaign(each), *row) for each in records for row in each.parameters]
    _write(folder.modes, _schema(MODES), modes)
    _write(folder.parameters, _schema(PARAMETERS), parameters)


def write_campaigns(records: Sequence[Record], folder: BatchFolder) -> None:
    """Write ``campaigns.parquet``, by which a later run knows what the tables hold.

    Raises
    ------
    InputError
        If it cannot be written; the earlier one stands then.
    """
    _write(folder.campaigns, pa.schema(_CAMPAIGNS), [_campaign_row(each) for each in records])


def tables_are_current(records: Sequence[Record], folder: BatchFolder) -> bool:
    """Whether tables and summary of these very records are there."""
    if not folder.is_complete():
        return False
    try:
        rows = pq.read_table(require_regular(folder.campaigns)).to_pylist()
    except (OSError, ValueError):  # what pyarrow raises for a damaged file
        return False
    return bool(rows == campaign_rows(records))


def _campaign_row(record: Record) -> tuple[Any, ...]:
    """Row of ``campaigns.parquet``."""
    return (
        *_campaign(record),
        record.status,
        record.message,
        record.seconds,
        len(record.modes),
        record.n_warnings,
        record.fingerprint.digest,
        record.traceback,
    )


def campaign_rows(records: Sequence[Record]) -> list[dict[str, Any]]:
    """Rows of ``campaigns.parquet`` with the names of their columns."""
    names = [name for name, _ in _CAMPAIGNS]
    return [dict(zip(names, _campaign_row(record), strict=True)) for record in records]


def _campaign(record: Record) -> tuple[Any, ...]:
    return record.campaign, record.designation, record.inflation_pressure_pa


def _schema(columns: Sequence[str]) -> Any:
    return pa.schema([*_OF_CAMPAIGN, *((name, _type_of(name)) for name in columns)])


def _type_of(column: str) -> Any:
    if column in _TEXT:
        return pa.string()
    return pa.int32() if column in _WHOLE else pa.float64()


def _write(path: Path, schema: Any, rows: Sequence[tuple[Any, ...]]) -> None:
    columns = list(zip(*rows, strict=True)) or [()] * len(schema)
    arrays = [
        pa.array([_plain(value) for value in column], field.type)
        for column, field in zip(columns, schema, strict=True)
    ]
    with file_written_whole(path) as partial:
        pq.write_table(pa.Table.from_arrays(arrays, schema=schema), partial)


def _plain(value: Any) -> Any:
    """None for what is unknown, as one kind of missing value is enough for those who read it."""
    value = value.item() if hasattr(value, "item") else value
    return None if value != value else value
