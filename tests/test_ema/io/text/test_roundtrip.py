"""Whatever dialect a table is written in, its numbers come back to the last bit."""

import gzip
import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from ema.core.errors import RecordingFormatError
from ema.io.text.csv import read as read_text

NUMBERS = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False),
    st.integers(-(10**6), 10**6).map(float),
    st.sampled_from([0.0, -0.0, 5e-324, 1.7976931348623157e308, 0.1]),
)
MISSING = st.sampled_from(["", "NaN", "-", "#N/A", "n/a", "#NV"])
NAMES = st.text(st.characters(categories=("Ll", "Lu"), max_codepoint=0x17F), min_size=2, max_size=8)
PREAMBLE = st.lists(st.sampled_from(["", "Lab 7", "Date: 2026-03-04", "# x", "tyre; no 5"]))


@st.composite
def tables(draw):
    """Names, cells as text with a decimal point, and the values that they stand for."""
    n_rows = draw(st.integers(1, 30))
    names = draw(st.lists(NAMES, min_size=2, max_size=5, unique_by=str.lower))
    rows = draw(
        st.lists(
            st.lists(NUMBERS, min_size=len(names), max_size=len(names)),
            min_size=n_rows,
            max_size=n_rows,
        )
    )
    cells = [[repr(value) for value in row] for row in rows]
    for column in range(1, len(names)):
        for row in draw(st.sets(st.integers(1, n_rows), max_size=3)) - {n_rows}:
            cells[row][column] = draw(MISSING)
    values = np.array([[float(c) if _is_float(c) else np.nan for c in row] for row in cells])
    return [f"A{name}" for name in names], cells, values


def _is_float(cell):
    return any(character.isdigit() for character in cell)


@st.composite
def dialects(draw):
    separator = draw(st.sampled_from([",", ";", "\t", "|"]))
    return {
        "separator": separator,
        "decimal": draw(st.sampled_from(".," if separator != "," else ".")),
        "end": draw(st.sampled_from(["\n", "\r\n", "\r"])),
        "encoding": draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"])),
        "quoted": draw(st.booleans()),
        "padded": draw(st.booleans()),
        "trailing": draw(st.booleans()),
        "units_below": draw(st.booleans()),
        "packed": draw(st.booleans()),
    }


def _written(names, cells, dialect, preamble):
    rows = [[cell.replace(".", dialect["decimal"]) for cell in row] for row in cells]
    if dialect["units_below"]:
        rows = [names, ["g"] * len(names), *rows]
    else:
        rows = [[f"{name} [g]" for name in names], *rows]
    if dialect["quoted"]:
        rows = [[f'"{cell}"' for cell in row] for row in rows]
    separator = dialect["separator"]
    between = f" {separator} " if dialect["padded"] else separator
    lines = [between.join(row) + (separator if dialect["trailing"] else "") for row in rows]
    text = dialect["end"].join([*preamble, *lines, ""])
    raw = text.encode(dialect["encoding"])
    return gzip.compress(raw) if dialect["packed"] else raw


@settings(max_examples=150, deadline=None)
@given(tables(), dialects(), PREAMBLE)
def test_any_table_in_any_dialect(table, dialect, preamble):
    names, cells, values = table
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("a.csv.gz" if dialect["packed"] else "a.csv")
        path.write_bytes(_written(names, cells, dialect, preamble))
        found = read_text(path)
    channels = found.recording.channels
    assert [channel.name for channel in channels] == names
    assert {channel.unit for channel in channels} == {"g"}
    for channel, expected in zip(channels, values.T, strict=True):
        read = channel.samples.astype(np.float64)
        np.testing.assert_array_equal(read, expected)
        np.testing.assert_array_equal(np.signbit(read), np.signbit(expected))
    counts = [each.detail.split()[0] for each in found.findings]
    assert counts == [str(n) for n in np.isnan(values).sum(axis=0) if n]


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.sampled_from([b"1", b"2.5", b"a [g]", b"t", b",", b";", b"\n", b'"', b"-", b" "])
        | st.binary(max_size=3),
        max_size=40,
    )
)
def test_any_bytes_are_read_or_refused(parts):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.csv"
        path.write_bytes(b"".join(parts))
        try:
            recording = read_text(path).recording
        except RecordingFormatError as error:
            assert error.where.startswith((path.name, str(path)))
        else:
            assert recording.n_samples > 0
