"""Poles fitted within bounds around those of the diagram: lines, weights, start values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.errors import FitError
from ema.frf import FRF
from ema.leakage import leakage_bias
from ema.noise import noise_level
from ema.pole_fit import N_STAND_INS, Lines, PoleFit, fit_poles
from ema.stability import widened_band

# Bounds around the poles of LSCE: the fit refines them, it does not look for others.
_FREQUENCY_REACH = 0.01  # share of the frequency, or the damping ratio where that is larger
_DAMPING_REACH = 4.0  # factor
# Free poles just above the lines stand for all modes farther up: two residual terms alone cost
# 0.6 % of damping in the lowest mode of a tyre. There are two, as modes of a tyre come in pairs.
_STAND_INS, _STAND_IN_REACH = (1.03, 1.09), (1.002, 1.3)
_STAND_IN_DAMPING = 0.02
# What lies beyond the lines disturbs those next to it: their weight falls to this at the ends.
_END_WEIGHT = 0.05
# A correction for random excitation that fits worse than this shows that it was not random.
_WORSE = 1.05
_LEAKAGE_ROUNDS = 2


def lines_to_fit(frf: FRF, band_hz: tuple[float, float]) -> Lines:
    """Lines of the band and a margin, with weights from their noise."""
    chosen = widened_band(frf, band_hz)
    level = noise_level(frf, chosen)
    common = np.exp(np.mean(np.log(level), axis=0))
    own = np.exp(np.mean(np.log(level / common), axis=1))
    names = frf.run_names
    run = np.array([names.index(name) for name in frf.run])
    frequency_hz = frf.frequency_hz[chosen]
    importance = _importance(frequency_hz, band_hz)
    values = frf.values[:, chosen]
    return Lines(frequency_hz, values, importance / common, 1 / own, run, importance)


def _importance(
    frequency_hz: NDArray[np.float64], band_hz: tuple[float, float]
) -> NDArray[np.float64]:
    """Weight 1 in the band, falling along the margins on either side."""
    low, high = frequency_hz[[0, -1]]
    below = (band_hz[0] - frequency_hz) / max(band_hz[0] - low, 1e-12)
    above = (frequency_hz - band_hz[1]) / max(high - band_hz[1], 1e-12)
    outside = np.clip(np.maximum(below, above), 0, 1)
    return np.asarray(_END_WEIGHT ** (outside**2))


def starting_poles(
    poles: NDArray[np.complex128], lines: Lines, band_hz: tuple[float, float]
) -> NDArray[np.complex128]:
    """Poles that the lines show on both sides, and the stand-in for everything above."""
    frequency_hz = np.abs(poles) / (2 * np.pi)
    low, high = lines.frequency_hz[[0, -1]]
    half_width_hz = -poles.real / (2 * np.pi)
    in_band = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    shown = (frequency_hz - low > half_width_hz) & (high - frequency_hz > half_width_hz)
    if not np.any(in_band):
        raise FitError(
            f"no pole between {band_hz[0]:g} and {band_hz[1]:g} Hz to start the curve fit from. "
            "Pin frequencies or change the band."
        )
    return with_stand_ins(poles[in_band | shown], lines)


def with_stand_ins(poles: NDArray[np.complex128], lines: Lines) -> NDArray[np.complex128]:
    """Poles and, at the end, start values of those that stand for all modes above the lines."""
    omega = 2 * np.pi * lines.frequency_hz[-1] * np.array(_STAND_INS)
    return np.append(poles, omega * (-_STAND_IN_DAMPING + 1j))


def fit_bounded(
    lines: Lines,
    start: NDArray[np.complex128],
    drift: NDArray[np.float64] | None = None,
    around: NDArray[np.complex128] | None = None,
    pairs: tuple[tuple[int, int], ...] = (),
) -> PoleFit:
    """Fit poles within the bounds that suit start values from a stability diagram.

    A fit that goes on from an earlier one keeps its bounds `around` the diagram's poles.
    """
    lower, upper = _bounds(start if around is None else around, lines.frequency_hz[-1])
    return fit_poles(lines, start, lower, upper, drift, pairs=pairs)


def _bounds(
    start: NDArray[np.complex128], highest_hz: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    decay, frequency = -start.real, start.imag
    reach = np.maximum(_FREQUENCY_REACH, decay / frequency) * frequency
    lower = np.column_stack([decay / _DAMPING_REACH, frequency - reach])
    upper = np.column_stack([decay * _DAMPING_REACH, frequency + reach])
    stand_ins = slice(-len(_STAND_INS), None)
    lower[stand_ins, 1], upper[stand_ins, 1] = (
        2 * np.pi * highest_hz * np.array([_STAND_IN_REACH]).T
    )
    return lower.ravel(), upper.ravel()


def without_leakage(
    frf: FRF, plain: PoleFit, around: NDArray[np.complex128]
) -> tuple[PoleFit, list[str]]:
    """Fit again, for averaged blocks, with the bias of the window taken out of the FRFs."""
    if frf.blocks is None or frf.blocks.n_blocks < 2:
        return plain, []
    if frf.blocks.is_one_period:
        return plain, []
    cleared = plain
    for _ in range(_LEAKAGE_ROUNDS):
        bias = leakage_bias(
            frf.blocks,
            plain.lines.frequency_hz,
            cleared.poles[:-N_STAND_INS],
            cleared.residues[:, :-N_STAND_INS],
        )
        lines = replace(plain.lines, values=plain.lines.values - bias)
        start = np.append(cleared.poles[:-N_STAND_INS], plain.poles[-N_STAND_INS:])
        drift = cleared.drift if cleared.drift.size > 1 else None
        cleared = fit_bounded(lines, start, drift, around, plain.pairs)
    if cleared.misfit > _WORSE * plain.misfit:
        note = "The bias of window and block length was left in: taking it out fits worse."
        return plain, [note]
    return cleared, ["The bias of window and block length was taken out of the curve fit."]
