"""Read-only arrays for frozen data."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def readonly(values: ArrayLike, dtype: Any = float) -> NDArray[Any]:
    """Copy `values` into a new array of type `dtype` that cannot be written to."""
    array = np.array(values, dtype=dtype)
    array.setflags(write=False)
    return array
