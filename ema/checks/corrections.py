"""Corrections of FRFs: data beside the FRFs as measured, applied on the way into the fit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ema.core.finding import Check, Finding
from ema.core.frf import FRF


class DecidedBy(StrEnum):
    """Who decided on a correction."""

    AUTOMATIC = "automatic"
    BY_HAND = "by hand"


@dataclass(frozen=True)
class Correction:
    """What is done with one measured FRF before the fit, and the evidence."""

    row: int  # of the FRFs as measured
    run: str
    channel: str
    position_deg: float | None
    check: Check  # reason: the check that found it
    factor: float  # what the FRF is multiplied with; −1 for a sensor of wrong sign
    source_row: int  # whose FRF belongs here: `row`, another one where sensors were swapped
    excluded: bool  # whether the row is left out of the fit
    # Measured over expected from the modes; None where these were not asked.
    gain: float | None = None
    gain_std: float | None = None
    mismatch_std: float | None = None  # RMS of what is left over the modes after this gain, in σ
    decided: DecidedBy = DecidedBy.AUTOMATIC

    @property
    def is_by_hand(self) -> bool:
        """Whether a person decided, which no check changes."""
        return self.decided is DecidedBy.BY_HAND


def exclusion(row: int, finding: Finding) -> Correction:
    """A row that a finding leaves out, without a look at the modes."""
    place = finding.run, finding.channel, finding.position_deg
    return Correction(row, *place, finding.check, 1.0, row, excluded=True)


def corrected(frf: FRF, corrections: Iterable[Correction]) -> FRF:
    """FRFs as the fit sees them.

    Parameters
    ----------
    frf : FRF
        As measured.
    corrections : iterable of Correction
        At most one for each row.
    """
    changes = tuple(corrections)
    if not changes:
        return frf
    factor, source = np.ones(frf.n_positions), np.arange(frf.n_positions)
    for each in changes:
        factor[each.row], source[each.row] = each.factor, each.source_row
    taken = frf.rows(source)
    changed = replace(
        taken,
        values=taken.values * factor[:, None],
        std=taken.std * np.abs(factor)[:, None],
        node=frf.node,
        position_deg=frf.position_deg,
    )
    return changed.rows(kept_rows(frf, changes))


def kept_rows(frf: FRF, corrections: Iterable[Correction]) -> NDArray[np.int_]:
    """Measured rows that are not left out."""
    out = [each.row for each in corrections if each.excluded]
    return np.setdiff1d(np.arange(frf.n_positions), out)


def followed_by(
    frf: FRF, first: tuple[Correction, ...], then: tuple[Correction, ...]
) -> tuple[Correction, ...]:
    """Corrections of the FRFs as measured for those of what `first` made of them.

    Parameters
    ----------
    frf : FRF
        As measured.
    first, then : tuple of Correction
        Rows of `then` count what `first` left.
    """
    kept = [int(row) for row in kept_rows(frf, first)]
    known = {each.row: each for each in first}
    changed = dict(known)
    for each in then:
        row, source = kept[each.row], kept[each.source_row]
        before = known.get(source)
        factor = each.factor * before.factor if before else each.factor
        source = before.source_row if before else source
        changed[row] = replace(each, row=row, source_row=source, factor=factor)
    return tuple(changed[row] for row in sorted(changed))
