"""Curve fit: from the poles of the stability diagram to modes with residues and error bars.

Decisions about poles are found again in a fit, so that each edit means one row or pole: a mode is
named by its frequency and, where given, its damping ratio. The nearest one within reach is meant,
if it is clearly the nearest; everything else is an error that lists what is there.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.circumference.orders import label_modes
from ema.core.drift import Drift
from ema.core.edits import OF_POLES, Edit, EditKind, PoleName, of_kind
from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.modes import Mode
from ema.core.numerics import one_blas_thread
from ema.core.settings import IdentificationSettings
from ema.fitting.covariance import (
    frequency_damping_covariance,
    parameter_covariance,
    residue_std,
    std_between_runs,
)
from ema.fitting.evidence import is_no_mode, with_model_error
from ema.fitting.fit_steps import (
    as_stated,
    beside_ring,
    in_other_orders,
    is_undetermined,
    modes_of,
    rows_of,
    shift_beside,
    std_of_unseen_pairs,
)
from ema.fitting.hidden_order import doubts_of
from ema.fitting.listing import Choice, Key, Row, Settled, with_own_factor
from ema.fitting.order_pair import RingOrder, with_curvature
from ema.fitting.own_lines import note_of_coarse_lines, on_own_lines, with_coarse_lines
from ema.fitting.pair import PairFit
from ema.fitting.pole_fit import N_STAND_INS, PoleFit, evaluate
from ema.fitting.run_states import with_states
from ema.fitting.search import CurveFit
from ema.fitting.variable_projection import Complex, Real
from ema.fitting.wave_mixing import sharing_resonance
from ema.fitting.weak_modes import beside_members
from ema.poles.stability import StabilityDiagram
from ema.poles.tracking import PoleSelection

#: Gives the diagram of a method, the main one without.
Diagrams = Callable[[str | None], StabilityDiagram]

# Nearer than this share of the next one's distance is clearly the nearest.
_CLEARLY = 0.5
# A pole of the diagram within this many half-widths of a mode is that mode.
_SAME = 0.1
# A mode or pole is found again exactly within this: what a rounding in a file does.
_EXACT = 1e-7
_MOST_SHOWN = 6


@dataclass(frozen=True)
class Wish:
    """One edit and its place in the list, for messages."""

    number: int
    edit: Edit

    @property
    def pole(self) -> PoleName:
        """What it names."""
        assert self.edit.pole is not None  # `Edit` sees to that
        return self.edit.pole

    def refused(self, what: str, there: Iterable[complex], remedy: str) -> FitError:
        """The error for an edit that cannot be carried out."""
        poles = sorted(there, key=lambda pole: _away(self.pole, pole))
        near = ", ".join([*dict.fromkeys(map(_said, poles))][:_MOST_SHOWN]) or "none"
        name = self.pole
        ratio = "" if name.damping_ratio is None else f", {100 * name.damping_ratio:.2f} %"
        return FitError(
            f"edit {self.number}, {self.edit.kind} {name.frequency_hz:.6g} Hz{ratio}: {what}. "
            f"There: {near}. {remedy}."
        )


def wishes(edits: Sequence[Edit], *kinds: EditKind) -> list[Wish]:
    """Edits of some kinds with their numbers."""
    return [Wish(k, edit) for k, edit in enumerate(edits, start=1) if edit.kind in kinds]


def acts_on_poles(edits: Sequence[Edit]) -> bool:
    """Whether any edit changes what is fitted or listed."""
    return bool(of_kind(edits, *OF_POLES, EditKind.ONLY_KEPT, EditKind.NO_PARTNERS))


def row_named(settled: Settled, wish: Wish, reach: float, rows: Sequence[Row]) -> Row | None:
    """The row that an edit names; None where none is within reach.

    Raises
    ------
    FitError
        Where two are.
    """
    poles = [settled.listed_pole(row) for row in rows]
    away = [_away(wish.pole, pole) for pole in poles]
    near = np.argsort(away)[:2]
    if not near.size or away[near[0]] > reach:
        return None
    if near.size > 1 and away[near[0]] > max(_CLEARLY * away[near[1]], _EXACT):
        remedy = "Name one of them by its frequency and damping ratio"
        raise wish.refused("it could mean several modes", poles, remedy)
    return rows[int(near[0])]


def row_refused(settled: Settled, wish: Wish, reach: float, rows: Sequence[Row]) -> FitError:
    """The error for an edit that names no row."""
    poles = [settled.listed_pole(row) for row in rows]
    what = f"no mode within {100 * reach:g} %"
    return wish.refused(what, poles, "Correct the frequency or leave the edit out")


def pole_named(diagram: StabilityDiagram, wish: Wish, settings: IdentificationSettings) -> complex:
    """The pole of the stability diagram that an edit names: of a model order, or of a column.

    Without a model order, columns of the automatic selection come before others, others before
    single poles.

    Raises
    ------
    FitError
        Where there is none within reach.
    """
    name, reach = wish.pole, settings.pin_reach
    if name.model_order is None:
        for within in (settings.exclude_reach, reach):
            near = [c for c in diagram.clusters if _away(name, c.pole) < within]
            if near:
                return min(near, key=lambda c: (not c.kept, _away(name, c.pole))).pole
    at = diagram.model_order == (name.model_order or diagram.model_order)
    poles = diagram.poles[at].tolist()
    found = min(poles, key=lambda pole: _away(name, pole), default=None)
    if found is None or _away(name, found) > reach:
        place = "any model order" if name.model_order is None else f"order {name.model_order}"
        what = f"no pole within {100 * reach:g} % at {place}"
        raise wish.refused(what, poles, "Leave it out, correct it or widen the band")
    return complex(found)


def is_same(row_pole: complex, pole: complex) -> bool:
    """Whether a pole of the diagram is a mode that is fitted already."""
    return abs(row_pole - pole) < _SAME * -row_pole.real


def verified(settled: Settled, choice: Choice, kept: dict[Key, Wish], poles: set[complex]) -> None:
    """Refuse a list that does not show what was decided.

    Raises
    ------
    FitError
        Where what was kept is absent or what was set aside is present among the listed `poles`.
    """
    rows = {row.key: row for row in settled.rows}
    there = [settled.listed_pole(row) for row in settled.rows if row.in_band]
    for key, wish in kept.items():
        if key not in rows or settled.listed_pole(rows[key]) not in poles:
            raise wish.refused("it is no mode of the fit any more", there, "Leave the edit out")
    for key in choice.aside:
        if key in rows and settled.listed_pole(rows[key]) in poles:
            raise FitError("a mode that was set aside is still listed. Report this as an error.")


def _away(name: PoleName, pole: complex) -> float:
    """Distance in frequency, relative, and in damping ratio."""
    apart = abs(pole) / (2 * np.pi * name.frequency_hz) - 1
    ratio = -pole.real / abs(pole)
    return float(
        np.hypot(apart, ratio - (ratio if name.damping_ratio is None else name.damping_ratio))
    )


def _said(pole: complex) -> str:
    return f"{abs(pole) / (2 * np.pi):.2f} Hz {-100 * pole.real / abs(pole):.2f} %"


@one_blas_thread
def curve_fit(
    frf: FRF,
    selection: PoleSelection,
    band_hz: tuple[float, float],
    settings: IdentificationSettings,
) -> CurveFit:
    """The automatic fit to its end, from which others can go on; as `fit_modes`."""
    fit = CurveFit(with_own_factor(frf), selection, band_hz, settings)
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
    return fit


def settled(curve: CurveFit) -> Settled:
    """Rows of all poles with their uncertainty."""
    curve, frf = copy(curve), curve.frf
    curve.ring = tuple(with_curvature(order, curve.settings) for order in curve.ring)
    fit, owner, place = _one_pole_per_order(curve)
    alone, two = _alone(curve, fit, owner), _two(curve, owner)
    weak = beside_members(fit, alone, two, curve.correlation, curve.settings)
    fit = _at(fit, weak.poles_in(fit.poles)) if weak.at.size else fit
    apart = _apart(curve, fit, owner)
    shown = curve.beside(fit.poles, apart, fit.locked) if apart else fit
    misfit = shown.misfit if apart else curve.fit.misfit
    poles, of_own_lines = on_own_lines(shown, alone, curve.correlation)
    as_fitted = fit
    if np.any(poles != fit.poles):
        fit = _at(fit, poles)
        shown = curve.beside(poles, apart, fit.locked) if apart else fit
    covariance = parameter_covariance(fit, curve.correlation)
    both = frequency_damping_covariance(fit.poles, covariance)
    both = weak.covariance_in(both) + np.diag(of_own_lines.ravel() ** 2)
    residues_std = residue_std(fit, covariance, curve.correlation)
    shifts, scatter = curve.sensitivity
    modes = _with_band_shift(modes_of(fit, both, residues_std), weak.shifts_in(shifts[place]))
    if not curve.circle:
        modes, both = with_model_error(modes, both, fit, scatter)
    drift = final_drift(curve, fit, covariance)
    unseen = std_of_unseen_pairs(fit, modes, owner, frf.position_deg, curve.correlation)
    between = np.hypot(_between_runs(curve, fit, owner), unseen)
    mixed = in_other_orders(fit, owner, residues_std, frf.position_deg, curve.settings)
    beside = beside_ring(modes, frf.position_deg, owner)
    if curve.circle and not curve.selection.pinned:
        between = np.hypot(between, shift_beside(modes, beside))
    modes = [replace(mode, residues=own) for mode, own in zip(modes, shown.residues.T, strict=True)]
    seen = rows_of(modes, owner, both, between, mixed, drift, frf.position_deg, curve.settings)
    seen = [with_coarse_lines(*each, frf) for each in seen]
    for r in fit.locked:
        seen[r] = as_stated(modes[r], curve.locked[place[r]])
    judged_by = [rows[0] for rows, _ in seen] if curve.circle else modes
    in_band, doubts = _doubts(curve, judged_by, as_fitted, beside, owner)
    ascending = [int(r) for r in np.argsort(np.abs(fit.poles))]
    return Settled(
        frf=frf,
        fit=shown,
        band_hz=curve.band_hz,
        rows=tuple(_rows(ascending, [rows for rows, _ in seen], place, in_band, doubts)),
        covariance=scipy.linalg.block_diag(*(seen[r][1] for r in ascending)),
        ring=curve.ring,
        drift=drift,
        values=curve.fit.lines.values,
        misfit=misfit if np.all(np.isfinite(frf.std)) else float("nan"),
        notes=(*curve.leakage_notes, *_notes(curve, shown, modes, in_band)),
        locked=frozenset(curve.locked),
    )


def _rows(
    ascending: Sequence[int],
    modes: Sequence[list[Mode]],
    place: Sequence[int],
    in_band: Container[int],
    doubts: Mapping[int, str],
) -> Iterator[Row]:
    """Rows of poles in this order, both members of resolved pairs."""
    for r in ascending:
        for member, mode in enumerate(modes[r]):
            yield Row(mode, (place[r], member), r in in_band, doubts.get(r, ""))


def _notes(
    curve: CurveFit, shown: PoleFit, modes: Sequence[Mode], in_band: set[int]
) -> Iterator[str]:
    """Notes of the search, and what the fit with all pairs leaves open."""
    yield from curve.notes
    yield from note_of_coarse_lines(curve.frf, shown.poles[sorted(in_band)])
    if curve.circle and not curve.selection.pinned:
        labelled = label_modes(modes[:-N_STAND_INS], curve.frf.position_deg)
        yield from doubts_of(curve.frf, shown, labelled, curve.band_hz)


def _two(curve: CurveFit, owner: Mapping[int, RingOrder]) -> dict[int, RingOrder]:
    """Poles that stand for a pair whose two poles fit better than one."""
    return {r: order for r, order in owner.items() if order.shows_two(curve.settings)}


def _between_runs(curve: CurveFit, fit: PoleFit, owner: Mapping[int, RingOrder]) -> Real:
    """Standard deviations from what the runs differ by, beside pairs.

    One pole in the place of a pair would leave in each run what that run sees of its members.
    """
    two = _two(curve, owner)
    beside = curve.beside(fit.poles, two, fit.locked) if two else fit
    return std_between_runs(beside, curve.correlation)


def _apart(curve: CurveFit, fit: PoleFit, owner: Mapping[int, RingOrder]) -> dict[int, RingOrder]:
    """Orders whose waves are taken as found: beside an order beneath another, of both of them."""
    held = [r for r, order in owner.items() if order.key in curve.held]
    near = sharing_resonance(fit.poles, held) if held else []
    return {
        r: order
        for r, order in owner.items()
        if order.jointly or order.is_resolved or r in held or r in near
    }


def _alone(curve: CurveFit, fit: PoleFit, owner: Mapping[int, RingOrder]) -> NDArray[np.int_]:
    """Poles in the band that no pair of an order is found for; those between bounds only."""
    low, high = curve.band_hz
    hz = np.abs(fit.poles) / (2 * np.pi)
    free = (low <= hz) & (hz <= high) & ~fit.at_bound.reshape(-1, 2).any(axis=1)
    free[[*owner, *fit.locked, *range(fit.poles.size - N_STAND_INS, fit.poles.size)]] = False
    return np.flatnonzero(free)


def _at(fit: PoleFit, poles: Complex) -> PoleFit:
    """The fit with other poles."""
    again = evaluate(fit.lines, poles, fit.drift, fit.pairs, fit.locked)
    return replace(again, at_bound=fit.at_bound)


def _one_pole_per_order(curve: CurveFit) -> tuple[PoleFit, dict[int, RingOrder], list[int]]:
    """A fit with one pole of each order in the place of its members: the mean, or the one seen.

    Residues of two poles closer than their width are not determined one by one; those of one
    pole are. The ± rest on it. Also: which order each of these poles belongs to, and the pole it
    stands for.
    """
    fit = curve.fit
    if curve.selection.pinned or not curve.ring:
        return fit, {}, list(range(fit.poles.size))
    means = {o.key: (o, _pole_of(o, o.pair)) for o in curve.ring if o.pair is not None}
    gone = {k for order, _ in means.values() for k in order.members if k != order.key}
    followers = [o.followers(fit, curve.frf.position_deg) for o, _ in means.values()]
    gone = gone.union(*followers)
    means = {k: found for k, found in means.items() if k not in gone}
    kept = [k for k in range(fit.poles.size) if k not in gone]
    poles = np.array([means[k][1] if k in means else fit.poles[k] for k in kept])
    bound = fit.at_bound.reshape(-1, 2)[kept]
    bound[[kept.index(k) for k in means]] = False
    owner = {kept.index(k): order for k, (order, _) in means.items()}
    locked = tuple(kept.index(k) for k in curve.locked if k in kept)
    jointly = {r: order for r, order in owner.items() if order.jointly}
    again = curve.beside(poles, jointly, locked)
    return replace(again, at_bound=bound.ravel()), owner, kept


def _pole_of(order: RingOrder, pair: PairFit) -> complex:
    """The pole that a row of an order stands for."""
    return pair.mean if order.one_row is None else pair.poles[order.one_row]


def _doubts(
    curve: CurveFit,
    modes: Sequence[Mode],
    fit: PoleFit,
    beside: set[int],
    owner: dict[int, RingOrder],
) -> tuple[set[int], dict[int, str]]:
    """Poles in the band, and why some of them are no part of the result; never all of them."""
    low, high = curve.band_hz
    inside = {r for r, mode in enumerate(modes) if low <= mode.frequency_hz <= high}
    if not inside:
        raise FitError("all poles left the band during the curve fit. Pin frequencies.")
    lost = is_no_mode(fit, curve.settings.visible_share) & (not curve.circle)
    why = {
        r: f"it is not determined (± {modes[r].frequency_std_hz:.2g} Hz, "
        f"{modes[r].frequency_band_shift_hz:.2g} Hz with another band)"
        for r in inside
        if is_undetermined(modes[r], r in beside, curve.settings)
    } | {r: "it hardly shows at its own resonance" for r in inside if lost[r]}
    why |= {
        r: "the pair of its order explains it"
        for r in inside & owner.keys()
        if any(owner[r].is_within(main, curve.settings) for main in curve.ring)
    }
    peaks = {r for r in inside if not (modes[r].flags or lost[r] or curve.circle)}
    return inside, {} if curve.selection.pinned else without_last_peaks(why, inside, peaks)


def without_last_peaks(why: dict[int, str], inside: set[int], peaks: set[int]) -> dict[int, str]:
    """Doubts that take poles off the list: not those of all, nor of all that stand out.

    Else only humps on the flanks of these `peaks` would be left.
    """
    if peaks and peaks <= why.keys():
        return {r: doubt for r, doubt in why.items() if r not in peaks}
    return {} if len(why) == len(inside) else why


def _with_band_shift(modes: Sequence[Mode], shifts: Real) -> list[Mode]:
    """Modes with what the ends of the band change in their poles."""
    return [
        replace(mode, frequency_band_shift_hz=float(hz), damping_band_shift=float(ratio))
        for mode, (hz, ratio) in zip(modes, shifts, strict=True)
    ]


def final_drift(curve: CurveFit, fit: PoleFit, covariance: Real) -> Drift:
    """Drift of the runs as the fit has it; where no pairs tell its ±, with that of the fit."""
    if not curve.drift.applied or len(fit.drift) == 1 or curve.ring:
        return curve.drift
    own = slice(2 * fit.poles.size, None)
    return with_states(curve.drift, fit.drift[1:], covariance[own, own])
