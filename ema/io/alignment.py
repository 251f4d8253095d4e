"""Channels that start at different times, cut to the span that all of them have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ema.core.errors import RecordingFormatError
from ema.core.finding import Check, Finding
from ema.core.recording import Channel
from ema.io.content import EXPORT_AGAIN, note, remark

_SHARE_OF_SAMPLE = 0.02  # by which starts may miss a whole sample: 1.4 degrees of phase at fs/10


def aligned(
    path: Path,
    channels: Sequence[Channel],
    starts_s: Sequence[float],
    rate_hz: float,
    findings: list[Finding],
    lengths: Sequence[int] = (),
    rounding_s: float = 0.0,
) -> tuple[Channel, ...]:
    """Channels cut to the span that all of them have, if they start whole samples apart.

    `rounding_s` is the last printed place of the starts. `RecordingFormatError` if starts differ
    by parts of a sample, are printed too coarsely, or have nothing in common.
    """
    lengths = list(lengths) or [channel.n_samples for channel in channels]
    all_lengths = {*lengths, *(channel.n_samples for channel in channels)}
    if max(starts_s) - min(starts_s) == 0 and len(all_lengths) == 1 and all_lengths != {0}:
        return tuple(channels)
    late = np.array(starts_s) - min(starts_s)
    if late.any():
        late *= _known(path, rate_hz, late.max())
    first, last = (channels[int(place)] for place in (np.argmin(late), np.argmax(late)))
    apart = f"{last.name!r} begins {np.ptp(starts_s):.6g} s after {first.name!r}"
    whole = np.rint(late)
    missed = np.max(np.abs(late - whole))
    if whole.any():
        missed = max(missed, rounding_s * rate_hz)
    if not missed <= _SHARE_OF_SAMPLE:
        rule = "channels must start together, or whole samples apart"
        remedy = "Resample them to one start, or export them again"
        raise RecordingFormatError(path.name, f"{apart}, {late.max():.6g} samples", rule, remedy)
    begin = (whole.max() - whole).astype(int)
    n_samples = min(length - start for length, start in zip(lengths, begin, strict=True))
    if n_samples < 1:
        raise RecordingFormatError(path.name, apart, "they have no time in common", EXPORT_AGAIN)
    if whole.any():
        detail = f"{apart} ({whole.max():.0f} samples): cut to the {n_samples} samples of both"
        findings.append(note(path, Check.START, detail))
    elif len(set(lengths)) > 1:
        detail = f"{max(lengths)} and {n_samples} samples: cut to the shorter"
        findings.append(remark(path, "", Check.START, detail))
    return tuple(
        channel
        if (start, n_samples) == (0, channel.n_samples)
        else replace(channel, samples=channel.samples[start : start + n_samples])
        for channel, start in zip(channels, begin.tolist(), strict=True)
    )


def _known(path: Path, rate_hz: float, late_s: float) -> float:
    """A sampling rate by which starts can be compared."""
    if rate_hz > 0:
        return rate_hz
    found, rule = f"channels begin up to {late_s:.6g} s apart", "their sampling rate must be known"
    remedy = "State it in the file, as in 'Sampling rate: 2048 Hz'"
    raise RecordingFormatError(path.name, found, rule, remedy)
