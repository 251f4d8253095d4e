"""Datasets are found without reading what they hold, whatever their size."""

import mmap
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import DELIMITER, ascii58, binary58, dataset, fixed, floats, header58

from ema.core.errors import RecordingFormatError
from ema.io.formats import read_file, read_headers
from ema.io.uff import scan as uff_scan
from ema.io.uff.scan import scan

GIGABYTE = 1 << 30
END = DELIMITER.encode() + b"\n"


class CountingMap(mmap.mmap):
    """A memory map that counts the bytes looked at."""

    looked_at = 0

    def __getitem__(self, where):
        found = super().__getitem__(where)
        CountingMap.looked_at += len(found)
        return found

    def find(self, mark, begin, end=None):
        end = len(self) if end is None else end
        found = super().find(mark, begin, end)
        CountingMap.looked_at += (end if found < 0 else found) - begin
        return found


@pytest.fixture
def looked_at(monkeypatch):
    CountingMap.looked_at = 0
    counting = SimpleNamespace(mmap=CountingMap, ACCESS_READ=mmap.ACCESS_READ)
    monkeypatch.setattr(uff_scan, "mmap", counting)
    return lambda: CountingMap.looked_at


def sparse(path, parts):
    """Write {position: bytes}; the rest of the file is a hole."""
    with path.open("wb") as file:
        for position, content in parts.items():
            file.seek(position)
            file.write(content)
    return path


def test_two_gigabytes_of_binary_values_are_not_looked_at(tmp_path, looked_at):
    n = GIGABYTE // 4
    lines = header58(n=n, binary=(1, 4 * n))
    second = len(lines) + 4 * n
    parts = {0: lines, second: END + lines, second + len(END + lines) + 4 * n: END}
    found = scan(sparse(tmp_path / "a.uff", parts))
    assert [each.payload[1] - each.payload[0] for each in found] == [GIGABYTE, GIGABYTE]
    assert looked_at() < 20_000


def test_two_gigabytes_of_text_are_not_looked_at(tmp_path, looked_at):
    n = 6 * 27_000_000 + 5
    line = fixed([1.5] * 6).encode()
    head = header58(n=n)
    last = len(head) + n // 6 * len(line)
    end = fixed([1.5] * 5).encode() + END
    parts = {0: head + line, last - len(line) - 1: b"\n" + line + end}
    (found,) = scan(sparse(tmp_path / "a.uff", parts))
    assert found.payload == (len(head), last + 5 * 13 + 1)
    assert found.stop > 2_000_000_000
    assert looked_at() < 20_000


@pytest.mark.parametrize("eol", ["\n", "\r\n"])
@pytest.mark.parametrize("n", [120_000, 120_001])
def test_text_ends_at_the_same_delimiter_with_and_without_a_jump(tmp_path, monkeypatch, eol, n):
    first = ascii58(fixed([0.25] * n, eol=eol), n=n, eol=eol)
    (path := tmp_path / "a.uff").write_bytes(first + first)
    jumped = scan(path)
    assert all(each.is_equal_lines for each in jumped)
    monkeypatch.setattr(uff_scan, "_WORTH_A_JUMP", len(first) * 2)
    assert jumped == tuple(replace(each, is_equal_lines=True) for each in scan(path))
    assert [each.stop for each in jumped] == [len(first), 2 * len(first)]


@pytest.mark.parametrize(
    "text",
    [fixed([0.25] * 120_000, per_line=5), fixed([0.25] * 6) + fixed([0.25] * 119_994, 15, 7, 5)],
    ids=["five a line", "lines of two lengths"],
)
def test_text_of_other_lines_ends_where_it_does(tmp_path, text):
    content = ascii58(text, n=120_000)
    (path := tmp_path / "a.uff").write_bytes(content + dataset(151, "x"))
    assert scan(path)[0].stop == len(content)


def test_text_shorter_than_stated_ends_at_its_own_delimiter(tmp_path):
    n = 120_000
    content = ascii58(fixed([0.25] * (n - 600)), n=n) + ascii58(fixed([0.25] * n), n=n)
    (path := tmp_path / "a.uff").write_bytes(content)
    begin, end = scan(path)[0].payload
    assert end - begin == (n - 600) // 6 * 79


def test_a_wrong_byte_count_does_not_make_the_payload_a_line(tmp_path, looked_at):
    n = GIGABYTE // 8
    lines = header58(n=n, ordinate=4, binary=(1, 4 * n))  # stated: half of what is there
    (found,) = scan(sparse(tmp_path / "a.uff", {0: lines, len(lines) + 8 * n: END}))
    assert found.payload[1] - found.payload[0] == GIGABYTE
    assert looked_at() < 20_000


def test_padding_of_any_length_is_skipped(tmp_path, looked_at):
    first, second = binary58(floats(range(8))), binary58(floats(range(8)), name="A02")
    padding = b"\r\n" * 300_000 + b" " * 1000 + b"\x1a\n"
    (path := tmp_path / "a.uff").write_bytes(first + padding + second + b"\x00" * 100_000)
    assert [each.start for each in scan(path)] == [0, len(first) + len(padding)]
    assert looked_at() < 1_000_000


def test_text_behind_padding_is_no_dataset(tmp_path):
    (path := tmp_path / "a.uff").write_bytes(b"\n\n" + binary58(floats(range(8))) + b"\n  what\n")
    with pytest.raises(RecordingFormatError, match="what"):
        scan(path)


@pytest.mark.parametrize("n", [120_000, 120_001])
def test_headers_alone_tell_all_but_the_samples(tmp_path, n):
    content = ascii58(fixed([0.25] * n), n=n) + binary58(floats([0.5] * n), n=n, name="A02")
    (path := tmp_path / "a.uff").write_bytes(content)
    told, read = read_headers(path).recording, read_file(path).recording
    assert (told.names, told.sampling_rate_hz) == (read.names, read.sampling_rate_hz)
    assert told.n_samples == read.n_samples == n
    assert np.isnan(told.channels[0].samples).all()
    assert told.channels[0].samples.strides == (0,)
    np.testing.assert_array_equal(told.channels[1].samples, read.channels[1].samples)


@pytest.mark.parametrize("there", [-6, -1, 1, 6])
@pytest.mark.parametrize("n", [120_000, 120_001])
def test_headers_alone_do_not_hide_missing_samples(tmp_path, n, there):
    (path := tmp_path / "a.uff").write_bytes(ascii58(fixed([0.25] * (n + there)), n=n))
    with pytest.raises(RecordingFormatError, match=f"{n + there} of {n} values"):
        read_headers(path)
    with pytest.raises(RecordingFormatError, match=f"{n + there} of {n} values"):
        read_file(path)


def test_headers_of_other_formats_are_read_with_their_samples(tmp_path):
    (path := tmp_path / "a.csv").write_text("time [s],A01 [m/s^2]\n0.0,1.0\n0.5,2.0\n")
    assert read_headers(path).recording.channels[0].samples.tolist() == [1.0, 2.0]
    with pytest.raises(RecordingFormatError, match="not found"):
        read_headers(tmp_path / "none.uff")
