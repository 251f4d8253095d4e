"""Tables of text: headers, separators, decimal signs, time columns, and faults."""

import re

import numpy as np
import pytest

from ema.core.errors import RecordingFormatError
from ema.io.formats import READERS, is_recording, read_file
from ema.io.text.csv import read as read_csv


def read(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "a.csv"
    path.write_bytes(text.encode(encoding))
    return read_csv(path)


TABLE = "time [s],A01 [g],force [kN]\n0,1.5,2\n0.0005,-1e-3,3\n0.001,0,4\n"


@pytest.mark.parametrize(
    "text",
    [
        TABLE,
        TABLE.replace("\n", "\r\n"),
        TABLE.replace(",", ";"),
        TABLE.replace(",", "\t"),
        TABLE.replace(",", ";").replace(".", ","),
        TABLE.replace(",", "\t").replace(".", ","),
        TABLE.replace("time [s]", '"t"'),
        TABLE.replace("[g]", "[ g ]").replace("force [kN]", "force[kN]"),
        TABLE.replace("\n", ",\n").replace("0,1.5", "0.0,1.5"),
        "\ufeff" + TABLE,
        TABLE.rstrip("\n"),
    ],
)
def test_dialects_of_one_table(tmp_path, text):
    recording = read(tmp_path, text).recording
    assert recording.names == ("A01", "force")
    assert [each.quantity for each in recording.channels] == ["acceleration", "force"]
    assert recording.sampling_rate_hz == 2000.0
    expected = [[1.5 * 9.80665, -1e-3 * 9.80665, 0.0], [2e3, 3e3, 4e3]]
    np.testing.assert_allclose(recording.block(0, 3), expected, rtol=1e-15)


def test_latin_1_header(tmp_path):
    recording = read(tmp_path, "Prüfkraft [N],a [m/s²]\n1,2\n3,4\n", "latin-1").recording
    assert recording.names == ("Prüfkraft", "a")
    assert recording.channels[1].quantity == "acceleration"


def test_milliseconds(tmp_path):
    assert read(tmp_path, "t [ms],a\n0,1\n0.5,2\n1.0,3\n").recording.sampling_rate_hz == 2000.0


def test_a_column_called_time_in_another_unit_is_a_channel(tmp_path):
    recording = read(tmp_path, "time [V],a\n0,1\n1,2\n").recording
    assert recording.names == ("time", "a")
    assert np.isnan(recording.sampling_rate_hz)


def test_unknown_units_are_reported(tmp_path):
    found = read(tmp_path, "a [EU],b\n0,1\n1,2\n")
    assert [(each.channel, each.check) for each in found.findings] == [("a", "unit")]
    assert [each.quantity for each in found.recording.channels] == ["unknown", "unknown"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        ("a,b\n", "no rows of numbers below the header"),
        ("a,b\n\n\n", "no rows of numbers"),
        ("0.5,1\n2,3\n", "no header"),
        ("a,b\n1,2\n3\n", "1 cells, 2 columns"),
        ("a,b\n1,x\n", "column 'b': 'x'"),
        ("a,b\n1,2,3\n", "3 cells below 2"),
        ("t\n0\n1\n", "columns t"),
        ("t,a\n0,1\n1,1\n3,1\n", "not at equal steps"),
        ("t,a\n0,1\n", "not at equal steps"),
        ("t,a\n0,1\nnan,1\n", "not at equal steps"),
        ("a\x00b\n1\n", "binary data"),
    ],
)
def test_faults_are_named(tmp_path, text, message):
    with pytest.raises(RecordingFormatError, match=re.escape(message)) as caught:
        read(tmp_path, text)
    assert "a.csv" in caught.value.where


def test_formats_are_known_by_their_ending(tmp_path):
    assert {".uff", ".csv"} <= set(READERS)
    assert is_recording(tmp_path / "A.UFF")
    with pytest.raises(RecordingFormatError, match="not found"):
        read_file(tmp_path / "a.csv")
    with pytest.raises(RecordingFormatError, match="not a file"):
        read_file(tmp_path)
    (tmp_path / "a.xyz").write_text("x")
    with pytest.raises(RecordingFormatError, match="recordings end in"):
        read_file(tmp_path / "a.xyz")
