"""Channels that hold one value while the structure moves on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.recording import Channel, Run
from ema.stored import piece

# A hold is looked for from here on: at 2 kHz a tyre's lowest modes turn many times meanwhile.
_SHORTEST_S, _SHORTEST_SAMPLES = 0.1, 100
# What a tyre has long stopped ringing after: a force may well be zero between impacts and bursts.
_RUNG_OUT_S = 0.25
# Looked at are four samples in the shortest hold: a fiftieth of the recording at 2 kHz.
_LOOKS = 4
# With more holds than these the signal is coarse, or slower than its rate: every top is flat.
_MOST_HOLDS = 64
_SENSELESS = 1e30  # no sensor gives such a number, in whatever unit
# A signal of fewer steps than these in its rms lies flat by itself.
_FEWEST_STEPS = 8.0
# The others go on: their rms in the hold over that of the whole recording. Random vibration of a
# tyre stays above 0.6 in 0.1 s; what rings out is below 0.1 after 0.25 s.
_GO_ON = 0.5
# Rest is where a signal lies without motion: its median, within these shares of its rms.
_FORCE_AT_REST, _SENSOR_AT_REST = 0.1, 0.5
_PIECE = 1 << 16


@dataclass(frozen=True)
class Stretch:
    """Samples `start` to `stop` (exclusive) of a recording."""

    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


@dataclass(frozen=True)
class _Hold(Stretch):
    """A stretch of one value, in stored units."""

    value: float


@dataclass(frozen=True, eq=False)
class _Look:
    """A channel as one sample in many shows it, in stored units."""

    channel: Channel
    middle: float
    rms: float
    holds: tuple[_Hold, ...]

    @property
    def is_alive(self) -> bool:
        """Whether it moves at all."""
        return self.rms > 0

    def at_rest(self, hold: _Hold, share: float) -> bool:
        """Whether a hold lies where the signal is without motion."""
        return abs(hold.value - self.middle) <= share * self.rms

    def level(self, stretch: Stretch) -> float:
        """Rms of a stretch about its mean, over that of the whole recording."""
        samples = piece(self.channel.samples, stretch.start, stretch.stop).astype(float)
        return float(np.std(samples) / self.rms) if np.all(np.isfinite(samples)) else 0.0


def stuck_stretches(run: Run) -> list[tuple[Channel, Stretch]]:
    """Where a channel of a run is stuck while the others go on, or all of them at once.

    A force that rests between impacts or bursts is not stuck, nor a sensor at rest with all
    others. Memory is that of one channel, one sample in many.

    Parameters
    ----------
    run : Run

    Returns
    -------
    list of (Channel, Stretch)
        In the order of the channels; the same stretch for every channel that is concerned.
    """
    shortest = max(_SHORTEST_SAMPLES, round(_SHORTEST_S * run.recording.sampling_rate_hz))
    rung_out = max(shortest, round(_RUNG_OUT_S * run.recording.sampling_rate_hz))
    force, *sensors = (_look(channel, shortest) for channel in run.channels)
    alive = [sensor for sensor in sensors if sensor.is_alive]
    if not any(look.holds for look in (force, *sensors)):
        return []
    stuck = [(force, hold) for hold in _stuck_force(force, alive, rung_out)]
    for sensor in alive:
        others = [other for other in alive if other is not sensor]
        stuck += [(sensor, hold) for hold in sensor.holds if _is_stuck(sensor, hold, others, force)]
    frozen = _frozen([look for look in (force, *alive) if look.is_alive])
    return [(look.channel, Stretch(hold.start, hold.stop)) for look, hold in (*stuck, *frozen)]


def _stuck_force(force: _Look, sensors: Sequence[_Look], rung_out: int) -> list[_Hold]:
    """Holds of the force after which the structure should have come to rest, and has not."""
    resting = [hold for hold in force.holds if force.at_rest(hold, _FORCE_AT_REST)]
    found = []
    for hold in force.holds:
        at_end = hold.start == 0 or hold.stop == force.channel.n_samples
        paused = hold in resting and (len(resting) > 1 or at_end)
        late = Stretch(hold.stop - len(hold) // 2, hold.stop)
        if len(hold) >= rung_out and not paused and _go_on(sensors, late):
            found.append(hold)
    return found


def _is_stuck(sensor: _Look, hold: _Hold, others: Sequence[_Look], force: _Look) -> bool:
    if others:
        return _go_on(others, hold)
    # A sensor alone: a sweep may drive it too little to be seen, but not away from rest.
    return not sensor.at_rest(hold, _SENSOR_AT_REST) and _go_on([force], hold)


def _go_on(looks: Sequence[_Look], stretch: Stretch) -> bool:
    """Whether most channels move in a stretch as they do elsewhere."""
    levels = [look.level(stretch) for look in looks if look.is_alive]
    return bool(levels) and float(np.median(levels)) >= _GO_ON


def _frozen(looks: Sequence[_Look]) -> list[tuple[_Look, _Hold]]:
    """Holds of all channels at once, most of them away from rest: the recorder stood still."""
    found: list[tuple[_Look, _Hold]] = []
    for first in looks[0].holds if looks else ():
        middle = (first.start + first.stop) // 2
        here = [
            next((hold for hold in look.holds if hold.start <= middle < hold.stop), None)
            for look in looks
        ]
        held = [(look, hold) for look, hold in zip(looks, here, strict=True) if hold is not None]
        away = [not look.at_rest(hold, _SENSOR_AT_REST) for look, hold in held]
        if len(held) == len(looks) and np.mean(away) > 0.5:
            found += held
    return found


def _look(channel: Channel, shortest: int) -> _Look:
    stride = max(shortest // _LOOKS, 1)
    seen = _every(channel.samples, stride)
    known = seen[np.isfinite(seen)].astype(float)
    known = known[np.abs(known) < _SENSELESS]  # a flipped bit is no sign of life, and overflows
    if not known.size:
        return _Look(channel, 0.0, 0.0, ())
    rms = float(np.std(known))
    found = _holds(channel, seen, stride, shortest) if rms > 0 else ()
    if found and _FEWEST_STEPS * np.min(np.diff(np.unique(known))) > rms:
        found = ()
    return _Look(channel, float(np.median(known)), rms, found)


def _every(samples: NDArray[np.generic], stride: int) -> NDArray[np.generic]:
    """One sample in `stride`, read piece by piece."""
    n = len(samples)
    return np.concatenate(
        [
            np.array(piece(samples, start, min(start + _PIECE, n))[-start % stride :: stride])
            for start in range(0, n, _PIECE)
        ]
    )


def _holds(
    channel: Channel, seen: NDArray[np.generic], stride: int, shortest: int
) -> tuple[_Hold, ...]:
    """Runs of one value that are long enough; none of a signal where these are common."""
    same = np.r_[False, (seen[1:] == seen[:-1]) & np.isfinite(seen[1:]), False]
    begins, ends = np.flatnonzero(np.diff(same)).reshape(-1, 2).T
    long = ends - begins >= _LOOKS - 1
    if np.count_nonzero(long) > _MOST_HOLDS:
        return ()
    found = []
    for begin, end in zip(begins[long].tolist(), ends[long].tolist(), strict=True):
        start = max((begin - 1) * stride, 0)
        near = piece(channel.samples, start, min((end + 1) * stride, channel.n_samples))
        value = seen[begin + 1]
        held = np.r_[False, near == value, False]
        edges = np.flatnonzero(np.diff(held)).reshape(-1, 2)
        first, last = edges[np.argmax(edges[:, 1] - edges[:, 0])].tolist()
        if last - first >= shortest:
            found.append(_Hold(start + first, start + last, float(value)))
    return tuple(found)
