"""Extreme samples of all channels in one pass, however they are stored."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.files import mapped, read_rows, side_by_side
from ema.core.recording import ACCELERATION, FORCE, SENSELESS, Channel, Recording
from ema.signals.extents import BEYOND_STEADY, CHUNK, extents_of
from ema.signals.signal_checks import level_findings

LONG = (1 << 17) + 300  # several pieces, and a rest


def channels_of(columns, scale=1.0):
    return [Channel(f"A{k}", FORCE, "N", each, scale_to_si=scale) for k, each in enumerate(columns)]


def noise(n_samples, dtype="f8"):
    numbers = 1000 * np.random.default_rng(4).normal(size=(n_samples, 5))
    return np.round(numbers).astype(dtype)


def on_disk(tmp_path, rows):
    path = tmp_path / f"{rows.shape}.bin"
    path.write_bytes(b"head of 12 b" + rows.tobytes())
    return np.asarray(mapped(path, rows.dtype, 12, rows.shape))


def in_memory(_, rows):
    return rows


@pytest.mark.parametrize("dtype", ["<f8", ">f8", "<f4", "<i2", ">i4"])
@pytest.mark.parametrize("n_samples", [1, 200, 4096, 5000, LONG])
@pytest.mark.parametrize("stored", [on_disk, in_memory])
@pytest.mark.parametrize("scale", [1.0, -0.01])
def test_extremes_are_those_of_all_samples(tmp_path, dtype, n_samples, stored, scale):
    rows = noise(n_samples, dtype)
    together = stored(tmp_path, rows)
    some = [together[:, 3], together[:, 1], together[:, 2]]  # out of turn, with others beside
    apart = stored(tmp_path, np.ascontiguousarray(rows.T))
    for columns in (list(together.T), some, list(apart), [apart[0, ::2]]):
        channels = channels_of(columns, scale)
        for channel, found in zip(channels, extents_of(channels), strict=True):
            expected = channel.block(0, n_samples)
            np.testing.assert_allclose(found.lowest, expected.min(), rtol=1e-12)
            np.testing.assert_allclose(found.highest, expected.max(), rtol=1e-12)
            assert found.is_even


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 2 * SENSELESS, -2 * SENSELESS])
@pytest.mark.parametrize("at", [0, 70_000, LONG - 1])
@pytest.mark.parametrize("n_samples", [300, LONG])
def test_what_is_senseless_is_not_known(value, at, n_samples):
    rows = noise(n_samples)
    rows[min(at, n_samples - 1), 2] = value
    found = extents_of(channels_of(rows.T))
    assert [each.is_known for each in found] == [True, True, False, True, True]
    assert [each.is_even for each in found] == [True, True, False, True, True]
    assert not found[2].size < SENSELESS


@given(data=st.data())
def test_what_is_even_has_no_chunk_far_below_another(data):
    """The peaks of chunks are only looked at in part: a few more may need a second look."""
    n_chunks = data.draw(st.integers(1, 6))
    peaks = data.draw(st.lists(st.sampled_from([0.0, 1.0, 29.0, 31.0, 900.0]), min_size=n_chunks))
    places = np.arange(n_chunks) * CHUNK + data.draw(st.integers(0, CHUNK - 1))
    samples = np.zeros(n_chunks * CHUNK)
    samples[places] = peaks[:n_chunks]
    (found,) = extents_of(channels_of([samples]))
    chunks = samples.reshape(-1, CHUNK).max(axis=1)
    assert not found.is_even or samples.max() <= BEYOND_STEADY * chunks.min()


def test_one_spike_is_not_even():
    rows = noise(LONG)
    rows[50_001, 3] = 1e9
    assert [each.is_even for each in extents_of(channels_of(rows.T))] == [True] * 3 + [False, True]


def test_channels_side_by_side_are_one_matrix(tmp_path):
    rows = on_disk(tmp_path, noise(100, "<f4"))
    ((places, columns),) = side_by_side([rows[:, k] for k in (2, 0, 1)])
    assert places == [1, 2, 0]
    room = np.empty((10, 3), "<f4")
    found = read_rows(columns, 30, room)
    assert found is room
    np.testing.assert_array_equal(found, rows[30:40, :3])
    of_memory = [np.zeros(9), np.zeros(9)]
    assert [places for places, _ in side_by_side([*rows.T, *of_memory])].count([5]) == 1


def test_extremes_do_not_hide_a_level_that_makes_no_sense():
    """Neither of a signal that is strong in one sample, nor of samples that are set aside."""
    weak = 1e-5 * noise(9000)[:, 0] / 1000
    spiky = np.where(np.arange(9000) == 4000, 500.0, weak)
    for samples, limit, expected in ((weak, np.inf, 1), (spiky, np.inf, 0), (spiky, 1.0, 1)):
        (channel,) = channels_of([samples])
        channel = replace(channel, quantity=ACCELERATION, limit_of=partial(float, limit))
        recording = Recording(Path("a.uff"), 2000.0, (channel,))
        known = dict(zip(recording.names, extents_of(recording.channels), strict=True))
        found = level_findings(recording, extents=known)
        assert len(found) == len(level_findings(recording)) == expected
