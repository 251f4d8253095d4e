"""Block plans: block length, window, overlap and number of averages."""

from __future__ import annotations

from ema.core.block_plan import BlockPlan
from ema.core.campaign import Processing
from ema.core.errors import InputError

DEFAULT_WINDOW = "hann"
# Tyre modes have decayed after 0.3 s: longer blocks only cost averages.
LONGEST_DEFAULT_BLOCK_S = 4.0
# A short recording is still cut into this many lengths, so that coherence means something.
FEWEST_DEFAULT_LENGTHS = 4
# What repeats sooner is a tone or its harmonics: between its lines, 4 Hz apart, nothing is excited.
SHORTEST_PERIOD_S = 0.25


def plan_blocks(
    n_samples: int,
    sampling_rate_hz: float,
    processing: Processing,
    place: str,
    *,
    steady: bool = True,
    period_samples: int = 0,
) -> BlockPlan:
    """Cut a recording into blocks as asked for, or as suits a tyre.

    By default Hann windows overlap by half over blocks of 4 s, or a quarter of a shorter recording;
    a sweep, burst or impact (a force that is not `steady`) stays one block without a window, and a
    force that repeats after `period_samples` (0 for one that does not) gets blocks of one period
    without a window. The paper's setting is ``averages=10, window="boxcar"``.

    `InputError`, which names `place`, if the blocks asked for do not fit the recording.
    """
    chosen = processing.averages is not None or processing.block_seconds is not None
    whole = not (steady or chosen or period_samples)
    asked = round((processing.block_seconds or 0) * sampling_rate_hz)
    one_period = period_samples > 0 and (not chosen or asked == period_samples)
    window = processing.window or ("boxcar" if whole or one_period else DEFAULT_WINDOW)
    overlap = processing.overlap
    if overlap is None:
        overlap = 0.0 if window == "boxcar" else 0.5
    duration_s = n_samples / sampling_rate_hz
    block_s = _block_seconds(duration_s, processing, overlap, whole)
    if period_samples and not chosen:
        block_s = period_samples / sampling_rate_hz
    block = int(block_s * sampling_rate_hz * (1 + 1e-9))
    if not 8 <= block <= n_samples:
        raise InputError(
            place,
            f"blocks of {block_s:g} s in a recording of {duration_s:g} s",
            "a block needs at least 8 samples and must not be longer than the recording",
            "Choose other averages or block_seconds",
        )
    # Rounded down, so that the last of the averages asked for still fits.
    step = max(int(block * (1 - overlap) * (1 + 1e-9)), 1)
    n_blocks = 1 + (n_samples - block) // step
    return BlockPlan(sampling_rate_hz, block, step, n_blocks, window, period_samples)


def _block_seconds(duration_s: float, processing: Processing, overlap: float, whole: bool) -> float:
    if processing.averages is not None:
        lengths = 1 + (processing.averages - 1) * (1 - overlap)
        return duration_s / lengths if lengths > 0 else 0.0
    if processing.block_seconds is not None:
        return processing.block_seconds
    if whole:
        return duration_s
    return min(LONGEST_DEFAULT_BLOCK_S, duration_s / FEWEST_DEFAULT_LENGTHS)
