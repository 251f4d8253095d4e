"""Tables with a fault: the message names the line, the column and the value."""

import errno
import gzip
import io

import pytest

from ema.core.errors import RecordingFormatError
from ema.io.text.csv import read as read_text
from ema.io.text.source import TextSource

HEADER = "time [s];A01 [g];force [N]\n"
ROWS = "".join(f"{k / 2000:.4f};{k + 0.125:.3f};{k + 0.25:.3f}\n" for k in range(40))


def refusal(tmp_path, text, name="a.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(RecordingFormatError) as caught:
        read_text(path)
    return caught.value


@pytest.mark.parametrize(
    ("text", "where", "message"),
    [
        ("a;b\n1;x\n", "a.csv, line 2, column 'b'", "'x'; "),
        ("a;b\n1.5;2\n1,5;2\n", "a.csv, line 3, column 'a'", "with a decimal point"),
        ('a,b\n"1,234",5\n7,"2,500"\n', "a.csv, line 2", "'1,234'; "),
        ("t,a\n0,1\n1,", "a.csv, line 3", "cut short"),
        ("t;a\n0:30;2\n", "a.csv, line 2, column 't'", "hh:mm:ss.s, or a date"),
        ("t;a\n10:00:00;1\n10:00:61;2\n", "a.csv, line 2, column 't'", "00:61"),
        ("t;a\n10:00:00;1\n;2\n", "a.csv, line 3, column 't'", "no time"),
        ("t;a\n10:00:00;1\n3;2\n", "a.csv, line 3, column 't'", "'3'"),
        ("t;a\n0;1\n10:00:00;1\n", "a.csv, line 3, column 't'", "'10:00:00'"),
        ("a;b\n1;2\n\n3\n", "a.csv, line 4", "1 cells, 2 columns"),
        ("a;b\n1;2\n3;4;5\n", "a.csv, line 3", "3 cells, 2 columns"),
        ("a;b\n1;2\n3;4\nEnd of data\n5;6\n", "a.csv, line 4", "text where numbers go on"),
        ("note\n\na;b\n1;2\n3;4\nmax;4\n5;6\n", "a.csv, line 6, column 'a'", "'max'"),
        ("a;b\n1;2;3\n", "a.csv, line 2", "3 cells below 2 in line 1"),
        ("a;b;c\n1;2\n3;4;5\n", "a.csv, line 2", "2 cells below 3 in line 1"),
        ("a;b;c\ns;g;N\n1;2\n3;4;5\n", "a.csv, line 3", "2 cells below 3 in line 2"),
        ("a;b;c\ns;g;N\n1;2\r3\n3;4;5\n", "a.csv, line 4", "no header"),
        ("time;a\ns;g;N\n3;4;5\n", "a.csv, line 3", "units in line 2, no header of 3"),
        ("time;a;b\nsg;N\n3;4;5\n", "a.csv, line 3", "3 cells below 2 in line 2"),
        ("note\n1;2;3\n4;5;6\n", "a.csv, line 2", "3 cells below 1 in line 1"),
        ("1;2\n3;4\n", "a.csv, line 1", "no header: '1;2'"),
        ("0,5;2\n1,5;4\n", "a.csv, line 1", "no header"),
        ("t;a\n0;1\n0,5;2\n1;3\n5;4\n", "a.csv, column 't'", "not at equal steps"),
        ("note\n" * 300 + "a\n1\n", "a.csv", "at most 200"),
        ("a,b\n1,2\n" + '"3,4\n' * 3, "a.csv, line 3", "1 cells, 2 columns"),
        ("\ufffd" * 600_000, "a.csv", "rows of over a megabyte"),
        (b"\xff\xfea\x00\n\x001\x00\n", "a.csv", "begins as UTF-16"),
        ("a;b\n1;2\n".encode("utf-16-le"), "a.csv", "binary data"),
        (b"\x89PNG\r\n\x1a\n\x00\x00", "a.csv", "binary data"),
        (b"a;b\n1;2\n3;4\n\x00\x00\x00", "a.csv", "binary data"),
        (b"a;b\n1;2\n3;\xff\n", "a.csv, line 3, column 'b'", "'ÿ'"),
    ],
)
def test_faults_are_named(tmp_path, text, where, message):
    error = refusal(tmp_path, text)
    assert error.where == where
    assert message in str(error)


def test_no_cut_within_the_last_row_passes_silently(tmp_path):
    whole = HEADER + ROWS
    last = whole[:-1].rfind("\n") + 1
    assert refusal(tmp_path, whole[: last + 1]).where == "a.csv, line 41"
    for end in range(last + 1, len(whole) - 1):
        error = refusal(tmp_path, whole[:end])
        assert "line 41" in error.where
        assert "cut short" in str(error)


def test_a_whole_last_row_needs_no_line_end(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text((HEADER + ROWS)[:-1])
    assert read_text(path).recording.n_samples == 40


def test_a_fault_far_down_is_found(tmp_path):
    rows = ["1.5;2.5"] * 200_000
    rows[150_000] = "1.5;2.5x"
    error = refusal(tmp_path, "a;b\n" + "\n".join(rows) + "\n")
    assert error.where == "a.csv, line 150002, column 'b'"
    assert error.found == "'2.5x'"


@pytest.mark.parametrize("cut", [5, 40, -9, -3])
def test_cut_gzip(tmp_path, cut):
    packed = gzip.compress((HEADER + ROWS).encode())
    assert "gzip" in str(refusal(tmp_path, packed[:cut], "a.csv.gz"))


def test_gzip_with_a_wrong_checksum_or_another_content(tmp_path):
    packed = bytearray(gzip.compress((HEADER + ROWS).encode()))
    packed[-6] ^= 1
    assert "CRC" in str(refusal(tmp_path, bytes(packed), "a.csv.gz"))
    assert "gzip" in str(refusal(tmp_path, HEADER + ROWS, "a.csv.gz"))


def test_a_bomb_is_refused_after_little_of_it(tmp_path):
    packed = gzip.compress(b"a\n" + b"1.5\n" * 5_000_000)
    error = refusal(tmp_path, packed, "a.csv.gz")
    assert error.rule == "measured numbers do not pack more than 50 times"
    unpacked = int(error.found.split()[1])
    assert unpacked < 50 * len(packed) + (4 << 20) < 20_000_000


def test_a_line_without_end_is_refused(tmp_path):
    error = refusal(tmp_path, b"a\n1\n" + b" " * (1 << 27))
    assert "a line of over 64 MB" in str(error)


def test_what_is_no_file_is_refused(tmp_path):
    for path in (tmp_path, tmp_path / "nothing.csv"):
        with pytest.raises(RecordingFormatError, match="must be readable"):
            read_text(path)


class Vanishing(io.FileIO):
    """A file on a network drive that goes away."""

    def read(self, size=-1):
        raise OSError(errno.ESTALE, "Stale file handle")


def test_a_file_that_stops_being_read_is_named(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("a\n1\n")
    with Vanishing(path) as file, pytest.raises(RecordingFormatError, match="Stale file handle"):
        TextSource(path, file)
