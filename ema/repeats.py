"""Stretches of a recording that occur twice: a block written again, a file appended to itself.

No two seconds of a measurement are alike to the last bit: its noise sees to that. What repeats
without noise, as a computed force or a whole virtual campaign may, repeats throughout.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.recording import Channel, Run
from ema.stored import piece
from ema.stuck import Stretch

# Samples that make a word, and the share of words that is kept: of a stretch of 64 samples, eight.
_WORD = 4
_KEPT_BITS = 3
# Beyond these, only half as many words are kept each time: memory does not grow with length.
_MOST_WORDS = 1 << 17
# So many equal words in a row, and so many equal samples of all channels, are no chance.
_FEWEST_WORDS, _SHORTEST = 4, 64
_MOST_LAGS = 8
# Words this many usual distances apart belong to different stretches.
_APART = 16
# Samples that agree elsewhere at the same lag. Noise in steps of an eighth of its rms agrees in
# 3.5 %; a signal that repeats by nature, or rests, in most.
_ELSEWHERE = 0.1
# Share of the samples in a stretch that have to differ from the one before: silence repeats too.
_LIVELY = 0.5
_PIECE = 1 << 16
_MIX = np.array(
    [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], np.uint64
)


@dataclass(frozen=True)
class Repeat:
    """Samples of `copy` equal those `lag` samples before them, in all channels or one.

    Parameters
    ----------
    copy : Stretch
    lag : int
    of : Channel or None
        The one channel that repeats; None where all do.
    throughout : bool
        Whether the recording consists of nothing else, from the sample `lag` on.
    """

    copy: Stretch
    lag: int
    of: Channel | None
    throughout: bool


def repeated_stretches(run: Run) -> list[Repeat]:
    """Find stretches that occur twice in all channels that move, or in the force alone.

    Words of a few samples, chosen by their content, are looked for in one sensor and in the force;
    where enough of them come again after the same time, samples are compared one by one.

    Parameters
    ----------
    run : Run
    """
    sensors = [channel for channel in run.channels[1:] if _moves(channel)]
    if not sensors or not _moves(run.force):
        return []
    found = [
        _repeat(sensors[0], copy, lag, None)
        for copy, lag in _copies(sensors[0])
        if _is_lively(run.force, copy)
        and not _is_steady_state(run.force, copy, lag)
        and all(_agreement(each, copy, lag) == 1 for each in (run.force, *sensors[1:]))
    ]
    known = {repeat.lag for repeat in found}
    alone = [(copy, lag) for copy, lag in _copies(run.force) if lag not in known]
    if len(alone) == 1 and _is_force_alone(run.force, sensors, *alone[0]):
        found.append(_repeat(run.force, *alone[0], run.force))
    return found


def _repeat(channel: Channel, copy: Stretch, lag: int, of: Channel | None) -> Repeat:
    return Repeat(copy, lag, of, len(copy) == channel.n_samples - lag)


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
    count = 0
    for start in range(stretch.start, stretch.stop, _PIECE):
        part = Stretch(start, min(start + _PIECE, stretch.stop))
        count += int(np.count_nonzero(_same(channel, part, lag)))
    return count / max(len(stretch), 1)


def _same(channel: Channel, stretch: Stretch, lag: int) -> NDArray[np.bool_]:
    late = piece(channel.samples, stretch.start, stretch.stop)
    early = piece(channel.samples, stretch.start - lag, stretch.stop - lag)
    return np.asarray(late == early)
