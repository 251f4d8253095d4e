"""How far the shapes of orders stray from their waves: what sensors and an uneven tyre mix.

Places and gains of the sensors mix all waves alike; an uneven tyre adds a few to each mode, and to
what drives it. Both are in the waves of other orders in an order's shape, beside noise and what one
pole in the place of a pair leaves: its residues, and those of all others, follow the pair.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ema.core.settings import IdentificationSettings
from ema.fitting.order_pair import SHARED, OrderDecomposition
from ema.fitting.pole_fit import N_STAND_INS, PoleFit, evaluate
from ema.fitting.variable_projection import Complex, Real

# Orders up to this many above an order show how far its shape strays from its waves; an RMS is that
# many medians. Something strays always.
_NEAR, _MEDIANS, _LEAST_STRAY = 8, 1.2, 1e-4
# Members closer than this many half-widths are one pole to any residue.
_ONE_POLE = 1e-3

Orders = Sequence[tuple[int, list[int]]]
Pairs = Sequence[tuple[tuple[int, ...], Complex]]


class WaveMixing:
    """What the shapes of a fit show of other orders than their own.

    Parameters
    ----------
    fit : PoleFit
    poles : ndarray of complex
        Those of the fit in the state that orders are seen in.
    std : ndarray, shape (n_positions, n_lines)
        Noise of the lines of the fit.
    decomposition : OrderDecomposition
    orders : sequence of (int, list of int)
        Orders, each with its poles.
    pairs : sequence of (tuple of int, ndarray)
        Poles of the fit that belong to one pair, and the two of its members that are known.
    correlation : float
        From `ema.fitting.covariance.line_correlation`.
    settings : IdentificationSettings
    """

    def __init__(
        self,
        fit: PoleFit,
        poles: Complex,
        std: Real,
        decomposition: OrderDecomposition,
        orders: Orders,
        pairs: Pairs,
        correlation: float,
        settings: IdentificationSettings,
    ) -> None:
        self.fit, self.poles, self.std, self.decomposition = fit, poles, std, decomposition
        self.orders, self.correlation, self.settings = orders, correlation, settings
        #: Waves in each order's shape beside known pairs, by its first pole, and their noise.
        self.beside = dict[int, tuple[Complex, Real]]()
        self.single = set[int]()  # orders of which one pole is fitted, beside those pairs
        apart = [(own, members) for own, members in pairs if _are_apart(members)]
        if apart and np.all(np.isfinite(std)):
            self._put_in_place(apart)

    def stray(self, order: int, found: list[int]) -> tuple[float, float]:
        """Amplitude of an order's shape in one wave of another order, and in all of them.

        Less what noise does. Of orders in the same resonance one pole has what those of the other
        leave of its waves, and so have orders of one pole in their own waves.
        """
        near = {*sharing_resonance(self.fit.poles, found)}
        waves, noise = self.beside.get(found[0]) or self._alone(found)
        power = np.sum(np.abs(waves) ** 2, axis=1)
        shared = {order, *(n for n, poles in self.orders if {*poles} & near)}
        others = [k for k in range(1, power.size) if k not in shared and k <= order + _NEAR]
        others = [k for k in others if k not in self.single] or others
        if not others:
            return self.settings.wave_deviation, 0.0
        rest = np.sqrt(np.maximum(power[others] / 2 - noise[others], 0.0) / power[order])
        return max(_MEDIANS * float(np.median(rest)), _LEAST_STRAY), float(np.linalg.norm(rest))

    def _alone(self, found: list[int]) -> tuple[Complex, Real]:
        """Waves of poles as fitted, and noise as if no other pole were there."""
        waves = self.decomposition.waves(self.fit.residues[:, found].sum(axis=1))
        omega = self.fit.lines.omega
        response = omega**2 / np.abs(1j * omega - self.poles[found[0]])
        known = np.sum((response / self.std) ** 2)
        noise = 4 * self.correlation / known if np.isfinite(known) else 0.0
        return waves, np.full(len(waves), noise)

    def _put_in_place(self, pairs: Pairs) -> None:
        """Find the residues again with both members of pairs."""
        fit, waves_of = self.fit, self.decomposition.waves
        gone = {k for own, _ in pairs for k in own}
        kept = [k for k in range(fit.poles.size) if k not in gone]
        poles = np.concatenate([*(members for _, members in pairs), fit.poles[kept]])
        both = evaluate(fit.lines, poles, fit.drift)
        columns = {k: [2 * at, 2 * at + 1] for at, (own, _) in enumerate(pairs) for k in own}
        columns |= {k: [2 * len(pairs) + at] for at, k in enumerate(kept)}
        unscaled = np.mean([part.unscaled for part in both.parts], axis=0)
        size = [
            np.square(self.decomposition.rows(n)) for n in range(self.decomposition.highest + 1)
        ]
        noise = self.correlation * np.array([np.sum(rows @ fit.lines.scale**-2.0) for rows in size])
        for _, found in self.orders:
            own = sorted({column for k in found for column in columns[k]})
            parts = np.ravel([[2 * k, 2 * k + 1] for k in own])
            share = unscaled[np.ix_(parts, parts)]
            known = self.correlation * (share[0::2, 0::2].sum() + share[1::2, 1::2].sum()) / 2
            self.beside[found[0]] = waves_of(both.residues[:, own].sum(axis=1)), known * noise
        contents = [waves_of(both.residues[:, columns[k][0]]) for k in kept]
        powers = [np.sum(np.abs(content) ** 2, axis=1) for content in contents]
        self.single = {int(np.argmax(power)) for power in powers}


def _are_apart(poles: Complex) -> bool:
    return bool(abs(poles[1] - poles[0]) > _ONE_POLE * np.max(-poles.real))


def sharing_resonance(poles: Complex, own: Sequence[int]) -> list[int]:
    """Poles of a fit that share the resonance of an order's own."""
    widest = np.maximum.outer(-poles.real, -poles[own].real)
    near = np.any(np.abs(poles[:, None] - poles[own]) < SHARED * widest, axis=1)
    return [int(k) for k in np.flatnonzero(near[: poles.size - N_STAND_INS]) if k not in own]
