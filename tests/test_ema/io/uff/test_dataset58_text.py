"""Numbers in fixed columns: each is what `float` makes of its text, to the last bit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.io.rates import parse_number
from ema.io.uff.frf import convert_lines

SINGLE, DOUBLE = (13,) * 6, (20,) * 4
FINITE = st.floats(allow_nan=False, allow_infinity=False)


def lines_of(cells, per_line, eol="\n"):
    rows = [cells[k : k + per_line] for k in range(0, len(cells), per_line)]
    return "".join("".join(row) + eol for row in rows).encode()


def convert(cells, widths, eol="\n"):
    text = lines_of(cells, len(widths), eol)
    return convert_lines(text, sum(widths) + len(eol), widths)


def assert_bits(found, cells):
    expected = np.array([parse_number(cell) for cell in cells])
    assert found.tobytes() == expected.tobytes(), cells


@given(st.lists(FINITE, min_size=6, max_size=6))
def test_single_precision_fields(values):
    cells = [f"{value:13.5E}" for value in values]
    assert_bits(convert(cells, SINGLE), cells)


@given(st.lists(FINITE, min_size=8, max_size=8), st.sampled_from(["\n", "\r\n", "  \n"]))
def test_double_precision_fields(values, eol):
    cells = [f"{value:20.12E}" for value in values]
    assert_bits(convert(cells, DOUBLE, eol), cells)


@given(
    st.lists(
        st.tuples(st.integers(0, 10**13 - 1), st.integers(-99, 99), st.booleans()),
        min_size=4,
        max_size=4,
    )
)
def test_any_digits_and_exponents_round_correctly(numbers):
    cells = []
    for mantissa, exponent, negative in numbers:
        digits = f"{mantissa:013d}"
        cells.append(f" {'-' if negative else ' '}{digits[0]}.{digits[1:]}E{exponent:+03d}")
    assert_bits(convert(cells, DOUBLE), cells)


@given(st.lists(st.tuples(FINITE, FINITE), min_size=2, max_size=20))
def test_fields_of_two_widths(pairs):
    cells = [f"{x:13.5E}{y:20.12E}" for x, y in pairs]
    pairwise = cells[: len(cells) // 2 * 2]
    text = lines_of(pairwise, 2)
    numbers = [part for cell in pairwise for part in (cell[:13], cell[13:])]
    assert_bits(convert_lines(text, 67, (13, 20, 13, 20)), numbers)


@pytest.mark.parametrize("letter", "EeDd")
@pytest.mark.parametrize("sign", " +-")
def test_letters_and_signs(letter, sign):
    cells = [
        f"  {sign}1.2500{letter}{power}" for power in ("+00", "-03", "+07", "-22", " 05", "+22")
    ]
    found = convert(cells, SINGLE)
    expected = 1.25 * 10.0 ** np.array([0, -3, 7, -22, 5, 22])
    np.testing.assert_allclose(found, -expected if sign == "-" else expected, rtol=1e-15)


def test_negative_zero_keeps_its_sign():
    cells = [" -0.00000E+00", "  0.00000E+00", " -0.00000E-99", "  0.00000E+99"] * 3
    found = convert(cells, SINGLE)
    assert not found.any()
    assert np.signbit(found).tolist() == [True, False, True, False] * 3


def test_exponents_of_three_digits():
    cells = [" 1.2345E+005", "-1.2345E-105", " 9.9999E+307", " 4.9000E-324"]
    assert_bits(convert(cells, (12,) * 4), cells)


@pytest.mark.parametrize(
    "odd", ["      .5E+00", " 12.34567E+00", "        12.5", "  1.23456E+5", "         1.5"]
)
def test_fields_of_another_form_are_read_too(odd):
    cells = ["  1.00000E+00"] * 5 + [f"{odd:>13}"]
    assert_bits(convert(cells, SINGLE), cells)


@pytest.mark.parametrize(
    "odd",
    [
        "  1.00000EE00",
        "  1.00x00E+00",
        "  1,00000E+00",
        "1 1.00000E+00",
        "--1.00000E+00",
        "  1.00000E+0x",
        "  1.00000E00 ",
        "     NONE    ",
        "             ",
        "  1.0 000E+00",
        "  1.00000E/00",
        "  1.00000F+00",
    ],
)
def test_what_is_no_number_is_not_converted(odd):
    assert convert(["  1.00000E+00"] * 5 + [odd], SINGLE) is None


def test_lines_that_differ_are_not_converted():
    line = b"  1.00000E+00" * 6
    assert convert_lines(line + b" \n" + line + b"x\n", 80, SINGLE) is None
    assert convert_lines(line + b"\n" + line, 79, SINGLE) is None
    assert convert_lines(b"", 79, SINGLE) is None
    assert convert_lines(line[:50] + b"\n", 51, SINGLE) is None
