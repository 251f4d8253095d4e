"""Numbers as options write them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import InputError
from pipelines.cli.options import orders_of, values_of


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("67.3", [67.3]),
        ("-1, 2.5", [-1.0, 2.5]),
        ("1:4", [1.0, 2.0, 3.0, 4.0]),
        ("0:1:0.25", [0.0, 0.25, 0.5, 0.75, 1.0]),
        ("0:1:0.4", [0.0, 0.4, 0.8]),
        ("5:5", [5.0]),
    ],
)
def test_notation(text, values):
    np.testing.assert_array_equal(values_of("--x", text), values)


@given(st.integers(-100, 100), st.integers(1, 400), st.sampled_from([0.1, 0.05, 0.3, 1.0, 2.5]))
def test_a_range_of_whole_steps_holds_both_ends(start, steps, step):
    stop = start + steps * step
    values = values_of("--x", f"{start}:{stop!r}:{step}")
    assert values.size == steps + 1
    assert values[0] == start
    assert values[-1] == pytest.approx(stop, abs=1e-9)


@pytest.mark.parametrize("text", ["", "a", "1:2:3:4", "1:2,3", "1:2:0", "2:1", "inf", "0:inf", ":"])
def test_anything_else_is_refused(text):
    with pytest.raises(InputError, match="--x"):
        values_of("--x", text)


def test_orders_are_whole():
    assert orders_of("--orders", "1:3").tolist() == [1, 2, 3]
    with pytest.raises(InputError, match="whole"):
        orders_of("--orders", "0:1:0.5")


def test_more_values_than_a_command_takes_are_refused():
    assert values_of("--x", "0:99999:1").size == 100_000
    for refused in (
        lambda: values_of("--x", "0:100000:1"),
        lambda: values_of("--x", "0:300:1", 300),
        lambda: orders_of("--orders", "1:100000"),
    ):
        with pytest.raises(InputError, match="at most"):
            refused()
