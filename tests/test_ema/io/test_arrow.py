"""Parquet, Feather and Arrow files: what labs write with pandas, and what is wrong with others."""

import re

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import RecordingFormatError
from ema.io.arrow import read
from ema.io.formats import READERS

RATE_HZ = 2000.0
N = 64
FORCE = np.sin(np.arange(N))
ANGLES = np.arange(N, dtype=np.int16) - 7


def table(**metadata):
    fields = [
        pa.field("force [kN]", pa.float64()),
        pa.field("A01", pa.int16(), metadata={"unit": "g"}),
    ]
    return pa.table([FORCE, ANGLES], schema=pa.schema(fields, metadata=metadata))


def write_stream(table, path):
    with pa.ipc.new_stream(path, table.schema) as file:
        file.write_table(table)


WRITERS = {
    "a.parquet": pa.parquet.write_table,
    "a.feather": pa.feather.write_feather,
    "b.feather": lambda *args: pa.feather.write_feather(*args, compression="uncompressed"),
    "a.arrow": pa.feather.write_feather,
    "b.arrow": write_stream,
}


def written(tmp_path, table, name="a.parquet"):
    WRITERS[name](table, str(tmp_path / name))
    return tmp_path / name


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize(
    "metadata", [{"sampling_rate_hz": "2000"}, {"dt": "0.0005"}, {"Fs": "2e3"}]
)
def test_columns_units_and_rate(tmp_path, name, metadata):
    found = read(written(tmp_path, table(**metadata), name))
    assert found.recording.names == ("force", "A01")
    assert [each.quantity for each in found.recording.channels] == ["force", "acceleration"]
    assert found.recording.sampling_rate_hz == RATE_HZ
    assert found.findings == ()
    np.testing.assert_allclose(
        found.recording.block(0, N), [1e3 * FORCE, 9.80665 * ANGLES], rtol=1e-15
    )
    assert not any(each.samples.flags.writeable for each in found.recording.channels)


def test_whole_feather_files_stay_on_disk(tmp_path):
    before = pa.total_allocated_bytes()
    path = written(tmp_path, table(), "b.feather")
    samples = read(path).recording.channels[0].samples
    assert pa.total_allocated_bytes() == before
    np.testing.assert_array_equal(samples, FORCE)


TIME_S = np.arange(N) / RATE_HZ


@pytest.mark.parametrize(
    "index",
    [
        pd.Index(TIME_S, name="time"),
        pd.Index(1e3 * TIME_S, name="t [ms]"),
        pd.to_timedelta(TIME_S, unit="s"),
        pd.date_range("2024-05-01", periods=N, freq="500us", tz="Europe/Berlin"),
        pd.date_range("2024-05-01", periods=N, freq="500us", name="when").as_unit("ns"),
    ],
)
@pytest.mark.parametrize("ending", ["parquet", "feather"])
def test_what_pandas_writes(tmp_path, index, ending):
    frame = pd.DataFrame({"A01 [g]": FORCE, "note": ["x"] * N}, index=index)
    path = tmp_path / f"a.{ending}"
    if ending == "parquet":
        frame.to_parquet(path)
    else:
        frame.reset_index(names=index.name or "time").to_feather(path)
    found = read(path)
    assert found.recording.names == ("A01",)
    assert found.recording.sampling_rate_hz == RATE_HZ
    assert [(each.channel, each.check) for each in found.findings] == [("note", "content")]


def test_an_index_that_only_counts_is_no_channel(tmp_path):
    frame = pd.DataFrame({"a": FORCE}, index=np.arange(N)[::-1])
    frame.to_parquet(tmp_path / "a.parquet")
    found = read(tmp_path / "a.parquet")
    assert found.recording.names == ("a",)
    assert found.findings[0].channel == "__index_level_0__"


@pytest.mark.parametrize("name", WRITERS)
def test_missing_values_become_nan(tmp_path, name):
    columns = {"a": pa.array([1, None, 3]), "b": pa.array([None, 0.5, 1.5])}
    found = read(written(tmp_path, pa.table(columns), name)).recording.block(0, 3)
    np.testing.assert_array_equal(found, [[1, np.nan, 3], [np.nan, 0.5, 1.5]])


@pytest.mark.parametrize("name", WRITERS)
def test_a_file_in_many_pieces(tmp_path, name):
    pieces = pa.Table.from_batches(table(fs="1").to_batches(max_chunksize=5))
    found = read(written(tmp_path, pieces, name)).recording
    np.testing.assert_array_equal(found.channels[1].samples, ANGLES)


def two_columns_of_one_name():
    return pa.table([FORCE, FORCE], names=["a", "a"])


def silence():
    return pa.table({"a": np.zeros(40_000_000, np.int8)})


@pytest.mark.parametrize(
    ("content", "name", "message"),
    [
        (lambda: pa.table({"note": ["x", "y"]}), "a.parquet", "columns none"),
        (lambda: pa.table({"a": np.zeros(0)}), "a.parquet", "no rows of numbers"),
        (lambda: pa.table({"t": [0.0, 1.0, 3.0], "a": [1, 2, 3]}), "a.arrow", "not at equal steps"),
        (lambda: table(fs="2000", dt="1"), "a.parquet", "2000 Hz by 'fs', 1 Hz by 'dt'"),
        (lambda: table(fs="fast"), "a.parquet", "one positive number"),
        (lambda: table(fs="-1"), "b.arrow", "one positive number"),
        (lambda: table(dt="0"), "a.feather", "one positive number"),
        (two_columns_of_one_name, "b.feather", "two columns 'a'"),
        (silence, "a.parquet", "40000000 bytes of numbers claimed"),
        (silence, "a.feather", "40000000 bytes of numbers claimed"),
    ],
)
def test_faults_are_named(tmp_path, content, name, message):
    with pytest.raises(RecordingFormatError, match=re.escape(message)) as caught:
        read(written(tmp_path, content(), name))
    assert name in caught.value.where


@pytest.mark.parametrize("name", WRITERS)
def test_every_truncation_is_named(tmp_path, name):
    path = written(tmp_path, table(), name)
    whole = path.read_bytes()
    for length in [*range(0, len(whole) - 8, 97), len(whole) - 9]:
        path.write_bytes(whole[:length])
        with pytest.raises(RecordingFormatError) as caught:
            read(path)
        assert caught.value.remedy


def test_wrong_content_is_named(tmp_path):
    for name in ("a.parquet", "a.feather", "a.arrow"):
        (tmp_path / name).write_bytes(b"time [s],A01 [g]\n0,1\n" * 50)
        with pytest.raises(RecordingFormatError, match="damaged, cut short or something else"):
            read(tmp_path / name)
        (tmp_path / name).write_bytes(b"FEA1" + bytes(60))
    with pytest.raises(RecordingFormatError, match="Feather version 1"):
        read(tmp_path / "a.feather")


@given(st.data())
def test_no_damage_escapes_as_another_exception(tmp_path_factory, data):
    name = data.draw(st.sampled_from(sorted(WRITERS)))
    path = written(tmp_path_factory.mktemp("damage"), table(fs="1"), name)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    try:
        recording = read(path).recording
    except RecordingFormatError:
        return
    assert recording.block(0, recording.n_samples).shape[1] == recording.n_samples


def test_frfs(tmp_path):
    lines, values = np.arange(1.0, 41.0), np.exp(0.1j * np.arange(40))
    parts = {"H1 real [g/N]": values.real, "H1 imag [g/N]": values.imag}
    pa.parquet.write_table(pa.table({"frequency": lines, **parts}), tmp_path / "a.parquet")
    found = read(tmp_path / "a.parquet").frf
    np.testing.assert_allclose(found.frequency_hz, lines)
    np.testing.assert_allclose(found.values, [9.80665 * values])


def test_integers_with_a_scale_are_refused(tmp_path):
    field = pa.field("A01", pa.int16(), metadata={"unit": "g", "scale": "0.001"})
    pa.parquet.write_table(pa.table([ANGLES], schema=pa.schema([field])), tmp_path / "a.parquet")
    with pytest.raises(RecordingFormatError, match="scale of integers"):
        read(tmp_path / "a.parquet")


def test_the_endings_are_known():
    assert {".parquet", ".feather", ".arrow"} <= set(READERS)
