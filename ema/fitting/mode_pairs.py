"""Mode pairs: whether one or both modes of an order n ≥ 1 are resolved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from ema.circumference.orders import circle_basis, highest_order
from ema.circumference.ring_modes import family
from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.modes import Mode, OrderReport, Pair, PairVerdict, synthesise
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.fitting.covariance import frequency_damping_covariance, parameter_covariance
from ema.fitting.pole_fit import Lines, PoleFit, fit_poles
from ema.fitting.variable_projection import Complex, Real
from ema.poles.run_alignment import stretched

# Damping of pairs that are searched for stays within this factor of the one pole's …
_ALIKE = 1.3
# … and the misfit that this costs at most.
_MUCH_WORSE = 1.1
# Steps after which a second pole that is there shows in the misfit.
_FIRST_TRIES = 12


def judge_pair(
    order: OrderFrf,
    poles: NDArray[np.complex128],
    correlation: float,
    settings: IdentificationSettings = IDENTIFICATION,
) -> tuple[PairVerdict, NDArray[np.complex128]]:
    """Test one pole against two on the FRFs of one order.

    Parameters
    ----------
    order : OrderFrf
        With everything but the mode (or pair) in question taken out.
    poles : ndarray of complex
        The one pole found so far, or two.
    correlation : float
        Lines that share the information of one, from `line_correlation`.
    settings : IdentificationSettings

    Returns
    -------
    verdict : PairVerdict
    poles : ndarray of complex
        What to go on with: two poles for a resolved pair, one where one explains everything, and
        those found already where it cannot be told.
    """
    number = order.order
    if not np.all(np.isfinite(order.std)):
        text = "the noise is unknown: one pole against two cannot be tested"
        verdict = Pair.RESOLVED if poles.size > 1 else Pair.NOT_SEPARABLE
        return PairVerdict(number, verdict, float("nan"), text), poles
    try:
        one = fit_order(order, np.array([np.mean(poles)]))
        start = poles if poles.size > 1 else _beside(one.poles[0])[0]
        two = fit_order(order, start, tries=_FIRST_TRIES)
        chance, doubt = _chance(one, two, correlation), _doubt(two, correlation, settings)
        if chance < settings.pair_p_value:
            better = fit_order(order, two.poles)
            if doubt or _doubt(better, correlation, settings):
                better = _searched(order, one.poles[0], two)
            two = better
            chance, doubt = _chance(one, two, correlation), _doubt(two, correlation, settings)
    except FitError as error:
        return PairVerdict(number, Pair.NOT_SEPARABLE, float("nan"), str(error)), poles
    if not chance < settings.pair_p_value:
        text = f"one pole explains the order; a second one is not significant (p = {chance:.2g})"
        return PairVerdict(number, Pair.ONE_SEEN, chance, text), one.poles
    if doubt:
        text = f"a second pole fits better (p = {chance:.2g}), but {doubt}"
        return PairVerdict(number, Pair.NOT_SEPARABLE, chance, text), poles
    text = f"two poles fit better than one (p = {chance:.2g})"
    return PairVerdict(number, Pair.RESOLVED, chance, text), two.poles[
        np.argsort(np.abs(two.poles))
    ]


def _searched(order: OrderFrf, pole: complex, found: PoleFit) -> PoleFit:
    """Best of some pairs around one pole whose members are damped alike, if any is better.

    Turning a tyre turns its modes: the members of a pair differ in frequency, hardly in damping.
    """
    fits = [fit_order(order, start, damping_reach=_ALIKE) for start in _beside(pole)]
    best = min(fits, key=lambda fit: fit.chi_square)
    return best if best.chi_square < _MUCH_WORSE * found.chi_square else found


def _beside(pole: complex) -> list[NDArray[np.complex128]]:
    """Two poles split evenly around one, and the one with another above or below it."""
    width = -pole.real
    shifts = ((-0.5j, 0.5j), (0.0, 1.0j), (0.0, -1.0j))
    return [np.asarray(pole + width * (0.1 + np.array(pair))) for pair in shifts]


def _chance(one: PoleFit, two: PoleFit, correlation: float) -> float:
    """Likelihood-ratio test with the noise as large as the better fit leaves it."""
    scale = correlation * max(two.misfit, 1.0)
    freedom = 2 + 2 * one.lines.scale.size
    return float(chdtrc(freedom, max(one.chi_square - two.chi_square, 0.0) / scale))


def _doubt(two: PoleFit, correlation: float, settings: IdentificationSettings) -> str:
    """Why two fitted poles cannot be taken for a pair; empty where they can."""
    covariance = parameter_covariance(two, correlation)
    gap = abs(two.poles[1].imag - two.poles[0].imag)
    spread = np.sqrt(max(covariance[1, 1] + covariance[3, 3] - 2 * covariance[1, 3], 0.0))
    damping = -two.poles.real
    strength = np.linalg.norm(two.residues, axis=0)
    if np.any(two.at_bound[1::2]):
        return "its frequency cannot be determined"
    if gap < settings.pair_separation_std * spread:
        return f"the two frequencies differ by only {gap / spread:.1f} standard deviations"
    unlike = damping.max() / damping.min()
    if unlike > settings.pair_damping_factor:
        return f"the two dampings would differ by a factor of {unlike:.1f}"
    share = strength.min() / strength.max()
    if share < settings.pair_weakest_share:
        return f"the weaker one has only {100 * share:.1f} % of the stronger"
    return ""


# Half-widths of a resonance that its own fit looks at, and the fewest lines for it.
_REACH = 6.0
_FEWEST_LINES = 12


@dataclass(frozen=True, eq=False)
class OrderFrf:
    """The part of the FRFs that goes with cos nθ and sin nθ.

    Parameters
    ----------
    order : int
    frequency_hz : ndarray, shape (n_frequencies,)
    values : ndarray of complex, shape (2, n_frequencies)
        Amplitudes of cos nθ and sin nθ; one row for n = 0.
    std : ndarray, shape (2, n_frequencies)
        Standard deviation per quadrature.
    """

    order: int
    frequency_hz: Real
    values: Complex
    std: Real


class OrderDecomposition:
    """FRFs of a circle of positions, resolved into circumferential orders.

    The spatial Fourier transform where the positions are complete and equidistant, least squares
    where some are missing.

    Parameters
    ----------
    frf : FRF
        With angles.
    """

    def __init__(self, frf: FRF) -> None:
        self._frf = frf
        self.highest = highest_order(frf.position_deg)
        self._inverse = np.linalg.pinv(circle_basis(frf.position_deg, self.highest))

    def order(
        self, order: int, lines: slice | NDArray[np.int_], values: Complex | None = None
    ) -> OrderFrf:
        """Resolve one order from the FRFs, or from other `values` on the same lines."""
        rows = self._inverse[[0]] if order == 0 else self._inverse[2 * order - 1 : 2 * order + 1]
        measured = self._frf.values[:, lines] if values is None else values
        variance = np.square(rows) @ np.square(self._frf.std[:, lines])
        return OrderFrf(order, self._frf.frequency_hz[lines], rows @ measured, np.sqrt(variance))


def fit_order(
    order: OrderFrf, start: Complex, *, damping_reach: float = 4.0, tries: int = 30
) -> PoleFit:
    """Fit the poles of one order to its own FRFs, around their resonance.

    Parameters
    ----------
    order : OrderFrf
    start : ndarray of complex, shape (n_modes,)
        One pole, or the two of a pair.
    damping_reach : float
        Factor within which the damping stays around the start.
    tries : int
        Most steps of the search.

    Raises
    ------
    FitError
        If too few lines lie around the resonance.
    """
    centre_hz = float(np.mean(np.abs(start))) / (2 * np.pi)
    half_width_hz = float(np.max(-start.real)) / (2 * np.pi)
    spread_hz = float(np.ptp(np.abs(start))) / (2 * np.pi)
    near = np.abs(order.frequency_hz - centre_hz) < _REACH * half_width_hz + spread_hz
    if np.count_nonzero(near) < _FEWEST_LINES:
        raise FitError(f"only {np.count_nonzero(near)} lines around order {order.order}.")
    level = np.sqrt(np.mean(order.std[:, near] ** 2, axis=1))
    known = bool(np.all(np.isfinite(level)) and np.all(level > 0))
    lines = Lines(
        frequency_hz=order.frequency_hz[near],
        values=order.values[:, near],
        weight=np.ones(np.count_nonzero(near)),
        scale=1 / level if known else np.ones(level.size),
        run=np.zeros(level.size, dtype=int),
        importance=np.ones(np.count_nonzero(near)),
    )
    decay, frequency = -start.real, start.imag
    lower = np.column_stack([decay / damping_reach, frequency - 2 * decay]).ravel()
    upper = np.column_stack([decay * damping_reach, frequency + 2 * decay]).ravel()
    return fit_poles(lines, start, lower, upper, tries=tries)


def resolve_orders(
    frf: FRF,
    lines: slice,
    fit: PoleFit,
    modes: Sequence[Mode],
    band_hz: tuple[float, float],
    correlation: float,
    settings: IdentificationSettings = IDENTIFICATION,
) -> tuple[NDArray[np.complex128], tuple[OrderReport, ...], bool]:
    """Decide for every order of the ring whether its pair is resolved.

    Parameters
    ----------
    frf : FRF
        Of a closed circle of positions, with known noise.
    lines : slice
        Lines of the fit.
    fit : PoleFit
    modes : sequence of Mode
        One for each pole of the fit, with orders.
    band_hz : tuple of float
        Band of the result; orders outside are left as they are.
    correlation : float
        From `ema.fitting.covariance.line_correlation`.

    Returns
    -------
    poles : ndarray of complex
        Poles to fit with: those of the fit, with single poles replaced by pairs or the reverse.
    reports : tuple of OrderReport
    changed : bool
        Whether a pole was added or taken away.
    """
    values = _in_one_state(fit)
    left = values - _synthesis(fit, range(fit.poles.size))
    decomposition = OrderDecomposition(frf)
    # Orders too high for these positions would pass for lower ones.
    untold = [k for k, mode in enumerate(modes) if mode.order is None]
    told = values - _synthesis(fit, untold, residual_terms=False)
    poles: list[complex] = [complex(pole) for pole in fit.poles]
    dropped: set[int] = set()
    reports = []
    for order, members in family(modes).items():
        if not band_hz[0] <= modes[members[0]].frequency_hz <= band_hz[1]:
            continue
        own = left + _synthesis(fit, members, residual_terms=False)
        alone = decomposition.order(order, lines, own)
        verdict, found = judge_pair(alone, fit.poles[members], correlation, settings)
        if found.size != len(members):
            dropped |= set(members)
            poles += [complex(pole) for pole in found]
        everything = decomposition.order(order, lines, told)
        reports.append(_by_itself(OrderReport(verdict), everything, found, correlation))
    kept = [pole for k, pole in enumerate(poles) if k not in dropped]
    return np.array(kept), tuple(reports), bool(dropped)


def _in_one_state(fit: PoleFit) -> NDArray[np.complex128]:
    """FRFs of all runs in the state of the first."""
    values = np.array(fit.lines.values)
    for rows, shift in zip(fit.groups, fit.drift, strict=True):
        if shift:
            values[rows] = stretched(fit.lines.frequency_hz, values[rows], 1 + shift)
    return values


def _synthesis(
    fit: PoleFit, members: Sequence[int], *, residual_terms: bool = True
) -> NDArray[np.complex128]:
    rows = list(members)
    terms = (fit.lower, fit.upper) if residual_terms else (0 * fit.lower, 0 * fit.upper)
    return synthesise(fit.lines.frequency_hz, fit.poles[rows], fit.residues[:, rows], *terms)


def _by_itself(
    report: OrderReport, order: OrderFrf, poles: NDArray[np.complex128], correlation: float
) -> OrderReport:
    try:
        fit = fit_order(order, poles)
    except FitError:
        return report
    covariance = parameter_covariance(fit, correlation)
    std = np.sqrt(np.diag(frequency_damping_covariance(fit.poles, covariance)))
    main = int(np.argmax(np.linalg.norm(fit.residues, axis=0)))
    pole = fit.poles[main]
    return replace(
        report,
        frequency_hz=float(abs(pole) / (2 * np.pi)),
        frequency_std_hz=float(std[2 * main]),
        damping_ratio=float(-pole.real / abs(pole)),
        damping_std=float(std[2 * main + 1]),
    )
