"""HDF5 files that claim too much, contradict themselves, are cut or damaged."""

import re
import sys

import h5py
import numpy as np
import pytest
from damage import assert_no_other_exception, assert_truncations_named
from hdf5_layouts import NAMES, NOISE, N, add, compressed, matrix, of_datasets, of_file, written
from hypothesis import given, settings
from hypothesis import strategies as st

from ema.core.errors import RecordingFormatError
from ema.io.formats import read_file


def claimed(file):
    space = h5py.h5s.create_simple((10**12,))
    h5py.h5d.create(file.id, b"a", h5py.h5t.IEEE_F64LE, space)


def claimed_in_chunks(file):
    file.create_dataset("a", (10**12,), "f8", chunks=(1000,))


def one_great_chunk(file):
    file.create_dataset(
        "a", data=np.zeros(5), chunks=(2**22,), maxshape=(None,), compression="gzip"
    )


def silence(file):
    file.create_dataset("a", data=np.zeros(5_000_000), compression="gzip")


def two_rates(file):
    add(file, "a", NOISE[:, 0], fs=1000.0)
    add(file, "b", NOISE[:, 1], fs=2000.0)


def rate_in_words(file):
    add(file, "a", NOISE[:, 0], fs="high")


def two_lengths(file):
    add(file, "a", NOISE[:, 0])
    add(file, "b", NOISE[1:, 1])


def too_few_names(file):
    add(file, "a", np.zeros((N, 3)), names=NAMES)


FAULTS = {
    claimed: "8000000000000 bytes of numbers claimed, 0 stored",
    claimed_in_chunks: "8000000000000 bytes of numbers claimed",
    one_great_chunk: "bytes of numbers claimed by a file of",
    silence: "40000",
    two_rates: "1000 Hz by '/a/fs', 2000 Hz by '/b/fs'",
    rate_in_words: "one positive number",
    two_lengths: "50 samples of 'a', 49 of 'b'",
    too_few_names: "50 × 3 and 2 names",
}


@pytest.mark.parametrize(("write", "message"), FAULTS.items())
def test_faults_are_named(tmp_path, write, message):
    path = written(tmp_path, write)
    with pytest.raises(RecordingFormatError, match=re.escape(message)) as caught:
        read_file(path)
    assert "a.h5" in caught.value.where


@pytest.mark.parametrize("content", [b"", b"time,A01\n0,1\n", b"\x89HDF\r\n\x1a\n" + bytes(99)])
def test_wrong_content_is_named(tmp_path, content):
    (tmp_path / "a.h5").write_bytes(content)
    with pytest.raises(RecordingFormatError, match=r"a\.h5"):
        read_file(tmp_path / "a.h5")


def test_texts_without_length_do_not_hang(tmp_path):
    path = written(tmp_path, matrix)
    content = bytearray(path.read_bytes())
    heap = content.index(b"GCOL")
    content[heap + 24] = 70  # the first text's length, which now leads to a free space of nothing
    path.write_bytes(content)
    with pytest.raises(RecordingFormatError, match="lengths do not add up"):
        read_file(path)


@pytest.mark.parametrize("layout", [of_file, compressed])
def test_every_truncation_is_named(tmp_path, layout):
    assert_truncations_named(written(tmp_path, layout), read_file, step=331)


@pytest.mark.parametrize("layout", [of_datasets, compressed])
@settings(max_examples=40)
@given(data=st.data())
def test_no_damage_escapes_as_another_exception(tmp_path_factory, layout, data):
    path = written(tmp_path_factory.mktemp("damage"), layout)
    assert_no_other_exception(path, read_file, lambda *ends: data.draw(st.integers(*ends)))


def test_without_the_library_it_is_named(tmp_path, monkeypatch):
    path = written(tmp_path, of_file)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(RecordingFormatError, match="pip install h5py"):
        read_file(path)
