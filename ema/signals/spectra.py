"""Auto and cross spectra of a run, summed block by block, and channels that slip between parts.

A sample that a channel loses during a recording advances all that follows: against the first part
of the run, the phase of the FRF then rises in proportion to frequency. Generalised
cross-correlation with phase weighting (Knapp & Carter 1976) tells by how many samples. A tyre that
warms up or is softer at harder hits turns the phase as well, at its resonances only: one percent in
frequency passes for a third of a sample at 2 kHz. What frequencies that are all higher or lower
explain as well is no slip.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ema.core.campaign import Run
from ema.core.recording import DERIVATIVES, BlockPlan, Channel

_LEAST_POWER = np.finfo(float).tiny
_LIMIT = 0.1  # of the span of a block: the distance of a limit from the mean, at least
# A round crest has 1.24 times as many samples on the four levels beneath the last one as on that;
# what is clipped has few there. Up to three share the last of so many levels by chance.
_LEVELS, _ON_LEVELS, _BY_CHANCE, _COARSE = 4.5, 1.2, 3, 1 << 17
_TOGETHER = 16  # sensors summed at once: the sums of more do not stay near the processor
_PIECE_BYTES = 1 << 22  # read at a time: few calls, and it stays near the processor
# A recording is compared in so many parts. The first one is short: what slips within it is ahead
# nearly from the start, and there is nothing to tell it from.
_PARTS, _SHARE_OF_FIRST = 8, 1 / 16
# Lines that the first look takes; a slip shows in all of them.
_LOOKED_AT = 512
# Phases count with this power of |cross spectrum|²: resonances must not outweigh all other lines,
# which a drift leaves alone, nor lines without force count at all.
_WEIGHT = 0.25
# Steps in a sample that the slip is sought in, and slips that are no chance.
_STEPS = 4
_FEWEST = 0.5
# Mean gain in alignment over its standard error, line by line.
_SIGNIFICANT = 15.0
# Below this alignment there is no FRF to compare.
_ALIGNED = 0.3
# Relative changes of all frequencies that are tried instead of a slip.
_CHANGES = np.linspace(-0.08, 0.08, 81)


@dataclass(frozen=True, eq=False)
class Spectra:
    """Sums over blocks of |F|², |X|² and X F*, in common arbitrary scale.

    Spectra are (n_rows, n_frequencies), numbers (n_rows,).
    """

    force: NDArray[np.float64]  # auto spectrum of the force, repeated for each response
    response: NDArray[np.float64]  # auto spectra
    cross: NDArray[np.complex128]  # cross spectra X F* of responses and force
    n_effective: NDArray[np.float64]  # independent averages
    n_planned: NDArray[np.float64]  # what they would be if no sample were missing
    clipped: NDArray[np.float64]  # share of samples that sit on the extremes of their block
    force_clipped: NDArray[np.float64]  # the same of the force
    slip: NDArray[np.float64]  # samples ahead of the force in each part of the run, as `SlipMeter`

    def rows(self, chosen: slice) -> Spectra:
        """Keep the chosen rows only."""
        return Spectra(*(getattr(self, field.name)[chosen] for field in fields(self)))


def measure_spectra(run: Run, plan: BlockPlan) -> Spectra:
    """Spectra of all responses of a run and, in the last row, of its reference sensor.

    Velocities and displacements are converted to accelerations.

    Only a few blocks of all channels are in memory at a time. Means are removed block by block: the
    shaker's preload is a constant force that says nothing about the tyre. A block in which samples
    of a channel are missing (not finite) is left out for that channel; without the force, for all.
    """
    force, *sensors = run.channels
    groups = [sensors[k : k + _TOGETHER] for k in range(0, len(sensors), _TOGETHER)]
    parts = [_measured((force, *group), plan) for group in groups]
    whole = Spectra(*(_stacked(parts, field.name) for field in fields(Spectra)))
    power = np.array([[DERIVATIVES.get(channel.quantity, 0)] for channel in sensors])
    if not power.any():
        return whole
    to_acceleration = (2j * np.pi * plan.frequency_hz) ** power
    response = whole.response * np.abs(to_acceleration) ** 2
    return replace(whole, response=response, cross=whole.cross * to_acceleration)


def _measured(channels: Sequence[Channel], plan: BlockPlan) -> Spectra:
    """Spectra of all channels against the first one, the force."""
    sums = _Sums(len(channels) - 1, plan)
    looked_at = 0  # samples up to here were looked at for clipping: none needs that twice
    for starts, blocks in _pieces_of(channels, plan):
        fresh = []
        for number, start in enumerate(starts):
            if start >= looked_at:
                looked_at = start + plan.block_samples
                fresh.append(number)
        sums.add(blocks, fresh)
    return sums.spectra()


def _stacked(parts: Sequence[Spectra], name: str) -> NDArray[Any]:
    return np.concatenate([getattr(part, name) for part in parts])


def blocks_of(
    channels: Sequence[Channel], plan: BlockPlan
) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Start and samples of each block, all channels; several blocks are read at a time."""
    for starts, blocks in _pieces_of(channels, plan):
        yield from zip(starts, blocks.swapaxes(0, 1), strict=True)


def _pieces_of(
    channels: Sequence[Channel], plan: BlockPlan
) -> Iterator[tuple[Sequence[int], NDArray[np.float64]]]:
    """Starts and samples of a few blocks at a time, (n_channels, n_blocks, block_samples)."""
    if plan.event_starts:
        for start in plan.starts:
            stop = start + plan.block_samples
            yield [start], np.stack([channel.block(start, stop) for channel in channels])[:, None]
        return
    room = _PIECE_BYTES // (8 * len(channels)) - plan.block_samples
    at_once = 1 + max(room, 0) // plan.step_samples
    longest = (min(at_once, plan.n_blocks) - 1) * plan.step_samples + plan.block_samples
    piece = np.empty((len(channels), longest))
    blocks = sliding_window_view(piece, plan.block_samples, axis=1)[:, :: plan.step_samples]
    for first in range(0, plan.n_blocks, at_once):
        starts = plan.starts[first : first + at_once]
        stop = starts[-1] + plan.block_samples
        for row, channel in zip(piece, channels, strict=True):
            channel.read_block(starts[0], row[: stop - starts[0]])
        yield starts, blocks[:, : len(starts)]


class _Sums:
    """Running sums over the blocks of a run; the force is row 0 of them.

    Row by row, what is computed stays near the processor.
    """

    def __init__(self, n_sensors: int, plan: BlockPlan) -> None:
        n_lines = plan.block_samples // 2 + 1
        self.plan = plan
        self.squares = np.zeros((n_sensors + 1, 2 * n_lines))  # of real and imaginary parts
        self.cross = np.zeros((n_sensors, n_lines), dtype=complex)
        self.gaps = np.zeros((n_sensors, 2 * n_lines))  # of the force, in blocks a sensor lacks
        self.clipped = np.zeros(n_sensors + 1)
        self.n_looked_at = 0
        self.n_used = np.zeros(n_sensors)
        self._slip = SlipMeter(n_sensors, plan)
        self._part = np.zeros_like(self.cross)  # of the part of the run that is going on
        self._n_seen, self._n_parts = 0, 0

    def add(self, blocks: NDArray[np.float64], fresh: Sequence[int]) -> None:
        """Add blocks of all channels; `fresh` are those to be looked at for clipping."""
        with np.errstate(invalid="ignore", over="ignore"):  # such a mean tells that samples miss
            mean = np.array([own.mean(axis=1) for own in blocks])
        whole = np.isfinite(mean)
        looked_at = [number for number in fresh if whole[0, number]]
        for row, own in enumerate(blocks):
            self.clipped[row] += sum(_on_extremes(own[k], mean[row, k]) for k in looked_at)
        self.n_looked_at += len(looked_at)
        done, n_blocks = 0, mean.shape[1]
        while done < n_blocks:  # never beyond the end of a part at once
            end = self._slip.ends[self._n_parts]
            here = slice(done, min(done + end - self._n_seen, n_blocks))
            usable = np.flatnonzero(whole[0, here]) + done
            if usable.size:
                chosen = here if usable.size == here.stop - done else usable
                self._add(blocks[:, chosen], mean[:, chosen], whole[:, chosen])
            self._n_seen += here.stop - done
            done = here.stop
            if self._n_seen == end:
                self._slip.add(self._n_parts, self._part)
                self._n_parts += 1
                self.cross += self._part
                self._part[:] = 0.0

    def _add(
        self, blocks: NDArray[np.float64], mean: NDArray[np.float64], whole: NDArray[np.bool_]
    ) -> None:
        """Add blocks of one part that all have the force."""
        block = np.empty(blocks.shape[1:])
        force, sensor = np.empty((2, len(block), self.cross.shape[1]), dtype=complex)
        for row, own in enumerate(blocks):
            with np.errstate(invalid="ignore"):
                np.subtract(own, mean[row, :, None], out=block)
            block[~whole[row]] = 0.0
            block *= self.plan.taper
            spectrum = np.fft.rfft(block, axis=1, out=sensor if row else force)
            parts = spectrum.view(np.float64)
            self.squares[row] += np.einsum("bk,bk->k", parts, parts)
            if row:
                spectrum *= force  # conjugate
                self._part[row - 1] += spectrum.sum(axis=0)
            else:
                np.conj(force, out=force)
        for row, number in np.argwhere(~whole[1:]):
            self.gaps[row] += force[number].view(np.float64) ** 2
        self.n_used += np.count_nonzero(whole[1:], axis=1)

    def spectra(self) -> Spectra:
        """Everything that was added."""
        self.gaps[self.n_used == 0] = self.squares[0]  # exactly, whatever the rounding
        lines = slice(1, self.plan.frequency_hz.size + 1)
        n_sensors = self.n_used.size
        clipped = self.clipped / max(self.n_looked_at, 1)
        return Spectra(
            _power(self.squares[0] - self.gaps)[:, lines],
            _power(self.squares[1:])[:, lines],
            self.cross[:, lines],
            self.plan.n_effective * self.n_used / self.plan.n_blocks,
            np.full(n_sensors, self.plan.n_effective),
            clipped[1:],
            np.full(n_sensors, clipped[0]),
            self._slip.found,
        )


def _power(squares: NDArray[np.float64]) -> NDArray[np.float64]:
    """|z|² from the squares of real and imaginary parts, which alternate."""
    return squares[:, ::2] + squares[:, 1::2]


def _on_extremes(block: NDArray[np.float64], mean: float) -> float:
    """Share of the samples of one channel on flat tops: equal to the largest or smallest.

    One is no top, nor are as many as a round crest, of a swept sine, has on the last level of a
    converter.
    """
    low, high = block.min(), block.max()
    count = 0.0
    for extreme in (high, low):
        there = int(np.count_nonzero(block == extreme))
        if there < 2 or abs(extreme - mean) < _LIMIT * (high - low):  # or a force at rest
            continue
        step = np.min(np.diff(np.unique(block)), initial=np.inf)
        near = int(np.count_nonzero(np.abs(block - extreme) < _LEVELS * step)) - there
        chance = _BY_CHANCE if high - low < _COARSE * step else 1
        count += max(there - chance - _ON_LEVELS * near, 0.0)
    return count / block.size


def pooled(parts: list[Spectra], place: NDArray[np.int_], n_places: int) -> Spectra:
    """Add up the spectra of rows that belong to the same place.

    `place` numbers the places, 0 … n_places − 1, of the rows of all parts, one after the other.
    """

    def add(name: str) -> NDArray[Any]:
        rows = _stacked(parts, name)
        total = np.zeros((n_places, *rows.shape[1:]), dtype=rows.dtype)
        for row, number in zip(rows, place, strict=True):  # np.add.at takes ten times as long
            total[number] += row
        return total

    def largest(name: str) -> NDArray[Any]:
        worst = np.zeros(n_places)
        np.maximum.at(worst, place, _stacked(parts, name))
        return worst

    sums = ("force", "response", "cross", "n_effective", "n_planned")
    worst = ("clipped", "force_clipped")
    return Spectra(
        **{name: add(name) for name in sums},
        **{name: largest(name) for name in worst},
        slip=np.zeros((n_places, 0)),  # of a run, not of a place
    )


def disagreement(
    parts: Sequence[Spectra], place: NDArray[np.int_], n_places: int
) -> NDArray[np.float64]:
    """By which share of their power the FRFs that are averaged at one place differ; see `pooled`.

    Between the runs, Σ|X F*|²/|F|² exceeds its value for the sums by (K − 1)σ² if all K of them see
    the same; σ² follows from what is incoherent within the runs. What exceeds that expectation is
    given, relative to the coherent power; 0 where a place was measured once.
    """
    force, response, cross, n_effective = (
        _stacked(parts, name) for name in ("force", "response", "cross", "n_effective")
    )
    freedom = n_effective - 1
    share = np.zeros(n_places)
    for number in np.flatnonzero(np.bincount(place, minlength=n_places) > 1):
        rows = np.flatnonzero(place == number)
        rows = rows[np.any(force[rows] > 0, axis=1)]
        if rows.size < 2:
            continue
        own = np.abs(cross[rows]) ** 2 / np.maximum(force[rows], _LEAST_POWER)
        total = np.maximum(force[rows].sum(axis=0), _LEAST_POWER)
        common = np.abs(cross[rows].sum(axis=0)) ** 2 / total
        noise = np.maximum(response[rows] - own, 0).sum() / max(freedom[rows].sum(), 1.0)
        between = (own.sum(axis=0) - common).sum() - (rows.size - 1) * noise
        share[number] = max(between, 0.0) / max(own.sum(), _LEAST_POWER)
    return share


def ratio(above: NDArray[Any], below: NDArray[Any]) -> NDArray[Any]:
    """Quotient of two spectra, and 0 where the one below is nothing.

    Nothing is what lies below the smallest power of full precision, as of a force of 1e-155 N.
    """
    zero = np.zeros(above.shape, np.result_type(above, below))
    return np.asarray(np.divide(above, below, out=zero, where=np.abs(below) >= _LEAST_POWER))


class SlipMeter:
    """Compares the phases of the parts of a recording; 0 samples where they agree."""

    def __init__(self, n_sensors: int, plan: BlockPlan) -> None:
        self.ends = part_ends(plan)
        self.found = np.zeros((n_sensors, len(self.ends)))
        self._first: NDArray[np.complex128] | None = None
        self._block_samples = plan.block_samples

    def add(self, part: int, cross: NDArray[np.complex128]) -> None:
        """Take the cross spectra of one part, summed over its blocks."""
        if self._first is None:
            self._first = cross.copy()
            return
        stride = max(cross.shape[1] // _LOOKED_AT, 1)
        lines = np.arange(1, cross.shape[1] - 1, stride)
        aligned = _weighted(cross[:, lines], self._first[:, lines])
        turn = np.exp(0.5j * np.pi * lines / (cross.shape[1] - 1))  # of half a sample
        still, late, early = (
            each.real.sum(axis=1) for each in (aligned, aligned * turn, aligned / turn)
        )
        weight = np.abs(aligned).sum(axis=1)
        doubtful = (np.maximum(late, early) > still) | (still < 0.5 * weight)
        for row in np.flatnonzero(doubtful & (weight > 0)):
            self.found[row, part] = self._slip(cross[row], self._first[row])

    def _slip(self, cross: NDArray[np.complex128], first: NDArray[np.complex128]) -> float:
        """Samples by which a channel is ahead; 0 where that is not significant."""
        aligned = _weighted(cross, first)
        aligned[[0, -1]] = 0.0
        n = _STEPS * self._block_samples
        correlation = np.fft.irfft(aligned.conj(), n)
        lag = int(np.argmax(correlation))
        samples = (lag - n if lag > n // 2 else lag) / _STEPS
        turn = -2j * np.pi * samples / self._block_samples * np.arange(aligned.size)
        turned = aligned * np.exp(turn)
        gain = turned.real - aligned.real
        error = float(np.std(gain)) / np.sqrt(gain.size)
        weight = float(np.abs(aligned).sum())
        significant = float(np.mean(gain)) > _SIGNIFICANT * error > 0
        clear = turned.real.sum() > _ALIGNED * weight
        if not (significant and clear and abs(samples) >= _FEWEST):
            return 0.0
        return 0.0 if _changed(cross, first) > turned.real.sum() else samples


def part_ends(plan: BlockPlan) -> list[int]:
    """Number of blocks at the end of each part; a single part where there is one block."""
    first = max(round(_SHARE_OF_FIRST * plan.n_blocks), 1)
    rest = plan.n_blocks - first
    n_parts = min(_PARTS - 1, rest)
    return [first, *(first + rest * part // n_parts for part in range(1, n_parts + 1))]


def _changed(cross: NDArray[np.complex128], first: NDArray[np.complex128]) -> float:
    """Best alignment with a first part whose frequencies are all higher or lower."""
    lines = np.arange(first.size)
    moved = (np.interp(lines * (1 + change), lines, first) for change in _CHANGES)
    return max(float(_weighted(cross, each)[1:-1].real.sum()) for each in moved)


def _weighted(
    cross: NDArray[np.complex128], first: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Phase of one spectrum against another, on each line weighted by what is there."""
    product = cross * first.conj()
    power = product.real**2 + product.imag**2
    scale = np.divide(
        power ** (_WEIGHT / 2), np.sqrt(power), out=np.zeros(power.shape), where=power > 0
    )
    return np.asarray(product * scale)
