"""What a page shows at one moment: the newest fit beside the automatic result."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from ema.checks.corrections import Correction
from ema.core.edits import EditKind, PoleName, of_kind
from ema.core.finding import Finding
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.identify import Identification
from ema.poles.selection import Opinion
from ema.poles.stability import StabilityDiagram
from pipelines.process.refit import settings_of
from pipelines.results.result import Result
from pipelines.review.session import Session

_SAME_MODE = 0.05  # farther from each other, relative to their frequency, poles are different modes
_SAME_POLE = 1e-6  # relative distance of a name to the pole it was taken from


@dataclass(frozen=True, eq=False)
class ModeRow:
    """A mode of the newest fit, of the automatic result, or of both.

    Parameters
    ----------
    mode : Mode
        That of the fit where it is listed there.
    listed : bool
    chosen : str
        Who put it on the list, or why it is not there.
    automatic : Mode or None
        The same mode of the automatic result.
    """

    mode: Mode
    listed: bool
    chosen: str
    automatic: Mode | None

    @property
    def key(self) -> str:
        """Its name in requests, as long as the frequency stays."""
        return f"{self.mode.pole.real:.9g},{self.mode.pole.imag:.9g}"

    @property
    def name(self) -> str:
        """Order and member."""
        return mode_label(self.mode)

    def shift_in_std(self) -> tuple[float, float]:
        """Changes of frequency and damping against the automatic mode in its σ."""
        one, other = self.mode, self.automatic
        if other is None or not self.listed:
            return float("nan"), float("nan")
        moved = one.frequency_hz - other.frequency_hz, one.damping_ratio - other.damping_ratio
        return moved[0] / other.frequency_std_hz, moved[1] / other.damping_std


@dataclass(frozen=True, eq=False)
class Sight:
    """The newest numbers of a review.

    Parameters
    ----------
    result : Result
        As opened.
    session : Session
    automatic : ModalModel
        Without any edit.
    found : Identification or None
        The newest fit; None where only what was opened is known.
    is_current : bool
        Whether it has all edits in force.
    """

    result: Result
    session: Session
    automatic: ModalModel
    found: Identification | None
    is_current: bool

    @property
    def revision(self) -> int:
        """Of the session."""
        return self.session.revision

    @property
    def _source(self) -> Identification | Result:
        return self.result if self.found is None else self.found

    @property
    def model(self) -> ModalModel:
        """The modes."""
        return self.result.modal_model if self.found is None else self.found.model

    @property
    def is_preview(self) -> bool:
        """Whether numbers can change yet."""
        return self.found is None or self.found.is_preview or not self.is_current

    @property
    def frf(self) -> FRF:
        """What is fitted."""
        return self._source.frf

    @property
    def measured(self) -> FRF:
        """All rows as measured."""
        return self._source.measured

    @property
    def diagram(self) -> StabilityDiagram:
        """Poles of all model orders."""
        return self._source.diagram

    @property
    def corrections(self) -> tuple[Correction, ...]:
        """What is done with single rows."""
        return self._source.corrections

    @property
    def opinions(self) -> tuple[Opinion, ...]:
        """The cross-check."""
        return self._source.opinions

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Of the recordings from the result, of the modes from the newest fit."""
        if self.found is None:
            return self.result.findings
        return tuple(dict.fromkeys([*self.result.findings, *self.found.findings]))

    @cached_property
    def settings(self) -> dict[str, Any]:
        """Settings in force."""
        options = self.result.provenance.get("options", {})
        processing = options.get("processing", {})
        names = "block_seconds", "window", "overlap", "averages"
        known = {name: processing.get(name) for name in names}
        if known["averages"] is None:
            known["averages"] = processing.get("averages_per_run")
        known |= {name: options.get(name) for name in ("method", "max_order", "estimator")}
        known["band_hz"] = list(self.result.modal_model.band_hz)
        return known | settings_of(self.session.edits)

    @property
    def poles_asked(self) -> dict[str, Any]:
        """How the poles of the diagram were found."""
        return {name: self.settings[name] for name in ("method", "max_order")}

    @cached_property
    def listed(self) -> list[ModeRow]:
        """Rows of the modes of the newest fit."""
        return [row for row in self.modes if row.listed]

    @cached_property
    def modes(self) -> list[ModeRow]:
        """All modes, ascending: those that are listed, and those of the automatic result."""
        now, before = self.model.modes, self.automatic.modes
        twins = _twins(now, before)
        rows = [
            ModeRow(mode, True, mode.chosen.value, before[twins[k]] if k in twins else None)
            for k, mode in enumerate(now)
        ]
        left = set(range(len(before))) - set(twins.values())
        rows += [ModeRow(before[k], False, self._why_gone(before[k]), before[k]) for k in left]
        return sorted(rows, key=lambda row: row.mode.frequency_hz)

    def mode_named(self, key: str) -> ModeRow | None:
        """The mode of a key."""
        return next((row for row in self.modes if row.key == key), None)

    def _why_gone(self, mode: Mode) -> str:
        aside = of_kind(self.session.edits, EditKind.SET_ASIDE)
        named = any(each.pole is not None and _is_name_of(each.pole, mode) for each in aside)
        only = of_kind(self.session.edits, EditKind.ONLY_KEPT)
        return "set aside" if named or only else "gone"


def mode_label(mode: Mode) -> str:
    """Order and member, a dash where the order is not known."""
    return "–" if mode.order is None else f"{mode.order}{mode.member}"


def _is_name_of(name: PoleName, mode: Mode) -> bool:
    return abs(name.frequency_hz / mode.frequency_hz - 1) < _SAME_POLE


def _twins(now: tuple[Mode, ...], before: tuple[Mode, ...]) -> dict[int, int]:
    """Which modes are the same: those that make the sum of all distances smallest."""
    if not now or not before:
        return {}
    one, other = (np.array([mode.pole for mode in modes]) for modes in (now, before))
    apart = np.abs(one[:, None] - other) / np.abs(other)
    pairs = zip(*linear_sum_assignment(np.minimum(apart, 2 * _SAME_MODE)), strict=True)
    return {int(k): int(m) for k, m in pairs if apart[k, m] < _SAME_MODE}
