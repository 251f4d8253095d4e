"""What a person decided about poles, found again in a fit: which row or pole each edit means.

A mode is named by its frequency and, where given, its damping ratio. The nearest one within reach
is meant, if it is clearly the nearest; everything else is an error that lists what is there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ema.core.edits import OF_POLES, Edit, EditKind, PoleName, of_kind
from ema.core.errors import FitError
from ema.core.settings import IdentificationSettings
from ema.fitting.listing import Choice, Key, Row, Settled
from ema.poles.stability import StabilityDiagram

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
        poles = sorted(there, key=lambda pole: _away(self.pole, pole))[:_MOST_SHOWN]
        near = ", ".join(_said(pole) for pole in sorted(poles, key=abs)) or "none"
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
