"""Hits and bursts in a recording: blocks that start before each, overloads and double hits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Run
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import BlockPlan, Channel, ExponentialWindow

# The force is looked at in pieces of this length: a hit has 1 to 10 ms.
_PIECE_S = 0.005
# It acts where a piece exceeds this share of the largest peak (hits by hand differ by 20 dB) …
_ACTS = 0.03
# … and this many times what the quietest fifth of the pieces stay below.
_ABOVE_QUIET, _QUIET = 5.0, 0.2
# Samples that tell what the force rests at to a two-hundredth of its noise.
_ENOUGH = 1 << 16
# The force rests for this long between two events. A bounce comes after 0.1 s at most; a tyre has
# rung out after half a second.
_REST_S = 0.3
# What is longer is a burst, and does not bounce.
_LONGEST_HIT_S = 0.25
# A further pulse of a hit: share of its peak, and how long the force is below it before.
_BOUNCE, _BETWEEN_S = 0.05, 0.004
_PRETRIGGER_S = 0.02
_LONGEST_BLOCK_S = 4.0
# Distances below this share of the median do not decide on the length of all blocks.
_USUAL_DISTANCE = 0.6
# Share of the mean square that the last tenth of a block may have, −13 dB, or −7 dB of noise: what
# rings has more in the tenth before, where it falls to so little by 22 % per tenth.
_RUNG_OUT, _LAST, _SENSORS = 0.05, 0.1, 6
_NOISY, _EVEN = 0.2, 0.9
# Two samples on the extreme of a hit are an overload if there are so many levels that this is no
# chance; three, unless the top is round: it leaves by fewer steps, or has fewer levels (as of
# `clipping_and_hum`).
_FINE_LEVELS, _FEWEST_LEVELS, _STEEP_STEPS = 4096, 64, 5.0
_ONE_SIDED = 0.2  # of the span of a hit: smaller extremes are not looked at
# A sensor overloaded in more hits than this has the wrong range: the sensor is judged, not hits.
_FEW_HITS = 1 / 3
_FEWEST = 2  # events of a run that give a coherence
# The end of a block, where little but noise is left, in pieces; what falls over the last four of
# them more slowly than by this share of a window's rate has not seen it. A noise of fewer steps of
# the converter is rounding, after any window.
_END, _PIECES, _LAST_PIECES, _SLOWER, _STEPS = 0.6, 6, 4, 0.75, 3.0
# Without a window it falls by up to 0.05 (log) over those pieces; a window that is not declared
# has to show by more, at the same rate within this share in all runs. Only so many hits tell.
_FALLS, _SAME_RATE, _HITS_FOR_NOISE = 0.15, 0.3, 4
_LEAST_NOISE = 1e-7  # of a response; below, a simulation without noise and rounding are seen


@dataclass(frozen=True)
class Event:
    """One hit or burst: first sample, the one behind its last, and samples of its pulses."""

    start: int
    stop: int
    pulses: tuple[int, ...] = ()

    @property
    def bounces(self) -> bool:
        """Whether it is a hit with more than one pulse."""
        return len(self.pulses) > 1


def find_events(force: Channel, rate_hz: float) -> tuple[Event, ...]:
    """Hits or bursts of a force, with rests between them; none for a force that goes on."""
    samples = force.block(0, force.n_samples)
    length = max(round(_PIECE_S * rate_hz), 1)
    n_pieces = samples.size // length
    if n_pieces < 2 or not np.isfinite(samples.sum()):
        return ()
    starts, whole = np.arange(0, n_pieces * length, length), samples[: n_pieces * length]
    high, low = (of.reduceat(whole, starts) for of in (np.maximum, np.minimum))
    middle = _ordered(samples[:: samples.size // _ENOUGH + 1], 0.5)
    peak = np.maximum(high - middle, middle - low)
    limit = max(_ACTS * peak.max(), _ABOVE_QUIET * _ordered(peak, _QUIET))
    acts = np.flatnonzero(peak > limit)
    if not acts.size:
        return ()
    rests = np.flatnonzero(np.diff(acts) * length > _REST_S * rate_hz)
    first, last = acts[np.r_[0, rests + 1]], acts[np.r_[rests, acts.size - 1]]
    bounds = zip((first * length).tolist(), ((last + 1) * length).tolist(), strict=True)
    return tuple(_event(samples[i:k] - middle, i, k, rate_hz) for i, k in bounds)


def _ordered(values: NDArray[np.float64], share: float) -> float:
    """The value that this share of them lies below; a true quantile takes five times as long."""
    place = int(share * values.size)
    return float(np.partition(values, place)[place])


def _event(part: NDArray[np.float64], start: int, stop: int, rate_hz: float) -> Event:
    """The hit or burst of a part of the force, which is 0 at rest."""
    if stop - start > _LONGEST_HIT_S * rate_hz:
        return Event(start, stop)
    part = part * np.sign(part[np.argmax(np.abs(part))])  # a hammer only pushes
    above = np.flatnonzero(part > _BOUNCE * part.max())
    begins = np.r_[True, np.diff(above) > max(_BETWEEN_S * rate_hz, 1)]
    return Event(start, stop, tuple((start + above[begins]).tolist()))


def event_plans(
    runs: Sequence[Run], events: Mapping[str, Sequence[Event]], plan: BlockPlan
) -> tuple[dict[str, BlockPlan], tuple[Finding, ...]] | None:
    """Blocks of each run that start before its events, and what was found; None where unsuitable.

    All blocks are of one length, up to the next event. Each run needs two events, and responses
    that have rung out at the end of the blocks; `plan` gives what blocks have in common.
    """
    rate = plan.sampling_rate_hz
    early = round(_PRETRIGGER_S * rate)
    ahead = {
        run.name: [event for event in events[run.name] if event.start >= early] for run in runs
    }
    if min(map(len, ahead.values())) < _FEWEST:
        return None
    room = {run.name: _room(ahead[run.name], run.recording.n_samples, early) for run in runs}
    distances = np.concatenate(list(room.values()))
    longest = max(event.stop - event.start for each in ahead.values() for event in each)
    least = max(_USUAL_DISTANCE * np.median(distances), longest + early + _REST_S * rate)
    if not np.any(distances >= least):
        return None
    most = max(round(_LONGEST_BLOCK_S * rate), 2 * longest)
    length = min(int(distances[distances >= least].min()), most)
    plans, findings = {}, []
    for run in runs:
        kept = [e for e, d in zip(ahead[run.name], room[run.name], strict=True) if d >= length]
        blocks = replace(plan, block_samples=length, step_samples=length, window="boxcar")
        blocks = blocks.at([event.start - early for event in kept])
        found: Iterator[Finding] = iter(())
        if all(event.pulses for event in kept):  # the peaks of a burst are many, some alike
            blocks, found = _without_overloads(run, blocks)
        if blocks.n_blocks < _FEWEST or not _rings_out(run, blocks):
            return None
        plans[run.name] = blocks
        findings += [*_bounces(run, events[run.name], rate), *found]
    return plans, tuple(findings)


def _room(events: Sequence[Event], n_samples: int, early: int) -> NDArray[np.int_]:
    """Samples from the start of each block to that of the next, or to the end."""
    starts = [event.start - early for event in events]
    return np.diff([*starts, n_samples])


def _rings_out(run: Run, plan: BlockPlan) -> bool:
    """Whether most sensors are quiet at the end of the blocks, or see even noise."""
    sensors = run.channels[1 :: max(len(run.channels) // _SENSORS, 1)]
    last = max(int(_LAST * plan.block_samples), 1)
    left, even = [], []
    for sensor in sensors:
        blocks = [sensor.block(start, start + plan.block_samples) for start in plan.starts]
        power = np.nansum([(block - np.median(block)) ** 2 for block in blocks], axis=0)
        at_end = power[-last:].mean()
        left.append(at_end / max(power.mean(), np.finfo(float).tiny))
        even.append(at_end > _EVEN * power[-2 * last : -last].mean())
    noisy = np.median(left) < _NOISY and np.mean(even) > 0.5
    return bool(np.median(left) < _RUNG_OUT or noisy)


def _without_overloads(run: Run, plan: BlockPlan) -> tuple[BlockPlan, Iterator[Finding]]:
    """Blocks without those in which a channel is overloaded, as long as enough are left."""
    starts, rate = np.array(plan.starts), plan.sampling_rate_hz

    def overloads(channel: Channel) -> NDArray[np.bool_]:
        blocks = (channel.block(start, start + plan.block_samples) for start in starts)
        return np.array([is_overloaded(block) for block in blocks])

    over = {channel.name: overloads(channel) for channel in run.channels}
    few = {
        name: bad
        for name, bad in over.items()
        if bad.any() and (name == run.force.name or bad.mean() <= _FEW_HITS)
    }
    bad = np.any(list(few.values()), axis=0) if few else np.zeros(starts.size, dtype=bool)
    if np.count_nonzero(~bad) < _FEWEST:
        return plan, iter(())
    places = {response.channel.name: response.position_deg for response in run.responses}

    def named(name: str) -> Finding:
        times = ", ".join(f"{(start / rate + _PRETRIGGER_S):.2f} s" for start in starts[few[name]])
        detail = f"overloaded in the hits at {times}; they are left out for all channels of the run"
        return Finding(run.name, name, places.get(name), Check.CLIPPED, Verdict.WARNING, detail)

    return plan.at(starts[~bad].tolist()), map(named, few)


def is_overloaded(samples: NDArray[np.float64]) -> bool:
    """Whether a hit reaches a limit: several samples on its extreme, which it leaves steeply."""
    steps = np.abs(np.diff(samples))
    if not np.any(steps > 0):
        return False
    step = float(steps[steps > 0].min())
    levels = float(np.ptp(samples)) / step
    fewest = 2 if levels >= _FINE_LEVELS else 3
    if not levels >= _FEWEST_LEVELS:
        return False
    about = samples - np.median(samples)
    for signed in (about, -about):
        at = signed == signed.max()
        if signed.max() < _ONE_SIDED * np.ptp(about):  # of a hammer, that is no force
            continue
        flank = steps[at[1:] != at[:-1]]
        if np.count_nonzero(at) >= fewest and flank.size and flank.max() > _STEEP_STEPS * step:
            return True
    return False


def _bounces(run: Run, events: Sequence[Event], rate_hz: float) -> Iterator[Finding]:
    double = [event for event in events if event.bounces]
    if double:
        times = ", ".join(f"{event.start / rate_hz:.2f} s" for event in double)
        detail = f"double hits at {times}: kept, as the force is recorded with both pulses"
        yield Finding(run.name, run.force.name, None, Check.DOUBLE_HITS, Verdict.OK, detail)


def is_one_early_hit(events: Sequence[Event], plan: BlockPlan) -> bool:
    """Whether a recording is one block with one hit, over before the end that is looked at."""
    early = (1 - _END) * plan.block_samples
    return (
        plan.n_blocks == 1
        and len(events) == 1
        and bool(events[0].pulses)
        and events[0].stop < early
    )


def window_findings(
    runs: Sequence[Run],
    plans: Mapping[str, BlockPlan],
    window: ExponentialWindow | None,
    *,
    hits: bool,
) -> tuple[Finding, ...]:
    """Whether a declared exponential window is missing, or one on hits was not declared.

    It lets the noise fall by e^(−t/τ). What still rings after a burst is not told from noise.
    """
    rates = np.array([_decay_per_s(run, plans[run.name]) for run in runs])
    rates = rates[np.isfinite(rates)]
    if not rates.size:
        return ()
    rate, plan = float(np.median(rates)), min(plans.values(), key=lambda each: each.n_blocks)
    detail = ""
    if window is None:
        seen_s = _END * _LAST_PIECES / _PIECES * plan.block_s
        alike = np.all(np.abs(rates - rate) < _SAME_RATE * rate)
        tells = hits and plan.n_blocks >= _HITS_FOR_NOISE
        if tells and rate * seen_s > _FALLS and alike:
            detail = (
                f"the noise after the hits falls by {rate:.2g} per s, as after an exponential "
                f"window of {1 / rate:.2g} s, which is not declared: damping ratios are too high, "
                f"by {rate / (2 * np.pi):.2g} % of critical at 100 Hz. If the analyser applied "
                f"one, state [processing] exponential_window_s = {1 / rate:.2g}"
            )
    elif rate < _SLOWER * window.decay_per_s:  # responses that still ring only fall faster
        detail = (
            f"exponential window of {window.time_constant_s:g} s declared (rate "
            f"{window.decay_per_s:.3g} per s), but the noise at the end of the blocks falls by "
            f"only {rate:.2g} per s: damping ratios are too low. Correct exponential_window_s"
        )
    return (Finding("", "", None, Check.WINDOW, Verdict.WARNING, detail),) if detail else ()


def _decay_per_s(run: Run, plan: BlockPlan) -> float:
    """Rate at which the noise of the sensors falls at the end of the blocks; NaN if unknown."""
    size = int(_END * plan.block_samples) // _PIECES
    force = _spectra_of_hits(run, plan, size)
    levels = []
    for channel in run.channels[1:]:
        ends = (start + plan.block_samples for start in plan.starts)
        blocks = np.array([channel.block(end - _PIECES * size - 2, end) for end in ends])
        moves = np.abs(np.diff(blocks))
        noise = np.diff(blocks, 2).reshape(len(blocks), _PIECES, size)  # rather than modes
        rms = np.sqrt(np.mean(noise**2, axis=(0, 2)))
        if np.all(rms > _STEPS * moves[moves > 0].min(initial=np.inf)):
            level = _noise_level(noise, force)
            first = channel.block(plan.starts[0], plan.starts[0] + plan.block_samples)
            if level.min() > np.log(_LEAST_NOISE * np.abs(first).max(initial=0.0) * size**0.5):
                levels.append(level)
    if not levels:
        return np.nan
    level = np.median(levels, axis=0)[-_LAST_PIECES:]
    time_s = np.arange(_LAST_PIECES) * size / plan.sampling_rate_hz
    return float(-np.polyfit(time_s, level, 1)[0])


def _spectra_of_hits(run: Run, plan: BlockPlan, size: int) -> NDArray[np.complex128]:
    """Spectra of the force of each block on the lines of a piece, (n_blocks, n_lines)."""
    blocks = np.array([run.force.block(at, at + plan.block_samples) for at in plan.starts])
    blocks -= np.median(blocks, axis=1)[:, None]
    missing = -plan.block_samples % size
    pieces = np.pad(blocks, ((0, 0), (0, missing))).reshape(len(blocks), -1, size)
    return np.asarray(np.fft.rfft(pieces.sum(axis=1)))


def _noise_level(pieces: NDArray[np.float64], force: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Log of the noise in each piece of all hits: (n_hits, n_pieces, size) to (n_pieces,).

    What still rings is in proportion to the hits, and on few lines.
    """
    spectra = np.fft.rfft(pieces * np.hanning(pieces.shape[2]))
    if len(spectra) >= _HITS_FOR_NOISE:
        power = np.maximum(np.sum(np.abs(force) ** 2, axis=0), np.finfo(float).tiny)
        shared = np.einsum("hf,hpf->pf", force.conj(), spectra) / power
        spectra = spectra - shared * force[:, None]
    level = np.median(np.mean(np.abs(spectra) ** 2, axis=0), axis=1)
    return np.asarray(0.5 * np.log(np.maximum(level, np.finfo(float).tiny)))
