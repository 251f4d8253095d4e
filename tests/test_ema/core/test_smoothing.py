"""Moving averages and medians agree with those of scipy.ndimage."""

import numpy as np
import pytest
from scipy import ndimage

from ema.core.numerics import moving_mean, moving_median


@pytest.mark.parametrize("width", [1, 3, 21])
@pytest.mark.parametrize("shape", [(50,), (4, 50), (2, 7)])
def test_as_scipy_does_it(shape, width):
    values = np.random.default_rng(1).lognormal(sigma=1, size=shape)
    mean = ndimage.uniform_filter1d(values, width, axis=-1, mode="nearest")
    np.testing.assert_allclose(moving_mean(values, width), mean, rtol=1e-7)
    size = (1,) * (len(shape) - 1) + (width,)
    median = ndimage.median_filter(values, size=size, mode="nearest")
    np.testing.assert_array_equal(moving_median(values, width), median)


def test_small_values_beside_large_ones_keep_their_digits():
    values = np.r_[1e20, np.full(30, 1e-20)]
    assert np.all(moving_mean(values, 3)[2:] == pytest.approx(1e-20, rel=1e-15))
