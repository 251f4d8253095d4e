"""WAV files: every sample format as scipy reads it, chunks of other programs, and faults."""

import re
import struct

import numpy as np
import pytest
import scipy.io.wavfile
from damage import assert_no_other_exception, assert_truncations_named
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import RecordingFormatError
from ema.io.formats import read_file

RATE_HZ = 25600
FULL_SCALE = {"u1": 2.0**7, "i2": 2.0**15, "i4": 2.0**31, "f4": 1.0, "f8": 1.0}
INTEGER, FLOAT, A_LAW = 1, 3, 6


def chunk(name, content):
    return name + struct.pack("<I", len(content)) + content + bytes(len(content) % 2)


def layout(code=INTEGER, n_channels=2, n_bits=16, row=None):
    row = n_channels * n_bits // 8 if row is None else row
    return struct.pack("<HHIIHH", code, n_channels, RATE_HZ, RATE_HZ * row, row, n_bits)


def wav(*chunks, form=b"RIFF"):
    body = b"WAVE" + b"".join(chunks)
    return form + struct.pack("<I", len(body)) + body


def read(tmp_path, content):
    path = tmp_path / "a.wav"
    path.write_bytes(content)
    return read_file(path)


@pytest.mark.parametrize("dtype", FULL_SCALE)
@pytest.mark.parametrize("n_channels", [1, 3])
def test_samples_are_those_of_scipy_over_full_scale(tmp_path, dtype, n_channels):
    noise = np.random.default_rng(5).uniform(-1, 1, (500, n_channels))
    stored = (noise * 100 + (128 if dtype == "u1" else 0)).astype(dtype)
    scipy.io.wavfile.write(tmp_path / "a.wav", RATE_HZ, stored)
    found = read_file(tmp_path / "a.wav")
    exact = (stored - np.float64(128 if dtype == "u1" else 0)) / FULL_SCALE[dtype]
    np.testing.assert_array_equal(found.recording.block(0, 500), exact.T)
    assert found.recording.sampling_rate_hz == RATE_HZ
    assert found.recording.names == tuple(f"channel {n + 1}" for n in range(n_channels))
    assert [each.check for each in found.findings] == ["unit"]


def test_24_bit(tmp_path):
    values = [0, 1, -1, 2**23 - 1, -(2**23), 0x123456]
    packed = b"".join(value.to_bytes(3, "little", signed=True) for value in values)
    found = read(
        tmp_path, wav(chunk(b"fmt ", layout(n_channels=1, n_bits=24)), chunk(b"data", packed))
    )
    np.testing.assert_array_equal(found.recording.block(0, 6), [np.array(values) / 2**23])


SAMPLES = chunk(b"data", struct.pack("<4h", 1, -2, 3, -4))
EXTENSIBLE = layout(0xFFFE) + struct.pack("<HHIH14s", 22, 16, 3, INTEGER, bytes(14))
LONG = struct.pack("<QQQI", 0, 8, 2, 0)


@pytest.mark.parametrize(
    "content",
    [
        wav(chunk(b"fmt ", layout()), SAMPLES),
        wav(chunk(b"bext", b"Lab 3"), chunk(b"fmt ", layout()), SAMPLES, chunk(b"LIST", b"x")),
        wav(chunk(b"fmt ", EXTENSIBLE), SAMPLES),
        wav(
            chunk(b"ds64", LONG),
            chunk(b"fmt ", layout()),
            b"data" + b"\xff" * 4 + SAMPLES[8:],
            form=b"RF64",
        ),
    ],
)
def test_chunks_of_other_programs(tmp_path, content):
    found = read(tmp_path, content).recording
    np.testing.assert_array_equal(found.block(0, 2) * 2**15, [[1, 3], [-2, -4]])


def test_floats_stay_on_disk(tmp_path):
    stored = np.linspace(-1, 1, 10, dtype="f4")
    found = read(
        tmp_path, wav(chunk(b"fmt ", layout(FLOAT, 1, 32)), chunk(b"data", stored.tobytes()))
    )
    samples = found.recording.channels[0].samples
    np.testing.assert_array_equal(samples, stored)
    assert not samples.flags.owndata and not samples.flags.writeable


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"time A01 and no numbers", "begins with RIFF"),
        (wav(chunk(b"fmt ", layout())), "no chunk 'data'"),
        (wav(SAMPLES), "no chunk 'fmt '"),
        (wav(chunk(b"fmt ", layout())[:-4]), "12 bytes; it takes at least 16"),
        (wav(chunk(b"fmt ", b"\1\0")), "2 bytes; it takes at least 16"),
        (wav(chunk(b"fmt ", layout(A_LAW, 1, 8)), SAMPLES), "format 6 of 8 bit"),
        (wav(chunk(b"fmt ", layout(n_bits=12)), SAMPLES), "format 1 of 12 bit"),
        (wav(chunk(b"fmt ", layout(n_channels=0)), SAMPLES), "0 channels"),
        (wav(chunk(b"fmt ", layout(row=3)), SAMPLES), "in rows of 3"),
        (wav(chunk(b"fmt ", layout()), SAMPLES)[:-1], "7 of 8 bytes of samples"),
        (wav(chunk(b"fmt ", layout()), SAMPLES[:-2]), "6 of 8 bytes of samples"),
        (wav(chunk(b"fmt ", layout(n_channels=3)), SAMPLES), "each instant takes 6 bytes"),
        (wav(chunk(b"fmt ", layout()), chunk(b"data", b"")), "no rows of numbers"),
        (wav(chunk(b"fmt ", layout()), b"data" + b"\xfe" * 4 + SAMPLES[8:]), "of 4278124286 bytes"),
    ],
)
def test_faults_are_named(tmp_path, content, message):
    with pytest.raises(RecordingFormatError, match=re.escape(message)) as caught:
        read(tmp_path, content)
    assert "a.wav" in caught.value.where


def test_every_truncation_is_named(tmp_path):
    (tmp_path / "a.wav").write_bytes(wav(chunk(b"fmt ", layout()), SAMPLES))
    assert_truncations_named(tmp_path / "a.wav", read_file, step=1)


@given(st.data())
def test_no_damage_escapes_as_another_exception(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("damage") / "a.wav"
    path.write_bytes(wav(chunk(b"fmt ", layout()), SAMPLES))
    assert_no_other_exception(path, read_file, lambda *ends: data.draw(st.integers(*ends)))
