"""Resolution of mode pairs, order by order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.circumference.ring_modes import family
from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.modes import Mode, OrderReport, synthesise
from ema.fitting.covariance import frequency_damping_covariance, parameter_covariance
from ema.fitting.mode_pairs import OrderDecomposition, OrderFrf, fit_order, judge_pair
from ema.fitting.pole_fit import PoleFit
from ema.poles.run_alignment import stretched


def resolve_orders(
    frf: FRF,
    lines: slice,
    fit: PoleFit,
    modes: Sequence[Mode],
    band_hz: tuple[float, float],
    correlation: float,
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
        verdict, found = judge_pair(alone, fit.poles[members], correlation)
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
