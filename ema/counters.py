"""Columns that count the samples, and what they say about samples lost or written twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.recording import Channel, Run
from ema.stored import piece
from ema.stuck import Stretch

# A ramp of whole numbers so long at the start is a counter …
_FIRST = 64
# … if it keeps its steps nearly everywhere.
_USUAL = 0.99
# Registers that counters live in, and begin anew where these are full.
_REGISTER_BITS = (8, 12, 16, 24, 32)
_PIECE = 1 << 18


@dataclass(frozen=True)
class Jump:
    """Where a counter leaves its steps.

    Parameters
    ----------
    channel : str
        Name of the counter.
    wrong : Stretch
        Samples that the counter has counted before, or the one behind a gap.
    lost : int
        Samples that are not there; 0 where it jumps back.
    before, after : int
        What it counts on either side.
    """

    channel: str
    wrong: Stretch
    lost: int
    before: int
    after: int


def counter_jumps(run: Run) -> list[Jump]:
    """Gaps and repetitions that a counter among the channels that have no role tells of.

    Parameters
    ----------
    run : Run
    """
    used = {channel.name for channel in run.channels}
    spare = [channel for channel in run.recording.channels if channel.name not in used]
    return [jump for channel in spare if _step(channel) for jump in _jumps(channel)]


def _step(channel: Channel) -> float:
    """Step of a channel that begins as a counter does; 0 for any other."""
    first = piece(channel.samples, 0, _FIRST).astype(np.float64)
    if first.size < _FIRST or not np.all(np.isfinite(first)) or np.any(first % 1):
        return 0.0
    steps = np.diff(first)
    step = float(np.median(steps))
    return step if step > 0 and np.mean(steps == step) > 0.9 else 0.0


def _jumps(channel: Channel) -> list[Jump]:
    step, n = _step(channel), channel.n_samples
    places: list[NDArray[np.int_]] = []
    for start in range(0, n - 1, _PIECE):
        samples = piece(channel.samples, start, min(start + _PIECE + 1, n)).astype(np.float64)
        places.append(start + 1 + np.flatnonzero(_is_jump(samples[:-1], samples[1:], step)))
    found = np.concatenate(places)
    if found.size > (1 - _USUAL) * n:
        return []
    jumps = [_jump(channel, int(place), step) for place in found]
    anew = {(jump.before, jump.after) for jump in jumps}
    return [] if len(jumps) > 1 and len(anew) == 1 else jumps  # an angle: it begins anew each turn


def _is_jump(
    before: NDArray[np.float64], after: NDArray[np.float64], step: float
) -> NDArray[np.bool_]:
    jump = after - before != step
    for bits in _REGISTER_BITS:
        jump &= after - before != step - 2.0**bits
    return np.asarray(jump)


def _jump(channel: Channel, place: int, step: float) -> Jump:
    before, after = piece(channel.samples, place - 1, place + 1).astype(np.float64).tolist()
    if not np.isfinite(after - before):
        return Jump(channel.name, Stretch(place, place + 1), 0, 0, 0)
    back = round((before - after) / step) + 1
    wrong = Stretch(place, min(place + max(back, 1), channel.n_samples))
    return Jump(channel.name, wrong, max(-back, 0), int(before), int(after))
