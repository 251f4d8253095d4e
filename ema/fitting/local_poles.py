"""Poles that differ from position to position, where no circle tells what they consist of.

Two members of a pair in other shares at each position, measurements in other states of the
structure: one pole for all positions presses what it leaves into the poles beside it. Terms
B_i/(jω − s)² next to A_i/(jω − s) give each position its own pole s + B_i/A_i to first order. The
mean over the positions, weighted by |A_i|², is free of that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri, ndtri, stdtrit

from ema.fitting.evidence import peak_response, share_resonance
from ema.fitting.pole_fit import N_STAND_INS, PoleFit, evaluate
from ema.fitting.variable_projection import Complex, Real

# Further rounds change nothing.
_ROUNDS = 2
# First order holds for changes up to this many half-widths, and this share of the frequency:
# beyond it, a pole damped critically would change to the other half-plane.
_FIRST_ORDER = 0.5
# Scatter that noise explains once in twenty is no more than noise.
_CHANCE = 0.05
# How far the poles of single positions are apart, in half-widths (1 σ): wheel, ruler, half a tyre.
_USUAL = 0.1


@dataclass(frozen=True, eq=False)
class _OwnPoles:
    """How far the poles of each position are from those of a fit, (n_positions, n_modes) each."""

    change: Complex  # rad/s
    variance: Real  # of its real and of its imaginary part, from noise
    residues: Complex

    @property
    def weight(self) -> Real:
        """Share of each position in the mean."""
        power = np.abs(self.residues) ** 2
        return np.asarray(power / power.sum(axis=0))

    @property
    def mean(self) -> Complex:
        """Mean change, (n_modes,)."""
        return np.asarray(np.sum(self.weight * self.change, axis=0))


def at_mean_of_positions(fit: PoleFit) -> PoleFit:
    """The fit at the mean poles of all positions."""
    for _ in range(_ROUNDS if len(fit.residues) > 1 else 0):
        step = _own_poles(fit, 1.0).mean
        step[np.abs(step) > _FIRST_ORDER * np.minimum(-fit.poles.real, fit.poles.imag)] = 0
        again = evaluate(fit.lines, fit.poles + step, fit.drift, fit.pairs)
        fit = replace(again, at_bound=fit.at_bound)
    return fit


def std_over_positions(fit: PoleFit, correlation: float) -> Real:
    """Standard deviations of mean frequencies in Hz and damping ratios, (n_modes, 2).

    From how far the positions' own poles scatter around the mean, where that is beyond noise; of
    few positions the 95 % interval is that of Student's t. `correlation` is that of
    `line_correlation`.
    """
    freedom = len(fit.residues) - 1
    if not freedom:
        return np.zeros((fit.poles.size, 2))
    own = _own_poles(fit, correlation)
    off, size = own.change - own.mean, np.abs(fit.poles)
    along = (fit.poles.conj() * off).real / size
    damping = (fit.poles.real / size * along - off.real) / size
    scatter = np.stack([np.sum((own.weight * each) ** 2, axis=0) for each in (along, damping)])
    noise = np.sum(own.weight**2 * own.variance, axis=0) / np.stack([np.ones_like(size), size**2])
    scatter *= (freedom + 1) / freedom
    beyond = scatter > noise * chdtri(freedom, _CHANCE) / freedom
    few = stdtrit(freedom, 1 - _CHANCE / 2) / ndtri(1 - _CHANCE / 2)
    std = few * np.sqrt(np.where(beyond, scatter - noise, 0.0)).T
    return np.asarray(std / (2 * np.pi, 1))


def _own_poles(fit: PoleFit, correlation: float) -> _OwnPoles:
    """Poles of the positions; no change for stand-ins and in the resonance of a stronger pole.

    What there is of either would follow the other. Changes that the residuals hide are likely
    small (ridge regression).
    """
    strength = peak_response(fit)
    beside = np.any(share_resonance(fit.poles) & (strength[:, None] < strength), axis=1)
    beside[-N_STAND_INS:] = True
    own = np.flatnonzero(~beside)
    columns = np.ravel(np.column_stack([2 * own, 2 * own + 1]))
    usual = _USUAL * -fit.poles.real * np.sqrt(np.mean(np.abs(fit.residues) ** 2, axis=0))
    expected = np.diag(np.repeat(usual[own], 2) ** -2)
    change, residues = np.zeros((2, *fit.residues.shape), dtype=complex)
    variance = np.zeros(fit.residues.shape)
    for part, rows in zip(fit.parts, fit.groups, strict=True):
        slopes, noise = part.slopes[:, columns], np.mean(part.misfit**2, axis=0)
        normal, towards = slopes.T @ slopes, slopes.T @ part.target
        inverse = np.linalg.inv(normal + noise[:, None, None] * expected)
        second = np.einsum("ikl,li->ki", inverse, towards)
        given = part.following[:-2, columns] @ second
        residues[rows] = part.residues - (given[0::2] + 1j * given[1::2]).T
        at = np.ix_(rows, own)
        change[at] = (second[0::2] + 1j * second[1::2]).T / residues[at]
        left = np.mean((part.misfit - slopes @ second) ** 2, axis=0)
        known = np.diagonal(inverse, axis1=1, axis2=2) * correlation * left[:, None]
        variance[at] = (known[:, 0::2] + known[:, 1::2]) / 2 / np.abs(residues[at]) ** 2
    return _OwnPoles(change, variance, residues)
