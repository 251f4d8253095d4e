"""Curve fit: from the poles of the stability diagram to modes with residues and error bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc

from ema.circumference.orders import label_modes, on_circle
from ema.circumference.ring_modes import PURE, family, judged
from ema.core.bands import widened_band
from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.mac import frac
from ema.core.modes import NO_DRIFT, Drift, Flag, ModalModel, Mode, OrderReport, ResidualTerms
from ema.core.numerics import one_blas_thread
from ema.fitting.covariance import (
    band_shift,
    frequency_damping_covariance,
    line_correlation,
    parameter_covariance,
    residue_std,
)
from ema.fitting.pole_fit import (
    N_STAND_INS,
    Lines,
    PoleFit,
    evaluate,
    fit_bounded,
    lines_to_fit,
    starting_poles,
    with_stand_ins,
    without_leakage,
)
from ema.fitting.resolution import resolve_orders
from ema.poles.selection import PoleSelection

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

    Examples
    --------
    >>> import numpy as np
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(np.arange(0, 72, 6))  # every 30°, to be quick
    >>> model = rm.fit_modes(frf, rm.select_poles(rm.build_stability(frf)))
    >>> f"{model.modes[1].frequency_hz:.1f} ± {model.modes[1].frequency_std_hz:.2f} Hz"
    '100.3 ± 0.01 Hz'
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
    chance = float(chdtrc(step.size, size))
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


# A mode is taken for real when chance would show residues as large once in 10 000 campaigns.
_RESIDUE_CHANCE = 1e-4
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Refit:
    """The same fit from other poles."""

    frf: FRF
    lines: Lines
    drift: NDArray[np.float64] | None

    def __call__(self, poles: NDArray[np.complex128]) -> tuple[PoleFit, list[str]]:
        """Fit from other poles, and what is to be said about it."""
        shift = np.zeros(1) if self.drift is None else self.drift
        pairs = pairs_of(evaluate(self.lines, poles, shift), self.frf)
        fit = fit_bounded(self.lines, poles, self.drift, pairs=pairs)
        return without_leakage(self.frf, fit, poles)


def settled(
    refit: Refit, fit: PoleFit, notes: list[str], band_hz: tuple[float, float], *, pinned: bool
) -> tuple[PoleFit, list[str], tuple[OrderReport, ...]]:
    """Fit of a closed circle with the poles that its orders ask for.

    Until nothing changes: members of pairs are added or merged, poles that ran astray dropped, and
    the members of pairs share what is known of their damping. Pinned poles stay as they are.

    Returns
    -------
    fit : PoleFit
    notes : list of str
    reports : tuple of OrderReport
    """
    frf = refit.frf
    chosen, correlation = widened_band(frf, band_hz), line_correlation(frf.blocks)
    reports: tuple[OrderReport, ...] = ()
    for _ in range(_ROUNDS):
        labelled = _labelled(fit, frf)
        astray = _astray(labelled, fit)
        if np.any(astray) and not pinned:
            fit, notes = refit(fit.poles[~astray])
            continue
        poles, reports, changed = resolve_orders(frf, chosen, fit, labelled, band_hz, correlation)
        if changed and not pinned:
            fit, notes = refit(_last(poles, fit))
            continue
        if pairs_of(fit, frf) == fit.pairs:
            break
        fit, notes = refit(fit.poles)
    return fit, notes, reports


def _labelled(fit: PoleFit, frf: FRF) -> tuple[Mode, ...]:
    return label_modes(modes_of(fit), frf.position_deg)[:-N_STAND_INS]


def _astray(labelled: Sequence[Mode], fit: PoleFit) -> NDArray[np.bool_]:
    """Poles that ran to a bound of their damping and took on a shape of no single order.

    A surplus pole ends like this: it explains a little of everything.
    """
    astray = np.zeros(fit.poles.size, dtype=bool)
    impure = np.array([mode.order_purity < PURE for mode in labelled], dtype=bool)
    astray[: impure.size] = impure & fit.at_bound[0 : 2 * impure.size : 2]
    return astray


def pairs_of(fit: PoleFit, frf: FRF) -> tuple[tuple[int, int], ...]:
    """Poles that are the two members of one order; none without a circle or with unknown noise."""
    if not on_circle(frf.position_deg) or not np.all(np.isfinite(frf.std)):
        return ()
    members = family(_labelled(fit, frf)).values()
    pairs = [sorted(chosen) for chosen in members if len(chosen) == 2]
    return tuple((first, second) for first, second in sorted(pairs))


def _last(poles: NDArray[np.complex128], fit: PoleFit) -> NDArray[np.complex128]:
    """Poles with the stand-ins of a fit at the end, where they belong."""
    stand_ins = fit.poles[-N_STAND_INS:]
    others = poles[~np.isin(poles, stand_ins)]
    return np.append(others[np.argsort(np.abs(others))], stand_ins)


def significant(
    refit: Refit, fit: PoleFit, notes: list[str], band_hz: tuple[float, float]
) -> tuple[PoleFit, list[str]]:
    """Fit without the poles of the band whose residues are no larger than their uncertainty.

    A pole may be stable from model order to model order and yet be only a wiggle of the noise. Of
    two that share a resonance, neither may be determined: only the lesser one goes.
    """
    size = _residue_size(fit, line_correlation(refit.frf.blocks))
    frequency_hz = np.abs(fit.poles) / (2 * np.pi)
    inside = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    inside[-N_STAND_INS:] = False
    noise = inside & ~(chdtrc(2 * fit.lines.scale.size, size) < _RESIDUE_CHANCE)
    lesser = size[:, None] > size
    noise &= ~np.any(noise & _share_resonance(fit.poles) & lesser, axis=1)
    if not np.any(noise) or np.all(noise | ~inside):
        return fit, notes
    again, notes = refit(fit.poles[~noise])
    dropped = [
        f"The pole at {hz:.2f} Hz was dropped: its residues are no larger than their uncertainty."
        for hz in frequency_hz[noise]
    ]
    return again, notes + dropped


def _residue_size(fit: PoleFit, correlation: float) -> NDArray[np.float64]:
    """Residues of each pole over their standard deviations, squared and summed over positions.

    What is uncertain about a pole moves its residues at all positions together. Where two poles
    share a resonance this says nothing about whether both are there: they are judged at the poles
    found.
    """
    covariance = parameter_covariance(fit, correlation)
    alone = residue_std(fit, covariance, correlation)
    beside = residue_std(fit, np.zeros_like(covariance), correlation)
    std = np.where(np.any(_share_resonance(fit.poles), axis=1), beside, alone)
    return np.asarray(np.sum(np.abs(fit.residues) ** 2 / std**2, axis=0))


def _share_resonance(poles: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Which poles lie within the half-width of each other's resonance, (n_poles, n_poles)."""
    near = np.abs(poles[:, None] - poles) < np.minimum.outer(-poles.real, -poles.real)
    return np.asarray(near & ~np.eye(poles.size, dtype=bool))


def modes_of(
    fit: PoleFit,
    covariance: NDArray[np.float64] | None = None,
    residues_std: NDArray[np.float64] | None = None,
) -> list[Mode]:
    """Modes of all poles of a fit, in its order; standard deviations NaN where not given."""
    if covariance is None or residues_std is None:
        unknown = 2 * fit.poles.size
        covariance = np.full((unknown, unknown), np.nan)
        residues_std = np.full(fit.residues.shape, np.nan)
    std = np.sqrt(np.diag(covariance)).reshape(-1, 2)
    bound = fit.at_bound.reshape(-1, 2)
    residues = fit.residues
    return [
        Mode(
            pole=complex(pole),
            frequency_std_hz=float(std[r, 0]),
            damping_std=float(std[r, 1]),
            residues=residues[:, r],
            residues_std=residues_std[:, r],
            flags=(Flag.AT_BOUND,) if np.any(bound[r]) else (),
        )
        for r, pole in enumerate(fit.poles)
    ]
