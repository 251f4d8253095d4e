"""Datasets 58 and 58b: what is stored is what is read, and damage is named."""

import re

import numpy as np
import pytest
from builders import ascii58, binary58, dataset, fixed, floats, header58, nodes15, units164
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import RecordingFormatError
from ema.io.rates import even_step, parse_number, plainest, step_and_inverse
from ema.io.uff import frf as uff58
from ema.io.uff.reader import read as read_uff

VALUES = [0.0, -1.5, 2.25, 1e-3, -3e5, 7.0, 0.125, -0.0]


def read(tmp_path, content, name="a.uff"):
    path = tmp_path / name
    path.write_bytes(content)
    return read_uff(path)


def samples(tmp_path, content):
    return read(tmp_path, content).recording.channels[0].samples


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("double", [False, True])
@pytest.mark.parametrize("before_end", [b"", b"\r\n", b"\n"])
@pytest.mark.parametrize("eol", ["\n", "\r\n"])
def test_binary_payload_is_mapped_bit_for_bit(tmp_path, big, double, before_end, eol):
    payload = floats(VALUES, big=big, double=double)
    ordinate = 4 if double else 2
    content = binary58(payload, big=big, ordinate=ordinate, before_end=before_end, eol=eol)
    found = samples(tmp_path, content)
    assert isinstance(found, np.memmap)
    assert found.tobytes() == payload
    np.testing.assert_array_equal(found, np.array(VALUES, dtype="f8" if double else "f4"))
    with pytest.raises(ValueError, match="read-only"):
        found[0] = 1.0


@pytest.mark.parametrize("double", [False, True])
def test_payload_may_contain_the_delimiter(tmp_path, double):
    trap = b"\n    -1\n    58\n    -1\n".ljust(64, b" ")
    first = binary58(trap, big=double, ordinate=4 if double else 2, n=8 if double else 16)
    second = binary58(floats(range(8 if double else 16)), n=8 if double else 16, name="A02")
    recording = read(tmp_path, first + second).recording
    assert recording.names == ("A01", "A02")
    assert recording.channels[0].samples.tobytes() == trap


def test_byte_count_of_half_the_size_is_corrected_and_reported(tmp_path):
    parts = floats(range(16), double=True)
    content = binary58(
        parts, n_bytes=64, function_type=4, ordinate=6, abscissa=(18, 0, 0, "f", "Hz"),
        denominator=(13, 0, 0, "Force", "N"), step="  1.00000E+00",
    )  # fmt: skip
    found = read(tmp_path, content)
    np.testing.assert_array_equal(
        found.frf.values[0], np.arange(0, 16, 2) + 1j * np.arange(1, 16, 2)
    )
    assert [finding.check for finding in found.findings] == ["byte count"]


def test_doubles_under_a_single_precision_header_are_read_as_doubles(tmp_path):
    found = read(tmp_path, binary58(floats(VALUES, double=True), n_bytes=32, ordinate=2))
    np.testing.assert_array_equal(found.recording.channels[0].samples, VALUES)
    assert "8 for each" in found.findings[0].detail


@pytest.mark.parametrize(("abscissa", "double"), [("f4", False), ("f4", True), ("f8", True)])
def test_uneven_binary_pairs(tmp_path, abscissa, double):
    pairs = np.zeros(8, dtype=[("x", "<" + abscissa), ("y", "<f8" if double else "<f4")])
    pairs["x"], pairs["y"] = np.arange(8) / 2000.0, VALUES
    content = binary58(pairs.tobytes(), ordinate=4 if double else 2, even=0, step="0.0")
    recording = read(tmp_path, content).recording
    np.testing.assert_array_equal(recording.channels[0].samples, pairs["y"])
    assert recording.sampling_rate_hz == pytest.approx(2000.0, rel=1e-9)


def test_truly_uneven_time_is_refused(tmp_path):
    pairs = np.column_stack([np.arange(8) ** 2 / 2000.0, VALUES]).astype("<f4")
    with pytest.raises(RecordingFormatError, match="equal steps"):
        read(tmp_path, binary58(pairs.tobytes(), even=0))


@pytest.mark.parametrize("eol", ["\n", "\r\n"])
def test_ascii_single_and_double(tmp_path, eol):
    np.testing.assert_array_equal(
        samples(tmp_path, ascii58(fixed(VALUES, eol=eol), eol=eol)), VALUES
    )
    exact = [1 / 3, -2e-300, np.pi, 1e22, 5.0, -6.0, 7.0, 8.0]
    text = fixed(exact, 20, 12, 4, eol=eol)
    np.testing.assert_allclose(samples(tmp_path, ascii58(text, eol=eol, ordinate=4)), exact, 1e-12)


@pytest.mark.parametrize(
    "text",
    [
        fixed(VALUES).replace("E", "D"),
        fixed(VALUES).replace("E", "d"),
        fixed(VALUES, digits=6),  # negative numbers fill the column and touch their neighbours
        fixed(VALUES, width=16, per_line=5),
        fixed(VALUES, per_line=1),
        fixed(VALUES).replace("\n", "      \n"),
    ],
    ids=["D", "d", "touching", "wide", "one per line", "trailing blanks"],
)
def test_ascii_dialects(tmp_path, text):
    np.testing.assert_array_equal(samples(tmp_path, ascii58(text)), VALUES)


def test_ascii_of_more_lines_than_one_chunk(tmp_path):
    values = np.round(np.random.default_rng(1).normal(size=130_001), 4)
    content = ascii58(fixed(values.tolist()), n=len(values))
    np.testing.assert_allclose(samples(tmp_path, content), values, rtol=1e-5)


@given(
    st.lists(
        st.lists(st.integers(-(10**6), 10**6), min_size=1, max_size=8), min_size=2, max_size=30
    ),
    st.integers(1, 200),
)
def test_irregular_lines_may_end_anywhere_in_a_chunk(tmp_path_factory, lines, chunk):
    text = "".join(" ".join(map(str, line)) + "\n" for line in lines)
    values = [value for line in lines for value in line]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(uff58, "_CHUNK_BYTES", chunk)
        found = samples(tmp_path_factory.mktemp("any"), ascii58(text, n=len(values)))
    assert found.tolist() == values


@pytest.mark.parametrize("chunk", [1, 78, 79, 80, 1000])
def test_regular_lines_may_end_anywhere_in_a_chunk(tmp_path, monkeypatch, chunk):
    monkeypatch.setattr(uff58, "_CHUNK_BYTES", chunk)
    values = [k / 8 for k in range(201)]
    found = samples(tmp_path, ascii58(fixed(values, 20, 12, 4), ordinate=4, n=201))
    assert found.tolist() == values


def test_uneven_ascii_double(tmp_path):
    pairs = [(k / 2000.0, value) for k, value in enumerate(VALUES)]
    cells = [f"{x:13.5E}{y:20.12E}" for x, y in pairs]
    text = "".join(f"{a}{b}\n" for a, b in zip(cells[::2], cells[1::2], strict=True))
    recording = read(tmp_path, ascii58(text, ordinate=4, even=0)).recording
    np.testing.assert_array_equal(recording.channels[0].samples, VALUES)
    assert recording.sampling_rate_hz == 2000.0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (binary58(floats(range(5)), n_bytes=32), "5 of 8 values"),
        (binary58(floats(range(8)))[:-30], "2 of 8 values; the file is truncated"),
        (binary58(floats(range(8)))[:-3], "no closing delimiter behind 8 values"),
        (binary58(floats(range(9)), n_bytes=32), "no closing delimiter behind 8 values"),
        (binary58(b"", n=10**9, n_bytes=4 * 10**9), "0 of 1000000000 values"),
        (ascii58(fixed(range(5))), "5 of 8 values"),
        (ascii58(fixed(range(9))), "9 of 8 values"),
        (ascii58(fixed(range(8)), n=10**9), "8 of 1000000000 values"),
        (ascii58(fixed(range(8)))[:-8], "no closing delimiter"),
        (ascii58(fixed(range(7)) + "  what is it\n"), "what is it"),
        (ascii58("  1.00000E+00" * 500 + "\n"), "more than 4096 characters"),
        (header58()[:300], "header lines"),
        (b"", "the file is empty"),
        (b"time,force\n0,1\n", "begins with a line"),
        (b"    -1\n", "the end of the file"),
        (b"    -1\nabc\n    -1\n", "number of the dataset"),
        (ascii58(fixed(range(8)), ordinate=3), "ordinate data type 3"),
        (ascii58(fixed(range(8)), n=0), "0 values"),
        (ascii58(fixed(range(8)), n=-4), "-4 values"),
        (ascii58(fixed(range(8)), even=2), "abscissa spacing 2"),
        (ascii58(fixed(range(8)), step="          nan"), "must be finite"),
        (ascii58(fixed(range(8)), step="  0.00000E+00"), "time step"),
        (ascii58(fixed(range(8)), step="-5.00000E-04"), "time step"),
        (ascii58(fixed(range(8)), function_type=1, ordinate=5, n=4), "complex values"),
        (binary58(floats(range(8))).replace(b"58b     1", b"58b     7"), "byte order 7"),
        (binary58(floats(range(8))).replace(b"58b     1     2", b"58b     1     5"), "format 5"),
        (
            nodes15({1: (1, 0, 0)}).replace(b"0.0", b"x.0") + ascii58(fixed(range(8))),
            "columns 54 to",
        ),
        (units164(0.0, 1.0) + ascii58(fixed(range(8))), "positive"),
        (ascii58(fixed(range(8))) + ascii58(fixed(range(4)), n=4, name="A02"), "'A02'"),
        (
            ascii58(fixed(range(8))) + ascii58(fixed(range(8)), step="1.00000E-04", name="A02"),
            "2000 Hz of 'A01', 10000 Hz of 'A02'",
        ),
    ],
)
def test_damage_is_named(tmp_path, content, message):
    with pytest.raises(RecordingFormatError, match=re.escape(message)) as caught:
        read(tmp_path, content)
    assert "a.uff" in caught.value.where
    assert caught.value.remedy


def test_the_damaged_dataset_is_counted(tmp_path):
    content = binary58(floats(range(8))) + binary58(floats(range(5)), n_bytes=32)
    with pytest.raises(RecordingFormatError) as caught:
        read(tmp_path, content)
    assert caught.value.where == "a.uff, dataset 2"


def test_delimiter_in_an_id_line(tmp_path):
    np.testing.assert_array_equal(samples(tmp_path, ascii58(fixed(VALUES), name="    -1")), VALUES)


def test_latin_1_names_survive(tmp_path):
    recording = read(tmp_path, ascii58(fixed(VALUES), name="Kraft für 5 µm")).recording
    assert recording.names == ("Kraft für 5 µm",)


def test_nameless_channels_are_called_by_their_degree_of_freedom(tmp_path):
    content = b"".join(
        ascii58(fixed(VALUES), name=name, node=node, direction=-2)
        for name, node in (("NONE", 12), ("", 0))
    )
    assert read(tmp_path, content).recording.names == ("12-Y", "channel 2")


def test_what_holds_nothing_is_counted_and_left_out(tmp_path):
    content = dataset(2420, "  1", "x") + ascii58(fixed(VALUES), function_type=2)
    found = read(tmp_path, content)
    assert found.recording is None
    assert found.frf is None
    assert (
        "dataset 2420 (coordinate systems), function type 2 (auto spectrum)"
        in found.findings[0].detail
    )


@pytest.mark.parametrize(
    ("printed", "rate"),
    [
        ("1.52588E-05", 65536.0),
        ("1.95312E-05", 51200.0),
        ("2.26757E-05", 44100.0),
        ("2.08333E-05", 48000.0),
        ("9.76562E-06", 102400.0),
        ("3.90625e-05", 25600.0),
        ("5.00000D-04", 2000.0),
        ("0.0005", 2000.0),
        ("2.26757369614512E-05", 44100.0),
    ],
)
def test_printed_steps_give_sensible_rates(printed, rate):
    step, inverse = step_and_inverse(printed)
    assert inverse == rate
    assert step == pytest.approx(1.0 / rate, rel=1e-15)


def test_a_plain_step_stays_as_printed():
    assert step_and_inverse("3.00000E-04") == (3e-4, 1.0 / 3e-4)
    assert step_and_inverse("4.00000E-02")[0] == 0.04


@given(st.integers(1, 400_000))
def test_snapping_never_leaves_the_printed_digits(rate):
    printed = f"{1.0 / rate:.5E}"
    step, inverse = step_and_inverse(printed)
    assert step == pytest.approx(float(printed), rel=1.01e-5)
    assert inverse == pytest.approx(1.0 / step, rel=1e-12)


@given(st.floats(1e-6, 1e6), st.floats(0, 1e-3))
def test_plainest_stays_within_its_tolerance(value, relative):
    assert abs(plainest(value, relative * value)[0] - value) <= relative * value


def test_one_dropped_sample_makes_times_uneven():
    times = np.arange(1000) / 2000.0
    assert even_step(times)[1] == 2000.0
    for dropped in (1, 500, 998):
        assert even_step(np.delete(times, dropped)) is None
    assert even_step(np.array([0.0])) is None
    assert even_step(np.array([0.0, np.nan, 1.0])) is None
    assert even_step(times[::-1]) is None


@pytest.mark.parametrize(
    ("text", "value"),
    [("1.5D-03", 1.5e-3), (" -2.5e+1 ", -25.0), ("1.5-103", 1.5e-103), ("7", 7.0), ("NaN", np.nan)],
)
def test_fortran_numbers(text, value):
    np.testing.assert_equal(parse_number(text), value)


@pytest.mark.parametrize("text", ["", "1.0-2.0", "1_000.0", "0x10", "-1-2", "١.٠", "abc"])
def test_what_is_no_fortran_number(text):
    with pytest.raises(ValueError):
        parse_number(text)


@given(st.binary(max_size=400))
def test_any_payload_is_read_as_stored(tmp_path_factory, payload):
    payload = payload[: len(payload) // 4 * 4] or b"\x00" * 4
    content = binary58(payload, n=len(payload) // 4)
    assert samples(tmp_path_factory.mktemp("any"), content).tobytes() == payload
