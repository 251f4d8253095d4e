"""The tail of χ² against scipy's."""

import numpy as np
import pytest
from scipy.stats import chi2

from ema.core.numerics import chi_square_tail


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 5, 11, 72, 146, 147, 290])
def test_the_tail_is_that_of_scipy(freedom: int) -> None:
    value = freedom * np.array([0.0, 1e-6, 0.1, 0.5, 0.9, 1.0, 1.1, 2.0, 3.0])
    np.testing.assert_allclose(chi_square_tail(value, freedom), chi2.sf(value, freedom), rtol=1e-10)


@pytest.mark.parametrize("freedom", [3, 146])
def test_what_chance_never_shows_and_what_is_unknown(freedom: int) -> None:
    assert chi_square_tail(np.inf, freedom) == 0
    assert chi_square_tail(1e9, freedom) == 0
    assert np.isnan(chi_square_tail(np.nan, freedom))
    assert chi_square_tail(0.0, freedom) == 1
