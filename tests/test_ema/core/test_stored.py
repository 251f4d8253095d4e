"""Samples on disk are read as they are, and a file that shrinks or goes is named."""

import os

import numpy as np
import pytest

from ema.core import files
from ema.core.errors import RecordingFormatError
from ema.core.files import fill, mapped, piece


@pytest.fixture
def stored(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"head" + np.arange(100, dtype=">f4").tobytes())
    return mapped(path, np.dtype(">f4"), 4, (100,))


@pytest.mark.parametrize(("start", "stop"), [(0, 100), (17, 43), (90, 200), (100, 110), (5, 5)])
def test_pieces_are_those_of_the_array(stored, start, stop):
    np.testing.assert_array_equal(piece(stored, start, stop), np.arange(100.0)[start:stop])


def test_views_are_read_where_they_are_in_the_file(stored):
    np.testing.assert_array_equal(piece(stored[10:], 5, 8), [15, 16, 17])
    np.testing.assert_array_equal(piece(np.asarray(stored)[3::2], 5, 200), np.arange(13, 100, 2))
    np.testing.assert_array_equal(piece(stored.reshape(20, 5).T[1], 1, 3), [6, 11])
    np.testing.assert_array_equal(piece(stored[::-1], 5, 8), [94, 93, 92])
    of_bytes = np.frombuffer(memoryview(stored.view(np.uint8))[8:], ">f4")
    np.testing.assert_array_equal(piece(of_bytes, 0, 2), [2, 3])
    np.testing.assert_array_equal(piece(np.arange(9), 2, 4), [2, 3])
    assert piece(stored[3::2], 0, 9).base is None


def test_nothing_is_read_through_the_map(stored):
    found = piece(stored, 0, 10)
    assert not isinstance(found, np.memmap)
    assert found.base is None


def test_a_file_that_became_shorter_is_named(stored, tmp_path):
    with (tmp_path / "a.bin").open("r+b") as file:
        file.truncate(4 + 4 * 60)
    with pytest.raises(RecordingFormatError, match=r"a\.bin: 10 of 50 samples from sample 51 on"):
        piece(stored, 50, 100)


def test_a_file_that_was_written_anew_is_named(stored, tmp_path):
    (tmp_path / "a.bin").write_bytes(b"head" + np.ones(100, dtype=">f4").tobytes())
    os.utime(tmp_path / "a.bin", (0, 0))  # clocks of drives may be coarse
    with pytest.raises(RecordingFormatError, match=r"a\.bin: changed since it was opened"):
        piece(stored, 50, 100)


def test_a_file_that_is_gone_is_named(stored, tmp_path):
    (tmp_path / "a.bin").unlink()
    with pytest.raises(RecordingFormatError, match="No such file"):
        piece(stored, 50, 100)


@pytest.mark.parametrize("kind", ["<f8", ">f8", "<f4", "<i2"])
def test_an_array_is_filled_whatever_is_stored(tmp_path, kind):
    path = tmp_path / "a.bin"
    path.write_bytes(b"head of 12 b" + np.arange(100, dtype=kind).tobytes())
    samples = mapped(path, np.dtype(kind), 12, (100,))
    into = np.empty(20)
    fill(samples, 30, into)
    np.testing.assert_array_equal(into, np.arange(30.0, 50.0))
    path.write_bytes(path.read_bytes()[: 12 + 40 * samples.itemsize])
    with pytest.raises(RecordingFormatError, match="10 of 20 samples from sample 31 on"):
        fill(samples, 30, into)


def test_channels_side_by_side_are_read_in_pieces(tmp_path, monkeypatch):
    """Single and double precision, from any row, over the ends of pieces of the file."""
    monkeypatch.setattr(files, "_PIECE_BYTES", 100)
    rows = np.arange(7 * 500, dtype=np.float64).reshape(500, 7)
    path = tmp_path / "rows.bin"
    path.write_bytes(b"12345" + rows.tobytes())
    table = mapped(path, rows.dtype, 5, rows.shape)
    for channel, start, stop in ((0, 0, 500), (3, 17, 411), (6, 499, 500), (6, 3, 3)):
        np.testing.assert_array_equal(
            piece(table[:, channel], start, stop), rows[start:stop, channel]
        )
    with path.open("r+b") as file:
        file.truncate(20_000)
    with pytest.raises(RecordingFormatError, match="stays as it is"):
        piece(table[:, 6], 0, 500)
