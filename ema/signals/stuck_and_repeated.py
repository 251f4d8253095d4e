"""Detection of stuck channels and of repeated parts of a recording."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Run
from ema.core.files import piece
from ema.core.recording import SENSELESS, Channel

# A hold is looked for from here on: at 2 kHz a tyre's lowest modes turn many times meanwhile.
_SHORTEST_S, _SHORTEST_SAMPLES = 0.1, 100
# What a tyre has long stopped ringing after: a force may well be zero between impacts and bursts.
_RUNG_OUT_S = 0.25
# Looked at are four samples in the shortest hold: a fiftieth of the recording at 2 kHz.
_LOOKS = 4
# With more holds than these the signal is coarse, or slower than its rate: every top is flat.
_MOST_HOLDS = 64
# A signal of fewer steps than these in its rms lies flat by itself.
_FEWEST_STEPS = 8.0
# The others go on: their rms in the hold over that of the whole recording. Random vibration of a
# tyre stays above 0.6 in 0.1 s; what rings out is below 0.1 after 0.25 s.
_GO_ON = 0.5
# Rest is where a signal lies without motion: its median, within these shares of its rms.
_FORCE_AT_REST, _SENSOR_AT_REST = 0.1, 0.5
_PIECE = 1 << 16
# Samples that make a word, and the share of words that is kept: of a stretch of 64 samples, eight.
_WORD = 4
_KEPT_BITS = 3
# Beyond these, only half as many words are kept each time: memory does not grow with length.
_MOST_WORDS = 1 << 17
_MOST_LAGS = 8
# Words this many usual distances apart belong to different stretches.
_APART = 16
# Samples that agree elsewhere at the same lag. Noise in steps of an eighth of its rms agrees in
# 3.5 %; a signal that repeats by nature, or rests, in most.
_ELSEWHERE = 0.1
# Share of the samples in a stretch that have to differ from the one before: silence repeats too.
_LIVELY = 0.5
_MIX = np.array(
    [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], np.uint64
)


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

    They come in the order of the channels; the same stretch for every channel that is concerned. A
    force that rests between impacts or bursts is not stuck, nor a sensor at rest with all others.
    Memory is that of one channel, one sample in many.
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
    known = known[np.abs(known) < SENSELESS]  # a flipped bit is no sign of life, and overflows
    if not known.size:
        return _Look(channel, 0.0, 0.0, ())
    rms = float(np.std(known))
    found = _holds(channel, seen, stride, shortest) if rms > 0 else ()
    if not found:
        return _Look(channel, 0.0, rms, ())  # nobody asks where its middle is
    levels = np.unique(known)
    coarse = levels.size < 2 or _FEWEST_STEPS * np.min(np.diff(levels)) > rms
    return _Look(channel, float(np.median(known)), rms, () if coarse else found)


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


# So many equal words in a row, and so many equal samples of all channels, are no chance.
_FEWEST_WORDS, _SHORTEST = 4, 64


@dataclass(frozen=True)
class Repeat:
    """Samples of `copy` equal those `lag` samples before them, in all channels or one."""

    copy: Stretch
    lag: int
    of: Channel | None  # the one channel that repeats; None where all do
    throughout: bool  # whether the recording is nothing else, from the sample `lag` on


def repeated_stretches(run: Run) -> list[Repeat]:
    """Find stretches that occur twice in all channels that move, or in the force alone.

    Words of a few samples, chosen by their content, are looked for in one sensor and in the force;
    where enough of them come again after the same time, samples are compared one by one.
    """
    sensors = [channel for channel in run.channels[1:] if _moves(channel)]
    if not sensors or not _moves(run.force):
        return []
    found = [
        Repeat(copy, lag, None, len(copy) == run.force.n_samples - lag)
        for copy, lag in _copies(sensors[0])
        if _is_lively(run.force, copy)
        and not _is_steady_state(run.force, copy, lag)
        and all(_agreement(each, copy, lag) == 1 for each in (run.force, *sensors[1:]))
    ]
    known = {repeat.lag for repeat in found}
    alone = [(copy, lag) for copy, lag in _copies(run.force) if lag not in known]
    if len(alone) == 1 and _is_force_alone(run.force, sensors, *alone[0]):
        found.append(Repeat(*alone[0], run.force, throughout=False))
    return found


def _is_steady_state(force: Channel, copy: Stretch, lag: int) -> bool:
    """Whether a computed answer to a force that repeats has settled: from here on it repeats."""
    before = Stretch(lag, copy.start)
    settled = copy.stop == force.n_samples and len(before) > 0
    return settled and _agreement(force, before, lag) > _ELSEWHERE


def _is_force_alone(force: Channel, sensors: Sequence[Channel], copy: Stretch, lag: int) -> bool:
    """Whether the force repeats amid motion, once, and no sensor with it.

    A sweep or burst that is played again comes out of silence; a force that repeats throughout is
    meant to.
    """
    ends = [place + shift for place in (copy.start, copy.stop) for shift in (0, -lag)]
    around = [
        Stretch(max(end - _SHORTEST, 0), min(end + _SHORTEST, force.n_samples)) for end in ends
    ]
    amid = all(_is_lively(force, stretch) for stretch in around)
    throughout = len(copy) == force.n_samples - lag
    return amid and not throughout and not any(_agreement(s, copy, lag) > 0.5 for s in sensors)


def _moves(channel: Channel) -> bool:
    """Whether most samples of the channel's middle differ from the one before."""
    middle = channel.n_samples // 2
    return _is_lively(channel, Stretch(max(middle - _SHORTEST, 0), middle + _SHORTEST))


def _is_lively(channel: Channel, stretch: Stretch) -> bool:
    samples = piece(channel.samples, stretch.start, stretch.stop)
    return samples.size > 1 and bool(np.mean(samples[1:] != samples[:-1]) >= _LIVELY)


def _copies(channel: Channel) -> list[tuple[Stretch, int]]:
    """Stretches of one channel that occurred before, with the lag, where little else agrees."""
    found = []
    for lag, place in _lags(*_words(channel.samples)):
        copy = _extended(channel, lag, place + lag)
        if len(copy) < _SHORTEST or not _is_lively(channel, copy):
            continue
        rest = channel.n_samples - lag - len(copy)
        ends = (Stretch(lag, copy.start), Stretch(copy.stop, channel.n_samples))
        agree = sum(len(end) * _agreement(channel, end, lag) for end in ends if len(end))
        if agree <= _ELSEWHERE * rest:
            found.append((copy, lag))
    return found


def _words(samples: NDArray[np.generic]) -> tuple[NDArray[np.uint64], NDArray[np.int_]]:
    """Words of a signal that are kept, and where they begin; chosen by content alone."""
    words, places = [np.zeros(0, np.uint64)], [np.zeros(0, int)]
    n, thinned = len(samples), 0
    for start in range(0, n - _WORD + 1, _PIECE):
        word, place = _words_of(piece(samples, start, min(start + _PIECE + _WORD - 1, n)))
        words.append(word)
        places.append(place + start)
        while sum(part.size for part in places) > _MOST_WORDS:
            thinned += 1
            words, places = _thinned(words, places, thinned)
    words, places = _thinned(words, places, thinned)
    return np.concatenate(words), np.concatenate(places)


def _thinned(
    words: list[NDArray[np.uint64]], places: list[NDArray[np.int_]], bits: int
) -> tuple[list[NDArray[np.uint64]], list[NDArray[np.int_]]]:
    """Words that begin with so many zero bits: the same ones wherever they occur."""
    most = np.uint64((1 << (64 - bits)) - 1)
    keep = [part <= most for part in words]
    return (
        [part[which] for part, which in zip(words, keep, strict=True)],
        [part[which] for part, which in zip(places, keep, strict=True)],
    )


def _words_of(part: NDArray[np.generic]) -> tuple[NDArray[np.uint64], NDArray[np.int_]]:
    bits = 8 * part.itemsize if part.itemsize in (4, 8) else 64
    same = part.dtype if 8 * part.itemsize == bits else np.float64
    number = np.ascontiguousarray(part, dtype=same).view(f"u{bits // 8}")
    # One sample chooses, as whole words would take four times as long; silence is left out.
    mixed = number[: 1 - _WORD] * number.dtype.type(int(_MIX[0]) >> (64 - bits) | 1)
    mixed >>= number.dtype.type(bits - _KEPT_BITS)
    place = np.flatnonzero(mixed == 0)
    place = place[number[place] != number[place + 1]]
    word = np.zeros(place.size, np.uint64)
    for behind in range(_WORD):
        word = (word ^ number[place + behind]) * _MIX[behind]
        word ^= word >> np.uint64(32)
    return word * _MIX[0], place


def _lags(words: NDArray[np.uint64], places: NDArray[np.int_]) -> Iterator[tuple[int, int]]:
    """Lags after which several words come again, and the span of their first occurrence."""
    in_order = np.sort(words)
    if np.count_nonzero(in_order[1:] == in_order[:-1]) < _FEWEST_WORDS:
        return
    order = np.argsort(words, kind="stable")
    same = np.flatnonzero(words[order][1:] == words[order][:-1])
    first, lag = places[order[same]], places[order[same + 1]] - places[order[same]]
    values, count = np.unique(lag[lag >= _SHORTEST], return_counts=True)
    often = np.argsort(-count, kind="stable")[:_MOST_LAGS]
    for value, votes in zip(values[often].tolist(), count[often].tolist(), strict=True):
        if votes >= _FEWEST_WORDS:
            yield value, _amid(np.sort(first[lag == value]))


def _amid(places: NDArray[np.int_]) -> int:
    """A place amid the most words that follow each other closely."""
    usual = max(int(np.median(np.diff(places))), 1)
    groups = np.split(places, np.flatnonzero(np.diff(places) > _APART * usual) + 1)
    largest = max(groups, key=len)
    return int(largest[largest.size // 2])


def _extended(channel: Channel, lag: int, place: int) -> Stretch:
    """Samples about a place that equal those `lag` before them."""
    start = stop = place
    while stop < channel.n_samples:
        same = _same(channel, Stretch(stop, min(stop + _PIECE, channel.n_samples)), lag)
        stop += same.size if same.all() else int(np.argmin(same))
        if not same.all():
            break
    while start > lag:
        same = _same(channel, Stretch(max(start - _PIECE, lag), start), lag)[::-1]
        start -= same.size if same.all() else int(np.argmin(same))
        if not same.all():
            break
    return Stretch(start, stop)


def _agreement(channel: Channel, stretch: Stretch, lag: int) -> float:
    """Share of the samples of a stretch that equal those `lag` before them."""
    starts = range(stretch.start, stretch.stop, _PIECE)
    parts = (Stretch(start, min(start + _PIECE, stretch.stop)) for start in starts)
    count = sum(np.count_nonzero(_same(channel, part, lag)) for part in parts)
    return count / max(len(stretch), 1)


def _same(channel: Channel, stretch: Stretch, lag: int) -> NDArray[np.bool_]:
    late = piece(channel.samples, stretch.start, stretch.stop)
    early = piece(channel.samples, stretch.start - lag, stretch.stop - lag)
    return np.asarray(late == early)
