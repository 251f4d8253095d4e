"""An order whose resonance lies beneath those of other ones, as order 1 of a rim that moves.

A pole that is free at all positions follows what a stronger order's pole leaves of its pair, not
the weaker order, and the stability diagram may show none. The weaker order's own FRFs show it:
nothing else of that size is in them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.circumference.orders import family, order_basis, order_content
from ema.core.frf import FRF
from ema.core.modes import Mode
from ema.fitting.mode_pairs import PairSearch
from ema.fitting.order_pair import OrderDecomposition
from ema.fitting.pair import PairFit
from ema.fitting.pole_fit import PoleFit
from ema.fitting.variable_projection import Complex, Real

# A ring mode of less purity may hide one of another order, damped this much more.
_IMPURE, _BROADER = 0.985, 1.8
# The other order has this many times the power of any third one: errors of sensors spread.
_CLEARLY = 4.0
# A pole of its own lies this far from that of the order above it, half-widths and 1 σ, …
_APART, _APART_STD = 0.2, 4.0
# … and leaves at most this share of the impurity, or of what was left of its order's FRFs.
_LEFT, _LEFT_OVER = 0.7, 0.3
# Fits of the order's own FRFs and of the rest, beside each other; two were enough.
_ROUNDS = 4
# A pole of a lower order, not the next one, which drift and unevenness mix most, or of order 1 is
# missing where the fit leaves this share of what the order has around, …
_UNEXPLAINED = 0.02
# … this many times the noise, and this share of the power of all orders: an uneven tyre mixes less.
_OVER_NOISE, _VISIBLE = 100.0, 1e-4
# Runs with this share of a wave in common show one order as another.
_CONVERTED = 0.3
# Around: so many half-widths of the ring's modes to each side, in which it has no other pole.
_AROUND = 4.0


@dataclass(frozen=True, eq=False)
class Suspect:
    """An order that may have a pole of its own where another one resounds.

    Parameters
    ----------
    order : int
    above : Mode
        The ring mode that resounds there.
    start : complex
        Where the search for the pole starts, rad/s.
    left : float
        Power that the fit leaves of the order's FRFs there; NaN where the mode is impure instead.
    """

    order: int
    above: Mode
    start: complex
    left: float = float("nan")


def suspects(
    frf: FRF, fit: PoleFit, modes: Sequence[Mode], band_hz: tuple[float, float]
) -> list[Suspect]:
    """Orders that may have a pole that the fit lacks, with modes of its poles in the band."""
    impure = _behind_impure(modes, frf.position_deg, band_hz)
    return [*_LeftOver(frf, fit, modes, band_hz).suspects(), *impure]


def _behind_impure(
    modes: Sequence[Mode], position_deg: Real, band_hz: tuple[float, float]
) -> Iterator[Suspect]:
    """Orders that ring modes may hide, as these are impure."""
    low, high = band_hz
    for mode in (modes[k] for found in family(modes).values() for k in found):
        if mode.order_purity < _IMPURE and low <= mode.frequency_hz <= high:
            power = order_content(mode.residues, position_deg).power
            power[[0, mode.order or 0]] = 0.0
            second, third = np.argsort(power)[[-1, -2]].tolist()
            if power[second] > _CLEARLY * power[third]:
                size = abs(mode.pole)
                ratio = min(_BROADER * mode.damping_ratio, 0.9)
                yield Suspect(second, mode, _pole(size, ratio * size))


class _LeftOver:
    """What a fit leaves of each order's FRFs.

    Parameters
    ----------
    frf : FRF
    fit : PoleFit
    modes : sequence of Mode
        Of the poles of the fit, with orders.
    band_hz : tuple of float
    """

    def __init__(
        self, frf: FRF, fit: PoleFit, modes: Sequence[Mode], band_hz: tuple[float, float]
    ) -> None:
        self.modes, self.hz = modes, fit.lines.frequency_hz
        self.ring = [modes[found[0]] for found in family(modes).values()]
        widths = [-mode.pole.real / (2 * np.pi) for mode in self.ring]
        self.width_hz = float(np.median(widths)) if widths else float("nan")
        self.inside = (self.hz >= band_hz[0]) & (self.hz <= band_hz[1])
        self.decomposition = OrderDecomposition(frf)
        first = int(np.searchsorted(frf.frequency_hz, self.hz[0]))
        self.lines = slice(first, first + self.hz.size)
        self.left, self.whole = _left_of(fit), fit.lines.values
        self.angles = [np.deg2rad(frf.position_deg[rows]) for rows in fit.groups]

    def suspects(self) -> list[Suspect]:
        """Orders with a resonance that no pole explains, what is left most of first."""
        if not self.ring:
            return []
        orders = range(1, max(mode.order or 0 for mode in self.ring) + 1)
        own = {n: self._power(n, self.whole)[0] for n in orders}
        around, found = self._around(np.sum([*own.values()], axis=0)), []
        for n in orders:
            left, noise = self._power(n, self.left)
            seen = left > np.maximum(_UNEXPLAINED * self._around(own[n]), _VISIBLE * around)
            seen &= (left > _OVER_NOISE * noise) & self.inside & ~self._resounds(n)
            if np.any(seen):
                at = int(np.argmax(np.where(seen, left, 0.0)))
                omega, width = 2 * np.pi * self.hz[at], _BROADER * 2 * np.pi * self.width_hz
                above = min(self.ring, key=lambda mode: abs(abs(mode.pole) - omega))
                order = above.order or 0
                if n < order and (n == 1 or n + 1 < order) and not self._converted(n, order):
                    found.append(Suspect(n, above, _pole(omega, width), float(left[at])))
        return sorted(found, key=lambda each: -each.left)

    def _converted(self, order: int, above: int) -> bool:
        """Whether runs in different states would show one order as another one.

        Twelve sensors all around the circle see order 7 as order 5.
        """
        if len(self.angles) < 2:
            return False
        waves = np.array([[above - order], [above + order]])
        alike = [np.abs(np.mean(np.exp(1j * waves * angles), axis=1)) for angles in self.angles]
        return bool(np.max(alike) > _CONVERTED)

    def at(self, suspect: Suspect) -> float:
        """What is left around a suspect's resonance."""
        near = np.abs(self.hz - abs(suspect.start) / (2 * np.pi)) < _AROUND * self.width_hz
        return float(np.max(self._power(suspect.order, self.left)[0], where=near, initial=0.0))

    def _power(self, order: int, values: Complex) -> tuple[Real, Real]:
        """Power of an order over noise, and that of the noise, smoothed over a resonance."""
        seen = self.decomposition.order(order, self.lines, values)
        noise = np.nan_to_num(np.sum(seen.std**2, axis=0))
        power = np.sum(np.abs(seen.values) ** 2, axis=0) - noise
        size = self._size(2.0)
        smooth = scipy.ndimage.uniform_filter1d
        return np.maximum(smooth(power, size), 0.0), smooth(noise, size)

    def _around(self, power: Real) -> Real:
        return np.asarray(scipy.ndimage.maximum_filter1d(power, self._size(2 * _AROUND)))

    def _size(self, widths: float) -> int:
        step_hz = float(self.hz[1] - self.hz[0])
        return max(round(widths * self.width_hz / step_hz), 3)

    def _resounds(self, order: int) -> NDArray[np.bool_]:
        """Lines at which a pole of the order itself resounds."""
        own = [abs(m.pole) / (2 * np.pi) for m in self.modes if m.order == order]
        away = np.abs(self.hz[:, None] - np.array([*own, np.inf]))
        return np.asarray(away.min(axis=1) < _AROUND * self.width_hz)


def _left_of(fit: PoleFit) -> Complex:
    """Residuals of all positions, (n_positions, n_frequencies)."""
    left = np.zeros(fit.lines.values.shape, dtype=complex)
    for rows, part in zip(fit.groups, fit.parts, strict=True):
        real, imaginary = np.split(part.misfit, 2)
        left[rows] = ((real + 1j * imaginary) / fit.lines.weight[:, None]).T
    return left


def _pole(size: float, decay: float) -> complex:
    return complex(-decay, np.sqrt(size**2 - decay**2))


def of_its_order(mode: Mode, order: int, position_deg: Real) -> Mode:
    """The mode with what its shape has of one order, and nothing else of it.

    The rest is what the pole above leaves there.
    """
    content = order_content(mode.residues, position_deg)
    own = order_basis(position_deg, order) @ [content.cosine[order], content.sine[order]]
    return replace(mode, residues=own, order=order, order_purity=1.0)


def pairs_beneath(
    suspect: Suspect, beside: Callable[[complex], PairSearch]
) -> tuple[PairFit, PairFit] | None:
    """The pair that an order's own FRFs show beneath a mode, and that of the mode's order.

    `beside` fits all other poles beside one of that order, the first of all, and gives the search
    for pairs on that fit. None where the FRFs show none.
    """
    pole, pair = suspect.start, None
    for _ in range(_ROUNDS):
        search = beside(pole)
        search.resolve(())
        pair = _pair_of(search, suspect.order, [0])
        if pair is None:
            return None
        pole = pair.mean
    above = [_pair_of(search, n, found) for n, found in search.main if n == suspect.above.order]
    return (pair, above[0]) if pair and above and above[0] else None


def _pair_of(search: PairSearch, order: int, found: list[int]) -> PairFit | None:
    if found[0] not in search.directions:
        return None
    return search.pair_in(search.seen_of(order, found))


def is_another(
    suspect: Suspect,
    pairs: tuple[PairFit, PairFit],
    frf: FRF,
    fit: PoleFit,
    modes: Sequence[Mode],
    band_hz: tuple[float, float],
) -> bool:
    """Whether an order has a pair of its own beneath a mode, in the fit with its pole, the first.

    What sensors or an uneven tyre mix of the mode into the order has the poles of the mode's pair.
    """
    before, pair = suspect.above, pairs[0]
    above = min(modes[1:], key=lambda mode: abs(mode.pole - before.pole))
    hz_std, ratio_std = np.sqrt(np.diag(pair.covariance)[4:])
    pole, mixed = pair.mean, np.array([above.pole, pairs[1].mean, *pairs[1].poles])
    apart = float(np.min(np.abs(pole - mixed)))
    known = np.hypot(2 * np.pi * hz_std, abs(pole) * ratio_std)
    if np.isnan(suspect.left):
        explained = 1 - above.order_purity < _LEFT * (1 - before.order_purity)
    else:
        explained = _LeftOver(frf, fit, modes, band_hz).at(suspect) < _LEFT_OVER * suspect.left
    return bool(
        before.order == above.order
        and explained
        and apart > -_APART * above.pole.real
        and apart > _APART_STD * known
    )


def note_of(suspect: Suspect) -> str:
    """What was found, for the notes of the result."""
    return (
        f"Order {suspect.order} has a resonance beneath that of order {suspect.above.order}: its "
        f"pole is taken from the FRFs of order {suspect.order} alone."
    )


def doubts_of(
    frf: FRF, fit: PoleFit, modes: Sequence[Mode], band_hz: tuple[float, float]
) -> Iterator[str]:
    """What a fit with all pairs in place leaves of order 1, for the notes of the result.

    Rim and air act on this order; what is left of others an uneven tyre mixes into them.
    """
    for suspect in _LeftOver(frf, fit, modes, band_hz).suspects():
        if suspect.order == 1:
            yield (
                f"No mode explains what order 1 does around {abs(suspect.start) / (2 * np.pi):.0f} "
                "Hz: one of a rim or of the air may be missing beneath order "
                f"{suspect.above.order}."
            )
