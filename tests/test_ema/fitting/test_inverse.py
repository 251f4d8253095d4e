"""Inverse of normal matrices that rounding has left with too little."""

import numpy as np

from ema.fitting.covariance import inverse_of


def test_what_rounding_leaves_below_zero_is_not_seen():
    """Exact FRFs: of a member that is not driven nothing but rounding is left."""
    normal = np.array([[4.0, 0.0, 0.0], [0.0, -1e-18, 0.0], [0.0, 0.0, 1.0]])
    found = inverse_of(normal)
    assert np.allclose(found, np.diag([0.25, 0.0, 1.0]))


def test_no_variance_is_negative():
    normal = np.array([[1.0, 1.0 + 1e-9], [1.0 + 1e-9, 1.0]])
    assert np.linalg.eigvalsh(inverse_of(normal)).min() > -1e-12
