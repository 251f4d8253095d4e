"""How a recording is cut into blocks: lengths, windows, overlap, and what averaging is worth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ema.errors import InputError
from ema.recording import Processing

DEFAULT_WINDOW = "hann"
# Tyre modes have decayed after 0.3 s: longer blocks only cost averages.
LONGEST_DEFAULT_BLOCK_S = 4.0
# A short recording is still cut into this many lengths, so that coherence means something.
FEWEST_DEFAULT_LENGTHS = 4
# What repeats sooner is a tone or its harmonics: between its lines, 4 Hz apart, nothing is excited.
SHORTEST_PERIOD_S = 0.25


@dataclass(frozen=True)
class BlockPlan:
    """Blocks of one recording.

    Parameters
    ----------
    sampling_rate_hz : float
    block_samples : int
        Length of a block.
    step_samples : int
        Distance from the start of one block to the next.
    n_blocks : int
        Number of blocks, the averages of one run.
    window : str
        Name of a scipy window.
    period_samples : int
        Samples after which the force repeats; 0 for one that does not.
    """

    sampling_rate_hz: float
    block_samples: int
    step_samples: int
    n_blocks: int
    window: str
    period_samples: int = 0

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
    def starts(self) -> range:
        """First sample of every block."""
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

    @cached_property
    def taper(self) -> NDArray[np.float64]:
        """The window, scaled to a mean square of 1.

        Raises
        ------
        InputError
            If there is no window of that name.
        """
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


def _window(name: str, n_samples: int) -> NDArray[np.float64]:
    """Periodic window; scipy.signal takes a second to load and is spared for the usual two."""
    if name == "boxcar":
        return np.ones(n_samples)
    if name == "hann":
        return np.asarray(0.5 - 0.5 * np.cos(2 * np.pi / n_samples * np.arange(n_samples)))
    from scipy.signal import get_window

    try:
        return np.asarray(get_window(name, n_samples))
    except ValueError as error:
        raise InputError(
            "window",
            repr(name),
            "it must be a window of scipy that needs no parameter",
            "Choose e.g. 'hann' or 'boxcar'",
        ) from error


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

    By default Hann windows overlap by half over blocks of 4 s, or a quarter of a shorter
    recording; a sweep, burst or impact stays one block without a window, and a force that repeats
    gets blocks of one period without a window. The paper's setting is
    ``averages=10, window="boxcar"``.

    Parameters
    ----------
    n_samples : int
        Length of the recording.
    sampling_rate_hz : float
    processing : Processing
        Averages or block length, window, overlap; None for the default.
    place : str
        What to name in an error.
    steady : bool
        Whether the force looks alike all along the recording.
    period_samples : int
        Samples after which the force repeats; 0 for one that does not.

    Raises
    ------
    InputError
        If the blocks asked for do not fit the recording.
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
            "a block needs at least 8 samples and must fit into the recording",
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
