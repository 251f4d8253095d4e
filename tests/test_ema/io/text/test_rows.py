"""Rows of a table: a glance at plain numbers tells the same as a look at every cell."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.io.text.layout import _row
from ema.io.text.source import (
    MISSING,
    NOT_A_NUMBER,
    Dialect,
    Line,
    begins_some_line,
    cells_of,
    count_of,
    is_clock,
    is_date,
    is_number,
)

SEPARATORS = "\t;,| "
NUMBERS = ["1", "0", "-1.5", "2,5", "1.234", "1,234", "1e5", "-2.5E-03", "+7,25e+1", "5."]
OTHERS = ["1.234,5", "1,234.5", "nan", "", "12.05.2026", "10:00:00", "1D3", "force", "12.5.", "1;2"]
OTHERS += ["3|4", " 7", "8 ", '"1,5"', "+", ".5", "1 234", "-", "1e", "12/05/26", "1\t2", "\u2081"]


def counts_of_cells(text, dialect):
    cells = cells_of(text, dialect.separator)
    is_only = len(cells) == 1
    numbers = texts = 0
    for cell in cells:
        if is_number(cell, dialect.decimal, is_only=is_only) or cell.lower() in NOT_A_NUMBER:
            numbers += 1
        elif cell.lower() not in MISSING and not (is_clock(cell) or is_date(cell)):
            texts += 1
    filled = max((number for number, cell in enumerate(cells, 1) if cell), default=0)
    return len(cells), filled, numbers, texts


@pytest.mark.parametrize("pool", [NUMBERS, NUMBERS + OTHERS])
@given(data=st.data())
def test_a_glance_at_a_row_tells_the_same(pool, data):
    written_with = data.draw(st.sampled_from(SEPARATORS))
    text = written_with.join(data.draw(st.lists(st.sampled_from(pool), min_size=1, max_size=5)))
    for separator in SEPARATORS:
        for decimal in ".,":
            dialect = Dialect(separator, decimal)
            row = _row(Line(text, 1, 0), dialect)
            found = row.width, row.filled, row.numbers, row.texts
            assert found == counts_of_cells(text, dialect)


@given(text=st.binary(max_size=60), sign=st.sampled_from([b"\n", b"a"]))
def test_characters_are_counted(text, sign):
    assert count_of(sign, 1000 * text) == (1000 * text).count(sign)


@given(st.text("\na*1\r", max_size=12).map(str.encode))
def test_first_characters_of_lines(text):
    begins = any(line[:1] in (b"a", b"*") for line in text.split(b"\n"))
    assert begins_some_line(b"a*", text or b"\n") == begins
