"""Curve fit: from the poles of the stability diagram to modes with residues and error bars."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.band_ends import band_shift
from ema.bounded_fit import (
    fit_bounded,
    lines_to_fit,
    starting_poles,
    with_stand_ins,
    without_leakage,
)
from ema.chance import chi_square_tail
from ema.circumference import label_modes, on_circle
from ema.covariance import (
    frequency_damping_covariance,
    line_correlation,
    parameter_covariance,
    residue_std,
)
from ema.errors import FitError
from ema.family import judged
from ema.frf import FRF
from ema.mac import frac
from ema.modes import NO_DRIFT, Drift, ModalModel, Mode, ResidualTerms
from ema.pole_fit import Lines, PoleFit, evaluate
from ema.pole_selection import PoleSelection
from ema.pole_set import Refit, modes_of, pairs_of, settled, significant
from ema.resolution import OrderReport
from ema.threads import one_blas_thread

# A drift is taken for real when chance would show it once in 10 000 campaigns.
_DRIFT_CHANCE = 1e-4


@one_blas_thread
def fit_modes(
    frf: FRF, poles: PoleSelection | ArrayLike, band_hz: tuple[float, float] | None = None
) -> ModalModel:
    """Fit poles, residues and residual terms to all FRFs at once.

    Weighted least squares with 1/σ, the noise level of the FRFs over frequency and position;
    poles move within bounds around their start values. Where the FRFs come from blocks of a
    random excitation, the bias of the window is taken out. Where the natural frequencies differ
    from run to run by more than chance, each run gets its own state: shapes stay common, all
    frequencies of a run move together, and the result is that of the first run.

    Parameters
    ----------
    frf : FRF
    poles : PoleSelection or array_like of complex
        From `select_poles`, or poles in rad/s.
    band_hz : tuple of float, optional
        Band of the result; the selection's own by default.

    Returns
    -------
    ModalModel

    Raises
    ------
    FitError
        If no pole lies in the band or the fit diverges.
    """
    selection = poles if isinstance(poles, PoleSelection) else PoleSelection.around(poles)
    band_hz = band_hz or selection.band_hz
    lines = lines_to_fit(frf, band_hz)
    start = starting_poles(selection.fitted, lines, band_hz)
    pairs = pairs_of(evaluate(lines, start, np.zeros(1)), frf)
    plain = fit_bounded(lines, start, pairs=pairs)
    seen = _drift_seen(frf, plain)
    drift = seen.percent / 100 if seen.applied else None
    if seen.applied:
        plain = fit_bounded(lines, plain.poles, drift, start, pairs)
    fit, notes = without_leakage(frf, plain, start)
    refit = Refit(frf, lines, drift)
    if not selection.pinned:
        fit, notes = significant(refit, fit, notes, band_hz)
    reports: tuple[OrderReport, ...] = ()
    if on_circle(frf.position_deg):
        fit, notes, reports = settled(refit, fit, notes, band_hz, pinned=selection.pinned)
    return _model(frf, fit, selection, band_hz, notes, reports, seen)


def drift_in_one_step(fit: PoleFit, run: tuple[str, ...], correlation: float) -> Drift:
    """Drift of the runs, one Gauss–Newton step away from a common state, tested against chance."""
    apart = evaluate(fit.lines, fit.poles, np.zeros(fit.lines.n_runs))
    own = slice(2 * fit.poles.size, None)
    covariance = parameter_covariance(apart, correlation)[own, own]
    step = -np.linalg.lstsq(apart.normal_matrix(), apart.gradient(), rcond=1e-12)[0][own]
    size = float(step @ np.linalg.pinv(covariance, rcond=1e-10) @ step)
    chance = float(chi_square_tail(size, step.size))
    std = np.sqrt(np.diag(covariance))
    percent = 100 * np.append(0.0, step), 100 * np.append(0.0, std)
    return Drift(run, *percent, applied=chance < _DRIFT_CHANCE, chance=chance)


def _drift_seen(frf: FRF, fit: PoleFit) -> Drift:
    if fit.lines.n_runs < 2 or not np.all(np.isfinite(frf.std)):
        return NO_DRIFT
    return drift_in_one_step(fit, frf.run_names, line_correlation(frf.blocks))


def _model(
    frf: FRF,
    fit: PoleFit,
    selection: PoleSelection,
    band_hz: tuple[float, float],
    notes: list[str],
    reports: tuple[OrderReport, ...],
    seen: Drift,
) -> ModalModel:
    correlation = line_correlation(frf.blocks)
    covariance = parameter_covariance(fit, correlation)
    both = frequency_damping_covariance(fit.poles, covariance)
    modes = _with_band_shift(modes_of(fit, both, residue_std(fit, covariance, correlation)), fit)
    ascending = np.argsort(np.abs(fit.poles))
    aside = selection.is_aside(np.array([mode.pole for mode in modes]))
    in_band = [r for r in ascending if band_hz[0] <= modes[r].frequency_hz <= band_hz[1]]
    inside = [r for r in in_band if not aside[r]]
    without = [f"{modes[r].frequency_hz:.1f}" for r in in_band if aside[r]]
    if without:
        listed = ", ".join(without)
        notes = [
            *notes,
            f"Left out by pinning or excluding, but fitted with the rest: {listed} Hz.",
        ]
    if not inside:
        raise FitError("all poles left the band during the curve fit. Pin frequencies.")
    rows = np.ravel([[2 * r, 2 * r + 1] for r in inside])
    model = ModalModel(
        modes=judged(label_modes([modes[r] for r in inside], frf.position_deg), reports),
        guard_modes=tuple(modes[r] for r in ascending if r not in inside),
        residual_terms=ResidualTerms(fit.lower, fit.upper),
        band_hz=band_hz,
        fit_band_hz=(float(fit.lines.frequency_hz[0]), float(fit.lines.frequency_hz[-1])),
        covariance=both[np.ix_(rows, rows)],
        frac=np.zeros(frf.n_positions),
        misfit=fit.misfit if np.all(np.isfinite(frf.std)) else float("nan"),
        node=frf.node,
        position_deg=frf.position_deg,
        drift=_drift(seen, fit, covariance),
        orders=reports,
        notes=tuple(notes),
    )
    measured = model.synthesise(fit.lines.frequency_hz, run=frf.run)
    return replace(model, frac=frac(fit.lines.values, measured))


def _with_band_shift(modes: list[Mode], fit: PoleFit) -> list[Mode]:
    drift = fit.drift if fit.drift.size > 1 else None

    def refit(lines: Lines, poles: NDArray[np.complex128]) -> PoleFit:
        return fit_bounded(lines, with_stand_ins(poles, lines), drift)

    shifts = band_shift(fit, refit)
    return [
        replace(mode, frequency_band_shift_hz=float(hz), damping_band_shift=float(ratio))
        for mode, (hz, ratio) in zip(modes, shifts, strict=True)
    ]


def _drift(seen: Drift, fit: PoleFit, covariance: NDArray[np.float64]) -> Drift:
    if not seen.applied or fit.drift.size == 1:
        return seen
    std = np.sqrt(np.diag(covariance))[2 * fit.poles.size :]
    return replace(seen, percent=100 * fit.drift, std_percent=100 * np.append(0.0, std))
