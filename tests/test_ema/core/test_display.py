"""Numbers as they are printed: no digit that the uncertainty does not bear."""

import re
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.display import number, plain, signed, value_with_std


@pytest.mark.parametrize(
    ("value", "std", "printed"),
    [
        (100.3123, 0.0213, "100.312 ± 0.021"),
        (100.3123, 0.0341, "100.312 ± 0.034"),
        (100.3123, 0.0354, "100.312 ± 0.035"),
        (100.3123, 0.0356, "100.31 ± 0.04"),
        (100.3123, 0.0298, "100.312 ± 0.030"),
        (8.271e6, 8.4e4, "(8.27 ± 0.08) × 10⁶"),
        (6.56e5, 1.4e5, "(6.6 ± 1.4) × 10⁵"),
        (7.45, 1.8, "7.5 ± 1.8"),
        (686.4, 27.1, "686 ± 27"),
        (686.4, 271.0, "690 ± 270"),
        (1.2e-5, 3e-7, "(1.200 ± 0.030) × 10⁻⁵"),
        (3.6e-6, 3.1e-6, "(3.6 ± 3.1) × 10⁻⁶"),
        (0.0, 0.5, "0.0 ± 0.5"),
        (-3.2, 0.5, "−3.2 ± 0.5"),
        (2.0, 96.0, "0 ± 100"),
        (2.0, 94.0, "0 ± 90"),
        (5.0, nan, "5.000"),
        (5.0, 0.0, "5.000"),
        (5.0, None, "5.000"),
        (nan, 1.0, "–"),
    ],
)
def test_values_end_where_their_uncertainty_does(value, std, printed):
    assert value_with_std(value, std) == printed


@pytest.mark.parametrize(
    ("value", "printed"),
    [
        (0, "0"),
        (1234.5, "1234"),
        (99949, "99949"),
        (2.2e5, "2.200 × 10⁵"),
        (0.012345, "0.01235"),
        (9.9996, "10.00"),
        (None, "–"),
        (inf, "–"),
    ],
)
def test_numbers_keep_four_digits(value, printed):
    assert number(value) == printed


def test_signs_and_given_values():
    assert [signed(1.234, 2), signed(-0.5, 1), signed(nan, 1)] == ["+1.23", "−0.5", "–"]
    assert [signed(-0.004, 2), signed(0.0, 1), signed(0.004, 2)] == ["0.00", "0.0", "0.00"]
    assert [plain(220000.0), plain(0.33), plain(None)] == ["220000", "0.33", "–"]


def read_back(text):
    match = re.fullmatch(r"\(?([−\d.]+) ± ([\d.]+)\)?(?: × 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?", text)
    exponent = (match[3] or "⁰").translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    scale = 10.0 ** int(exponent)
    return float(match[1].replace("−", "-")) * scale, float(match[2]) * scale


@given(st.floats(-1e12, 1e12, allow_nan=False), st.floats(1e-9, 1e9, allow_nan=False))
def test_what_is_printed_is_within_a_fifth_of_the_uncertainty(value, std):
    printed, printed_std = read_back(value_with_std(value, std))
    assert abs(printed - value) <= 0.2 * std + 1e-12 * abs(value)
    assert printed_std == pytest.approx(std, rel=0.2)
