"""A look into recordings before anything is done with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ema.io.formats import read_file
from ema.recording import Channel

_PIECE = 1 << 20


@dataclass(frozen=True)
class ChannelSummary:
    """One channel of a file: what it is and how large its signal is, in SI units."""

    file: str
    channel: str
    node: int | None
    quantity: str
    unit: str
    sampling_rate_hz: float
    n_samples: int
    rms: float
    peak: float
    mean: float


def inspect_files(files: Sequence[Path]) -> list[ChannelSummary]:
    """Summarise all channels of some recordings.

    Raises
    ------
    InputError
        If a file cannot be read.
    """
    summaries = []
    for path in files:
        recording = read_file(path).recording
        if recording is None:
            continue
        rate = recording.sampling_rate_hz
        summaries += [_summary(path, channel, rate) for channel in recording.channels]
    return summaries


def _summary(path: Path, channel: Channel, rate_hz: float) -> ChannelSummary:
    total = squares = peak = 0.0
    for start in range(0, channel.n_samples, _PIECE):
        piece = channel.block(start, min(start + _PIECE, channel.n_samples))
        total += float(piece.sum())
        squares += float(piece @ piece)
        peak = max(peak, float(np.max(np.abs(piece))))
    return ChannelSummary(
        file=path.name,
        channel=channel.name,
        node=channel.node,
        quantity=channel.quantity,
        unit=channel.unit,
        sampling_rate_hz=rate_hz,
        n_samples=channel.n_samples,
        rms=float(np.sqrt(squares / channel.n_samples)),
        peak=peak,
        mean=total / channel.n_samples,
    )
