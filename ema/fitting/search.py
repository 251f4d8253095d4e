"""The automatic fit of poles: start, drift, leakage, what is dropped, and the pairs of orders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import family, label_modes, of_order, on_circle
from ema.core.drift import NO_DRIFT, Drift, of_runs
from ema.core.frf import FRF
from ema.core.modes import Mode
from ema.core.settings import IdentificationSettings
from ema.fitting import hidden_order
from ema.fitting.covariance import band_shift, line_correlation
from ema.fitting.evidence import (
    at_mean_of_positions,
    is_hidden,
    merged,
    scatter_over_positions,
    share_resonance,
    surplus_poles,
    visible_share,
    within_noise,
)
from ema.fitting.fit_steps import (
    cleared_like,
    cleared_lines,
    cleared_of_moved,
    modes_of,
    without_leakage,
)
from ema.fitting.listing import with_own_factor
from ema.fitting.mode_pairs import PairSearch
from ema.fitting.order_pair import RingOrder, beside_pairs, poles_shown
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
from ema.fitting.run_states import (
    drift_beside_pairs,
    drift_in_one_step,
    in_states,
    middle_of,
    ring_in,
)
from ema.fitting.variable_projection import Complex, Real
from ema.poles.estimators import widened_band
from ema.poles.tracking import PoleSelection

# A pole damped this many times more than the others, on its bound, is no mode.
_BROAD = 3.0
NO_SHIFT = np.zeros((1, N_DRIFT))
# A pole with this share of the response makes up its resonance.
_MAKES_UP = 0.8
# Without a circle, one of several doubtful poles goes first if this many half-widths hold them.
_AROUND = 4.0
# Rounds in which poles that hardly show are dropped; more than five were never needed.
_MOST_DROPS = 8
# Rounds in which states of the runs and pairs are found from each other, and after which the poles
# of the orders have settled; more than two were never needed.
_STATE_ROUNDS, _ROUNDS = 2, 4


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
    drift : Drift
        Drift of the runs, and whether it is significant.
    ring : tuple of RingOrder
        Pairs of the ring, order by order.
    locked : mapping of int to ndarray
        Poles that stay where they are, with the covariance of frequency and damping ratio stated.
    order_of : mapping of int to int
        Orders of poles that a person gave them.
    held : mapping of int to int
        Poles that stay where their order's own FRFs show them, and that order.
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
        self.start_poles = starting_poles(selection.poles, self.lines, band_hz)
        self.correlation = line_correlation(frf)
        self.drift: Drift = NO_DRIFT
        self.leakage_notes, self.notes = list[str](), list[str]()
        self.ring: tuple[RingOrder, ...] = ()
        self.circle = on_circle(frf.position_deg)
        self.locked: Mapping[int, Real] = {}
        self.order_of: Mapping[int, int] = {}
        self.held: Mapping[int, int] = {}

    def start(self) -> None:
        """Fit all runs in one state, the members of close pairs as one pole at first."""
        if not self.selection.pinned:
            self.start_poles = merged(self.lines, self.start_poles, self.frf.position_deg)
        self.centre = self.start_poles
        self.fit = self._bounded(self.lines, self.centre, self._shifts)

    def follow_drift(self) -> None:
        """Give each run its own state where the frequencies differ by more than chance."""
        if self.lines.n_runs < 2 or not (self.circle or np.all(np.isfinite(self.frf.std))):
            return
        known = self.frf, self.correlation, self.settings.drift_p_value
        self.drift = drift_in_one_step(self.fit, *known)
        if self.drift.applied:
            self.fit = self._bounded(self.lines, self.centre, self._shifts)

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
        noise, size = within_noise(self.fit, self.correlation, self.settings.residue_p_value)
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
        """Fit again without doubtful poles, of two in a resonance the lesser one; False: none."""
        poles, inside = self.fit.poles, self._is_inside(self.fit.poles)
        drop = inside & doubtful
        drop &= ~np.any(drop & share_resonance(poles, reach) & (size[:, None] > size), axis=1)
        if not np.any(drop) or np.all(drop | ~inside):
            return False
        self._refit(poles[~drop])
        dropped_hz = np.abs(poles[drop]) / (2 * np.pi)
        self.notes += [f"The pole at {hz:.2f} Hz was dropped: {reason}." for hz in dropped_hz]
        return True

    def _is_inside(self, poles: Complex) -> NDArray[np.bool_]:
        """Which poles lie in the band."""
        low, high = (2 * np.pi * hz for hz in self.band_hz)
        inside = (low <= np.abs(poles)) & (np.abs(poles) <= high)
        inside[-N_STAND_INS:] = False
        return inside

    def drop_surplus(self) -> None:
        """Drop poles that ended on the bound of their damping, far above that of the others."""
        fit, ratio = self.fit, -self.fit.poles.real / np.abs(self.fit.poles)
        broad = fit.at_bound[0::2] & (ratio > _BROAD * np.median(ratio[:-N_STAND_INS]))
        broad[-N_STAND_INS:] = False
        if np.any(broad) and np.count_nonzero(~broad) > N_STAND_INS:
            self._refit(fit.poles[~broad])

    def settle_orders(self) -> None:
        """Fit the pair of each order of the ring, after poles that diverged were dropped."""
        for _ in range(0 if self.selection.pinned else _ROUNDS):
            in_runs = self.drift.applied & self._is_inside(self.fit.poles)
            surplus = surplus_poles(self.labelled(self.fit), self.fit, in_runs)
            if not np.any(surplus):
                break
            self._refit(self.fit.poles[~surplus])
        if not self.selection.pinned:
            self._add_hidden()
        self._find_orders()
        if not (self.selection.pinned or self.held) and self._add_hidden():
            self._find_orders()

    def _find_orders(self) -> None:
        """Fit the pair of each order, and the states of the runs that go with them."""
        search = self._orders_alone()
        if not self.selection.pinned and self._start_at_pairs():
            search = self._orders_alone()
        for _ in range(_STATE_ROUNDS):
            if not self._follow_drift_of_pairs(search):
                break
            search = self._orders_alone()
        self.ring = self._together(search, self.ring)
        if self.drift.applied and self._follow_drift_of_pairs(search, however_little=True):
            search = self.pair_search()
            self.ring = self._together(search, search.orders_near(self.ring))

    def _together(self, search: PairSearch, orders: tuple[RingOrder, ...]) -> tuple[RingOrder, ...]:
        """The orders beside each other's pairs, which never settle while sensors weigh on them."""
        return orders if self.selection.pinned else search.orders_together(orders)

    def _orders_alone(self) -> PairSearch:
        search = self.pair_search()
        self.ring = search.orders_alone()
        return search

    def _start_at_pairs(self) -> bool:
        """Fit again where an order's own FRFs show it elsewhere; whether that fits better."""
        before, centre = self.fit, self.centre
        poles = poles_shown(before.poles, self.ring)
        if np.any(poles != before.poles):
            self._refit(poles)
        if self.fit.cost < before.cost:
            return True
        self.fit, self.centre = before, centre
        return False

    def _follow_drift_of_pairs(self, search: PairSearch, *, however_little: bool = False) -> bool:
        """Give each run its own state as seen with pairs in place; whether that changes any."""
        orders = [each for each in self.ring if each.is_main and each.pair]
        if self.lines.n_runs < 2 or not orders:
            return False
        before = self.drift
        self.drift = drift_beside_pairs(search, orders, self.settings.drift_p_value)
        if self.drift.is_as(before) and not however_little:
            self.drift = self.drift.at_states_of(before)
            return False
        self.fit = self.in_new_states(in_states(self.fit, self._shifts))
        return True

    def in_new_states(self, fit: PoleFit) -> PoleFit:
        """Fit again where runs have other states: what leakage does is that of poles in these."""
        if (lines := self.lines) is not self.fit.lines:
            lines = cleared_lines(self.frf, lines, fit.poles, fit.drift)
        return self._fit_near(lines, fit.poles, fit.drift)

    def find_pairs(self, before: Sequence[RingOrder] = ()) -> None:
        """Fit the pair of each order of the ring."""
        alone = (search := self.pair_search()).orders_alone(before)
        self.ring = search.orders_together(alone, before)

    def pair_search(self) -> PairSearch:
        """What the pairs of the orders are found from."""
        known = self.band_hz, self.correlation, self.drift, self.settings
        lines = widened_band(self.frf, self.band_hz)
        return PairSearch(self.frf, lines, self.fit, self.labelled(self.fit), *known)

    def _add_hidden(self) -> bool:
        """Add the pole of an order that its own FRFs show; what known pairs explain counts not."""
        before, centre = self.fit, self.centre
        two = {each.key: each for each in self.ring if each.shows_two(self.settings)}
        known = self.beside(before.poles, two) if two else before

        def beside(pole: complex) -> PairSearch:
            self._refit(np.insert(before.poles, 0, pole))
            return self.pair_search()

        for suspect in hidden_order.suspects(*self._seen(known)):
            self.held = {0: suspect.order}
            pairs = hidden_order.pairs_beneath(suspect, beside)
            if pairs and hidden_order.is_another(suspect, pairs, *self._seen(self.fit)):
                self.notes.append(hidden_order.note_of(suspect))
                return True
            self.fit, self.centre, self.held = before, centre, {}
        return False

    def _seen(self, fit: PoleFit) -> tuple[FRF, PoleFit, tuple[Mode, ...], tuple[float, float]]:
        return self.frf, fit, self.labelled(fit), self.band_hz

    def beside(
        self, poles: Complex, pairs: Mapping[int, RingOrder], locked: tuple[int, ...] = ()
    ) -> PoleFit:
        """Linear solution for poles, `beside_pairs` in the place of some of them."""
        return beside_pairs(self.fit, self.frf.position_deg, poles, pairs, locked)

    @property
    def _shifts(self) -> Real:
        return self.drift.states if self.drift.applied else NO_SHIFT

    def _refit(self, poles: Complex, around: Complex | None = None) -> None:
        """Fit from other poles, with bounds around them or others."""
        self.centre = poles if around is None else around
        fit = self._bounded(self.lines, poles, self._shifts)
        self.fit, self.leakage_notes = without_leakage(self.frf, fit, self.centre, self.settings)

    def _pairs(self, fit: PoleFit) -> tuple[tuple[int, int], ...]:
        """Poles that are the two members of one order; none without a circle or known noise."""
        if not self.circle or not np.all(np.isfinite(self.frf.std)):
            return ()
        members = family(self.labelled(fit)).values()
        return tuple(sorted((min(each), max(each)) for each in members if len(each) == 2))

    def labelled(self, fit: PoleFit) -> tuple[Mode, ...]:
        """Modes of all poles but the stand-ins, with their orders."""
        modes = list(label_modes(modes_of(fit), self.frf.position_deg)[:-N_STAND_INS])
        for pole, order in self.order_of.items():
            modes[pole] = of_order(modes[pole], order, self.frf.position_deg)
        for pole, order in self.held.items():
            modes[pole] = hidden_order.of_its_order(modes[pole], order, self.frf.position_deg)
        return tuple(modes)

    @cached_property
    def sensitivity(self) -> tuple[Real, Real]:
        """What the ends of the band change in each pole, and, without a circle, other positions."""
        shifts = band_shift(self.fit, self._again)
        unknown = np.zeros((self.fit.poles.size, 2))
        return shifts, unknown if self.circle else scatter_over_positions(self.fit, self._again)

    def going_on(
        self,
        added: Sequence[complex] = (),
        starts: Mapping[int, complex] | None = None,
        locked: Mapping[int, Real] | None = None,
    ) -> CurveFit:
        """Fit again from these poles; pairs move along, verdicts and sensitivity stay.

        With poles `added` behind those there are, other `starts` of some, and some `locked` there.
        """
        other, unknown = copy(self), np.full((len(added), 2), np.nan)  # in front of the stand-ins
        other.__dict__["sensitivity"] = tuple(
            np.insert(each, len(each) - N_STAND_INS, unknown, axis=0) for each in self.sensitivity
        )
        other.locked = locked or {}
        poles, other.centre = self.fit.poles.copy(), self.centre.copy()
        for pole, start in (starts or {}).items():
            poles[pole] = other.centre[pole] = start
        at, further = poles.size - N_STAND_INS, np.array(added, dtype=complex)
        poles, other.centre = (np.insert(each, at, further) for each in (poles, other.centre))
        fit = other._fit_near(self.fit.lines, poles, self.fit.drift)
        if self.fit.lines is not self.lines:  # its bias is compensated
            fit = other._cleared_again(self.fit, fit)
        other.fit = other.at_mean(fit)
        other.ring = other.pair_search().orders_near(self.ring) if self.ring else ()
        return other

    def on(self, frf: FRF) -> CurveFit:
        """Fit other rows of the same tyre from these poles, and the pairs from where they were."""
        other = copy(self)
        other.frf = with_own_factor(frf)
        other.lines = lines_to_fit(other.frf, self.band_hz)
        other.circle = on_circle(frf.position_deg)
        poles, drift, ring = self.fit.poles, self.fit.drift, self.ring
        if len(drift) > 1:
            rows = [self.frf.run_names.index(name) for name in frf.run_names]
            first = drift[rows[0]]
            ring = ring_in(ring, self.lines, first)
            poles, drift = self.lines.drifted(poles, first), drift[rows] - first
            other.centre = self.lines.drifted(self.centre, first)
            other.drift = of_runs(self.drift, frf.run_names)
        lines = other.lines
        if self.fit.lines is not self.lines:
            before = self.frf, self.lines, self.fit.lines
            lines = cleared_like(*before, other.frf, lines, poles, drift)
        fit = other._fit_near(lines, poles, drift)
        if lines is not other.lines:
            fit = other._cleared_again(evaluate(lines, poles, drift), fit)
        other.fit = other.at_mean(fit)
        if other.circle and ring:
            search = other.pair_search()
            other.ring, states = search.orders_near(ring), other.fit.drift
            if len(states) > 1 and other._follow_drift_of_pairs(search):
                ring = ring_in(other.ring, lines, middle_of(lines, states - other.fit.drift))
                other.ring = other.pair_search().orders_near(ring)
        return other

    def _cleared_again(self, before: PoleFit, fit: PoleFit) -> PoleFit:
        """The fit with the bias that its poles have where they moved to since `before`."""
        lines = cleared_of_moved(self.frf, before, fit)
        return fit if lines is None else self._fit_near(lines, fit.poles, fit.drift)

    def _fit_near(self, lines: Lines, poles: Complex, drift: Real) -> PoleFit:
        """Fit lines from poles and states that are nearly right."""
        fit = self._bounded(lines, poles, drift)
        return in_states(fit, drift) if self.ring else fit

    def _bounded(self, lines: Lines, poles: Complex, drift: Real) -> PoleFit:
        """Fit within the bounds around `centre`, members of a pair damped alike."""
        pairs = self._pairs(evaluate(lines, poles, drift))
        states = drift if len(drift) > 1 else None
        given = self.settings, states, self.centre, pairs, (*self.locked, *self.held)
        return fit_bounded(lines, poles, *given)

    def judged_anew(self, before: Sequence[RingOrder]) -> CurveFit:
        """The same poles with sensitivity of their own, and pairs where they are not as before."""
        other = copy(self)
        other.__dict__.pop("sensitivity", None)
        if other.circle and not other.selection.pinned:
            other.find_pairs(before)
        return other

    def _again(self, lines: Lines, poles: Complex) -> PoleFit:
        """Fit other lines from these poles."""
        drift = self.fit.drift if len(self.fit.drift) > 1 else None
        stay = self.fit.poles[[*self.locked, *self.held]]
        locked = tuple(np.flatnonzero(np.isin(poles, stay)).tolist())
        start = around = with_stand_ins(poles, lines)
        if lines.frequency_hz[-1] == self.fit.lines.frequency_hz[-1]:
            start = np.append(poles, self.fit.poles[-N_STAND_INS:])
        return self.at_mean(fit_bounded(lines, start, self.settings, drift, around, (), locked))

    def at_mean(self, fit: PoleFit) -> PoleFit:
        """The fit at the mean poles of its positions, where no circle tells pairs."""
        return fit if self.circle else at_mean_of_positions(fit)
