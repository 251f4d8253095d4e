"""Modes that are of no pair, beside both members of all pairs.

What one pole leaves of a strong pair reaches through the band, and with residues that are free at
all positions a weak mode follows it: lateral modes of benchmarks/laboratory.py were damped up to
20 % too much, and modes of a rim moved by several Hz when the band lost its ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.core.settings import IdentificationSettings
from ema.fitting.covariance import frequency_damping_covariance, parameter_covariance, without_ends
from ema.fitting.order_pair import RingOrder
from ema.fitting.pole_fit import Lines, PoleFit, fit_bounded
from ema.fitting.variable_projection import Complex, Real, numbers_of


@dataclass(frozen=True, eq=False)
class WeakModes:
    """Where some poles of a fit are beside both members of all pairs, and how well known.

    Parameters
    ----------
    at : ndarray of int, shape (n_modes,)
        Poles of the fit.
    poles : ndarray of complex, shape (n_modes,)
        rad/s.
    covariance : ndarray, shape (n_modes, 2, 2)
        Of frequency in Hz and damping ratio.
    shift : ndarray, shape (n_modes, 2)
        What the ends of the band change in them.
    """

    at: NDArray[np.int_]
    poles: Complex
    covariance: Real
    shift: Real

    def poles_in(self, poles: Complex) -> Complex:
        """Poles of the fit, with these in their places."""
        moved = poles.copy()
        moved[self.at] = self.poles
        return moved

    def shifts_in(self, shift: Real) -> Real:
        """What the ends of the band change in all poles, with these in their places."""
        known = shift.copy()
        known[self.at] = self.shift
        return known

    def covariance_in(self, covariance: Real) -> Real:
        """Covariance of all poles, with these in their places."""
        known = covariance.copy()
        for k, own in zip(self.at, self.covariance, strict=True):
            known[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = own
        return known


def beside_members(
    fit: PoleFit,
    at: NDArray[np.int_],
    pairs: Mapping[int, RingOrder],
    correlation: float,
    settings: IdentificationSettings,
) -> WeakModes:
    """Fit some poles again, with both members in the place of the poles of `pairs`, which stay.

    None of them where there is no pair, nor those that end on a bound: they stay what they were.
    """
    if not at.size or not pairs:
        nothing = np.zeros((0, 2))
        return WeakModes(at[:0], fit.poles[:0], np.zeros((0, 2, 2)), nothing)
    kept = [k for k in range(fit.poles.size) if k not in pairs]
    start = np.concatenate([*(order.poles for order in pairs.values()), fit.poles[kept]])
    free = start.size - len(kept) + np.searchsorted(kept, at)
    stay = np.setdiff1d(np.arange(start.size), free)
    drift = fit.drift if len(fit.drift) > 1 else None

    def fitted(lines: Lines) -> PoleFit:
        return fit_bounded(lines, start, settings, drift, start, (), tuple(stay.tolist()))

    again = fitted(fit.lines)
    covariance = frequency_damping_covariance(
        again.poles, parameter_covariance(again, correlation)
    ).reshape(start.size, 2, start.size, 2)
    # All other poles stay, those beyond the ends that are cut too: what is compared are lines.
    numbers = [
        numbers_of(other.poles[free]).reshape(-1, 2)
        for other in (again, *map(fitted, without_ends(fit.lines)))
    ]
    shift = np.max(np.abs(np.array(numbers[1:]) - numbers[0]), axis=0)
    inside = ~again.at_bound.reshape(-1, 2)[free].any(axis=1)
    found = free[inside]
    return WeakModes(at[inside], again.poles[found], covariance[found, :, found], shift[inside])
