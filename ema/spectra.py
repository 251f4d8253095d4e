"""Auto and cross spectra of a run, summed block by block."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.blocks import BlockPlan
from ema.recording import Run


@dataclass(frozen=True, eq=False)
class Spectra:
    """Sums over blocks of |F|², |X|² and X F*, in common arbitrary scale.

    Parameters
    ----------
    force : ndarray, shape (n_rows, n_frequencies)
        Auto spectrum of the force, repeated for each response.
    response : ndarray, shape (n_rows, n_frequencies)
        Auto spectra of the responses.
    cross : ndarray of complex, shape (n_rows, n_frequencies)
        Cross spectra X F* of responses and force.
    n_effective, n_planned : ndarray, shape (n_rows,)
        Independent averages, and what they would be if no sample were missing.
    clipped, force_clipped : ndarray, shape (n_rows,)
        Share of samples of response and force that sit on the extremes of their block.
    """

    force: NDArray[np.float64]
    response: NDArray[np.float64]
    cross: NDArray[np.complex128]
    n_effective: NDArray[np.float64]
    n_planned: NDArray[np.float64]
    clipped: NDArray[np.float64]
    force_clipped: NDArray[np.float64]

    def rows(self, chosen: slice) -> Spectra:
        """Keep the chosen rows only."""
        return Spectra(*(getattr(self, field.name)[chosen] for field in fields(self)))


def measure_spectra(run: Run, plan: BlockPlan) -> Spectra:
    """Spectra of all responses of a run and, in the last row, of its reference sensor.

    Only one block of all channels is in memory at a time. Means are removed block by block: the
    shaker's preload is a constant force that says nothing about the tyre. A block in which samples
    of a channel are missing (not finite) is left out for that channel; without the force, for all.

    Parameters
    ----------
    run : Run
    plan : BlockPlan
        Blocks for the length of this run.
    """
    from scipy.fft import rfft

    sensors = [response.channel for response in run.responses]
    if run.reference is not None:
        sensors.append(run.reference)
    channels = [run.force, *sensors]
    lines = slice(1, plan.frequency_hz.size + 1)
    force = np.zeros(plan.frequency_hz.size)
    response = np.zeros((len(sensors), force.size))
    cross = np.zeros(response.shape, dtype=complex)
    gaps = np.zeros(response.shape)  # power of the force in blocks that a sensor lacks
    clipped = np.zeros(len(channels))
    n_used = np.zeros(len(sensors))
    for start in plan.starts:
        block = np.stack([c.block(start, start + plan.block_samples) for c in channels])
        mean = block.mean(axis=1, keepdims=True)
        whole = np.isfinite(mean[:, 0])
        if not whole[0]:
            continue
        clipped += _on_extremes(block)
        block -= mean
        block[~whole] = 0.0
        spectrum = rfft(block * plan.taper, axis=1)[:, lines]
        power = np.abs(spectrum[0]) ** 2
        force += power
        gaps[~whole[1:]] += power
        response += np.abs(spectrum[1:]) ** 2
        cross += spectrum[1:] * spectrum[0].conj()
        n_used += whole[1:]
    gaps[n_used == 0] = force  # exactly, whatever the rounding
    return Spectra(
        force - gaps,
        response,
        cross,
        plan.n_effective * n_used / plan.n_blocks,
        np.full(len(sensors), plan.n_effective),
        clipped[1:] / plan.n_blocks,
        np.full(len(sensors), clipped[0] / plan.n_blocks),
    )


def _on_extremes(block: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of samples equal to a block's largest or smallest; one of each is no clipping."""
    high, low = block.max(axis=1, keepdims=True), block.min(axis=1, keepdims=True)
    count = np.count_nonzero((block == high) | (block == low), axis=1) - 2
    return np.asarray(np.maximum(count, 0) / block.shape[1])


def pooled(parts: list[Spectra], place: NDArray[np.int_], n_places: int) -> Spectra:
    """Add up the spectra of rows that belong to the same place.

    Parameters
    ----------
    parts : list of Spectra
        Their rows, one after the other, are the rows of `place`.
    place : ndarray of int, shape (n_rows,)
        Place of each row, 0 … n_places − 1.
    n_places : int
    """

    def add(name: str) -> NDArray[Any]:
        rows = np.concatenate([getattr(part, name) for part in parts])
        total = np.zeros((n_places, *rows.shape[1:]), dtype=rows.dtype)
        np.add.at(total, place, rows)
        return total

    def largest(name: str) -> NDArray[Any]:
        worst = np.zeros(n_places)
        np.maximum.at(worst, place, np.concatenate([getattr(part, name) for part in parts]))
        return worst

    sums = (add(name) for name in ("force", "response", "cross", "n_effective", "n_planned"))
    return Spectra(*sums, *(largest(name) for name in ("clipped", "force_clipped")))
