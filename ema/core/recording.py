"""Recordings of one clock, and the plan by which they are cut into blocks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import InputError, require_type
from ema.core.files import fill

ACCELERATION = "acceleration"
FORCE = "force"
VELOCITY = "velocity"
DISPLACEMENT = "displacement"
VOLTAGE = "voltage"
UNKNOWN = "unknown"

#: Motions, and how often each is differentiated to an acceleration.
DERIVATIVES = {ACCELERATION: 0, VELOCITY: 1, DISPLACEMENT: 2}

SENSELESS = 1e30  # in SI, beyond any signal: what programs write where they have no number


def unlimited() -> float:
    """Limit of a channel of which nobody knows an impossible sample."""
    return float("inf")


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
    #: Tells `limit`; all samples may have to be looked at for it, which is done when it is needed.
    limit_of: Callable[[], float] = unlimited
    axis: int = 0  # direction in the file: 1 to 3 for X, Y, Z; 0 where it states none

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return int(self.samples.shape[0])

    @property
    def limit(self) -> float:
        """Magnitude in SI beyond which samples are impossible and missing; infinite without any."""
        return self.limit_of()

    def block(self, start: int, stop: int) -> NDArray[np.float64]:
        """Samples `start` to `stop` in SI units; NaN where impossible or known to be wrong."""
        found = self.raw_block(start, stop)
        self._leave_out(start, found)
        return found

    def raw_block(self, start: int, stop: int) -> NDArray[np.float64]:
        """Samples `start` to `stop` in SI units, impossible ones included."""
        start, stop, _ = slice(start, stop).indices(self.n_samples)
        found = np.empty(max(stop - start, 0))
        self.read_raw(start, found)
        return found

    def read_block(self, start: int, into: NDArray[np.float64]) -> None:
        """Fill `into` with the samples from `start` on, as `block` gives them."""
        self.read_raw(start, into)
        self._leave_out(start, into)

    def read_raw(self, start: int, into: NDArray[np.float64]) -> None:
        """Fill `into` with the samples from `start` on, as `raw_block` gives them."""
        with np.errstate(invalid="ignore", over="ignore"):  # what is not finite counts as missing
            fill(self.samples, start, into)
            if self.scale_to_si != 1.0:
                into *= self.scale_to_si

    def _leave_out(self, start: int, samples: NDArray[np.float64]) -> None:
        limit = min(self.limit, SENSELESS)
        # Not by BLAS: its threads wait for each other on a busy machine. NaN is not within either.
        if samples.size and not (samples.min() >= -limit and samples.max() <= limit):
            samples[~(np.abs(samples) <= limit)] = np.nan  # signalling NaNs become quiet
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


@dataclass(frozen=True)
class BlockPlan:
    """Blocks of one recording."""

    sampling_rate_hz: float
    block_samples: int  # length of a block
    step_samples: int  # from the start of one block to that of the next
    n_blocks: int  # the averages of one run
    window: str  # name of a scipy window
    period_samples: int = 0  # after which the force repeats; 0 for one that does not
    event_starts: tuple[int, ...] = ()  # of blocks that each begin before a hit or burst

    @property
    def block_s(self) -> float:
        """Length of a block."""
        return self.block_samples / self.sampling_rate_hz

    @property
    def period_s(self) -> float:
        """Time after which the force repeats; 0 for one that does not."""
        return self.period_samples / self.sampling_rate_hz

    @property
    def is_one_period(self) -> bool:
        """Whether every block is one period of the force: nothing leaks, every line is excited."""
        return self.window == "boxcar" and self.block_samples == self.period_samples

    @property
    def overlap(self) -> float:
        """Share of a block that the next one repeats."""
        return 1 - self.step_samples / self.block_samples

    @property
    def starts(self) -> Sequence[int]:
        """First sample of every block."""
        if self.event_starts:
            return self.event_starts
        return range(0, self.n_blocks * self.step_samples, self.step_samples)

    @property
    def frequency_hz(self) -> NDArray[np.float64]:
        """Lines of the FRF: without 0 Hz, as means are removed, and without the Nyquist line."""
        lines = np.arange(1, (self.block_samples + 1) // 2)
        return np.asarray(lines * self.sampling_rate_hz / self.block_samples)

    def for_length(self, n_samples: int) -> BlockPlan:
        """Plan the same blocks for a recording of another length."""
        n_blocks = 1 + (n_samples - self.block_samples) // self.step_samples
        return replace(self, n_blocks=n_blocks)

    def at(self, starts: Sequence[int]) -> BlockPlan:
        """Plan the same blocks, one at each of these samples."""
        return replace(self, n_blocks=len(starts), event_starts=tuple(starts))

    @cached_property
    def taper(self) -> NDArray[np.float64]:
        """The window, scaled to a mean square of 1; `InputError` if there is none of that name."""
        taper = _window(self.window, self.block_samples)
        return np.asarray(taper / np.sqrt(np.mean(taper**2)))

    @property
    def n_effective(self) -> float:
        """Number of independent averages that the overlapping blocks are worth (Welch 1967)."""
        correlation = 0.0
        for lag in range(1, self.n_blocks):
            shift = lag * self.step_samples
            if shift >= self.block_samples:
                break
            shared = float(self.taper[shift:] @ self.taper[:-shift]) / self.block_samples
            correlation += 2 * (1 - lag / self.n_blocks) * shared**2
        return self.n_blocks / (1 + correlation)


@dataclass(frozen=True)
class ExponentialWindow:
    """Exponential window e^{−t/τ} that an analyser applied to the responses.

    It moves every pole by −1/τ.
    """

    time_constant_s: float  # τ
    std_s: float = 0.0  # standard deviation of τ

    @property
    def decay_per_s(self) -> float:
        """Decay rate that it adds to every mode."""
        return 1 / self.time_constant_s

    @property
    def decay_std_per_s(self) -> float:
        """Standard deviation of `decay_per_s`."""
        return self.std_s / self.time_constant_s**2


# Names of windows in other programs, and those of scipy.
_WINDOW_NAMES = {"hanning": "hann", "von hann": "hann", "flat top": "flattop"}
_WINDOW_NAMES |= dict.fromkeys(("rectangular", "rectangle", "rect", "uniform", "none"), "boxcar")


def window_name(name: str) -> str:
    """The scipy name of a window, whatever other programs call it."""
    require_type("window", name, str, "Write e.g. 'hann' or 'rectangular'")
    return _WINDOW_NAMES.get(" ".join(name.split()).casefold(), name)


def overlap_share(overlap: float | str) -> float:
    """Overlap as a share of a block, from a share or percent: 0.5, 50 or "50 %"."""
    text = str(overlap).strip()
    try:
        value = float(text.removesuffix("%"))
    except ValueError:
        value = -1.0
    share = value / 100 if text.endswith("%") or value > 1 else value
    if not 0 <= share < 1:
        rule = "it must be a share from 0 to below 1, or percent below 100"
        raise InputError("overlap", repr(overlap), rule, "Write e.g. 0.5 or 50 %")
    return share


def _window(name: str, n_samples: int) -> NDArray[np.float64]:
    """Periodic window; scipy.signal takes a second to load and is spared for the usual two."""
    if name == "boxcar":
        return np.ones(n_samples)
    if name == "hann":
        return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi / n_samples * np.arange(n_samples)))
    # Half a second to load: not for FRFs that are read from a file.
    from scipy.signal import get_window

    try:
        return np.asarray(get_window(name, n_samples))
    except ValueError as error:
        rule = "it must be a scipy window without parameters"
        raise InputError("window", repr(name), rule, "Use e.g. 'hann' or 'rectangular'") from error
