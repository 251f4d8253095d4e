"""Read-only arrays for frozen data, and tables made of arrays."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import pandas as pd

_ARRAY = re.compile(r"NDArray\[np\.(\w+)\]")


def readonly(values: ArrayLike, dtype: Any = float) -> NDArray[Any]:
    """Copy `values` into a new array of type `dtype` that cannot be written to.

    What is of that type and cannot be written to by anyone already is taken as it is.
    """
    if isinstance(values, np.ndarray) and values.dtype == dtype and _is_frozen(values):
        return values
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array


class ReadonlyArrays:
    """Base of frozen data classes: arrays become read-only and of the type they are declared as."""

    def __post_init__(self) -> None:
        for name, declared in type(self).__annotations__.items():
            if match := _ARRAY.fullmatch(declared):
                dtype = np.dtype(getattr(np, match[1]))
                object.__setattr__(self, name, readonly(getattr(self, name), dtype))


def constant(value: float, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Read-only array that holds one number everywhere, and takes the memory of one."""
    return np.broadcast_to(readonly(value), shape)


def stacked(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Rows of all parts in one read-only array; one part alone is not copied.

    Parts that `constant` made of one number stay such.
    """
    if len(parts) == 1:
        return readonly(parts[0], parts[0].dtype)
    if all(part.size and not any(part.strides) for part in parts):
        numbers = np.unique([part.flat[0] for part in parts])
        if len(numbers) == 1:
            n_rows = sum(len(part) for part in parts)
            return constant(numbers[0], (n_rows, *parts[0].shape[1:]))
    array = np.concatenate(parts)
    array.setflags(write=False)
    return array


def frame_of(columns: Mapping[Any, Any], whole: Sequence[str] = ()) -> pd.DataFrame:
    """Table with a copy of each column; those in `whole` are integers, with None where unknown."""
    import pandas as pd  # takes 0.3 s, more than `import ema`: only those who want tables wait

    return pd.DataFrame(
        {
            name: pd.array(values, dtype="Int64")
            if name in whole
            else np.array(values)
            if isinstance(values, np.ndarray)
            else list(values)
            for name, values in columns.items()
        }
    )


def _is_frozen(array: NDArray[Any]) -> bool:
    """Whether neither the array nor one whose memory it shows can be written to."""
    owner: object = array
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            return False
        owner = owner.base
    return owner is None
