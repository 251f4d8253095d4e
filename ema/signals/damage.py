"""Detection of damaged parts of recordings, which are reported and left out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Run
from ema.core.display import counted
from ema.core.files import piece
from ema.core.finding import Check, Finding, Verdict
from ema.core.recording import BlockPlan, Channel
from ema.signals.spectra import Spectra, part_ends, ratio
from ema.signals.spikes_and_gaps import lost_everywhere
from ema.signals.stuck_and_repeated import Stretch, repeated_stretches, stuck_stretches

# Runs of one campaign are as long as each other within this share; stopped by hand they differ.
SAME_LENGTH = 0.01
_LEFT_OUT = "the averages with it are left out"
# Slips that are one and the same, in samples; the share of the sensors of a run that puts the blame
# on the force, and the fewest that have a majority.
_SAME_SLIP, _MOST_SENSORS, _FEWEST_SENSORS = 0.25, 0.8, 3
_SHOWN = 5  # of one kind in one channel
# Share of a response that its FRF explains below which its blocks are looked at one by one; a block
# with less than this share of the usual gain, and of the power, is lost. Fewer have no usual gain.
_EXPLAINED, _LOST, _FEWEST_BLOCKS = 0.9, 0.5, 4
_EXCITED = 1e-3  # of the strongest block's power: others have no gain
# A ramp of whole numbers so long at the start is a counter …
_FIRST = 64
# … if it keeps its steps nearly everywhere.
_USUAL = 0.99
# Registers that counters live in, and begin anew where these are full.
_REGISTER_BITS = (8, 12, 16, 24, 32)
_PIECE = 1 << 18


@dataclass(frozen=True, eq=False)
class _Damage:
    """Stretches of a run that are wrong, in one channel or (None) in all; texts as in `Finding`."""

    check: Check
    channel: Channel | None
    wrong: tuple[Stretch, ...]
    detail: str


def without_damage(
    runs: Sequence[Run], every: Callable[..., Iterable[Any]] = map
) -> tuple[list[Run], tuple[Finding, ...]]:
    """Runs in which stretches that are stuck or repeated read as missing, and what was found.

    Nothing is changed or guessed: blocks that contain such a stretch are left out like those in
    which samples are missing, for the channel that is concerned, or for all. `every` is a `map`,
    e.g. that of a pool of threads.
    """

    def damage_of(run: Run) -> list[_Damage]:
        others = [other.recording.n_samples for other in runs if other is not run]
        return [*_stuck(run), *_repeated(run, others), *_miscounted(run)]

    found = list(every(damage_of, runs))
    usable = [_left_out(run, damage) for run, damage in zip(runs, found, strict=True)]
    pairs = zip(runs, found, strict=True)
    return usable, tuple(_finding(run, one) for run, damage in pairs for one in damage)


def _finding(run: Run, damage: _Damage) -> Finding:
    channel = damage.channel
    places = {response.channel.name: response.position_deg for response in run.responses}
    name, place = ("", None) if channel is None else (channel.name, places.get(channel.name))
    return Finding(run.name, name, place, damage.check, Verdict.WARNING, damage.detail)


def _left_out(run: Run, damage: Sequence[_Damage]) -> Run:
    """The run, its channels with gaps where they are wrong."""
    if not damage:
        return run

    def with_gaps(channel: Channel) -> Channel:
        wrong = [
            (stretch.start, stretch.stop)
            for one in damage
            if one.channel is None or one.channel.name == channel.name
            for stretch in one.wrong
        ]
        return replace(channel, gaps=(*channel.gaps, *wrong)) if wrong else channel

    return replace(
        run,
        force=with_gaps(run.force),
        responses=tuple(replace(each, channel=with_gaps(each.channel)) for each in run.responses),
        reference=None if run.reference is None else with_gaps(run.reference),
    )


def without_lost_samples(
    run: Run, spectra: Spectra, plan: BlockPlan
) -> tuple[Run, tuple[Finding, ...]]:
    """The run without what does not fit the rest after samples or a sensor were lost, and findings.

    `spectra` are those of all its sensors, the reference sensor last, over its blocks, `plan`.
    """
    joints = lost_everywhere(run, spectra, plan)
    damage = [*_slipped(run, spectra.slip, plan), *_joined(run, joints)]
    damage += _intermittent(run, spectra, plan)
    return _left_out(run, damage), tuple(_finding(run, one) for one in damage)


def _stuck(run: Run) -> Iterator[_Damage]:
    rate_hz = run.recording.sampling_rate_hz
    by_channel: dict[str, list[Stretch]] = {}
    for channel, stretch in stuck_stretches(run):
        by_channel.setdefault(channel.name, []).append(stretch)
    if len(by_channel) >= len(run.channels):  # the recorder stood still
        wrong = tuple(dict.fromkeys(by_channel[run.force.name]))
        detail = f"all channels are stuck: {_where(wrong, rate_hz)}; {_LEFT_OUT}"
        yield _Damage(Check.STUCK, None, wrong, detail)
        return
    for channel in run.channels:
        wrong = tuple(by_channel.get(channel.name, ()))
        if wrong:
            where = _where(wrong, rate_hz)
            detail = f"it holds one value while the others move: {where}; {_LEFT_OUT}"
            yield _Damage(Check.STUCK, channel, wrong, detail)


def _repeated(run: Run, others: Sequence[int]) -> Iterator[_Damage]:
    rate_hz = run.recording.sampling_rate_hz
    for repeat in repeated_stretches(run):
        if repeat.throughout and not any(abs(repeat.lag - n) <= SAME_LENGTH * n for n in others):
            continue  # a computed recording of whole periods
        copy, lag = repeat.copy, repeat.lag
        what = "all channels repeat" if repeat.of is None else "the force alone repeats"
        detail = f"{what} to the last bit what was recorded {lag / rate_hz:.4g} s before: "
        detail += _where([copy], rate_hz)
        if repeat.throughout:
            detail += "; the recording was appended to itself"
        first = Stretch(copy.start - lag, copy.stop - lag)
        # Which of two forces the sensors answered to is not known; of two recordings the first.
        wrong = (copy,) if repeat.of is None else (first, copy)
        says = _LEFT_OUT if repeat.of is None else "the averages with either are left out"
        yield _Damage(Check.REPEATED, repeat.of, wrong, f"{detail}; {says}")


def _miscounted(run: Run) -> Iterator[_Damage]:
    jumps = counter_jumps(run)
    if not jumps:
        return
    said = [_counted(jump) for jump in jumps[:_SHOWN]]
    more = f" and {len(jumps) - _SHOWN} more" if len(jumps) > _SHOWN else ""
    detail = f"counter {jumps[0].channel!r} {', '.join(said)}{more}; {_LEFT_OUT}"
    yield _Damage(Check.COUNTER, None, tuple(jump.wrong for jump in jumps), detail)


def _counted(jump: Jump) -> str:
    row = f"goes from {jump.before} to {jump.after} at row {jump.wrong.start + 1}"
    if jump.lost:
        return f"{row}, {jump.lost} samples lost"
    return f"{row}, {len(jump.wrong)} samples repeated"


def _slipped(run: Run, slip: NDArray[np.float64], plan: BlockPlan) -> Iterator[_Damage]:
    """Channels that run ahead of the force, or behind it, from some part of the run to its end."""
    ends = part_ends(plan)
    ahead = {row: part for row in range(len(slip)) if (part := _first_ahead(slip[row])) is not None}
    if not ahead:
        return
    last = slip[:, -1]
    usual = float(np.median(last[list(ahead)]))
    same = np.abs(last - usual) <= _SAME_SLIP
    if len(slip) < _FEWEST_SENSORS:  # sensor or force? Nothing can tell
        who: dict[Channel | None, tuple[int, float]] = {None: (min(ahead.values()), usual)}
    elif np.mean(same) >= _MOST_SENSORS:
        who = {run.force: (min(ahead.values()), -usual)}
    else:
        sensors = run.channels[1:]
        who = {sensors[row]: (part, float(last[row])) for row, part in ahead.items()}
    for channel, (part, samples) in who.items():
        first = plan.starts[_first_doubtful_block(ends, part, samples)]
        behind = plan.starts[ends[part] - 1] + plan.block_samples
        start_s, stop_s = first / plan.sampling_rate_hz, behind / plan.sampling_rate_hz
        count = counted(max(round(abs(samples)), 1), "sample")
        detail = (
            f"{count} {'lost' if samples > 0 else 'too many'} "
            f"against the other channels between {start_s:.4g} and {stop_s:.4g} s; the averages "
            "from there on are left out"
        )
        wrong = (Stretch(first, run.recording.n_samples),)
        yield _Damage(Check.LOST_SAMPLES, channel, wrong, detail)


def _joined(run: Run, joints: Sequence[int]) -> Iterator[_Damage]:
    rate_hz = run.recording.sampling_rate_hz
    for sample in joints:
        detail = (
            f"all channels jump at {sample / rate_hz:.5g} s (row {sample + 1}), as when samples "
            f"are lost or written twice; {_LEFT_OUT}"
        )
        yield _Damage(Check.LOST_SAMPLES, None, (Stretch(sample, sample + 1),), detail)


def _intermittent(run: Run, spectra: Spectra, plan: BlockPlan) -> Iterator[_Damage]:
    """Sensors that lose their signal in some of the blocks, as with a loose cable."""
    enough = plan.n_blocks >= _FEWEST_BLOCKS and len(spectra.force) > _FEWEST_SENSORS
    if not enough or not np.any(spectra.force > 0):
        return
    explained = np.sum(np.abs(ratio(spectra.cross, np.sqrt(spectra.force))) ** 2, axis=1)
    share = ratio(explained, spectra.response.sum(axis=1))
    doubtful = np.flatnonzero((share < _EXPLAINED) & (share > 0)).tolist()
    if (
        not doubtful or np.median(share) < _EXPLAINED
    ):  # what rings longer than a block follows no force in it
        return

    def lost_blocks(row: int) -> NDArray[np.int_]:
        frf = ratio(spectra.cross[row], spectra.force[row])
        return _lost_blocks(run.force, run.channels[1 + row], frf, plan)

    in_all = lost_blocks(int(np.argmax(share)))
    for row in doubtful:
        lost, channel = np.setdiff1d(lost_blocks(row), in_all), run.channels[1 + row]
        if lost.size:
            first_s = plan.starts[lost[0]] / plan.sampling_rate_hz
            detail = (
                f"the response is lost in {lost.size} of {plan.n_blocks} blocks, first from "
                f"{first_s:.4g} s on; the sensor is left out in this run"
            )
            whole = (Stretch(0, run.recording.n_samples),)
            yield _Damage(Check.DROPOUT, channel, whole, detail)


def _lost_blocks(
    force: Channel, sensor: Channel, frf: NDArray[np.complex128], plan: BlockPlan
) -> NDArray[np.int_]:
    """Blocks in which a sensor shows far less than its FRF predicts from the force."""

    def spectrum(channel: Channel, start: int) -> NDArray[np.complex128]:
        block = channel.block(start, start + plan.block_samples)
        return np.asarray(np.fft.rfft((block - block.mean()) * plan.taper)[1 : frf.size + 1])

    sums = []
    for start in plan.starts:
        predicted, seen = frf * spectrum(force, start), spectrum(sensor, start)
        powers = (np.vdot(part, part).real for part in (predicted, seen))
        sums.append((np.vdot(predicted, seen).real, *powers))
    shared, expected, there = np.array(sums).T  # NaN where samples miss
    excited = expected > _EXCITED * np.nanmax(expected)
    gain = np.divide(shared, expected, out=np.full(shared.size, np.nan), where=excited)
    usual = np.nanquantile(gain, 0.75)
    return np.flatnonzero((gain < _LOST * usual) & (there < _LOST * usual**2 * expected))


def _first_doubtful_block(ends: Sequence[int], part: int, samples: float) -> int:
    """First block that may be ahead: near the end of a part of several blocks that is not seen."""
    if part == 1:
        return ends[0] if ends[0] == 1 and samples % 1 == 0 else 0
    return ends[part - 1] if ends[part - 1] - ends[part - 2] == 1 else ends[part - 2]


def _first_ahead(slip: NDArray[np.float64]) -> int | None:
    """Part from which on a channel is ahead, to the end and by one time; None where it is not."""
    away = np.flatnonzero(np.abs(slip - slip[-1]) > _SAME_SLIP)
    if slip[-1] == 0 or not away.size:
        return None
    part = int(away[-1]) + 1
    whole = part == 1 or slip[-1] % 1 == 0  # of a slip within the first part only a share shows
    partly = slip[part - 1] != 0  # the part in which it slips shows a share of it too
    return (part - 1 if partly else part) if whole else None


def _where(stretches: Sequence[Stretch], rate_hz: float) -> str:
    return ", ".join(
        f"from {stretch.start / rate_hz:.4g} s for {len(stretch) / rate_hz:.3g} s"
        for stretch in stretches
    )


@dataclass(frozen=True)
class Jump:
    """Where the counter `channel` leaves its steps."""

    channel: str
    wrong: Stretch  # samples that it has counted before, or the one behind a gap
    lost: int  # samples that are not there; 0 where it jumps back
    before: int  # what it counts on either side
    after: int


def counter_jumps(run: Run) -> list[Jump]:
    """Gaps and repetitions that a counter among the channels that have no role tells of."""
    used = {channel.name for channel in run.channels}
    spare = [channel for channel in run.recording.channels if channel.name not in used]
    return [jump for channel in spare if (step := _step(channel)) for jump in _jumps(channel, step)]


def _step(channel: Channel) -> float:
    """Step of a channel that begins as a counter does; 0 for any other."""
    first = piece(channel.samples, 0, _FIRST).astype(np.float64)
    if first.size < _FIRST or not np.all(np.isfinite(first)) or np.any(first % 1):
        return 0.0
    steps = np.diff(first)
    step = float(np.median(steps))
    return step if step > 0 and np.mean(steps == step) > 0.9 else 0.0


def _jumps(channel: Channel, step: float) -> list[Jump]:
    n = channel.n_samples
    usual = [step, *(step - 2.0**bits for bits in _REGISTER_BITS)]
    places: list[NDArray[np.int_]] = []
    for start in range(0, n - 1, _PIECE):
        samples = piece(channel.samples, start, min(start + _PIECE + 1, n)).astype(np.float64)
        places.append(start + 1 + np.flatnonzero(~np.isin(np.diff(samples), usual)))
    found = np.concatenate(places)
    if found.size > (1 - _USUAL) * n:
        return []
    jumps = [_jump(channel, int(place), step) for place in found]
    anew = {(jump.before, jump.after) for jump in jumps}
    return [] if len(jumps) > 1 and len(anew) == 1 else jumps  # an angle: it begins anew each turn


def _jump(channel: Channel, place: int, step: float) -> Jump:
    before, after = piece(channel.samples, place - 1, place + 1).astype(np.float64).tolist()
    if not np.isfinite(after - before):
        return Jump(channel.name, Stretch(place, place + 1), 0, 0, 0)
    back = round((before - after) / step) + 1
    wrong = Stretch(place, min(place + max(back, 1), channel.n_samples))
    return Jump(channel.name, wrong, max(-back, 0), int(before), int(after))
