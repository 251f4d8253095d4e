"""Write time series as a table of text."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv

from ema.core.errors import inert
from ema.core.recording import Channel
from ema.core.units import is_stated
from ema.io.uff.write import check_time_series, in_own_unit


def write_csv(
    path: Path | str,
    channels: Sequence[Channel],
    sampling_rate_hz: float,
    *,
    time_column: bool = True,
) -> None:
    """Write channels that share one clock as columns under ``name [unit]``.

    Numbers take as many digits as their precision needs to be read back unchanged. A name that a
    spreadsheet would take for a formula gets an apostrophe in front, which reading takes away.

    Parameters
    ----------
    path : Path or str
        File to write; an existing one is replaced.
    channels : sequence of Channel
        All of the same length. A negative direction is written as negative samples, because a
        table has no other place for it.
    sampling_rate_hz : float
        Common sampling rate, Hz.
    time_column : bool
        Whether the first column is ``time [s]``.

    Raises
    ------
    InputError
        If there are no channels, their lengths differ, or the rate is not positive.
    """
    check_time_series(path, channels, sampling_rate_hz)
    names, columns = [], []
    if time_column:
        names.append("time [s]")
        columns.append(pa.array(np.arange(channels[0].n_samples) / sampling_rate_hz))
    for channel in channels:
        samples, unit, sense = in_own_unit(channel)
        name = " ".join(channel.name.split())
        names.append(inert(f"{name} [{unit}]" if is_stated(unit) else name))
        native = samples.astype(samples.dtype.newbyteorder("="), copy=False)
        columns.append(pa.array(native if sense > 0 else -native))
    table = pa.table(columns, names=names)
    options = pa.csv.WriteOptions(include_header=True, quoting_style="needed")
    pa.csv.write_csv(table, Path(path), options)
