"""Damage done to whole files, and what must come of it."""

from __future__ import annotations

import numpy as np
import pytest

from ema.core.errors import RecordingFormatError


def assert_truncations_named(path, read, step=97, end=1):
    """Every shorter file is refused, in four parts, by its name."""
    whole = path.read_bytes()
    for length in [*range(0, len(whole) - end, step), len(whole) - end]:
        path.write_bytes(whole[:length])
        with pytest.raises(RecordingFormatError) as caught:
            read(path)
        assert path.name in caught.value.where
        assert caught.value.found and caught.value.rule and caught.value.remedy
    path.write_bytes(whole)


def assert_no_other_exception(path, read, draw_int, n_bytes=3):
    """With some bytes changed, the file is read to its end or refused."""
    content = bytearray(path.read_bytes())
    for _ in range(n_bytes):
        content[draw_int(0, len(content) - 1)] = draw_int(0, 255)
    path.write_bytes(content)
    try:
        recording = read(path).recording
    except RecordingFormatError:
        return
    with np.errstate(over="ignore"):
        assert recording.block(0, recording.n_samples).shape[1] == recording.n_samples
