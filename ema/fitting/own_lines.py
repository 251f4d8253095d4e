"""Modes on the lines of their own resonance, where the rest of the band moves them.

A fit of the whole band follows what is strong. What its model leaves of strong resonances, and of
all that lies beyond the band, moves a weak mode far more than noise does, and any mode of a
structure whose resonances are no exact ones: differently in every band. Next to the mode that is a
smooth background, which its own lines tell from it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ema.core.frf import FRF
from ema.core.modes import Flag, Mode
from ema.fitting.pole_fit import N_STAND_INS, PoleFit, evaluate
from ema.fitting.variable_projection import Complex, Real, numbers_of
from ema.signals.leakage import has_leakage

# Half-widths on either side whose lines count, and twice as many to see what that choice does:
# the measured wheel of benchmarks/README.md and lateral modes of benchmarks/laboratory.py.
_REACH = 3.0
# Coefficients of the background, a polynomial of the frequency.
_BACKGROUND = 3
# Independent lines for each of the unknowns of a position, at least.
_LINES_PER_UNKNOWN = 3
# What lines farther apart than its half-width leave open of a resonance, in half-widths: a rim's
# mode 0.67 Hz wide on lines 0.74 Hz apart (benchmarks/laboratory.py).
_COARSE = 0.1
# … and of any damping where leakage is compensated: this share, with the square of the lines'
# distance in half-widths (a steel ring on blocks of 4 s: 1.3 % at 0.8 half-widths, 140 % at 4).
_LEAKING = 0.02
# Damping that ended on its bound may be anything below: the deviation of an even distribution.
_BELOW_BOUND = 3**-0.5
# A pole that moves by more than this many half-widths is no resonance of these lines: it stays.
_FARTHEST = 0.5
_ROUNDS = 3
# A change that noise brings about once in twenty is no more than noise.
_CHANCE = 0.05


@dataclass(frozen=True)
class _Step:
    """What its own lines change in a pole, and the variance of either part of that."""

    change: complex
    variance: float

    @property
    def beyond_noise(self) -> complex:
        """The change less what noise adds to it (James & Stein 1961); 0 where noise explains it."""
        size = abs(self.change) ** 2
        if size <= -2 * self.variance * np.log(_CHANCE):
            return 0j
        return self.change * (1 - 2 * self.variance / size)


def on_own_lines(
    fit: PoleFit, chosen: NDArray[np.int_], correlation: float
) -> tuple[Complex, Real]:
    """Poles of a fit, some of them where the lines of their own resonance have them.

    Parameters
    ----------
    fit : PoleFit
    chosen : ndarray of int
        Poles that may move.
    correlation : float
        From `line_correlation`.

    Returns
    -------
    poles : ndarray of complex, shape (n_modes,)
    std : ndarray, shape (n_modes, 2)
        What this leaves open of frequency in Hz and damping ratio; 0 for poles that stay.
    """
    start, free = fit, set(chosen.tolist())
    for _ in range(_ROUNDS):
        steps = {k: _step(fit, k, _REACH, correlation) for k in sorted(free)}
        poles = fit.poles.copy()
        for k, step in steps.items():
            poles[k] += step.beyond_noise if step is not None else 0.0
        far = [k for k in free if _is_far(poles[k] - start.poles[k], start.poles[k])]
        poles[far] = start.poles[far]
        if np.array_equal(poles, fit.poles):
            break
        free = {k for k in free if poles[k] != fit.poles[k] and k not in far}
        fit = evaluate(fit.lines, poles, fit.drift, fit.pairs, fit.locked)
    std = np.zeros((fit.poles.size, 2))
    for k in chosen:
        std[k] = _left_open(fit, int(k), bool(fit.poles[k] != start.poles[k]), correlation)
    return fit.poles, std


def _left_open(fit: PoleFit, k: int, moved: bool, correlation: float) -> Real:
    """Standard deviations from noise, where it moved, and from how many lines are its own."""
    pole, largest, noise = fit.poles[k], np.zeros(2), 0.0
    near, wide = (_step(fit, k, reach, correlation) for reach in (_REACH, 2 * _REACH))
    if wide is not None and _is_far(wide.change, pole):
        wide = None  # farther out there is more than a smooth background
    for step in (each for each in (near, wide) if each is not None):
        there, here = numbers_of(np.array([pole + step.beyond_noise, pole])).reshape(2, 2)
        largest, noise = np.maximum(largest, np.abs(there - here)), max(noise, step.variance)
    coarse = -pole.real < fit.lines.omega[1] - fit.lines.omega[0]
    variance = noise * moved + (_COARSE * pole.real) ** 2 * coarse
    return np.asarray(np.hypot(largest, np.sqrt(variance) / np.array([2 * np.pi, abs(pole)])))


def _is_far(change: complex, pole: complex) -> bool:
    return bool(abs(change) > _FARTHEST * -pole.real)


def _step(fit: PoleFit, k: int, reach: float, correlation: float) -> _Step | None:
    """Change of a pole that its own lines ask for; None where they are too few.

    Its variance is that of the positions around their mean, or of their lines if larger.
    """
    groups = range(len(fit.parts))
    of_groups = [_of_positions(fit, number, k, reach, correlation) for number in groups]
    known = [each for each in of_groups if each is not None]
    if len(known) < len(of_groups):
        return None
    change, weight, noise = (np.concatenate(each) for each in zip(*known, strict=True))
    whole = float(np.sum(weight))
    mean = complex(np.sum(weight * change) / whole)
    scatter = float(np.sum((weight * np.abs(change - mean)) ** 2)) / 2
    scatter *= weight.size / max(weight.size - 1, 1)
    return _Step(mean, max(scatter, correlation * float(np.sum(weight * noise))) / whole**2)


def _of_positions(
    fit: PoleFit, number: int, k: int, reach: float, correlation: float
) -> tuple[Complex, Real, Real] | None:
    """Change of a pole, weight and noise of each position of a group.

    First order in the pole; residue, background and resonances close by are free.
    """
    part, rows, poles = fit.parts[number], fit.groups[number], fit.in_run(number)
    near = np.abs(fit.lines.omega - poles[k].imag) < reach * -poles[k].real
    free = _free_terms(poles, k, fit.lines.omega[near], reach)
    n_left = free.shape[0] - free.shape[1]
    if free.shape[0] < _LINES_PER_UNKNOWN * free.shape[1] * correlation:
        return None
    s = 1j * fit.lines.omega[near]
    factor = s**2 * fit.lines.weight[near]
    basis, triangle = np.linalg.qr(free * factor[:, None])
    slope = factor / (s - poles[k]) ** 2
    slope = slope - basis @ (basis.conj().T @ slope)
    real, imag = np.split(part.misfit.T[:, np.tile(near, 2)], 2, axis=1)
    left = real + 1j * imag
    inside = left @ basis.conj()
    left = left - inside @ basis.T
    residues = fit.residues[rows, k] + np.linalg.solve(triangle, inside.T)[0]
    scale = fit.lines.scale[rows]
    power = float(np.sum(np.abs(slope) ** 2))
    change = (left @ slope.conj()) / (power * residues)
    left = left - np.outer(change * residues, slope)
    noise = scale**2 * np.sum(np.abs(left) ** 2, axis=1) / (2 * n_left)
    return change, power * np.abs(residues * scale) ** 2, noise


def _free_terms(poles: Complex, k: int, omega: Real, reach: float) -> Complex:
    """What each position has of its own, in columns: residues, background, poles close by."""
    pole, real = poles[k], poles[:-N_STAND_INS]
    close = np.abs(real.imag - pole.imag) < (reach + 1) * -pole.real
    others = real[close & (real != pole)]
    at = (omega - pole.imag) / -pole.real
    terms = [1 / (1j * omega - pole), *(at**power + 0j for power in range(_BACKGROUND))]
    terms += [(1j * omega - other) ** -power for other in others for power in (1, 2)]
    return np.column_stack(terms)


def with_coarse_lines(rows: list[Mode], covariance: Real, frf: FRF) -> tuple[list[Mode], Real]:
    """Rows of one pole, and their covariance, with what the lines leave open of narrow ones."""
    ratio = np.array([mode.damping_ratio for mode in rows])
    std = np.where([Flag.AT_BOUND in mode.flags for mode in rows], _BELOW_BOUND * ratio, 0.0)
    if has_leakage(frf):
        poles = np.array([mode.pole for mode in rows])
        apart = _lines_apart_hz(frf) / _half_widths_hz(poles)
        std = np.hypot(std, _LEAKING * ratio * apart**2)
    wider = [
        replace(mode, damping_std=float(np.hypot(mode.damping_std, own)))
        for mode, own in zip(rows, std, strict=True)
    ]
    return wider, covariance + np.diag(np.column_stack([np.zeros(std.size), std]).ravel() ** 2)


def note_of_coarse_lines(frf: FRF, poles: Complex) -> Iterator[str]:
    """Which modes the lines do not resolve, and which blocks would."""
    narrow = poles[_half_widths_hz(poles) < _lines_apart_hz(frf)]
    if has_leakage(frf) and narrow.size:
        listed = ", ".join(f"{size / (2 * np.pi):.4g}" for size in np.sort(np.abs(narrow)))
        seconds = np.ceil(1 / np.min(_half_widths_hz(narrow)))
        yield (
            f"Lines {_lines_apart_hz(frf):.3g} Hz apart do not resolve the modes at {listed} Hz: "
            "their damping rests on the compensation of leakage. Blocks of "
            f"{seconds:.0f} s or more would resolve them (--block-seconds)."
        )


def _lines_apart_hz(frf: FRF) -> float:
    return float(frf.frequency_hz[1] - frf.frequency_hz[0])


def _half_widths_hz(poles: Complex) -> Real:
    return np.asarray(-poles.real / (2 * np.pi))
