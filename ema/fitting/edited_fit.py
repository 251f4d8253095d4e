"""Modes from FRFs: by selected poles, by frequencies, automatically, with edits of a person."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ema.core.edits import Edit, EditKind, of_kind, shorthand
from ema.core.errors import InputError, require_type
from ema.core.frf import FRF
from ema.core.frf_arrays import frequencies_of
from ema.core.modes import Chosen, ModalModel, Pair
from ema.core.numerics import one_blas_thread
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.fitting.curve_fit import (
    Diagrams,
    Wish,
    is_same,
    pole_named,
    row_named,
    row_refused,
    settled,
    verified,
    wishes,
)
from ema.fitting.listing import Choice, Key, Row, Settled, listed
from ema.fitting.mode_pairs import RingOrder
from ema.fitting.pole_fit import N_STAND_INS, evaluate
from ema.fitting.search import CurveFit, curve_fit
from ema.fitting.variable_projection import Real
from ema.poles.estimators import NO_FRF
from ema.poles.stability import PoleSelection, StabilityDiagram, build_stability, select_poles


@dataclass(frozen=True, eq=False)
class EditedFit:
    """A fit and what is listed of it.

    Parameters
    ----------
    curve : CurveFit
    known : Settled or None
        Rows of the fit where they are known already.
    choice : Choice
    is_preview : bool
        Whether pairs and sensitivity are still those of the fit before.
    """

    curve: CurveFit
    known: Settled | None = None
    choice: Choice = field(default_factory=Choice)
    is_preview: bool = False

    @cached_property
    def settled(self) -> Settled:
        """Rows of the fit with their uncertainty."""
        return settled(self.curve) if self.known is None else self.known

    @cached_property
    def model(self) -> ModalModel:
        """The modes that are listed."""
        return listed(self.settled, self.choice)


@dataclass
class _Found:
    """What the edits mean in a fit, gathered one by one."""

    added: list[complex] = field(default_factory=list)  # further poles, rad/s
    starts: dict[int, complex] = field(default_factory=dict)
    locked: dict[int, Real] = field(default_factory=dict)  # with the covariance of before
    two: set[int] = field(default_factory=set)  # keys of orders that have two members
    orders: dict[Key, int] = field(default_factory=dict)
    kept: dict[Key, Wish] = field(default_factory=dict)
    picked: set[Key] = field(default_factory=set)

    def keep(self, key: Key, wish: Wish, *, picked: bool = False) -> None:
        """Note that a row is wanted; two names for one row are a mistake."""
        before = self.kept.get(key)
        if before is not None and before.pole != wish.pole:
            remedy = "Leave one of them out, or pick a pole of the diagram"
            raise wish.refused(f"edit {before.number} means the same mode", (), remedy)
        self.kept[key] = wish
        if picked:
            self.picked.add(key)

    @property
    def refits(self) -> bool:
        """Whether poles have to be fitted again."""
        return bool(self.added or self.starts or self.locked)


def edited(
    before: EditedFit,
    edits: Sequence[Edit],
    diagrams: Diagrams,
    *,
    live: bool = False,
    first_stage: CurveFit | None = None,
) -> EditedFit:
    """The fit with the edits of poles.

    Parameters
    ----------
    before : EditedFit
        The automatic fit.
    edits : sequence of Edit
    diagrams : callable
        Stability diagram by method.
    live : bool
        Whether to stop after the first stage.
    first_stage : CurveFit, optional
        What the first stage of the same edits gave.

    Raises
    ------
    FitError
        Where an edit means nothing that is there, or several things.
    """
    if of_kind(edits, EditKind.NO_PARTNERS):
        before = _again(before.curve, [_one(order) for order in before.curve.ring])
    found = _meaning(before, edits, diagrams)
    curve, anew = before.curve, found.refits or bool(found.orders)
    if found.refits:
        curve = first_stage or curve.going_on(
            added=found.added, starts=found.starts, locked=found.locked
        )
    if anew and not live:
        curve = copy(curve)
        curve.order_of = {key[0]: order for key, order in found.orders.items()}
        curve = curve.judged_anew(before.curve.ring)
        if of_kind(edits, EditKind.NO_PARTNERS):
            curve.ring = tuple(_one(order) for order in curve.ring)
    after = before
    if anew or found.two:
        after = _with_orders(curve, found, before.curve.fit.poles.size - N_STAND_INS)
    choice = _choice(after, edits, found)
    result = replace(after, known=after.settled, choice=choice, is_preview=anew and live)
    listed_poles = {mode.pole for mode in result.model.modes}
    verified(result.settled, choice, found.kept, listed_poles)
    return result


def _again(curve: CurveFit, ring: Sequence[RingOrder]) -> EditedFit:
    """The same poles with other verdicts on pairs."""
    other = copy(curve)
    other.ring = tuple(ring)
    return EditedFit(other, settled(other))


def _one(order: RingOrder) -> RingOrder:
    """The order with one mode, as a person wants no partners."""
    pair = order.report.pair
    if pair.verdict is not Pair.RESOLVED:
        return order
    said = f"no partners are added, by decision; {pair.evidence}"
    one = replace(pair, verdict=Pair.NOT_SEPARABLE, evidence=said)
    return replace(order, report=replace(order.report, pair=one))


def _two(order: RingOrder) -> RingOrder:
    """The order with both members, as a person says that it has two."""
    pair = order.report.pair
    if pair.verdict is Pair.RESOLVED:
        return order
    said = f"this order has two members, by decision; {pair.evidence}"
    two = replace(pair, verdict=Pair.RESOLVED, evidence=said)
    return replace(order, report=replace(order.report, pair=two))


def _meaning(before: EditedFit, edits: Sequence[Edit], diagrams: Diagrams) -> _Found:
    """What the edits mean in the automatic fit."""
    found, settings = _Found(), before.curve.settings
    rows = [row for row in before.settled.rows if row.in_band]
    for wish in wishes(edits, EditKind.KEEP, EditKind.PICK):
        row = None
        if wish.edit.kind is EditKind.KEEP:
            row = row_named(before.settled, wish, settings.exclude_reach, rows)
        if row is not None:
            found.keep(row.key, wish)
        else:
            _pick(before, pole_named(diagrams(wish.pole.method), wish, settings), wish, found)
    for wish in wishes(edits, EditKind.START, EditKind.LOCK, EditKind.ORDER_IS):
        row = row_named(before.settled, wish, settings.exclude_reach, rows)
        if row is None:
            raise row_refused(before.settled, wish, settings.exclude_reach, rows)
        if wish.edit.kind is EditKind.ORDER_IS:
            found.orders[row.key] = int(wish.edit.value or 0)
        else:
            _hold(before, row, wish, found)
    return found


def _hold(before: EditedFit, row: Row, wish: Wish, found: _Found) -> None:
    """A pole that starts elsewhere, or stays where it is."""
    pole = row.key[0]
    if any(other.key == (pole, 1) for other in before.settled.rows):
        remedy = "Add no_partners, which leaves one mode for the order"
        raise wish.refused("a member of a pair cannot be moved by itself", (), remedy)
    if wish.edit.kind is EditKind.LOCK:
        start = found.starts.setdefault(pole, row.mode.pole)
        found.locked[pole] = _as_known(before.settled, row, start)
        return
    size = 2 * np.pi * wish.pole.frequency_hz
    ratio = wish.pole.damping_ratio
    ratio = row.mode.damping_ratio if ratio is None else ratio
    found.starts[pole] = size * complex(-ratio, np.sqrt(1 - ratio**2))


def _as_known(settled: Settled, row: Row, pole: complex) -> Real:
    """Covariance of frequency and damping ratio of a row, and how far a pole is from there."""
    at = 2 * settled.rows.index(row)
    own = settled.covariance[at : at + 2, at : at + 2]
    poles = np.array([pole, row.mode.pole])
    hz, ratio = np.diff(np.abs(poles) / (2 * np.pi)), np.diff(-poles.real / np.abs(poles))
    return np.asarray(own + np.diag(np.concatenate([hz, ratio]) ** 2))


def _pick(before: EditedFit, pole: complex, wish: Wish, found: _Found) -> None:
    """A pole of the diagram: a mode that is there, the second one of an order, or a new one."""
    low, high = before.settled.band_hz
    if not low <= abs(pole) / (2 * np.pi) <= high:
        remedy = "Widen the band or leave the edit out"
        raise wish.refused(f"not between {low:g} and {high:g} Hz", (pole,), remedy)
    rows = [row for row in before.settled.rows if row.in_band]
    near = min(rows, key=lambda row: abs(row.mode.pole - pole), default=None)
    if near is not None and is_same(near.mode.pole, pole):
        found.keep(near.key, wish)
        return
    order = _order_holding(before.curve, pole)
    if order is not None:
        found.two.add(order.key)
        found.keep((order.key, _nearest_member(order, pole)), wish, picked=True)
        return
    n_before = before.curve.fit.poles.size - N_STAND_INS
    key = n_before + len(found.added), 0
    if any(is_same(other, pole) for other in found.added):
        raise wish.refused("another edit leads to the same pole", (pole,), "Leave one of them out")
    found.added.append(pole)
    found.keep(key, wish, picked=True)


def _order_holding(curve: CurveFit, pole: complex) -> RingOrder | None:
    """The order of the ring one of whose members a further pole is, by place and shape."""
    near = [
        order
        for order in curve.ring
        if order.is_main
        and order.pair is not None
        and min(abs(member - pole) for member in order.pair.poles) < -pole.real
    ]
    if not near:
        return None
    at = curve.fit.poles.size - N_STAND_INS
    tried = evaluate(curve.lines, np.insert(curve.fit.poles, at, pole), curve.fit.drift)
    shape = curve.labelled(tried)[at]
    return next((order for order in near if order.order == shape.order), None)


def _nearest_member(order: RingOrder, pole: complex) -> int:
    assert order.pair is not None
    return int(np.argmin([abs(member - pole) for member in order.pair.poles]))


def _with_orders(curve: CurveFit, found: _Found, n_before: int) -> EditedFit:
    """Rows of a fit whose orders have two members, or a locked pole, where that was decided.

    A further pole that turns out to be the second member of an order gets that member's row.
    """
    ring = []
    for order in curve.ring:
        if any(k in found.locked for k in order.members):
            order = replace(order, pair=None)
        pair_known = order.is_main and order.pair is not None
        joined = pair_known and any(k >= n_before for k in order.members)
        if pair_known and (order.key in found.two or joined):
            order = _two(order)
        for k in order.members if joined else ():
            wish = found.kept.pop((k, 0), None)
            if wish is not None:
                member = _nearest_member(order, curve.fit.poles[k])
                found.keep((order.key, member), wish, picked=k >= n_before)
        ring.append(order)
    return _again(curve, ring)


def _choice(after: EditedFit, edits: Sequence[Edit], found: _Found) -> Choice:
    """What is listed of the rows; of decisions on one row the last one counts."""
    reach, rows = after.curve.settings.exclude_reach, after.settled.rows
    named = [row for row in rows if row.is_listed or row.key in found.kept]
    aside, notes = dict[Key, Wish](), list[str]()
    for wish in wishes(edits, EditKind.SET_ASIDE):
        row = row_named(after.settled, wish, reach, named)
        if row is None:
            raise row_refused(after.settled, wish, reach, named)
        before = found.kept.get(row.key)
        if before is not None:
            late, early = max(wish.number, before.number), min(wish.number, before.number)
            notes.append(f"Edit {late} overrules edit {early}.")
            if before.number > wish.number:
                continue
            del found.kept[row.key]
        aside[row.key] = wish
    how = {k: Chosen.PICKED if k in found.picked else Chosen.KEPT for k in found.kept}
    only = bool(of_kind(edits, EditKind.ONLY_KEPT))
    return Choice(how, frozenset(aside), only, found.orders, tuple(notes))


@one_blas_thread
def fit_modes(
    frf: FRF,
    poles: PoleSelection | ArrayLike | None = None,
    band_hz: tuple[float, float] | None = None,
    settings: IdentificationSettings = IDENTIFICATION,
    *,
    hz: ArrayLike | None = None,
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
    poles : PoleSelection or array_like of complex, optional
        From `select_poles`, or poles in rad/s. Default: the automatic selection.
    band_hz : tuple of float, optional
        Band of the result; by default that of the selection, or where coherence is good.
    settings : IdentificationSettings
    hz : array_like, optional
        List only the modes at these frequencies in Hz. The others of the band are fitted too, so
        that their response is not pressed into these.

    Returns
    -------
    ModalModel

    Raises
    ------
    InputError
        If an argument cannot be used.
    FitError
        If no pole lies in the band, none at a frequency of `hz`, or the fit diverges.

    Examples
    --------
    >>> import ringmodal as rm
    >>> frf = rm.estimate_frf(rm.read_campaign("sample_data/tyre_225_55R17"))
    >>> frf = frf.rows(range(0, 72, 6))  # every 30°, to be quick
    >>> rm.fit_modes(frf, hz=[78.7, 100.3]).frequencies_hz.round(1)
    array([ 78.7, 100.3])
    """
    require_type("frf", frf, FRF, NO_FRF)
    require_type("settings", settings, IdentificationSettings, "Leave it out")
    pinned = None if hz is None else frequencies_of("hz", hz)
    if poles is None:
        band_hz = band_hz or _around(frf, pinned or ())
        selection = select_poles(build_stability(frf, band_hz, settings=settings))
    elif pinned is not None:
        rule = "modes are given by their poles or by their frequencies"
        raise InputError("fit_modes", "poles and hz", rule, "Leave one of them out")
    else:
        selection = poles if isinstance(poles, PoleSelection) else PoleSelection.around(poles)
    curve = curve_fit(frf, selection, band_hz or selection.band_hz, settings)
    fit = EditedFit(curve, settled(curve))
    if pinned is None:
        return fit.model

    def diagram(method: str | None) -> StabilityDiagram:
        return build_stability(frf, selection.band_hz, method=method or "lsce", settings=settings)

    return edited(fit, shorthand(pinned), diagram).model


def _around(frf: FRF, hz: tuple[float, ...]) -> tuple[float, float]:
    """The band of views, widened to some frequencies and a fifth beyond."""
    low, high = frf.shown_band_hz()
    far = min(max([high, *(1.2 * each for each in hz)]), float(frf.frequency_hz[-1]))
    return min([low, *(0.8 * each for each in hz)]), far
