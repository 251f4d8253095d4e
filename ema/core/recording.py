"""Recordings: channels sampled together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.files import fill, piece

ACCELERATION = "acceleration"
FORCE = "force"
VELOCITY = "velocity"
DISPLACEMENT = "displacement"
VOLTAGE = "voltage"
UNKNOWN = "unknown"

#: Motions, and how often each is differentiated to an acceleration.
DERIVATIVES = {ACCELERATION: 0, VELOCITY: 1, DISPLACEMENT: 2}

SENSELESS = 1e30  # in SI, beyond any signal: what programs write where they have no number


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel of a recording."""

    name: str  # it is found by (UFF 58: first ID line; CSV: header cell without the unit)
    quantity: str  # "acceleration", "force", "velocity", "displacement", "voltage" or "unknown"
    unit: str  # as the file states it; empty where it states none
    samples: NDArray[Any]  # as stored, in the file's unit and precision; memory-mapped if possible
    scale_to_si: float = 1.0  # from stored samples (m/s², N, m/s, m, V), sign of the direction too
    node: int | None = None  # where the file has one
    angle_deg: float | None = None  # from geometry in the same file, which overrides the grid
    #: Stretches known to be wrong, first sample and the one behind the last: NaN in `block`.
    gaps: tuple[tuple[int, int], ...] = ()
    #: Magnitude in SI beyond which samples are impossible and missing; never beyond `SENSELESS`.
    limit: float = float("inf")
    axis: int = 0  # direction in the file: 1 to 3 for X, Y, Z; 0 where it states none

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return int(self.samples.shape[0])

    def block(self, start: int, stop: int) -> NDArray[np.float64]:
        """Samples `start` to `stop` in SI units; NaN where impossible or known to be wrong."""
        found = self.raw_block(start, stop)
        self._leave_out(start, found)
        return found

    def raw_block(self, start: int, stop: int) -> NDArray[np.float64]:
        """Samples `start` to `stop` in SI units, impossible ones included."""
        with np.errstate(invalid="ignore", over="ignore"):  # what is not finite counts as missing
            found = piece(self.samples, start, stop)
            return np.asarray(np.asarray(found, dtype=np.float64) * self.scale_to_si)

    def read_block(self, start: int, into: NDArray[np.float64]) -> None:
        """Fill `into` with the samples from `start` on, as `block` gives them."""
        self.read_raw(start, into)
        self._leave_out(start, into)

    def read_raw(self, start: int, into: NDArray[np.float64]) -> None:
        """Fill `into` with the samples from `start` on, as `raw_block` gives them."""
        with np.errstate(invalid="ignore", over="ignore"):
            fill(self.samples, start, into)
            if self.scale_to_si != 1.0:
                into *= self.scale_to_si

    def _leave_out(self, start: int, samples: NDArray[np.float64]) -> None:
        limit = min(self.limit, SENSELESS)
        # No sample exceeds the root of the sum of squares, which BLAS has sooner than both ends.
        if not np.vdot(samples, samples) <= limit**2 and samples.size:
            samples[np.abs(samples) > limit] = np.nan
        for first, behind in self.gaps:
            samples[max(first - start, 0) : max(behind - start, 0)] = np.nan


@dataclass(frozen=True, eq=False)
class Recording:
    """Channels recorded together at one rate."""

    path: Path  # of the file it was read from
    sampling_rate_hz: float  # NaN where the file does not say
    channels: tuple[Channel, ...]  # all of the same length
    #: Lowest and highest rate that the file leaves open where it prints few digits; else NaN.
    rate_range_hz: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def n_samples(self) -> int:
        """Samples per channel."""
        return self.channels[0].n_samples

    @property
    def duration_s(self) -> float:
        """Length of the recording."""
        return self.n_samples / self.sampling_rate_hz

    @property
    def names(self) -> tuple[str, ...]:
        """Channel names in file order."""
        return tuple(channel.name for channel in self.channels)

    def block(self, start: int, stop: int) -> NDArray[np.float64]:
        """Samples `start` to `stop` of all channels in SI, (n_channels, n)."""
        return np.stack([channel.block(start, stop) for channel in self.channels])


def motions(channels: Sequence[Channel]) -> list[Channel]:
    """Accelerations, or else velocities, or else displacements."""
    measured = {each.quantity for each in channels}
    motion = next((each for each in DERIVATIVES if each in measured), None)
    return [each for each in channels if each.quantity == motion]
