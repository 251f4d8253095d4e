"""Arrays of MATLAB and HDF5 files as columns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ema.core.errors import RecordingFormatError
from ema.core.finding import Finding
from ema.core.recording import ACCELERATION, FORCE
from ema.core.units import parse_unit
from ema.io.columns import Column, name_and_unit
from ema.io.content import EXPORT_AGAIN, left_out

_SLOW_SHARE = 0.25  # of the longest channel, which slower ones beside it have at most


def are_slow(lengths: Sequence[int], units: Sequence[str]) -> list[bool]:
    """Which series are slow channels beside a recording; a force or an acceleration is none.

    Those of the longest one's length are the recording, if there are at least two.
    """
    longest = max(lengths, default=0)
    known = [parse_unit(unit) for unit in units]
    wanted = [unit is not None and unit.quantity in (FORCE, ACCELERATION) for unit in known]
    is_recording = list(lengths).count(longest) > 1
    return [
        is_recording and n <= _SLOW_SHARE * longest and not is_wanted
        for n, is_wanted in zip(lengths, wanted, strict=True)
    ]


def without_complex(
    path: Path, columns: Sequence[Column]
) -> tuple[list[Column], tuple[Finding, ...]]:
    """Columns of real numbers, and findings about others: complex ones need frequencies."""
    complex_ones = [each.name for each in columns if each.samples.dtype.kind == "c"]
    reason = "complex numbers without a vector of frequencies"
    real = [each for each in columns if each.samples.dtype.kind != "c"]
    if not real and complex_ones:
        rule = "FRFs need their frequencies, in a vector such as frequency"
        found = f"{', '.join(complex_ones)} (complex numbers)"
        raise RecordingFormatError(path.name, found, rule, EXPORT_AGAIN)
    return real, left_out(path, dict.fromkeys(complex_ones, reason))


def matrix_columns(
    where: str, matrix: NDArray[Any], names: Sequence[str], units: Sequence[str]
) -> list[Column]:
    """Split a matrix, (n_samples, n_channels) or the other way round, into its channels.

    Names may have the unit in square brackets. Their number shows which side counts the channels;
    without names, the shorter one does. `units` are one for each channel, one for all, or none.
    """
    rows, columns = matrix.shape
    n_channels = len(names) or min(rows, columns)
    if rows == columns or n_channels not in (rows, columns):
        found = f"a matrix of {rows} × {columns} and {len(names)} names"
        rule = "one side must be the samples, the other the channels, with a name for each channel"
        raise RecordingFormatError(where, found, rule, "Give as many names as channels")
    signals = matrix.T if columns == n_channels else matrix
    labels = names or [f"channel {number}" for number in range(1, n_channels + 1)]
    columns = []
    for label, unit, samples in zip(
        labels, unit_of_each(where, n_channels, units), signals, strict=True
    ):
        name, own = name_and_unit(label)
        matrix_name = where.rpartition(", ")[2].rpartition("/")[2]
        columns.append(Column(name, unit or own, samples, matrix=matrix_name))
    return columns


def unit_of_each(where: str, n_channels: int, units: Sequence[str]) -> list[str]:
    """Unit of each channel, from a list of as many, of one for all, or of none."""
    if len(units) not in (0, 1, n_channels):
        found = f"{len(units)} units for {n_channels} channels"
        rule = "there must be one unit for each channel, or one for all"
        raise RecordingFormatError(where, found, rule, "Correct the list of units")
    stated = [unit.strip() for unit in units] or [""]
    return stated if len(stated) == n_channels else stated * n_channels
