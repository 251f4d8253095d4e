"""What a file is by its content, under another ending; headers of WAV that were never completed."""

import zipfile

import numpy as np
import pytest
from builders import force58, response58
from scenarios_binary import hdf5_file, mat_file, parquet_file, tdms_file, wav_file
from scenarios_text import lvm_file

from ema.core.errors import RecordingFormatError
from ema.io.formats import read_file

CONTENTS = {
    ".uff": force58() + response58(),
    ".lvm": lvm_file(),
    ".mat": mat_file(),
    ".h5": hdf5_file(),
    ".tdms": tdms_file(),
    ".parquet": parquet_file(),
    ".wav": wav_file(),
}


@pytest.mark.parametrize("ending", [".csv", ".txt", ".uff", ".mat", ".xyz", ".uff.txt", ""])
@pytest.mark.parametrize("kind", CONTENTS)
def test_content_decides(tmp_path, kind, ending):
    path = tmp_path / f"a{ending}"
    path.write_bytes(CONTENTS[kind])
    found = read_file(path)
    assert len(found.recording.channels) == 2
    named = any("by its content" in each.detail for each in found.findings)
    assert named == (kind != ending and (kind, ending) != (".h5", ".mat"))


@pytest.mark.parametrize("ending", [".uff", ".58", ".lvm", ".mat", ".h5", ".wav", ".tdms"])
def test_tables_under_another_ending(tmp_path, ending):
    (tmp_path / f"a{ending}").write_text("time [s],F [N],A [g]\n0,1,2\n1,2,3\n")
    found = read_file(tmp_path / f"a{ending}")
    assert found.recording.names == ("F", "A")
    assert "by its content" in found.findings[-1].detail


@pytest.mark.parametrize("kind", [".uff", ".lvm"])
def test_a_damaged_beginning_makes_no_table(tmp_path, kind):
    """A universal file or LabVIEW file with another first line keeps its own message."""
    lines = force58().splitlines(keepends=True) if kind == ".uff" else lvm_file().splitlines(True)
    (tmp_path / f"a{kind}").write_bytes(b"name,unit\n" + b"".join(lines[1:]))
    with pytest.raises(RecordingFormatError, match=r"universal file|LabVIEW Measurement"):
        read_file(tmp_path / f"a{kind}")


@pytest.mark.parametrize("n_bytes", [0, 0xFFFFFFFF])
@pytest.mark.parametrize("more", [b"", b"\0"])
def test_unfinished_wav_header(tmp_path, n_bytes, more):
    (tmp_path / "a.wav").write_bytes(wav_file(n_bytes=n_bytes) + more)
    found = read_file(tmp_path / "a.wav")
    assert [each.n_samples for each in found.recording.channels] == [64, 64]
    assert any("never completed" in each.detail for each in found.findings)


def test_wav_without_samples_but_other_chunks(tmp_path):
    content = wav_file(n_bytes=0, samples=b"LIST" + np.uint32(4).tobytes() + b"INFO")
    (tmp_path / "a.wav").write_bytes(content)
    with pytest.raises(RecordingFormatError):
        read_file(tmp_path / "a.wav")


def test_a_workbook_of_damaged_xml_is_refused(tmp_path):
    path = tmp_path / "run.xlsx"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("[Content_Types].xml", "?")
        archive.writestr("xl/workbook.xml", "<wb>")
    with pytest.raises(RecordingFormatError, match="damaged, cut short or something else"):
        read_file(path)
    with pytest.raises(RecordingFormatError, match=r"run\.csv, by its content \.xlsx"):
        read_file(path.rename(tmp_path / "run.csv"))


@pytest.mark.parametrize("kind", [".uff", ".mat", ".h5", ".wav"])
def test_a_recording_cut_while_it_is_open_is_named(tmp_path, kind):
    """A map of what is not there any more would end the program without a word."""
    path = tmp_path / f"a{kind}"
    floats = wav_file(bits=32, kind=3, samples=np.ones(64, "<f4").tobytes())
    path.write_bytes(floats if kind == ".wav" else CONTENTS[kind])
    recording = read_file(path).recording
    assert np.isfinite(recording.block(0, recording.n_samples)).all()
    path.write_bytes(b"")
    with pytest.raises(RecordingFormatError, match=f"a{kind}.*0 of"):
        recording.block(0, recording.n_samples)
