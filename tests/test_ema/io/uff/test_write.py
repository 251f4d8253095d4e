"""What is written is read back bit for bit, by us and by others."""

import numpy as np
import pandas as pd
import pytest
import pyuff
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from ema.core.errors import InputError
from ema.core.frf import FRF
from ema.core.recording import Channel
from ema.io.text.csv import read as read_csv
from ema.io.text.csv import write_csv
from ema.io.uff.reader import read as read_uff
from ema.io.uff.write import write_frfs, write_time_series

G = 9.80665


def channels(dtype="f4", n=1001):
    noise = np.random.default_rng(7).normal(size=(3, n)).astype(dtype)
    return [
        Channel("force", "force", "N", noise[0]),
        Channel("A01", "acceleration", "g", noise[1], G, node=12),
        Channel("A02", "acceleration", "m/s^2", noise[2], -1.0, node=13),
    ]


def frf(n=7):
    rng = np.random.default_rng(3)
    values = rng.normal(size=(3, n)) + 1j * rng.normal(size=(3, n))
    unknown = np.full((3, n), np.nan)
    lines = 20.0 + 0.04 * np.arange(n)
    return FRF(lines, values, unknown, unknown, [0, 20, 71], [0.0, 100.0, 355.0], ("a", "a", "b"))


@pytest.mark.parametrize("byte_order", ["little", "big"])
@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_time_series_return_bit_for_bit(tmp_path, byte_order, dtype):
    written = channels(dtype)
    write_time_series(tmp_path / "a.uff", written, 44100.0, byte_order=byte_order)
    found = read_uff(tmp_path / "a.uff")
    assert found.findings == ()
    assert found.recording.sampling_rate_hz == 44100.0
    for one, other in zip(written, found.recording.channels, strict=True):
        assert (one.name, one.quantity, one.unit) == (other.name, other.quantity, other.unit)
        assert (one.node or 0, one.scale_to_si) == (other.node, other.scale_to_si)
        assert other.samples.dtype.itemsize == one.samples.dtype.itemsize
        np.testing.assert_array_equal(one.samples, other.samples)


@pytest.mark.parametrize(
    ("precision", "tolerance"), [("single", 1e-5), ("double", 1e-12), (None, 1e-12)]
)
def test_ascii_keeps_its_digits(tmp_path, precision, tolerance):
    written = channels("f8", 14)
    write_time_series(tmp_path / "a.uff", written, 2000.0, precision=precision, binary=False)
    found = read_uff(tmp_path / "a.uff").recording
    for one, other in zip(written, found.channels, strict=True):
        np.testing.assert_allclose(one.samples, other.samples, rtol=tolerance)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("precision", ["single", "double"])
def test_pyuff_reads_our_time_series(tmp_path, binary, precision):
    written = channels()
    path = tmp_path / "a.uff"
    write_time_series(
        path, written, 2000.0, binary=binary, precision=precision, directions=[1, 2, 3]
    )
    sets = pyuff.UFF(str(path)).read_sets()
    assert [each["id1"].strip() for each in sets] == ["force", "A01", "A02"]
    assert [each["rsp_node"] for each in sets] == [0, 12, 13]
    assert [each["rsp_dir"] for each in sets] == [1, 2, -3]
    assert [each["ordinate_spec_data_type"] for each in sets] == [13, 12, 12]
    assert [each["load_case_id"] for each in sets] == [0, 0, 0]
    for one, other in zip(written, sets, strict=True):
        assert other["func_type"] == 1
        np.testing.assert_allclose(other["data"], one.samples, rtol=0 if binary else 1e-5)
        assert other["x"][-1] == pytest.approx(0.5)


@pytest.mark.parametrize("binary", [True, False])
def test_pyuff_and_we_read_our_frfs(tmp_path, binary):
    written = frf()
    path = tmp_path / "a.uff"
    write_frfs(path, written, binary=binary, reference_node=4)
    found = read_uff(path)
    np.testing.assert_allclose(found.frf.values, written.values, rtol=0 if binary else 1e-12)
    np.testing.assert_allclose(found.frf.frequency_hz, written.frequency_hz, rtol=1e-12)
    np.testing.assert_array_equal(found.frf.node, written.node)
    assert found.findings == ()
    sets = pyuff.UFF(str(path)).read_sets()
    for row, other in enumerate(sets):
        np.testing.assert_allclose(other["data"], written.values[row], rtol=0 if binary else 1e-11)
        assert (other["func_type"], other["ref_node"], other["load_case_id"]) == (4, 4, 0)
        assert (other["ordinate_spec_data_type"], other["orddenom_spec_data_type"]) == (12, 13)


def test_frfs_in_single_precision(tmp_path):
    write_frfs(tmp_path / "a.uff", frf(), precision="single", byte_order="big")
    found = read_uff(tmp_path / "a.uff").frf
    np.testing.assert_array_equal(found.values, frf().values.astype(np.complex64))


def test_a_factor_that_no_unit_explains_is_applied(tmp_path):
    counts = np.arange(5, dtype=np.int16)
    odd = Channel("A01", "acceleration", "counts", counts, -0.5)
    for write, read in ((write_time_series, read_uff), (write_csv, read_csv)):
        write(tmp_path / "a", [odd], 2000.0)
        found = read(tmp_path / "a").recording.channels[0]
        assert found.unit == "m/s^2"
        np.testing.assert_array_equal(found.block(0, 5), odd.block(0, 5))


def test_tables_return_what_was_written(tmp_path):
    written = channels()
    write_csv(tmp_path / "a.csv", written, 44100.0)
    found = read_csv(tmp_path / "a.csv").recording
    assert found.sampling_rate_hz == 44100.0
    for one, other in zip(written, found.channels, strict=True):
        assert (one.name, one.quantity, one.unit) == (other.name, other.quantity, other.unit)
        sense = np.sign(one.scale_to_si)
        np.testing.assert_array_equal(other.samples.astype("f4"), sense * one.samples)


def test_pandas_reads_our_tables(tmp_path):
    written = channels("f8")
    write_csv(tmp_path / "a.csv", written, 2000.0)
    table = pd.read_csv(tmp_path / "a.csv")
    assert list(table.columns) == ["time [s]", "force [N]", "A01 [g]", "A02 [m/s^2]"]
    np.testing.assert_allclose(table["A01 [g]"], written[1].samples, rtol=1e-15)
    np.testing.assert_allclose(table["A02 [m/s^2]"], -written[2].samples, rtol=1e-15)


def test_names_keep_to_one_line(tmp_path):
    odd = Channel("two\nlines\t Ω", "force", "N", np.ones(3))
    write_time_series(tmp_path / "a.uff", [odd], 2000.0)
    assert read_uff(tmp_path / "a.uff").recording.names == ("two lines ?",)


@pytest.mark.parametrize(
    ("written", "rate", "directions", "message"),
    [
        ([], 2000.0, None, "channel lengths"),
        ([*channels(n=5), *channels(n=6)], 2000.0, None, r"\[5, 6\]"),
        (channels(n=0), 2000.0, None, r"\[0\]"),
        (channels(), 0.0, None, "sampling rate 0.0"),
        (channels(), np.nan, None, "sampling rate nan"),
        (channels(), 2000.0, [1], "1 directions for 3"),
    ],
)
def test_what_cannot_be_written(tmp_path, written, rate, directions, message):
    with pytest.raises(InputError, match=message):
        write_time_series(tmp_path / "a.uff", written, rate, directions=directions)
    assert not (tmp_path / "a.uff").exists()


def test_frfs_need_two_lines(tmp_path):
    with pytest.raises(InputError, match="3 FRFs of 1 lines"):
        write_frfs(tmp_path / "a.uff", frf(1))


@given(hnp.arrays("f8", st.integers(1, 40), elements=st.floats(width=64)))
def test_any_number_survives_in_double_precision(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("any") / "a.uff"
    write_time_series(path, [Channel("a", "force", "N", values)], 2000.0)
    np.testing.assert_array_equal(read_uff(path).recording.channels[0].samples, values)


@given(
    hnp.arrays(
        "f8",
        st.integers(1, 40),
        elements=st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False),
    )
)
def test_any_finite_number_survives_in_ascii(tmp_path_factory, values):
    path = tmp_path_factory.mktemp("any") / "a.uff"
    write_time_series(path, [Channel("a", "force", "N", values)], 2000.0, binary=False)
    found = read_uff(path).recording.channels[0].samples
    np.testing.assert_allclose(found, values, rtol=1e-12)
