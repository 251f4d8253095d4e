"""Curve fit: from the poles of the stability diagram to modes with residues and error bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.band_ends import band_shift
from ema.circumference import label_modes, on_circle
from ema.covariance import (
    frequency_damping_covariance,
    line_correlation,
    parameter_covariance,
    residue_std,
)
from ema.errors import FitError
from ema.family import family, judged
from ema.frf import FRF
from ema.leakage import leakage_bias
from ema.mac import frac
from ema.modes import NO_DRIFT, Drift, ModalModel, Mode, ResidualTerms
from ema.noise import noise_level
from ema.pole_fit import N_STAND_INS, Lines, PoleFit, evaluate, fit_poles
from ema.resolution import OrderReport, resolve_orders
from ema.stability import PoleSelection, widened_band

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
# A drift is taken for real when chance would show it once in 10 000 campaigns.
_DRIFT_CHANCE = 1e-4
# So is a mode, by the size of its residues.
_RESIDUE_CHANCE = 1e-4
_LEAKAGE_ROUNDS = 2
_PAIR_ROUNDS = 3


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
    start = _starting_poles(selection.poles, lines, band_hz)
    plain = fit_bounded(lines, start)
    seen = _drift_seen(frf, plain)
    drift = seen.percent / 100 if seen.applied else None
    if seen.applied:
        plain = fit_bounded(lines, plain.poles, drift, start)
    fit, notes = _without_leakage(frf, plain, start)
    refit = _Refit(frf, lines, drift)
    if not selection.pinned:
        fit, notes = _significant(refit, fit, notes, band_hz)
    if not on_circle(frf.position_deg):
        return _model(frf, fit, band_hz, notes, (), seen)
    chosen, correlation = widened_band(frf, band_hz), line_correlation(frf.blocks)
    reports: tuple[OrderReport, ...] = ()
    for _ in range(_PAIR_ROUNDS):
        labelled = label_modes(_modes(fit), frf.position_deg)[:-N_STAND_INS]
        poles, reports, changed = resolve_orders(frf, chosen, fit, labelled, band_hz, correlation)
        changed = changed and not selection.pinned
        if changed:
            fit, notes = refit(_last(poles, fit))
            labelled = label_modes(_modes(fit), frf.position_deg)[:-N_STAND_INS]
        if _pairs(labelled) != fit.pairs:
            fit, notes = refit(fit.poles, _pairs(labelled))
        if not changed:
            break
    return _model(frf, fit, band_hz, notes, reports, seen)


@dataclass(frozen=True, eq=False)
class _Refit:
    """The same fit from other poles."""

    frf: FRF
    lines: Lines
    drift: NDArray[np.float64] | None

    def __call__(
        self, poles: NDArray[np.complex128], pairs: tuple[tuple[int, int], ...] = ()
    ) -> tuple[PoleFit, list[str]]:
        known = pairs if np.all(np.isfinite(self.frf.std)) else ()
        fit = fit_bounded(self.lines, poles, self.drift, pairs=known)
        return _without_leakage(self.frf, fit, poles)


def _pairs(labelled: Sequence[Mode]) -> tuple[tuple[int, int], ...]:
    """Poles that are the two members of one order of the ring."""
    members = [sorted(chosen) for chosen in family(labelled).values() if len(chosen) == 2]
    return tuple((first, second) for first, second in sorted(members))


def _significant(
    refit: _Refit, fit: PoleFit, notes: list[str], band_hz: tuple[float, float]
) -> tuple[PoleFit, list[str]]:
    """Fit without the poles of the band whose residues are no larger than their uncertainty.

    A pole may be stable from model order to model order and yet be only a wiggle of the noise.
    """
    from scipy.stats import chi2

    correlation = line_correlation(refit.frf.blocks)
    std = residue_std(fit, parameter_covariance(fit, correlation), correlation)
    size = np.sum(np.abs(fit.residues) ** 2 / std**2, axis=0)
    frequency_hz = np.abs(fit.poles) / (2 * np.pi)
    inside = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    inside[-N_STAND_INS:] = False
    noise = inside & ~(chi2.sf(size, 2 * fit.lines.scale.size) < _RESIDUE_CHANCE)
    if not np.any(noise) or np.all(noise | ~inside):
        return fit, notes
    again, notes = refit(fit.poles[~noise])
    dropped = [
        f"The pole at {hz:.2f} Hz was dropped: its residues are no larger than their uncertainty."
        for hz in frequency_hz[noise]
    ]
    return again, notes + dropped


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


def drift_in_one_step(fit: PoleFit, run: tuple[str, ...], correlation: float) -> Drift:
    """Drift of the runs, one Gauss–Newton step away from a common state, tested against chance."""
    from scipy.stats import chi2

    apart = evaluate(fit.lines, fit.poles, np.zeros(fit.lines.n_runs))
    own = slice(2 * fit.poles.size, None)
    covariance = parameter_covariance(apart, correlation)[own, own]
    step = -np.linalg.lstsq(apart.normal_matrix(), apart.gradient(), rcond=1e-12)[0][own]
    size = float(step @ np.linalg.pinv(covariance, rcond=1e-10) @ step)
    chance = float(chi2.sf(size, step.size))
    std = np.sqrt(np.diag(covariance))
    percent = 100 * np.append(0.0, step), 100 * np.append(0.0, std)
    return Drift(run, *percent, applied=chance < _DRIFT_CHANCE, chance=chance)


def _drift_seen(frf: FRF, fit: PoleFit) -> Drift:
    if fit.lines.n_runs < 2 or not np.all(np.isfinite(frf.std)):
        return NO_DRIFT
    return drift_in_one_step(fit, frf.run_names, line_correlation(frf.blocks))


def _starting_poles(
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
    return _with_stand_in(poles[in_band | shown], lines)


def _with_stand_in(poles: NDArray[np.complex128], lines: Lines) -> NDArray[np.complex128]:
    omega = 2 * np.pi * lines.frequency_hz[-1] * np.array(_STAND_INS)
    return np.append(poles, omega * (-_STAND_IN_DAMPING + 1j))


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


def _without_leakage(
    frf: FRF, plain: PoleFit, around: NDArray[np.complex128]
) -> tuple[PoleFit, list[str]]:
    """Fit again, for averaged blocks, with the bias of the window taken out of the FRFs."""
    if frf.blocks is None or frf.blocks.n_blocks < 2:
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


def _last(poles: NDArray[np.complex128], fit: PoleFit) -> NDArray[np.complex128]:
    """Poles with the stand-ins of a fit at the end, where they belong."""
    stand_ins = fit.poles[-N_STAND_INS:]
    others = poles[~np.isin(poles, stand_ins)]
    return np.append(others[np.argsort(np.abs(others))], stand_ins)


def _model(
    frf: FRF,
    fit: PoleFit,
    band_hz: tuple[float, float],
    notes: list[str],
    reports: tuple[OrderReport, ...],
    seen: Drift,
) -> ModalModel:
    correlation = line_correlation(frf.blocks)
    covariance = parameter_covariance(fit, correlation)
    both = frequency_damping_covariance(fit.poles, covariance)
    modes = _with_band_shift(_modes(fit, both, residue_std(fit, covariance, correlation)), fit)
    ascending = np.argsort(np.abs(fit.poles))
    inside = [r for r in ascending if band_hz[0] <= modes[r].frequency_hz <= band_hz[1]]
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


def _modes(
    fit: PoleFit,
    covariance: NDArray[np.float64] | None = None,
    residues_std: NDArray[np.float64] | None = None,
) -> list[Mode]:
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
            status="at bound" if np.any(bound[r]) else "ok",
        )
        for r, pole in enumerate(fit.poles)
    ]


def _with_band_shift(modes: list[Mode], fit: PoleFit) -> list[Mode]:
    drift = fit.drift if fit.drift.size > 1 else None

    def refit(lines: Lines, poles: NDArray[np.complex128]) -> PoleFit:
        return fit_bounded(lines, _with_stand_in(poles, lines), drift)

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
