"""Coherence over neighbouring lines, for few averages: that of a single one is 1."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from ema.core.frf import FRF, ForceRecord

# Averages and lines that one value rests on: noise alone has a coherence of about 1/20.
_VALUES = 20


def line_coherence(frf: FRF) -> NDArray[np.float64]:
    """Coherence of each row as if neighbouring lines were further averages of one FRF.

    A response has a smooth FRF, noise has not. Lower than the coherence where an FRF changes
    within a few lines, in all rows alike. NaN where the force of a row is not known, and without a
    coherence.
    """
    found = np.full(frf.values.shape, np.nan)
    run = np.array(frf.run)
    for name, record in frf.forces.items():
        rows = np.flatnonzero(run == name)
        width = max(-(-_VALUES // record.plan.n_blocks), 1)

        def smooth(spectra: NDArray[np.generic], width: int = width) -> NDArray[np.generic]:
            return np.asarray(uniform_filter1d(spectra, width, axis=-1))

        force = _power(record)
        cross = frf.values[rows] * force
        coherence = np.maximum(frf.coherence[rows], np.finfo(float).tiny)
        power = np.abs(frf.values[rows]) ** 2 * force / coherence
        together = smooth(force) * smooth(power)
        found[rows] = np.abs(smooth(cross)) ** 2 / np.maximum(together, np.finfo(float).tiny)
    return found


def _power(record: ForceRecord) -> NDArray[np.float64]:
    """Power of the force on the lines, summed over the blocks."""
    plan = record.plan
    total = np.zeros(plan.frequency_hz.size)
    for start in plan.starts:
        block = record.force.block(start, start + plan.block_samples)
        spectrum = np.fft.rfft((block - block.mean()) * plan.taper)
        total += np.abs(spectrum[1 : total.size + 1]) ** 2
    return total
