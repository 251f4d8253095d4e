"""Sections of a parameter file that say what its values rest on."""

from pathlib import Path

import pytest

from ema.core.errors import InputError
from pipelines.results.verdict import basis_of


@pytest.mark.parametrize("orders", [["x"], [1], 3, [{"order": 1, "frequency_hz": -1.0}]])
def test_measured_orders_that_are_no_tables_are_refused(orders):
    empty = {name: {} for name in ("model", "verdict", "covariance")}
    with pytest.raises(InputError, match=r"tyre\.toml"):
        basis_of(Path("tyre.toml"), {**empty, "measured": {"orders": orders}}, ())
