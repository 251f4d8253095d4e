"""Corrections of FRFs: data beside the FRFs as measured, applied on the way into the fit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ema.core.edits import OF_CHANNELS, Edit, EditKind, of_kind
from ema.core.errors import InputError, unknown
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF, position_finding


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


_SAID = {
    EditKind.CHANNEL_OUT: "left out",
    EditKind.RUN_OUT: "left out with its run",
    EditKind.CHANNEL_IN: "used, whatever the checks say of it",
    EditKind.FLIP: "sign changed",
    EditKind.GAIN: "multiplied with a factor",
}


def channel_edits(edits: Sequence[Edit]) -> tuple[Edit, ...]:
    """Edits of rows, in their order."""
    return of_kind(edits, *OF_CHANNELS, EditKind.RUN_OUT)


def rows_by_hand(frf: FRF, corrections: Sequence[Correction]) -> frozenset[int]:
    """Rows that a person decided on, counted among those that are left."""
    decided = {each.row for each in corrections if each.is_by_hand}
    return frozenset(at for at, row in enumerate(kept_rows(frf, corrections)) if row in decided)


def corrections_by_hand(
    frf: FRF, edits: Sequence[Edit]
) -> tuple[tuple[Correction, ...], tuple[Finding, ...]]:
    """Corrections that a person decided on, and a finding for each.

    Factors of one row multiply; of leaving out and bringing back the last one counts.

    Parameters
    ----------
    frf : FRF
        As measured, with all rows.
    edits : sequence of Edit

    Raises
    ------
    InputError
        For a channel or run that the FRFs do not have, and where no row is left.
    """
    made: dict[int, Correction] = {}
    said: dict[int, list[str]] = {}
    for edit in channel_edits(edits):
        for row in _rows(frf, edit):
            before = made.get(row) or _untouched(frf, row)
            made[row] = _after(before, edit)
            why = f" ({edit.reason})" if edit.reason else ""
            said.setdefault(row, []).append(f"{_SAID[edit.kind]}{why}")
    rows = sorted(made)
    if sum(each.excluded for each in made.values()) == frf.n_positions:
        raise InputError("edits", "all rows are left out", "one has to be used", "Bring one back")
    findings = [_finding(frf, made[row], "; ".join(said[row])) for row in rows]
    return tuple(made[row] for row in rows), tuple(findings)


def _rows(frf: FRF, edit: Edit) -> list[int]:
    every = range(frf.n_positions)
    if edit.kind is EditKind.RUN_OUT:
        rows = [row for row in every if frf.run[row] == edit.run]
        if not rows:
            raise unknown("edits", str(edit.run), "no such run has been measured", frf.run)
        return rows
    name = edit.channel
    assert name is not None  # `Edit` sees to that
    rows = [
        row
        for row in every
        if frf.channel[row] == name.channel and name.run in (None, frf.run[row])
    ]
    if not rows:
        channels = [frf.channel[row] for row in every if name.run in (None, frf.run[row])]
        known, found = (channels, name.channel) if channels else (frf.run, str(name.run))
        raise unknown(f"edits, {edit.kind}", found, "no such FRF has been measured", known)
    return rows


def _untouched(frf: FRF, row: int) -> Correction:
    place = position_finding(frf, row, Check.BY_HAND, Verdict.WARNING, "").position_deg
    return Correction(
        row=row,
        run=frf.run[row],
        channel=frf.channel[row],
        position_deg=place,
        check=Check.BY_HAND,
        factor=1.0,
        source_row=row,
        excluded=False,
        decided=DecidedBy.BY_HAND,
    )


def _after(before: Correction, edit: Edit) -> Correction:
    if edit.kind is EditKind.FLIP:
        return replace(before, factor=-before.factor)
    if edit.kind is EditKind.GAIN:
        return replace(before, factor=before.factor * float(edit.value or 1.0))
    return replace(before, excluded=edit.kind is not EditKind.CHANNEL_IN)


def _finding(frf: FRF, made: Correction, said: str) -> Finding:
    verdict = Verdict.EXCLUDED if made.excluded else Verdict.WARNING
    return position_finding(frf, made.row, Check.BY_HAND, verdict, f"decided by hand: {said}")
