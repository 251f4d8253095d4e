"""Whether binary values make sense in the byte order that their header states."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.errors import RecordingFormatError

_LOOKED_AT = 1024
_FEWEST = 16  # values other than zero; fewer may be anything
_SENSIBLE = (1e-15, 1e15)  # of motion or force, in whatever unit


def check_byte_order(where: str, values: NDArray[Any]) -> None:
    """Refuse values that make sense in the other byte order alone.

    Parameters
    ----------
    where : str
        File and place of the byte order in it.
    values : ndarray, shape (n_values,)
        Real or complex, in the byte order stated; the beginning is looked at.

    Raises
    ------
    RecordingFormatError
        If most of them are too large or too small to be measured, and none is when swapped.
    """
    beginning = np.array(values[:_LOOKED_AT])
    stated = beginning.view(beginning.real.dtype)
    swapped = stated.byteswap()
    if _share_sensible(swapped) < 1.0 or _share_sensible(stated) > 0.5:
        return
    first = int(np.flatnonzero(stated)[0])
    found = f"values such as {stated[first]:.3g}, which is {swapped[first]:.3g} in the other order"
    rule = "the byte order is 1 where the lowest byte comes first, else 2; here it is wrong"
    raise RecordingFormatError(where, found, rule, "Correct the header, or export the file again")


def _share_sensible(values: NDArray[Any]) -> float:
    """Share of the values other than zero that a sensor could have measured; 0 of too few."""
    with np.errstate(invalid="ignore"):  # signalling NaNs
        size = np.abs(values[values != 0].astype(np.float64))
    if size.size < _FEWEST:
        return 0.0
    low, high = _SENSIBLE
    return float(np.mean((size > low) & (size < high)))
