"""The tables over all campaigns, in the order of their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow.parquet as pq

from ema.core.files import require_regular
from pipelines.batch.state import BatchFolder, Record
from pipelines.results.tables import MODES
from pipelines.storage.tables import write_table

PARAMETERS = ("parameter", "value", "std", "how")
_OF_CAMPAIGN = {
    "campaign": "string",
    "designation": "string",
    "inflation_pressure_pa": "Float64",
}
_TEXT = ("member", "status", "parameter", "how")
_WHOLE = ("mode", "order")
_CAMPAIGNS = {
    **_OF_CAMPAIGN,
    "status": "string",
    "message": "string",
    "seconds": "Float64",
    "n_modes": "Int32",
    "n_warnings": "Int32",
    "fingerprint": "string",
    "traceback": "string",
}


def write_modes_and_parameters(records: Sequence[Record], folder: BatchFolder) -> None:
    """Write ``modes.parquet`` and ``parameters.parquet``.

    Raises
    ------
    InputError
        If one cannot be written; the earlier one stands then.
    """
    modes = [(*_campaign(each), *row) for each in records for row in each.modes]
    parameters = [(*_campaign(each), *row) for each in records for row in each.parameters]
    _write(folder.modes, _types(MODES), modes)
    _write(folder.parameters, _types(PARAMETERS), parameters)


def write_campaigns(records: Sequence[Record], folder: BatchFolder) -> None:
    """Write ``campaigns.parquet``, by which a later run knows what the tables hold.

    Raises
    ------
    InputError
        If it cannot be written; the earlier one stands then.
    """
    _write(folder.campaigns, _CAMPAIGNS, [_campaign_row(each) for each in records])


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
    return [dict(zip(_CAMPAIGNS, _campaign_row(record), strict=True)) for record in records]


def _campaign(record: Record) -> tuple[Any, ...]:
    return record.campaign, record.designation, record.inflation_pressure_pa


def _types(columns: Sequence[str]) -> dict[str, str]:
    return {**_OF_CAMPAIGN, **{name: _type_of(name) for name in columns}}


def _type_of(column: str) -> str:
    if column in _TEXT:
        return "string"
    return "Int32" if column in _WHOLE else "Float64"


def _write(path: Path, types: Mapping[str, str], rows: Sequence[tuple[Any, ...]]) -> None:
    write_table(path, pd.DataFrame(rows, columns=list(types), dtype=object).astype(dict(types)))
