"""Average linkage agrees with that of scipy."""

import numpy as np
import pytest
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import pdist, squareform

from ema.core.numerics import average_linkage


@pytest.mark.parametrize("n", [2, 3, 10, 60])
@pytest.mark.parametrize("cut", [0.05, 0.2, 0.6])
def test_as_scipy_does_it(n, cut):
    flat = pdist(np.random.default_rng(n).random((n, 2)))
    expected = fcluster(linkage(flat, "average"), cut, "distance")
    found = average_linkage(squareform(flat), cut)
    together = found[:, None] == found
    np.testing.assert_array_equal(together, expected[:, None] == expected)


def test_none_and_one():
    assert average_linkage(np.zeros((0, 0)), 1.0).size == 0
    assert average_linkage(np.zeros((1, 1)), 1.0).tolist() == [0]


def test_members_of_a_cluster_are_numbered_in_order_of_appearance():
    far = 9.0
    distance = np.array([[0, far, 0.1], [far, 0, far], [0.1, far, 0]])
    assert average_linkage(distance, 1.0).tolist() == [0, 1, 0]
