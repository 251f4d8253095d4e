"""Detection of channels that lose samples relative to the force during a recording.

A lost sample advances all that follows: against the first part of the run, the phase of the FRF
then rises in proportion to frequency. Generalised cross-correlation with phase weighting (Knapp &
Carter 1976) tells by how many samples. A tyre that warms up does not look like that: one percent
in frequency passes for a third of a sample at 2 kHz.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.core.block_plan import BlockPlan

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
        return samples if significant and clear and abs(samples) >= _FEWEST else 0.0


def part_ends(plan: BlockPlan) -> list[int]:
    """Number of blocks at the end of each part; a single part where there is one block."""
    first = max(round(_SHARE_OF_FIRST * plan.n_blocks), 1)
    rest = plan.n_blocks - first
    n_parts = min(_PARTS - 1, rest)
    return [first, *(first + rest * part // n_parts for part in range(1, n_parts + 1))]


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
