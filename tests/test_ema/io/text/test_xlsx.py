"""Excel workbooks: sheets, dates, FRFs, and what is refused."""

from datetime import datetime, timedelta

import numpy as np
import pytest

from ema.core.errors import RecordingFormatError
from ema.io.formats import read_file

openpyxl = pytest.importorskip("openpyxl")
SIGNALS = np.random.default_rng(5).standard_normal((40, 2))
HEADER = ["time [s]", "force [N]", "A01 [g]"]


def write(path, *sheets):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets:
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    book.save(path)
    return path


def table(times, header=HEADER):
    return [header, *([t, *row] for t, row in zip(times, SIGNALS.tolist(), strict=True))]


@pytest.mark.parametrize("name", ["a.xlsx", "a.csv", "a.xlsm"])
@pytest.mark.parametrize(
    "times",
    [
        [k / 500 for k in range(40)],
        [datetime(2026, 3, 1, 12) + timedelta(milliseconds=2 * k) for k in range(40)],
    ],
)
def test_the_first_sheet_with_a_table(tmp_path, name, times):
    notes = [["Tyre 4711"], [], ["measured by", "Mia"]]
    sheets = ("Notes", notes), ("Data", [["Lab 7"], [], *table(times)]), ("More", notes)
    found = read_file(write(tmp_path / name, *sheets))
    assert found.recording.names == ("force", "A01")
    assert found.recording.sampling_rate_hz == 500.0
    np.testing.assert_allclose(found.recording.channels[0].samples, SIGNALS[:, 0], rtol=1e-14)
    assert any("sheet 'Data' is read, Notes, More" in each.detail for each in found.findings)


def test_frfs(tmp_path):
    header = ["Frequency (Hz)", "H1 real (g/N)", "H1 imag (g/N)"]
    found = read_file(write(tmp_path / "a.xlsx", ("Data", table(range(40), header))))
    np.testing.assert_allclose(found.frf.values, [9.80665 * SIGNALS @ [1, 1j]])


def test_what_is_refused(tmp_path):
    with pytest.raises(RecordingFormatError, match=r"a\.xlsx"):
        read_file(write(tmp_path / "a.xlsx", ("Notes", [["no table"]])))
    path = write(tmp_path / "b.xlsx", ("Data", table([k / 500 for k in range(40)])))
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(RecordingFormatError, match="damaged"):
        read_file(path)
    path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600))
    with pytest.raises(RecordingFormatError, match="old kind"):
        read_file(path)
