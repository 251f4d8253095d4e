"""Curve fit: from the poles of the stability diagram to modes with residues and error bars."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ema.circumference import label_modes
from ema.covariance import (
    frequency_damping_covariance,
    line_correlation,
    pole_covariance,
    residue_std,
)
from ema.errors import FitError
from ema.frf import FRF
from ema.leakage import leakage_bias
from ema.mac import frac
from ema.modes import ModalModel, Mode, ResidualTerms
from ema.stability import PoleSelection, widened_band
from ema.variable_projection import Projection, fit_poles

# Bounds around the poles of LSCE: the fit refines them, it does not look for others.
_FREQUENCY_REACH = 0.01  # share of the frequency, or the damping ratio where that is larger
_DAMPING_REACH = 4.0  # factor
# One free pole just above the lines stands for all modes farther up: two residual terms alone
# cost 0.6 % of damping in the lowest mode of a tyre.
_STAND_IN_START, _STAND_IN_REACH = 1.05, (1.005, 1.25)
_STAND_IN_DAMPING = 0.02
# Lines over which the noise level is smoothed: σ of one line is itself uncertain.
_SMOOTHING_LINES = 21
# A correction for random excitation that fits worse than this shows that it was not random.
_WORSE = 1.05


@dataclass(frozen=True, eq=False)
class _Task:
    """The lines and weights of one fit."""

    frequency_hz: NDArray[np.float64]
    values: NDArray[np.complex128]
    weight: NDArray[np.float64]
    scale: NDArray[np.float64]

    @property
    def omega(self) -> NDArray[np.float64]:
        return 2 * np.pi * self.frequency_hz


@dataclass(frozen=True, eq=False)
class _Fit:
    """Outcome of one fit; the last pole is the stand-in for modes above."""

    task: _Task
    solution: Projection
    at_bound: NDArray[np.bool_]

    @property
    def misfit(self) -> float:
        """Reduced χ²."""
        weighted = self.solution.misfit * self.task.scale
        n_linear = weighted.shape[1] * (2 * self.solution.poles.size + 2)
        return float(np.sum(weighted**2) / max(weighted.size - n_linear, 1))


def fit_modes(
    frf: FRF, poles: PoleSelection | ArrayLike, band_hz: tuple[float, float] | None = None
) -> ModalModel:
    """Fit poles, residues and residual terms to all FRFs at once.

    Weighted least squares with 1/σ, the noise level of the FRFs over frequency and position;
    poles move within bounds around their start values. Where the FRFs come from blocks of a
    random excitation, the bias of the window is taken out if that fits better.

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
    task = _task(frf, band_hz)
    start = _starting_poles(selection.poles, task, band_hz)
    fit, notes = _fit_without_leakage(frf, task, start)
    return _model(frf, fit, band_hz, notes)


def _task(frf: FRF, band_hz: tuple[float, float]) -> _Task:
    lines = widened_band(frf, band_hz)
    level = _noise_level(frf, lines)
    common = np.exp(np.mean(np.log(level), axis=0))
    own = np.exp(np.mean(np.log(level / common), axis=1))
    return _Task(frf.frequency_hz[lines], frf.values[:, lines], 1 / common, 1 / own)


def _noise_level(frf: FRF, lines: slice) -> NDArray[np.float64]:
    """Standard deviation to weigh each line with, smoothed, (n_positions, n_frequencies).

    Where it is unknown, lines are taken as equally good relative to the FRFs around them.
    """
    from scipy.ndimage import uniform_filter1d

    known = np.all(np.isfinite(frf.std[:, lines]))
    power = (
        frf.std[:, lines] ** 2
        if known
        else np.broadcast_to(
            np.mean(np.abs(frf.values[:, lines]) ** 2, axis=0), frf.values[:, lines].shape
        )
    )
    smooth = uniform_filter1d(power, _SMOOTHING_LINES, axis=1, mode="nearest")
    floor = 1e-12 * np.max(np.abs(frf.values[:, lines])) ** 2
    return np.asarray(np.sqrt(np.maximum(smooth, max(floor, np.finfo(float).tiny))))


def _starting_poles(
    poles: NDArray[np.complex128], task: _Task, band_hz: tuple[float, float]
) -> NDArray[np.complex128]:
    """Poles that the lines show on both sides, and the stand-in for everything above."""
    frequency_hz = np.abs(poles) / (2 * np.pi)
    low, high = task.frequency_hz[[0, -1]]
    half_width_hz = -poles.real / (2 * np.pi)
    in_band = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    shown = (frequency_hz - low > half_width_hz) & (high - frequency_hz > half_width_hz)
    if not np.any(in_band):
        raise FitError(
            f"no pole between {band_hz[0]:g} and {band_hz[1]:g} Hz to start the curve fit from. "
            "Pin frequencies or change the band."
        )
    omega = 2 * np.pi * high * _STAND_IN_START
    stand_in = omega * (-_STAND_IN_DAMPING + 1j)
    return np.append(poles[in_band | shown], stand_in)


def _bounds(
    start: NDArray[np.complex128], highest_hz: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    decay, frequency = -start.real, start.imag
    reach = np.maximum(_FREQUENCY_REACH, decay / frequency) * frequency
    lower = np.column_stack([decay / _DAMPING_REACH, frequency - reach])
    upper = np.column_stack([decay * _DAMPING_REACH, frequency + reach])
    lower[-1, 1], upper[-1, 1] = 2 * np.pi * highest_hz * np.array(_STAND_IN_REACH)
    return lower.ravel(), upper.ravel()


def _fit(task: _Task, start: NDArray[np.complex128]) -> _Fit:
    lower, upper = _bounds(start, task.frequency_hz[-1])
    solution, at_bound = fit_poles(
        task.omega, task.values, task.weight, task.scale, start, lower, upper
    )
    return _Fit(task, solution, at_bound)


def _fit_without_leakage(
    frf: FRF, task: _Task, start: NDArray[np.complex128]
) -> tuple[_Fit, list[str]]:
    """Fit as measured and, for averaged blocks, with the bias of the window taken out."""
    plain = _fit(task, start)
    if frf.blocks is None or frf.blocks.n_blocks < 2:
        return plain, []
    corrected = plain
    for _ in range(2):
        bias = leakage_bias(
            frf.blocks,
            task.frequency_hz,
            corrected.solution.poles[:-1],
            corrected.solution.residues[:, :-1],
        )
        cleared = replace(task, values=task.values - bias)
        corrected = _fit(cleared, np.append(corrected.solution.poles[:-1], start[-1]))
    if corrected.misfit > _WORSE * plain.misfit:
        return plain, ["The bias of window and block length was left in: taking it out fits worse."]
    return corrected, ["The bias of window and block length was taken out of the curve fit."]


def _model(frf: FRF, fit: _Fit, band_hz: tuple[float, float], notes: list[str]) -> ModalModel:
    solution, task = fit.solution, fit.task
    correlation = line_correlation(frf.blocks)
    run = np.unique(np.asarray(frf.run), return_inverse=True)[1]
    covariance = pole_covariance(solution, task.scale, run, correlation)
    noise = np.sqrt(np.mean(solution.misfit**2, axis=0))
    spread = residue_std(solution, covariance, noise, correlation)
    both = frequency_damping_covariance(solution.poles, covariance)
    std = np.sqrt(np.diag(both)).reshape(-1, 2)
    bound = fit.at_bound.reshape(-1, 2)
    modes = [
        Mode(
            pole=complex(pole),
            frequency_std_hz=float(std[r, 0]),
            damping_std=float(std[r, 1]),
            residues=solution.residues[:, r],
            residues_std=spread[:, r],
            status="at bound" if np.any(bound[r]) else "ok",
        )
        for r, pole in enumerate(solution.poles)
    ]
    ascending = np.argsort(np.abs(solution.poles))
    inside = [r for r in ascending if band_hz[0] <= modes[r].frequency_hz <= band_hz[1]]
    if not inside:
        raise FitError("all poles left the band during the curve fit. Pin frequencies.")
    rows = np.ravel([[2 * r, 2 * r + 1] for r in inside])
    model = ModalModel(
        modes=label_modes([modes[r] for r in inside], frf.position_deg),
        guard_modes=tuple(modes[r] for r in ascending if r not in inside),
        residual_terms=ResidualTerms(solution.lower, solution.upper),
        band_hz=band_hz,
        fit_band_hz=(float(task.frequency_hz[0]), float(task.frequency_hz[-1])),
        covariance=both[np.ix_(rows, rows)],
        frac=np.zeros(frf.n_positions),
        misfit=fit.misfit if np.all(np.isfinite(frf.std)) else float("nan"),
        node=frf.node,
        position_deg=frf.position_deg,
        notes=tuple(notes),
    )
    return replace(model, frac=frac(task.values, model.synthesise(task.frequency_hz)))
