"""Curve fit: from the poles of the stability diagram to modes with residues and error bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag
from scipy.special import chdtrc

from ema.circumference.orders import label_modes, on_circle
from ema.circumference.ring_modes import family, judged
from ema.core.drift import NO_DRIFT, Drift
from ema.core.errors import FitError
from ema.core.frf import FRF, widened_band
from ema.core.mac import frac
from ema.core.modes import ModalModel, Mode, ResidualTerms
from ema.core.numerics import one_blas_thread
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.fitting.covariance import (
    band_shift,
    frequency_damping_covariance,
    line_correlation,
    parameter_covariance,
    residue_std,
    std_between_runs,
)
from ema.fitting.evidence import (
    is_hidden,
    is_no_mode,
    residue_size,
    share_resonance,
    visible_share,
    with_model_error,
)
from ema.fitting.exponential_window import with_own_factor, without_window
from ema.fitting.fit_steps import (
    beside_ring,
    drift_in_one_step,
    in_other_orders,
    is_undetermined,
    merged,
    modes_of,
    rows_of,
    shift_beside,
    std_of_unseen_pairs,
    surplus_poles,
    with_states,
    without_leakage,
)
from ema.fitting.local_poles import at_mean_of_positions
from ema.fitting.mode_pairs import PairSearch, RingOrder
from ema.fitting.pole_fit import (
    N_DRIFT,
    N_STAND_INS,
    Lines,
    PoleFit,
    evaluate,
    fit_bounded,
    lines_to_fit,
    starting_poles,
    with_stand_ins,
)
from ema.fitting.variable_projection import Real
from ema.poles.selection import PoleSelection

# A pole damped this many times more than the others, on its bound, is no mode.
_BROAD = 3.0
NO_SHIFT = np.zeros((1, N_DRIFT))
# A pole with this share of the response makes up its resonance.
_MAKES_UP = 0.8
# Without a circle, one of several doubtful poles goes first if this many half-widths hold them.
_AROUND = 4.0
# A ring mode of less purity may hide one of another order, damped this much more.
_TWO_ORDERS, _BROADER = 0.97, 1.8
# Its shape has at least this share of its power in that order.
_ITS_OWN = 0.6
# Rounds in which poles that hardly show are dropped; more than five were never needed.
_MOST_DROPS = 8
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
    >>> second = model.modes[1]
    >>> f"{second.frequency_hz:.1f} Hz", second.frequency_std_hz < 0.01
    ('100.3 Hz', True)
    """
    selection = poles if isinstance(poles, PoleSelection) else PoleSelection.around(poles)
    fit = CurveFit(with_own_factor(frf), selection, band_hz or selection.band_hz, settings)
    fit.start()
    fit.follow_drift()
    fit.compensate_leakage()
    if not selection.pinned:
        fit.drop_insignificant()
    if fit.circle:
        fit.settle_orders()
    else:
        if not selection.pinned:
            fit.drop_surplus()
            fit.follow_poles()
            fit.drop_hidden()
        fit.fit = fit.at_mean(fit.fit)
    return without_window(fit.modal_model(), frf.exponential_window)


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
    ring : tuple of RingOrder
        Pairs of the ring, order by order.
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
        self.leakage_notes, self.notes = list[str](), list[str]()
        self.ring: tuple[RingOrder, ...] = ()
        self.circle = on_circle(frf.position_deg)

    def start(self) -> None:
        """Fit all runs in one state, the members of close pairs as one pole at first."""
        if not self.selection.pinned:
            self.start_poles = merged(self.lines, self.start_poles, self.frf.position_deg)
        pairs = self._pairs(evaluate(self.lines, self.start_poles, NO_SHIFT))
        self.centre = self.start_poles
        self.fit = fit_bounded(self.lines, self.start_poles, self.settings, pairs=pairs)

    def follow_drift(self) -> None:
        """Give each run its own state where the frequencies differ by more than chance."""
        known = np.all(np.isfinite(self.frf.std))
        if self.lines.n_runs < 2 or not (known or self.circle):
            return
        limit = self.settings.drift_p_value
        self.drift = drift_in_one_step(self.fit, self.frf.run_names, self.correlation, limit)
        if self.drift.applied:
            given = self.settings, self._shifts, self.start_poles, self.fit.pairs
            self.fit = fit_bounded(self.lines, self.fit.poles, *given)

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
        size = residue_size(self.fit, self.correlation)
        p_value = chdtrc(2 * self.fit.lines.scale.size, size)
        noise = ~(p_value < self.settings.residue_p_value)
        reach = 1.0 if self.circle else _AROUND
        self._drop(noise, size, "its residues are no larger than their uncertainty", reach)

    def follow_poles(self) -> None:
        """Move bounds of frequencies along with poles that ended on them, main ones only."""
        for _ in range(_ROUNDS):
            poles = self.fit.poles
            held = self.fit.at_bound[1::2] & self._is_inside(poles)
            held &= visible_share(self.fit) > _MAKES_UP
            if not np.any(held):
                break
            self._refit(poles, np.where(held, poles, self.centre))

    def drop_hidden(self) -> None:
        """Drop poles that hardly show at their own resonance, until none is left.

        They follow what the model leaves out of other resonances.
        """
        for _ in range(_MOST_DROPS):
            share = visible_share(self.fit)
            hidden = is_hidden(self.fit, self.settings.visible_share)
            if not self._drop(hidden, share, "it hardly shows at its own resonance"):
                break

    def _drop(
        self, doubtful: NDArray[np.bool_], size: Real, reason: str, reach: float = 1.0
    ) -> bool:
        """Fit again without doubtful poles of the band; of two in a resonance the lesser one goes.

        False where there is none to drop, or no other.
        """
        poles = self.fit.poles
        inside = self._is_inside(poles)
        drop = inside & doubtful
        drop &= ~np.any(drop & share_resonance(poles, reach) & (size[:, None] > size), axis=1)
        if not np.any(drop) or np.all(drop | ~inside):
            return False
        self._refit(poles[~drop])
        self.notes += [
            f"The pole at {abs(pole) / (2 * np.pi):.2f} Hz was dropped: {reason}."
            for pole in poles[drop]
        ]
        return True

    def _is_inside(self, poles: NDArray[np.complex128]) -> NDArray[np.bool_]:
        """Which poles lie in the band."""
        frequency_hz = np.abs(poles) / (2 * np.pi)
        inside = (frequency_hz >= self.band_hz[0]) & (frequency_hz <= self.band_hz[1])
        inside[-N_STAND_INS:] = False
        return inside

    def drop_surplus(self) -> None:
        """Drop poles that ended on the bound of their damping, far above that of the others."""
        fit = self.fit
        ratio = -fit.poles.real / np.abs(fit.poles)
        broad = fit.at_bound[0::2] & (ratio > _BROAD * np.median(ratio[:-N_STAND_INS]))
        broad[-N_STAND_INS:] = False
        if np.any(broad) and np.count_nonzero(~broad) > N_STAND_INS:
            self._refit(fit.poles[~broad])

    def settle_orders(self) -> None:
        """Fit the pair of each order of the ring, after poles that diverged were dropped.

        Pinned poles stay as they are.
        """
        for _ in range(_ROUNDS):
            labelled = self._labelled(self.fit)
            surplus = surplus_poles(labelled, self.fit)
            if not np.any(surplus) or self.selection.pinned:
                break
            self._refit(self.fit.poles[~surplus])
        if not self.selection.pinned:
            labelled = self._with_hidden(labelled)
        known = self.band_hz, self.correlation, self.drift, self.settings
        lines = widened_band(self.frf, self.band_hz)
        self.ring = PairSearch(self.frf, lines, self.fit, labelled, *known).orders_found()

    def _with_hidden(self, labelled: tuple[Mode, ...]) -> tuple[Mode, ...]:
        """Add the pole of a second order where one pole holds two at the same frequency.

        A rim that moves gives order 1 a broad resonance, often beneath that of order 2. Kept only
        if its shape is that order's.
        """
        before, (low, high) = self.fit, self.band_hz
        for found in family(labelled).values():
            mode = labelled[found[0]]
            if mode.order_purity < _TWO_ORDERS and low <= mode.frequency_hz <= high:
                size, ratio = abs(mode.pole), min(_BROADER * mode.damping_ratio, 0.9)
                added = size * (-ratio + 1j * np.sqrt(1 - ratio**2))
                self._refit(np.insert(before.poles, 0, added))
                tried = self._labelled(self.fit)
                if tried[0].order != mode.order and tried[0].order_purity > _ITS_OWN:
                    return tried
                self.fit = before
        return labelled

    def modal_model(self) -> ModalModel:
        """Modes of the band with their uncertainty."""
        frf, (fit, owner) = self.frf, self._one_pole_per_order()
        covariance = parameter_covariance(fit, self.correlation)
        both = frequency_damping_covariance(fit.poles, covariance)
        residues_std = residue_std(fit, covariance, self.correlation)
        modes = self._with_band_shift(modes_of(fit, both, residues_std), fit)
        if not self.circle:
            modes, both = with_model_error(modes, both, fit, self._again)
        drift = self._final_drift(fit, covariance)
        unseen = std_of_unseen_pairs(fit, modes, owner, frf.position_deg, self.correlation)
        between = np.hypot(std_between_runs(fit, self.correlation), unseen)
        mixed = in_other_orders(fit, owner, residues_std, frf.position_deg)
        beside = beside_ring(modes, frf.position_deg)
        if self.circle and not self.selection.pinned:
            between = np.hypot(between, shift_beside(modes, beside))
        seen = rows_of(modes, owner, both, between, mixed, drift, frf.position_deg, self.settings)
        inside = self._wanted([rows[0] for rows, _ in seen] if self.circle else modes, fit, beside)
        listed = [row for r in inside for row in seen[r][0]]
        guards = [r for r in np.argsort(np.abs(fit.poles)) if r not in inside]
        reports = tuple(order.report for order in self.ring if order.is_main)
        model = ModalModel(
            modes=judged(label_modes(listed, frf.position_deg), reports),
            guard_modes=tuple(modes[r] for r in guards),
            residual_terms=ResidualTerms(fit.lower, fit.upper),
            band_hz=self.band_hz,
            fit_band_hz=(float(fit.lines.frequency_hz[0]), float(fit.lines.frequency_hz[-1])),
            covariance=block_diag(*(seen[r][1] for r in inside)),
            frac=np.zeros(frf.n_positions),
            misfit=self.fit.misfit if np.all(np.isfinite(frf.std)) else float("nan"),
            node=frf.node,
            position_deg=frf.position_deg,
            drift=drift,
            orders=reports,
            notes=(*self.leakage_notes, *self.notes),
        )
        fitted = model.synthesise(fit.lines.frequency_hz, run=frf.run)
        return replace(model, frac=frac(fit.lines.values, fitted))

    def _one_pole_per_order(self) -> tuple[PoleFit, dict[int, RingOrder]]:
        """Residues with the mean pole of each order in the place of its members, and whose it is.

        Residues of two poles closer than their width are not determined one by one; those of one
        pole are.
        """
        if self.selection.pinned or not self.ring:
            return self.fit, {}
        fit = self.fit
        replaced = {each.members[0]: each for each in self.ring if each.pair is not None}
        gone = {k for each in replaced.values() for k in each.members[1:]}
        kept = [k for k in range(fit.poles.size) if k not in gone]
        poles = np.array(
            [replaced[k].pair.mean if k in replaced else fit.poles[k] for k in kept]  # type: ignore[union-attr]
        )
        again = evaluate(fit.lines, poles, fit.drift)
        bound = fit.at_bound.reshape(-1, 2)[kept]
        bound[[kept.index(k) for k in replaced]] = False
        owner = {kept.index(k): each for k, each in replaced.items()}
        return replace(again, at_bound=bound.ravel()), owner

    @property
    def _shifts(self) -> NDArray[np.float64] | None:
        return self.drift.states if self.drift.applied else None

    def _refit(
        self, poles: NDArray[np.complex128], around: NDArray[np.complex128] | None = None
    ) -> None:
        """Fit from other poles, with bounds around them or others."""
        self.centre = poles if around is None else around
        shifts = NO_SHIFT if self._shifts is None else self._shifts
        pairs = self._pairs(evaluate(self.lines, poles, shifts))
        fit = fit_bounded(self.lines, poles, self.settings, self._shifts, self.centre, pairs)
        self.fit, self.leakage_notes = without_leakage(self.frf, fit, self.centre, self.settings)

    def _pairs(self, fit: PoleFit) -> tuple[tuple[int, int], ...]:
        """Poles that are the two members of one order; none without a circle or known noise."""
        if not self.circle or not np.all(np.isfinite(self.frf.std)):
            return ()
        members = family(self._labelled(fit)).values()
        pairs = sorted(sorted(chosen) for chosen in members if len(chosen) == 2)
        return tuple((first, second) for first, second in pairs)

    def _labelled(self, fit: PoleFit) -> tuple[Mode, ...]:
        return label_modes(modes_of(fit), self.frf.position_deg)[:-N_STAND_INS]

    def _wanted(self, modes: Sequence[Mode], fit: PoleFit, beside: set[int]) -> list[int]:
        """Poles of the result: inside the band and not set aside, ascending in frequency."""
        (low, high), aside = self.band_hz, self.selection.is_aside(fit.poles)
        in_band = [r for r in np.argsort(np.abs(fit.poles)) if low <= modes[r].frequency_hz <= high]
        without = ", ".join(f"{modes[r].frequency_hz:.1f}" for r in in_band if aside[r])
        left_out = "Left out by pinning or excluding, but fitted with the rest:"
        self.notes += [f"{left_out} {without} Hz."] if without else []
        inside = [r for r in in_band if not aside[r]]
        if not inside:
            raise FitError("all poles left the band during the curve fit. Pin frequencies.")
        lost = is_no_mode(fit, self.settings.visible_share) & (not self.circle)
        why = {
            r: f"it is not determined (± {modes[r].frequency_std_hz:.2g} Hz, "
            f"{modes[r].frequency_band_shift_hz:.2g} Hz with another band)"
            for r in inside
            if is_undetermined(modes[r], r in beside, self.settings)
        } | {r: "it hardly shows at its own resonance" for r in inside if lost[r]}
        if len(why) == len(inside) or self.selection.pinned:
            return inside
        self.notes += [
            f"The pole at {modes[r].frequency_hz:.1f} Hz is fitted but not listed: {why[r]}."
            for r in sorted(why)
        ]
        return [r for r in inside if r not in why]

    def _again(self, lines: Lines, poles: NDArray[np.complex128]) -> PoleFit:
        """Fit other lines from these poles."""
        drift = self.fit.drift if len(self.fit.drift) > 1 else None
        return self.at_mean(fit_bounded(lines, with_stand_ins(poles, lines), self.settings, drift))

    def at_mean(self, fit: PoleFit) -> PoleFit:
        """The fit at the mean poles of its positions, where no circle tells pairs."""
        return fit if self.circle else at_mean_of_positions(fit)

    def _with_band_shift(self, modes: Sequence[Mode], fit: PoleFit) -> list[Mode]:
        """Modes with what the ends of the band change in the nearest fitted pole."""
        shifts = band_shift(self.fit, self._again)
        nearest = np.argmin(np.abs(self.fit.poles - fit.poles[:, None]), axis=1)
        return [
            replace(mode, frequency_band_shift_hz=float(hz), damping_band_shift=float(ratio))
            for mode, (hz, ratio) in zip(modes, shifts[nearest], strict=True)
        ]

    def _final_drift(self, fit: PoleFit, covariance: Real) -> Drift:
        if not self.drift.applied or len(fit.drift) == 1:
            return self.drift
        own = slice(2 * fit.poles.size, None)
        return with_states(self.drift, fit.drift[1:], covariance[own, own])
