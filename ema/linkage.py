"""Average-linkage clusters of a few things; `scipy.cluster` takes longer to load than they take."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def average_linkage(distance: NDArray[np.float64], cut: float) -> NDArray[np.int_]:
    """Merge the two nearest clusters until the nearest are further apart than `cut`.

    The distance of two clusters is the mean over all pairs of their members (UPGMA; Sokal and
    Michener 1958).

    Parameters
    ----------
    distance : ndarray, shape (n, n)
        Symmetric.
    cut : float

    Returns
    -------
    ndarray of int, shape (n,)
        Number of the cluster of each, from 0 in order of appearance.
    """
    between = np.array(distance, dtype=np.float64)
    np.fill_diagonal(between, np.inf)
    label = np.arange(len(between))
    size = np.ones(len(between))
    while len(between) > 1:
        one, other = divmod(int(np.argmin(between)), len(between))
        if not between[one, other] <= cut:
            break
        mean = size[one] * between[one] + size[other] * between[other]
        between[one] = between[:, one] = mean / (size[one] + size[other])
        between[one, one] = np.inf
        between[other] = between[:, other] = np.inf
        size[one] += size[other]
        label[label == other] = one
    return np.asarray(np.unique(label, return_inverse=True)[1])
