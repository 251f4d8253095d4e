"""Spikes in a signal, and samples that were lost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from heapq import nlargest

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Run
from ema.core.finding import Check, Finding
from ema.core.recording import DERIVATIVES, FORCE, SENSELESS, UNKNOWN, BlockPlan, Channel, Recording
from ema.signals.excitation import is_steady
from ema.signals.extents import BEYOND_STEADY, CHUNK, Extent, extents_of
from ema.signals.signal_checks import STEADY_CREST, level_findings, signal_findings, summarise
from ema.signals.spectra import Spectra, ratio
from ema.signals.stuck_and_repeated import Stretch

_PIECE = 1 << 16
# An impact may be one sample wide in a recording that is silent but for the noise of a 24-bit
# converter, 1.7e7 steps high; its hits are neither. One sample alone 1e6 times beyond is damage.
_BEYOND_ANY = 1e6
_FEW = 8  # more of them in a steady channel are a pattern, not damage
_JUDGED = (*DERIVATIVES, FORCE, UNKNOWN)  # a voltage may be a trigger: one sample, and nothing else
# … which stand out of their median by this factor. Random vibration stays below 4, a single lost
# sample makes 15 to 2000.
_PEAK = 6.0
_MOST_PLACES = 5
# Fewer pieces have no median to speak of.
_FEWEST_PIECES = 40
# Samples lost, or written twice, that are tried; what repeats for longer is found by itself.
_MOST_LOST = 8
# Putting the samples between has to take this factor off the error, in most sensors. Knocks on the
# structure stay below 1.2, lost samples make 4 to 50.
_EXPLAINED = 2.0
# Responses longer than this, at very high rates, are not convolved.
_LONGEST_RESPONSE = 1 << 15
_LONG_CHUNK = 1 << 15  # transformed at once: it stays near the processor


class FirstLook:
    """A look at all samples of a recording, taken when something that it tells is asked for."""

    def __init__(self, recording: Recording) -> None:
        # Once they were looked at, the samples are let go: who keeps one channel does not keep all.
        self._seen: Sequence[Channel] | _Seen = recording.channels

    def _look(self) -> _Seen:
        seen = self._seen
        if not isinstance(seen, _Seen):
            seen = self._seen = _Seen.of(seen)
        return seen

    def limit(self, number: int) -> float:
        """Limit of a channel by its number in the recording."""
        return self._look().limits[number]

    def findings(self, file: str, recording: Recording) -> list[Finding]:
        """Impossible samples and levels of some of the channels; `file` is named in the former."""
        spikes = spike_findings(file, recording.channels)
        return spikes + level_findings(recording, extents=self._look().extents)


def with_limits(recording: Recording, look: FirstLook | None = None) -> Recording:
    """Give the channels that hold impossible samples a limit beyond which samples are missing.

    `look` is the one at this recording, where there is one already.
    """
    look = look or FirstLook(recording)
    channels = [
        replace(channel, limit_of=partial(look.limit, number))
        for number, channel in enumerate(recording.channels)
    ]
    return replace(recording, channels=tuple(channels))


@dataclass(frozen=True)
class _Seen:
    """What a first look shows."""

    extents: dict[str, Extent]  # by the name of the channel
    limits: tuple[float, ...]

    @classmethod
    def of(cls, channels: Sequence[Channel]) -> _Seen:
        """Extents tell that most channels are in order; of others a piece is read at a time."""
        extents = extents_of(channels)
        lonely = [
            _Lonely() if extent.is_even else _lonely(channel)
            for channel, extent in zip(channels, extents, strict=True)
        ]
        names = (channel.name for channel in channels)
        return cls(dict(zip(names, extents, strict=True)), _limits(channels, lonely))


def _limits(channels: Sequence[Channel], lonely: Sequence[_Lonely]) -> tuple[float, ...]:
    if not any(each.highest for each in lonely):
        return (np.inf,) * len(lonely)
    steady = _is_steady(channels, lonely)
    return tuple(
        each.limit(steady=steady and channel.quantity in _JUDGED)
        for channel, each in zip(channels, lonely, strict=True)
    )


def spike_findings(file: str, channels: Sequence[Channel]) -> list[Finding]:
    """Impossible samples of channels that went through `with_limits`; `file` is named in them."""
    concerned = [channel for channel in channels if channel.limit < np.inf]
    found = [signal_findings(summarise(channel), file, channel) for channel in concerned]
    return [one for each in found for one in each if one.check == Check.IMPOSSIBLE_SAMPLES]


@dataclass(frozen=True)
class _Lonely:
    """Samples far beyond both neighbours, and how far all others reach."""

    highest: tuple[float, ...] = ()  # the largest magnitudes, descending; one more than are few
    others: float = 0.0  # largest magnitude of all others
    senseless: bool = False  # whether there are numbers beyond any signal

    def limit(self, *, steady: bool) -> float:
        """Magnitude beyond which samples are impossible; infinite where none is."""
        if self.others > 0:
            beyond = sum(each > BEYOND_STEADY * self.others for each in self.highest)
            if steady and 0 < beyond <= _FEW:
                return BEYOND_STEADY * self.others
            if self.highest and self.highest[0] > _BEYOND_ANY * self.others:
                return _BEYOND_ANY * self.others
        return SENSELESS if self.senseless else np.inf


def _lonely(channel: Channel) -> _Lonely:
    """Look for samples that stand alone, if the peaks leave room for them."""
    if _looks_even(channel):
        return _Lonely()
    found, others, senseless = [0.0], 0.0, False
    for piece in _magnitudes(channel, overlap=1):
        here, beside = piece[1:-1], np.maximum(piece[:-2], piece[2:])
        alone = here > BEYOND_STEADY * beside
        others = max(others, float(np.max(here, where=~alone & (here < SENSELESS), initial=0.0)))
        found = nlargest(_FEW + 1, [*found, *here[alone].tolist()])
        senseless = senseless or bool(np.any(here >= SENSELESS))
    return _Lonely(tuple(each for each in found if each > 0), others, senseless)


def _looks_even(channel: Channel) -> bool:
    """Whether no short stretch has a peak so far above that of another that one may be damage."""
    highest, lowest = 0.0, np.inf
    for piece in _magnitudes(channel):
        whole = piece[: piece.size // CHUNK * CHUNK].reshape(-1, CHUNK).max(axis=1)
        rest = piece[whole.size * CHUNK :].max(initial=0.0)
        highest = max(highest, float(whole.max(initial=rest)))
        lowest = min(lowest, float(whole.min(initial=np.inf)))
    return not highest > BEYOND_STEADY * min(lowest, highest)


def _magnitudes(channel: Channel, overlap: int = 0) -> Iterator[NDArray[np.float64]]:
    """Magnitudes piece by piece, 0 for what is missing, with samples of the pieces beside it.

    What is senseless is cut down to where that begins: nothing computed with it overflows. The
    array is used again for the next piece.
    """
    room = np.empty(min(_PIECE, channel.n_samples) + 2 * overlap)
    for start in range(0, channel.n_samples, _PIECE):
        stop = min(start + _PIECE, channel.n_samples)
        begin, end = max(start - overlap, 0), min(stop + overlap, channel.n_samples)
        piece = room[: stop - start + 2 * overlap]
        inner = piece[begin - start + overlap : end - start + overlap]
        piece[: begin - start + overlap] = piece[end - start + overlap :] = 0.0
        channel.read_raw(begin, inner)
        np.abs(inner, out=inner)
        if not inner.max() < SENSELESS:
            np.minimum(np.nan_to_num(inner, copy=False, posinf=0.0), SENSELESS, out=inner)
        yield piece


def _is_steady(channels: Sequence[Channel], lonely: Sequence[_Lonely]) -> bool:
    """Whether most sensors tell of a steady excitation, lonely samples set aside."""
    verdicts = [
        is_steady(without) and summarise(without).crest_factor < STEADY_CREST
        for without in (
            replace(channel, limit_of=partial(each.limit, steady=True))
            for channel, each in zip(channels, lonely, strict=True)
            if channel.quantity in (*DERIVATIVES, UNKNOWN)
        )
    ]
    return 2 * sum(verdicts) > len(verdicts)


# An impulse response: a tyre has rung out after half a second; a band-limited one begins early.
_RINGING_S, _EARLY = 0.5, 64
# The prediction error is looked at in pieces of this length …
_PIECE_S, _LONGEST_PIECE = 0.05, 256


@dataclass(frozen=True)
class _Joint:
    """First sample behind a joint, and how many seem to miss there (below 0: too many)."""

    sample: int
    lost: int


@dataclass(frozen=True, eq=False)
class _Answer:
    """A sensor, and its impulse response from `_EARLY` samples before the impulse on."""

    sensor: Channel
    force: Channel
    response: NDArray[np.float64]

    def errors(self, n_piece: int) -> Iterator[tuple[int, NDArray[np.float64]]]:
        """Measured minus predicted, in whole pieces with their first sample; not at the ends."""
        chunk = 1 << (4 * self.response.size - 1).bit_length()
        while chunk < _LONG_CHUNK and 8 * chunk <= self.force.n_samples:
            chunk *= 2
        spectrum = np.fft.rfft(self.response, chunk)
        overlap = self.response.size - 1
        before = overlap - _EARLY
        fresh = (chunk - overlap) // n_piece * n_piece
        last = self.force.n_samples - fresh - _EARLY
        for start in (*range(before, last, fresh), last):
            if start < before:
                continue
            force = self.force.block(start - before, start - before + overlap + fresh)
            measured = self.sensor.block(start, start + fresh)
            if np.isfinite(force.sum()) and np.isfinite(measured.sum()):
                answer = np.fft.irfft(np.fft.rfft(force - force.mean(), chunk) * spectrum, chunk)
                yield start, measured - measured.mean() - answer[overlap : overlap + fresh]

    def predicted(self, force: NDArray[np.float64]) -> NDArray[np.float64]:
        """Answer to a piece of force, on all samples that it fully determines."""
        n = force.size + self.response.size
        whole = np.fft.irfft(np.fft.rfft(force, n) * np.fft.rfft(self.response, n), n)
        return np.asarray(whole[self.response.size - 1 : force.size])


def lost_everywhere(run: Run, spectra: Spectra, plan: BlockPlan) -> list[int]:
    """First samples behind joints, where all channels lost samples together or got them twice.

    How many it were cannot be said: numbers near the true one explain most of it too. The force
    must be steady; `spectra` are those of all sensors of the run over its blocks, `plan`.
    """
    usable = np.all(spectra.force > 0, axis=1) & np.any(spectra.response > 0, axis=1)
    rows = np.flatnonzero(usable).tolist()
    late = min(round(_RINGING_S * plan.sampling_rate_hz), plan.block_samples // 2)
    if not rows or not _EARLY < late < _LONGEST_RESPONSE:
        return []

    def answer(row: int) -> _Answer:
        sensor = run.channels[1 + row]
        return _Answer(sensor, run.force, _impulse_response(spectra, row, plan, late))

    n_piece = min(round(_PIECE_S * plan.sampling_rate_hz), _LONGEST_PIECE)
    last = answer(rows[-1])
    places = _places(last, n_piece)
    if not places or not is_steady(run.force):
        return []
    answers = [answer(row) for row in rows]
    joints = []
    for place in places:
        window = Stretch(place - n_piece, place + 3 * n_piece)
        joint = _best_joint(last, window, 2 * n_piece)
        if joint and np.median([_gain(each, window, joint) for each in answers]) > _EXPLAINED:
            joints.append(joint.sample)
    return joints


def _impulse_response(
    spectra: Spectra, row: int, plan: BlockPlan, late: int
) -> NDArray[np.float64]:
    lines = np.zeros(plan.block_samples // 2 + 1, dtype=complex)
    lines[1 : 1 + spectra.cross.shape[1]] = ratio(spectra.cross[row], spectra.force[row])
    response = np.fft.irfft(lines, plan.block_samples)
    return np.concatenate((response[-_EARLY:], response[:late]))


def _places(answer: _Answer, n_piece: int) -> list[int]:
    """Pieces whose error stands out, the worst of each neighbourhood."""
    starts, powers = [np.zeros(0, int)], [np.zeros(0)]
    for start, error in answer.errors(n_piece):
        power = np.mean(error.reshape(-1, n_piece) ** 2, axis=1)
        starts.append(start + n_piece * np.arange(power.size))
        powers.append(power)
    at, power = np.concatenate(starts), np.concatenate(powers)
    if power.size < _FEWEST_PIECES:
        return []
    order = np.argsort(-power)
    order = order[power[order] > _PEAK * np.median(power)]
    places: list[int] = []
    for place in at[order].tolist():
        if all(abs(place - other) > answer.response.size for other in places):
            places.append(place)
    return places if len(places) <= _MOST_PLACES else []


@dataclass(frozen=True, eq=False)
class _Window:
    """What a sensor shows in a window and `_MOST_LOST` samples around, and what makes it do so."""

    measured: NDArray[np.float64]  # the signal, (n + 2 _MOST_LOST,)
    all_of_it: NDArray[np.float64]  # answer to the whole force
    early: NDArray[np.float64]  # answer to the force before the window
    force: NDArray[np.float64]  # within the window, (n,)

    @classmethod
    def of(cls, answer: _Answer, window: Stretch) -> _Window | None:
        """None where the recording does not reach far enough, or lacks samples."""
        begin, end = window.start - _MOST_LOST, window.stop + _MOST_LOST
        first, last = begin - (answer.response.size - 1 - _EARLY), end + _EARLY
        if first < 0 or last > answer.force.n_samples:
            return None
        force, measured = answer.force.block(first, last), answer.sensor.block(first, last)
        if not np.all(np.isfinite(force)) or not np.all(np.isfinite(measured)):
            return None
        force, measured = force - force.mean(), measured - measured.mean()
        before = np.where(np.arange(first, last) < window.start, force, 0.0)
        return cls(
            measured[begin - first : end - first],
            answer.predicted(force),
            answer.predicted(before),
            force[window.start - first : window.stop - first],
        )

    def error(
        self, past: NDArray[np.float64], at: NDArray[np.int_], lost: int
    ) -> NDArray[np.float64]:
        """Error if samples are lost ahead of sample `at` of the window, (n, n_places).

        `past`, (n + 2 _MOST_LOST, n_places), is the answer to the force ahead of each place.
        """
        n, m = self.force.size, _MOST_LOST
        future = self.all_of_it[:, None] - past
        behind = future[m : m + n] + past[m + lost : m + lost + n]
        ahead = past[m : m + n] + future[m - lost : m - lost + n]
        answer = np.where(np.arange(n)[:, None] >= at, behind, ahead)
        return np.asarray(self.measured[m : m + n, None] - answer)

    def past(self, answer: _Answer, n_places: int) -> NDArray[np.float64]:
        """Answer to the force ahead of the first places of the window."""
        size, m = self.force.size, _MOST_LOST
        lag = np.arange(-m, size + m)[:, None] - np.arange(n_places - 1) + _EARLY
        known = (lag >= 0) & (lag < answer.response.size)
        response = np.where(known, answer.response[np.clip(lag, 0, answer.response.size - 1)], 0.0)
        parts = np.cumsum(response * self.force[: n_places - 1], axis=1)
        return np.asarray(self.early[:, None] + np.pad(parts, ((0, 0), (1, 0))))


def _best_joint(answer: _Answer, stretch: Stretch, n_places: int) -> _Joint | None:
    """Joint in the first places of a window that explains most of the error there."""
    window = _Window.of(answer, stretch)
    if window is None:
        return None
    past, at = window.past(answer, n_places), np.arange(n_places)
    tried = [lost for lost in range(-_MOST_LOST, _MOST_LOST + 1) if lost]
    power = np.array([np.sum(window.error(past, at, lost) ** 2, axis=0) for lost in tried])
    number, place = np.unravel_index(np.argmin(power), power.shape)
    return _Joint(stretch.start + int(place), tried[number])


def _gain(answer: _Answer, stretch: Stretch, joint: _Joint) -> float:
    """Factor by which a joint lowers the error of a sensor."""
    window = _Window.of(answer, stretch)
    if window is None:
        return 1.0
    at = np.array([joint.sample - stretch.start])
    past = window.past(answer, int(at[0]) + 1)[:, -1:]
    as_it_is, joined = (np.sum(window.error(past, at, lost) ** 2) for lost in (0, joint.lost))
    return float(as_it_is / max(joined, np.finfo(float).tiny))
