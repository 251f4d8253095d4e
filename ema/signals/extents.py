"""How far the channels of a recording reach: one pass over all of them, as they are stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.files import read_rows, side_by_side
from ema.core.recording import SENSELESS, Channel

CHUNK = 1 << 8  # samples; a signal has a peak of its own in each
# Noise stays within 6 rms, and what a structure answers rings on: in a steady recording a single
# sample this many times beyond its neighbours and everything else is no signal. A flipped exponent
# bit multiplies by 16 (which harms nothing), 256, 65 536, …
BEYOND_STEADY = 30.0
_APART = 16  # of every so many samples one is looked at for the peaks of chunks
_FEW = 1 << 12  # samples of channels that are looked at together, wherever they are stored
_PIECE_BYTES = 1 << 19  # they stay near the processor


@dataclass(frozen=True)
class Extent:
    """Extreme samples of a channel in SI, damaged ones included."""

    lowest: float = float("nan")  # both NaN where samples are not finite, or senseless
    highest: float = float("nan")
    is_even: bool = False  # where true, no chunk has a peak `BEYOND_STEADY` times that of another

    @property
    def is_known(self) -> bool:
        """Whether all samples are numbers that make sense."""
        return self.lowest <= self.highest

    @property
    def size(self) -> float:
        """Largest magnitude; NaN where it is not known."""
        return max(self.highest, -self.lowest)


def extents_of(channels: Sequence[Channel]) -> list[Extent]:
    """Extents of channels of one length; those that are stored side by side are read together."""
    ends = np.empty((3, len(channels)))
    room = np.empty(_PIECE_BYTES, np.uint8)  # fresh memory takes longer than what is read into it
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is not known
        matrices = side_by_side([channel.samples for channel in channels])
        if channels[0].n_samples <= _FEW:
            matrices = [_joined(matrices)]
        for places, columns in matrices:
            ends[:, places] = _ends(columns, room)
        ends *= [channel.scale_to_si for channel in channels]
    return [_extent(*each) for each in ends.T.tolist()]


def _joined(
    matrices: Sequence[tuple[list[int], NDArray[Any]]],
) -> tuple[list[int], NDArray[np.float64]]:
    """Short matrices in one: most of the time would go into calls for each."""
    rows = [read_rows(each, 0, np.empty(each.shape, each.dtype)) for _, each in matrices]
    joined = np.concatenate(rows, axis=1, dtype=np.float64)
    return [place for places, _ in matrices for place in places], joined


def _extent(one: float, other: float, least: float) -> Extent:
    lowest, highest = (one, other) if one <= other else (other, one)
    size = max(highest, -lowest)
    if not size < SENSELESS:
        return Extent()
    return Extent(lowest, highest, size <= BEYOND_STEADY * abs(least))


def _ends(columns: NDArray[Any], room: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Lowest and highest sample of each column, and what the least peak of its chunks exceeds."""
    n_samples, count = columns.shape
    row_bytes = count * columns.itemsize
    n_rows = max(room.size // (row_bytes * CHUNK), 1) * CHUNK
    enough = room if n_rows * row_bytes <= room.size else np.empty(n_rows * row_bytes, np.uint8)
    rows = enough[: n_rows * row_bytes].view(columns.dtype).reshape(n_rows, count)
    found = np.array([[np.inf], [-np.inf], [np.inf]]).repeat(count, axis=1)
    for start in range(0, n_samples, n_rows):
        piece = _as_floats(read_rows(columns, start, rows[: n_samples - start]))
        found[0] = np.minimum(found[0], _along_columns(np.minimum, piece))
        found[1] = np.maximum(found[1], _along_columns(np.maximum, piece))
        if len(piece) >= CHUNK:
            chunks = piece[: len(piece) // CHUNK * CHUNK].reshape(-1, CHUNK, count)
            some = np.abs(chunks.swapaxes(0, 1)[::_APART], order="C")
            found[2] = np.minimum(found[2], np.minimum.reduce(np.maximum.reduce(some)))
    return found


def _along_columns(extreme: np.ufunc, rows: NDArray[Any]) -> Any:
    """Extreme of each column; many rows are compared with as many at once."""
    count = rows.shape[1]
    if count == 1:
        return extreme.reduce(rows)
    whole = len(rows) // CHUNK * CHUNK
    if whole > CHUNK:
        folded = extreme.reduce(rows[:whole].reshape(-1, CHUNK * count)).reshape(CHUNK, count)
        rows = np.concatenate([folded, rows[whole:]])
    return extreme.reduce(rows)


def _as_floats(rows: NDArray[Any]) -> NDArray[Any]:
    """Numbers that can be negated and compared fast."""
    is_fast = rows.dtype.kind == "f" and rows.dtype.isnative
    return rows if is_fast else rows.astype(np.float64)
