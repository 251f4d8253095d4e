"""Block plan of a recording: block length, window, overlap; windows of the analyser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ema.core.errors import InputError, require_type


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
