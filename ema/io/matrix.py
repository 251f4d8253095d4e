"""A matrix of samples, one channel in each column or in each row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from ema.errors import RecordingFormatError
from ema.io.columns import Column, name_and_unit


def matrix_columns(
    where: str, matrix: NDArray[Any], names: Sequence[str], units: Sequence[str]
) -> list[Column]:
    """Split a matrix into its channels.

    The names tell which of its sides counts the channels; without them, it is the shorter one.

    Parameters
    ----------
    where : str
        File and place in it, for messages.
    matrix : ndarray, shape (n_samples, n_channels) or (n_channels, n_samples)
    names : sequence of str
        Names of the channels, perhaps with the unit in square brackets; empty where unknown.
    units : sequence of str
        One for each channel, one for all, or none.

    Raises
    ------
    RecordingFormatError
        If names or units do not fit, or a square matrix leaves open what its rows are.
    """
    rows, columns = matrix.shape
    n_channels = len(names) or min(rows, columns)
    if rows == columns or n_channels not in (rows, columns):
        found = f"a matrix of {rows} × {columns} and {len(names)} names"
        rule = "one side counts samples, the other the channels, which have a name each"
        remedy = "Give as many names as there are channels"
        raise RecordingFormatError(where, found, rule, remedy)
    signals = matrix.T if columns == n_channels else matrix
    labels = names or [f"channel {number}" for number in range(1, n_channels + 1)]
    stated = unit_of_each(where, n_channels, units)
    pairs = [name_and_unit(label) for label in labels]
    return [
        Column(name, unit or own, samples)
        for (name, own), unit, samples in zip(pairs, stated, signals, strict=True)
    ]


def unit_of_each(where: str, n_channels: int, units: Sequence[str]) -> list[str]:
    """Unit of each channel, from a list of as many, of one for all, or of none.

    Raises
    ------
    RecordingFormatError
        If the list has another length.
    """
    if len(units) not in (0, 1, n_channels):
        found = f"{len(units)} units for {n_channels} channels"
        rule = "there is one unit for each channel, or one for all"
        raise RecordingFormatError(where, found, rule, "Correct the list of units")
    stated = units if len(units) == n_channels else list(units or ("",)) * n_channels
    return [unit.strip() for unit in stated]
