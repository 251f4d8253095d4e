"""Run gain: a run whose FRFs differ from all others by a constant factor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.checks.quality import ReferenceCheck
from ema.core.finding import WARNING, Finding

# Gains repeat from run to run to a percent; what is nearer to 1 than this is how sensors are.
_SMALLEST = 0.03
_SIGNIFICANT = 5.0  # standard deviations
# Share of the difference, beyond noise, that the factor has to explain. Of damping that changes it
# explains a half, of a gain all.
_EXPLAINED = 0.8
# Frequencies shift by that much where pressure and warming change, high orders more than low ones:
# each part of the band is shifted to where it fits. Half a step is 1/80 of a half-bandwidth.
_SHIFTS = np.linspace(-0.03, 0.03, 121)
_PARTS = 8


@dataclass(frozen=True)
class OddGain:
    """Factor of one run over the usual one, with its standard deviation."""

    run: str
    factor: float
    std: float


def odd_gains(check: ReferenceCheck) -> list[OddGain]:
    """Runs that are most others times a real number; none with fewer than three runs.

    Every run is compared with every other one, shifted in frequency to where it fits: tyres
    drift, but none changes by one factor on all lines.

    Parameters
    ----------
    check : ReferenceCheck
    """
    if not np.all(np.isfinite(check.std)):
        return []
    noise = 2 * np.sum(check.std**2, axis=1)
    power = np.sum(np.abs(check.values) ** 2, axis=1) - noise
    runs = np.flatnonzero(power > noise * _SIGNIFICANT / np.sqrt(check.frequency_hz.size))
    if runs.size < 3 or not _differ(check.values[runs]):
        return []
    values, noise, power = check.values[runs], noise[runs], power[runs]
    product, shifted = _products(values, check.frequency_hz)
    factor = product / (shifted - noise)
    error = noise[:, None] + factor**2 * noise
    std = np.sqrt(error / (2 * check.frequency_hz.size) / power)
    total = power[:, None] + noise[:, None]
    before = np.maximum(total - 2 * product + shifted - noise[:, None] - noise, 0)
    after = np.maximum(total - 2 * factor * product + factor**2 * shifted - error, 0)
    odd = np.abs(factor - 1) > np.maximum(_SMALLEST, _SIGNIFICANT * std)
    odd &= after < (1 - _EXPLAINED) * before
    alone = odd.sum(axis=1) > runs.size / 2
    return [
        OddGain(
            check.run[runs[row]],
            float(np.median(factor[row, odd[row]])),
            float(np.median(std[row, odd[row]])),
        )
        for row in np.flatnonzero(alone)
    ]


def _differ(values: NDArray[np.complex128]) -> bool:
    """Whether any two runs differ in a first look; where none do, nothing has to be shifted."""
    product = np.real(values.conj() @ values.T)
    return bool(np.any(np.abs(product / np.diag(product) - 1) > _SMALLEST / 2))


def _products(
    values: NDArray[np.complex128], frequency_hz: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Real products of each run (rows) with all others, shifted to fit it, and their powers."""
    n_runs, n_lines = values.shape
    shifted = np.array(
        [
            [np.interp(frequency_hz / (1 + shift), frequency_hz, run) for run in values]
            for shift in _SHIFTS
        ]
    )
    product, power = np.zeros((2, n_runs, n_runs))
    for lines in np.array_split(np.arange(n_lines), _PARTS):
        part = shifted[:, :, lines]
        own = np.sum(np.abs(part) ** 2, axis=2)
        here = np.real(np.tensordot(values[:, lines], part.conj(), axes=(1, 2)))
        fit = here**2 / np.maximum(own, np.finfo(float).tiny)
        best = np.argmax(fit, axis=1)[:, None]
        product += np.take_along_axis(here, best, axis=1)[:, 0]
        power += own[best[:, 0], np.arange(n_runs)]
    return product, power


def gain_findings(check: ReferenceCheck) -> list[Finding]:
    """Runs that are odd by a factor, as lines of ``quality.csv``."""
    return [
        Finding(
            run=gain.run,
            channel="reference",
            position_deg=None,
            check="gain",
            verdict=WARNING,
            detail=f"the FRF reads {gain.factor:.3g} ± {gain.std:.1g} times that of the other runs "
            "on all lines, as no tyre changes: check sign, unit and range of the force, and of the "
            "sensors; it was left in",
        )
        for gain in odd_gains(check)
    ]
