"""A fit with the edits of a person: what they mean in it, and what is listed then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ema.core.edits import Edit, EditKind, of_kind
from ema.core.errors import InputError
from ema.core.modes import Chosen, ModalModel, Pair
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
from ema.fitting.joint_modes import JointModes
from ema.fitting.joint_orders import joint_curves
from ema.fitting.listing import Choice, Key, Row, Settled, listed, std_of_unknown_window
from ema.fitting.order_pair import RingOrder
from ema.fitting.pole_fit import N_STAND_INS, evaluate
from ema.fitting.search import CurveFit
from ema.fitting.variable_projection import Real


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

    def against(self, twins: Mapping[Key, Key]) -> _Found:
        """The same in a fit against another force, whose rows are the twins."""
        poles = {one[0]: other[0] for one, other in twins.items()}

        def there(own: Mapping[int, Any]) -> dict[int, Any]:
            return {poles[k]: each for k, each in own.items() if k in poles}

        orders = {twins[key]: order for key, order in self.orders.items() if key in twins}
        two = {poles[k] for k in self.two if k in poles}
        return _Found(list(self.added), there(self.starts), there(self.locked), two, orders)

    @property
    def refits(self) -> bool:
        """Whether poles have to be fitted again."""
        return bool(self.added or self.starts or self.locked)

    @property
    def is_anew(self) -> bool:
        """Whether pairs have to be found again."""
        return self.refits or bool(self.orders)


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
    before, found = _begun(before, edits, diagrams)
    curve, after = before.curve, before
    if found.refits:
        curve = first_stage or _gone_on(curve, found)
    if found.is_anew and not live:
        curve = _judged_anew(curve, before.curve.ring, edits, found)
    if found.is_anew or found.two:
        after = _with_orders(curve, found, before)
    return _listing(after, edits, found, is_preview=found.is_anew and live)


def edited_jointly(
    before: Sequence[EditedFit],
    edits: Sequence[Edit],
    diagrams: Diagrams,
    *,
    live: bool = False,
    of_ring: bool = True,
    joint: JointModes | None = None,
) -> list[EditedFit]:
    """Fits against each of several forces with the edits of poles, which name modes of the first.

    A mode of the ring is its order's member against each force; another one is the nearest within
    its half-width, or none. Where poles are fitted again, pairs are found from all forces again.

    Parameters
    ----------
    before : sequence of EditedFit
        Of `joint_curves`.
    edits, diagrams, live
        As for `edited`; the diagram is that of the first force.
    of_ring : bool
        Whether pairs are found from all forces.
    joint : JointModes, optional
        The fit of all forces at once, off a circle; it has nothing left for a second stage.

    Raises
    ------
    InputError
        For an edit that locks a pole or gives it an order where all forces are fitted at once.
    """
    main, found = _begun(before[0], edits, diagrams)
    alike = [main, *(_begun(each, edits)[0] for each in before[1:])]
    meant = [found, *(found.against(_twins(main, each)) for each in alike[1:])]
    curves, after = [each.curve for each in alike], alike
    if joint is not None:
        after = _at_once(joint, alike, found) if found.is_anew else alike
    elif found.refits:
        curves = [_gone_on(curve, own) for curve, own in zip(curves, meant, strict=True)]
    if found.is_anew and not live and joint is None:
        curves = [
            _judged_anew(curve, each.curve.ring, edits, own)
            for curve, each, own in zip(curves, alike, meant, strict=True)
        ]
    if joint is None and (found.is_anew or found.two):
        two = {order.order for order in main.curve.ring if order.key in found.two}
        curves = joint_curves(curves, two) if of_ring else curves
        curves = [_without_partners(curve, edits) for curve in curves]
        after = [_with_orders(*each) for each in zip(curves, meant, alike, strict=True)]
    is_preview = found.is_anew and live and joint is None
    first = _listing(after[0], edits, found, is_preview=is_preview)
    done = [first]
    for each, old in zip(after[1:], alike[1:], strict=True):
        twins = _twins(first, each)
        rows = {row.key for row in each.settled.rows}
        for k in range(len(found.added)):
            twin = _n_poles(old) + k, 0
            twins |= {(_n_poles(main) + k, 0): twin} if twin in rows else {}
        done.append(replace(each, choice=first.choice.against(twins), is_preview=is_preview))
    return done


def _at_once(joint: JointModes, before: Sequence[EditedFit], found: _Found) -> list[EditedFit]:
    """Fits of all forces off a circle, with further poles or from other starts."""
    if found.locked or found.orders:
        rule = "off a circle, poles of several forces cannot be locked and have no order"
        raise InputError("edits", "lock or order_is", rule, "Leave it out")
    rows = joint.going_on(found.added, found.starts)
    return [replace(each, known=own) for each, own in zip(before, rows, strict=True)]


def _twins(one: EditedFit, other: EditedFit) -> dict[Key, Key]:
    """Rows against one force, and the same modes against another."""
    order_of = {order.key: order.order for order in one.curve.ring if order.is_main}
    key_of = {order.order: order.key for order in other.curve.ring if order.is_main}
    there = {row.key: row.mode.pole for row in other.settled.rows}
    rest = {key: pole for key, pole in there.items() if key[0] not in key_of.values()}
    found = dict[Key, Key]()
    for row in one.settled.rows:
        order = order_of.get(row.key[0])
        if order in key_of:
            twin = key_of[order], row.key[1]
            found |= {row.key: twin} if twin in there else {}
        elif order is None and rest:
            near = min(rest, key=lambda key: abs(rest[key] - row.mode.pole))
            if abs(rest[near] - row.mode.pole) < -row.mode.pole.real:
                found[row.key] = near
    return found


def _begun(
    before: EditedFit, edits: Sequence[Edit], diagrams: Diagrams | None = None
) -> tuple[EditedFit, _Found]:
    """The fit without partners, if that is wanted, and what the edits mean in it."""
    if of_kind(edits, EditKind.NO_PARTNERS):
        before = _again(before.curve, [_one(order) for order in before.curve.ring])
    return before, _meaning(before, edits, diagrams) if diagrams else _Found()


def _gone_on(curve: CurveFit, found: _Found) -> CurveFit:
    return curve.going_on(added=found.added, starts=found.starts, locked=found.locked)


def _judged_anew(
    curve: CurveFit, ring: Sequence[RingOrder], edits: Sequence[Edit], found: _Found
) -> CurveFit:
    """Poles that were fitted again, with verdicts on their pairs."""
    curve = copy(curve)
    curve.order_of = {key[0]: order for key, order in found.orders.items()}
    return _without_partners(curve.judged_anew(ring), edits)


def _without_partners(curve: CurveFit, edits: Sequence[Edit]) -> CurveFit:
    if of_kind(edits, EditKind.NO_PARTNERS):
        curve.ring = tuple(_one(order) for order in curve.ring)
    return curve


def _listing(
    after: EditedFit, edits: Sequence[Edit], found: _Found, *, is_preview: bool
) -> EditedFit:
    """The fit with what is listed of it, which is what was decided."""
    choice = _choice(after, edits, found)
    result = replace(after, known=after.settled, choice=choice, is_preview=is_preview)
    listed_poles = {mode.pole for mode in result.model.modes}
    verified(result.settled, choice, found.kept, listed_poles)
    return result


def _n_poles(fit: EditedFit) -> int:
    """Poles of the fit that rows stand for: of several forces off a circle those of all."""
    shown = fit.curve if fit.settled.ring else fit.settled
    return shown.fit.poles.size - N_STAND_INS


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
    window = std_of_unknown_window(settled.frf, row.mode.frequency_hz, row.mode.damping_ratio)
    return np.asarray(own + np.diag([float(hz[0]) ** 2, float(ratio[0]) ** 2 + window**2]))


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
    order = _order_holding(before.curve, pole) if before.settled.ring else None
    if order is not None:
        found.two.add(order.key)
        found.keep((order.key, _nearest_member(order, pole)), wish, picked=True)
        return
    key = _n_poles(before) + len(found.added), 0
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


def _with_orders(curve: CurveFit, found: _Found, before: EditedFit) -> EditedFit:
    """Rows of a fit whose orders have two members, or a locked pole, where that was decided.

    A further pole that turns out to be the second member of an order gets that member's row.
    """
    first = _n_poles(before)
    further = range(first, first + len(found.added))
    ring = []
    for order in curve.ring:
        if any(k in found.locked for k in order.members):
            order = replace(order, pair=None)
        pair_known = order.is_main and order.pair is not None
        joined = pair_known and any(k in further for k in order.members)
        if pair_known and (order.key in found.two or joined):
            order = _two(order)
        for k in order.members if joined else ():
            wish = found.kept.pop((k, 0), None)
            if wish is not None:
                member = _nearest_member(order, curve.fit.poles[k])
                found.keep((order.key, member), wish, picked=k in further)
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
