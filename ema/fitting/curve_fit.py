"""Curve fit: from the poles of the stability diagram to modes with residues and error bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc

from ema.circumference.orders import label_modes, on_circle
from ema.circumference.ring_modes import PURE, family, judged
from ema.core.errors import FitError
from ema.core.frf import FRF, widened_band
from ema.core.mac import frac
from ema.core.modes import NO_DRIFT, Drift, Flag, ModalModel, Mode, OrderReport, ResidualTerms
from ema.core.numerics import one_blas_thread
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.fitting.covariance import (
    band_shift,
    frequency_damping_covariance,
    line_correlation,
    parameter_covariance,
    residue_std,
)
from ema.fitting.mode_pairs import resolve_orders
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
from ema.poles.selection import PoleSelection

# Rounds after which the poles of the orders have settled; more than two were never needed.
_ROUNDS = 4


@one_blas_thread
def fit_modes(
    frf: FRF,
    poles: PoleSelection | ArrayLike,
    band_hz: tuple[float, float] | None = None,
    settings: IdentificationSettings = IDENTIFICATION,
) -> ModalModel:
    """Fit poles, residues and residual terms to all FRFs at once.

    Weighted least squares with 1/σ, the noise level of the FRFs over frequency and position;
    poles move within bounds around their start values. Where the FRFs come from blocks of a
    random excitation, the bias of the window is compensated. Where the natural frequencies differ
    from run to run by more than chance, each run gets its own state: shapes stay common, all
    frequencies of a run move together, and the result is that of the first run.

    Parameters
    ----------
    frf : FRF
    poles : PoleSelection or array_like of complex
        From `select_poles`, or poles in rad/s.
    band_hz : tuple of float, optional
        Band of the result; the selection's own by default.
    settings : IdentificationSettings

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
    fit = CurveFit(frf, selection, band_hz or selection.band_hz, settings)
    fit.start()
    fit.follow_drift()
    fit.compensate_leakage()
    if not selection.pinned:
        fit.drop_insignificant()
    if on_circle(frf.position_deg):
        fit.settle_orders()
    return fit.modal_model()


class CurveFit:
    """State of one curve fit; each step replaces `fit`, the poles and residues so far.

    Parameters
    ----------
    frf : FRF
    selection : PoleSelection
        Where the poles start.
    band_hz : tuple of float
        Band of the result.
    settings : IdentificationSettings

    Attributes
    ----------
    lines : Lines
        What is fitted, with weights.
    fit : PoleFit
    drift : Drift
        Drift of the runs, and whether it is significant.
    leakage_notes, notes : list of str
    orders : tuple of OrderReport
    """

    def __init__(
        self,
        frf: FRF,
        selection: PoleSelection,
        band_hz: tuple[float, float],
        settings: IdentificationSettings,
    ) -> None:
        self.frf, self.selection, self.band_hz, self.settings = frf, selection, band_hz, settings
        self.lines = lines_to_fit(frf, band_hz)
        self.start_poles = starting_poles(selection.fitted, self.lines, band_hz)
        self.correlation = line_correlation(frf.blocks)
        self.drift: Drift = NO_DRIFT
        self.leakage_notes: list[str] = []
        self.notes: list[str] = []
        self.orders: tuple[OrderReport, ...] = ()

    def start(self) -> None:
        """Fit all runs in one state."""
        pairs = self._pairs(evaluate(self.lines, self.start_poles, np.zeros(1)))
        self.fit = fit_bounded(self.lines, self.start_poles, self.settings, pairs=pairs)

    def follow_drift(self) -> None:
        """Give each run its own state where the frequencies differ by more than chance."""
        if self.lines.n_runs < 2 or not np.all(np.isfinite(self.frf.std)):
            return
        limit = self.settings.drift_p_value
        self.drift = drift_in_one_step(self.fit, self.frf.run_names, self.correlation, limit)
        if self.drift.applied:
            self.fit = fit_bounded(
                self.lines,
                self.fit.poles,
                self.settings,
                self._shifts,
                self.start_poles,
                self.fit.pairs,
            )

    def compensate_leakage(self) -> None:
        """Fit again without the bias of window and block length."""
        self.fit, self.leakage_notes = without_leakage(
            self.frf, self.fit, self.start_poles, self.settings
        )

    def drop_insignificant(self) -> None:
        """Drop poles of the band whose residues are no larger than their uncertainty.

        A pole may be stable from model order to model order and yet be only a wiggle of the noise.
        Of two that share a resonance, neither may be determined: only the lesser one goes.
        """
        fit = self.fit
        size = _residue_size(fit, self.correlation)
        frequency_hz = np.abs(fit.poles) / (2 * np.pi)
        inside = (frequency_hz >= self.band_hz[0]) & (frequency_hz <= self.band_hz[1])
        inside[-N_STAND_INS:] = False
        p_value = chdtrc(2 * fit.lines.scale.size, size)
        noise = inside & ~(p_value < self.settings.residue_p_value)
        lesser = size[:, None] > size
        noise &= ~np.any(noise & _share_resonance(fit.poles) & lesser, axis=1)
        if not np.any(noise) or np.all(noise | ~inside):
            return
        self._refit(fit.poles[~noise])
        self.notes += [
            f"The pole at {hz:.2f} Hz was dropped: its residues are no larger than their "
            "uncertainty."
            for hz in frequency_hz[noise]
        ]

    def settle_orders(self) -> None:
        """Fit a closed circle with the poles that its orders need, until nothing changes.

        Members of pairs are added or merged, diverged poles dropped, and the members of pairs share
        what is known of their damping. Pinned poles stay as they are.
        """
        pinned = self.selection.pinned
        lines = widened_band(self.frf, self.band_hz)
        for _ in range(_ROUNDS):
            labelled = self._labelled(self.fit)
            diverged = _diverged(labelled, self.fit)
            if np.any(diverged) and not pinned:
                self._refit(self.fit.poles[~diverged])
                continue
            poles, self.orders, changed = resolve_orders(
                self.frf,
                lines,
                self.fit,
                labelled,
                self.band_hz,
                self.correlation,
                self.settings,
            )
            if changed and not pinned:
                self._refit(_stand_ins_last(poles, self.fit))
                continue
            if self._pairs(self.fit) == self.fit.pairs:
                break
            self._refit(self.fit.poles)

    def modal_model(self) -> ModalModel:
        """Modes of the band with their uncertainty."""
        fit, frf = self.fit, self.frf
        covariance = parameter_covariance(fit, self.correlation)
        both = frequency_damping_covariance(fit.poles, covariance)
        modes = modes_of(fit, both, residue_std(fit, covariance, self.correlation))
        modes = self._with_band_shift(modes)
        inside = self._wanted(modes)
        ascending = np.argsort(np.abs(fit.poles))
        rows = np.ravel([[2 * r, 2 * r + 1] for r in inside])
        named = label_modes([modes[r] for r in inside], frf.position_deg)
        model = ModalModel(
            modes=judged(named, self.orders),
            guard_modes=tuple(modes[r] for r in ascending if r not in inside),
            residual_terms=ResidualTerms(fit.lower, fit.upper),
            band_hz=self.band_hz,
            fit_band_hz=(float(fit.lines.frequency_hz[0]), float(fit.lines.frequency_hz[-1])),
            covariance=both[np.ix_(rows, rows)],
            frac=np.zeros(frf.n_positions),
            misfit=fit.misfit if np.all(np.isfinite(frf.std)) else float("nan"),
            node=frf.node,
            position_deg=frf.position_deg,
            drift=self._final_drift(covariance),
            orders=self.orders,
            notes=(*self.leakage_notes, *self.notes),
        )
        fitted = model.synthesise(fit.lines.frequency_hz, run=frf.run)
        return replace(model, frac=frac(fit.lines.values, fitted))

    @property
    def _shifts(self) -> NDArray[np.float64] | None:
        return self.drift.percent / 100 if self.drift.applied else None

    def _refit(self, poles: NDArray[np.complex128]) -> None:
        """Fit from other poles."""
        shifts = np.zeros(1) if self._shifts is None else self._shifts
        pairs = self._pairs(evaluate(self.lines, poles, shifts))
        fit = fit_bounded(self.lines, poles, self.settings, self._shifts, pairs=pairs)
        self.fit, self.leakage_notes = without_leakage(self.frf, fit, poles, self.settings)

    def _pairs(self, fit: PoleFit) -> tuple[tuple[int, int], ...]:
        """Poles that are the two members of one order; none without a circle or known noise."""
        if not on_circle(self.frf.position_deg) or not np.all(np.isfinite(self.frf.std)):
            return ()
        members = family(self._labelled(fit)).values()
        pairs = [sorted(chosen) for chosen in members if len(chosen) == 2]
        return tuple((first, second) for first, second in sorted(pairs))

    def _labelled(self, fit: PoleFit) -> tuple[Mode, ...]:
        return label_modes(modes_of(fit), self.frf.position_deg)[:-N_STAND_INS]

    def _wanted(self, modes: Sequence[Mode]) -> list[int]:
        """Poles of the result: inside the band and not set aside, ascending in frequency."""
        low, high = self.band_hz
        aside = self.selection.is_aside(self.fit.poles)
        in_band = [
            r for r in np.argsort(np.abs(self.fit.poles)) if low <= modes[r].frequency_hz <= high
        ]
        without = ", ".join(f"{modes[r].frequency_hz:.1f}" for r in in_band if aside[r])
        if without:
            self.notes.append(
                f"Left out by pinning or excluding, but fitted with the rest: {without} Hz."
            )
        inside = [r for r in in_band if not aside[r]]
        if not inside:
            raise FitError("all poles left the band during the curve fit. Pin frequencies.")
        return inside

    def _with_band_shift(self, modes: Sequence[Mode]) -> list[Mode]:
        drift = self.fit.drift if self.fit.drift.size > 1 else None

        def refit(lines: Lines, poles: NDArray[np.complex128]) -> PoleFit:
            return fit_bounded(lines, with_stand_ins(poles, lines), self.settings, drift)

        shifts = band_shift(self.fit, refit)
        return [
            replace(mode, frequency_band_shift_hz=float(hz), damping_band_shift=float(ratio))
            for mode, (hz, ratio) in zip(modes, shifts, strict=True)
        ]

    def _final_drift(self, covariance: NDArray[np.float64]) -> Drift:
        fit = self.fit
        if not self.drift.applied or fit.drift.size == 1:
            return self.drift
        std = np.sqrt(np.diag(covariance))[2 * fit.poles.size :]
        percent, std_percent = 100 * fit.drift, 100 * np.append(0.0, std)
        return replace(self.drift, percent=percent, std_percent=std_percent)


def drift_in_one_step(
    fit: PoleFit, run: tuple[str, ...], correlation: float, p_value: float
) -> Drift:
    """Drift of the runs, one Gauss–Newton step away from a common state, tested against chance."""
    apart = evaluate(fit.lines, fit.poles, np.zeros(fit.lines.n_runs))
    own = slice(2 * fit.poles.size, None)
    covariance = parameter_covariance(apart, correlation)[own, own]
    step = -np.linalg.lstsq(apart.normal_matrix(), apart.gradient(), rcond=1e-12)[0][own]
    size = float(step @ np.linalg.pinv(covariance, rcond=1e-10) @ step)
    chance = float(chdtrc(step.size, size))
    std = np.sqrt(np.diag(covariance))
    percent = 100 * np.append(0.0, step), 100 * np.append(0.0, std)
    return Drift(run, *percent, applied=chance < p_value, chance=chance)


def _diverged(labelled: Sequence[Mode], fit: PoleFit) -> NDArray[np.bool_]:
    """Poles that ran to a bound of their damping and took on a shape of no single order.

    A surplus pole ends like this: it explains a little of everything.
    """
    diverged = np.zeros(fit.poles.size, dtype=bool)
    impure = np.array([mode.order_purity < PURE for mode in labelled], dtype=bool)
    diverged[: impure.size] = impure & fit.at_bound[0 : 2 * impure.size : 2]
    return diverged


def _stand_ins_last(poles: NDArray[np.complex128], fit: PoleFit) -> NDArray[np.complex128]:
    stand_ins = fit.poles[-N_STAND_INS:]
    others = poles[~np.isin(poles, stand_ins)]
    return np.append(others[np.argsort(np.abs(others))], stand_ins)


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
