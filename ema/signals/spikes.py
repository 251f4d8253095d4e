"""Detection of impossible samples: single values far beyond all others, e.g. from flipped bits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from heapq import nlargest

import numpy as np
from numpy.typing import NDArray

from ema.core.finding import Check, Finding
from ema.core.recording import DERIVATIVES, FORCE, SENSELESS, UNKNOWN, Channel, Recording
from ema.signals.excitation import is_steady
from ema.signals.signal_checks import STEADY_CREST, signal_findings, summarise

_PIECE, _CHUNK = 1 << 16, 1 << 8
# Noise stays within 6 rms, and what a structure answers rings on: in a steady recording a single
# sample this many times beyond its neighbours and everything else is no signal. A flipped exponent
# bit multiplies by 16 (which harms nothing), 256, 65 536, …
_BEYOND_STEADY = 30.0
# An impact may be one sample wide in a recording that is silent but for the noise of a 24-bit
# converter, 1.7e7 steps high; its hits are neither. One sample alone 1e6 times beyond is damage.
_BEYOND_ANY = 1e6
_FEW = 8  # more of them in a steady channel are a pattern, not damage
_JUDGED = (*DERIVATIVES, FORCE, UNKNOWN)  # a voltage may be a trigger: one sample, and nothing else


def with_limits(recording: Recording) -> Recording:
    """Give the channels that hold impossible samples a limit beyond which samples are missing.

    A piece of one channel is in memory at a time.
    """
    lonely = [_lonely(channel) for channel in recording.channels]
    if not any(each.highest for each in lonely):
        return recording
    steady = _is_steady(recording.channels, lonely)
    channels = [
        replace(channel, limit=each.limit(steady=steady and channel.quantity in _JUDGED))
        for channel, each in zip(recording.channels, lonely, strict=True)
    ]
    return replace(recording, channels=tuple(channels))


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
            beyond = sum(each > _BEYOND_STEADY * self.others for each in self.highest)
            if steady and 0 < beyond <= _FEW:
                return _BEYOND_STEADY * self.others
            if self.highest and self.highest[0] > _BEYOND_ANY * self.others:
                return _BEYOND_ANY * self.others
        return SENSELESS if self.senseless else np.inf


def _lonely(channel: Channel) -> _Lonely:
    """Look for samples that stand alone; most channels need a glance at their peaks only."""
    if _looks_even(channel):
        return _Lonely()
    found, others, senseless = [0.0], 0.0, False
    for piece in _magnitudes(channel, overlap=1):
        here, beside = piece[1:-1], np.maximum(piece[:-2], piece[2:])
        alone = here > _BEYOND_STEADY * beside
        others = max(others, float(np.max(here, where=~alone & (here < SENSELESS), initial=0.0)))
        found = nlargest(_FEW + 1, [*found, *here[alone].tolist()])
        senseless = senseless or bool(np.any(here >= SENSELESS))
    return _Lonely(tuple(each for each in found if each > 0), others, senseless)


def _looks_even(channel: Channel) -> bool:
    """Whether no short stretch has a peak so far above that of another that one may be damage."""
    highest, lowest = 0.0, np.inf
    for piece in _magnitudes(channel):
        whole = piece[: piece.size // _CHUNK * _CHUNK].reshape(-1, _CHUNK).max(axis=1)
        rest = piece[whole.size * _CHUNK :].max(initial=0.0)
        highest = max(highest, float(whole.max(initial=rest)))
        lowest = min(lowest, float(whole.min(initial=np.inf)))
    return not highest > _BEYOND_STEADY * min(lowest, highest)


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
            replace(channel, limit=each.limit(steady=True))
            for channel, each in zip(channels, lonely, strict=True)
            if channel.quantity in (*DERIVATIVES, UNKNOWN)
        )
    ]
    return 2 * sum(verdicts) > len(verdicts)
