"""How likely chance alone makes a sum of squares this large."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def chi_square_tail(value: ArrayLike, freedom: ArrayLike) -> NDArray[np.float64]:
    """Chance that χ² of some degrees of freedom exceeds `value` (`scipy.stats.chi2.sf`).

    From `scipy.special`: `scipy.stats` takes a second to load.
    """
    from scipy.special import chdtrc

    return np.asarray(chdtrc(freedom, value))
