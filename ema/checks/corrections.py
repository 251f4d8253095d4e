"""Screening of the channels before a fit, and corrections of their rows."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ema.core.display import counted
from ema.core.edits import OF_CHANNELS, Edit, EditKind, of_kind
from ema.core.errors import InputError, unknown
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF, position_finding
from ema.core.settings import CHECKS, CheckSettings
from ema.signals.leakage import line_coherence

_SAID = {
    EditKind.CHANNEL_OUT: "left out",
    EditKind.RUN_OUT: "left out with its run",
    EditKind.CHANNEL_IN: "used, whatever the checks say of it",
    EditKind.FLIP: "sign changed",
    EditKind.GAIN: "multiplied with a factor",
}
_HUM_HZ = (50.0, 60.0)
# One or two places may have a fault of their own, unless more than two runs differ there.
_FEWEST_AVERAGED = 3
# Noise has a coherence of one over the number of averages: fewer do not tell it from a response.
_FEW_AVERAGES = 6.0
# An FRF with less than this share of the usual size is rounding of a constant signal.
_ROUNDING = 1e-12


#: Checks that find a factor between a sensor and the modes.
OF_GAINS = (Check.FLIPPED, Check.SCALED)


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

    @property
    def is_none(self) -> bool:
        """Whether a check left the row as it is, after all."""
        as_measured = self.source_row == self.row and math.isclose(self.factor, 1.0, rel_tol=1e-9)
        return as_measured and not (self.excluded or self.is_by_hand)


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
    """Corrections of the FRFs as measured; the rows of `then` count what `first` left of them.

    What a later one takes back is none.
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
    return tuple(changed[row] for row in sorted(changed) if not changed[row].is_none)


def gains_applied(frf: FRF, corrections: Sequence[Correction]) -> dict[int, float]:
    """Factors that a check of the sensors gave to rows, counted among those that are left."""
    given = {
        each.row: each.factor
        for each in corrections
        if each.check in OF_GAINS and not each.is_by_hand
    }
    kept = kept_rows(frf, corrections).tolist()
    return {at: given[row] for at, row in enumerate(kept) if row in given}


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

    The FRFs are as measured, with all rows; all edits are given, so that an error tells which one
    it is. Factors of one row multiply; of leaving out and bringing back the last one counts.

    `InputError` for a channel or run that the FRFs do not have, a run that was averaged with
    others, a channel to be used that measured nothing, and where no row is left.
    """
    made: dict[int, Correction] = {}
    said: dict[int, list[str]] = {}
    for number, edit in enumerate(edits, start=1):
        for row in rows_named(frf, edit, number) if channel_edits([edit]) else ():
            if edit.kind is EditKind.CHANNEL_IN:
                _require_signal(frf, row, number)
            before = made.get(row) or _untouched(frf, row)
            made[row] = _after(before, edit)
            why = f" ({edit.reason})" if edit.reason else ""
            said.setdefault(row, []).append(f"{_SAID[edit.kind]}{why}")
    rows = sorted(made)
    if sum(each.excluded for each in made.values()) == frf.n_positions:
        raise InputError("edits", "all rows are left out", "one has to be used", "Bring one back")
    findings = [_finding(frf, made[row], "; ".join(said[row])) for row in rows]
    return tuple(made[row] for row in rows), tuple(findings)


def _require_signal(frf: FRF, row: int, number: int) -> None:
    """Refuse to use a row that is nothing but rounding: it would count as an exact zero."""
    size = np.max(np.abs(frf.values), axis=1)
    if not size[row] > _ROUNDING * np.median(size):
        where, found = f"edit {number}, channel_in", f"{frf.channel[row]} in {frf.run[row]}"
        rule, remedy = "it measured nothing", "Leave it out, or name the other runs only"
        raise InputError(where, found, rule, remedy)


def rows_named(frf: FRF, edit: Edit, number: int) -> list[int]:
    """Rows that an edit of a number means; an error where there are none."""
    every, where = range(frf.n_positions), f"edit {number}, {edit.kind}"
    if edit.kind is EditKind.RUN_OUT:
        rows = [row for row in every if frf.run[row] == edit.run]
        mixed = [row for row in every if f"+{edit.run}+" in f"+{frf.run[row]}+" and row not in rows]
        if mixed:
            found = f"{edit.run} is averaged with other runs in {counted(len(mixed), 'FRF')}"
            rule = f"the first is {frf.channel[mixed[0]]}; an average cannot be taken apart"
            raise InputError(where, found, rule, "Process the recordings again without this run")
        if not rows:
            raise unknown(where, str(edit.run), "no such run has been measured", frf.run)
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
        raise unknown(where, found, "no such FRF has been measured", known)
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


def screen(
    frf: FRF,
    band_hz: tuple[float, float],
    settings: CheckSettings = CHECKS,
    decided: Container[int] = (),
) -> tuple[FRF, list[Finding], tuple[Correction, ...]]:
    """Leave out channels that are dead, clipped, incoherent or full of gaps; remark on hum.

    Channels are judged in the band. Of the rows that a person `decided` on, what speaks against
    them is told, and they are used. Returned are the usable FRFs, a finding for everything that is
    not in order, and the corrections that leave the usable ones of all FRFs.

    `InputError` if no channel is usable, or most places were averaged from runs that contradict
    each other.
    """
    faults: dict[int, _Fault] = {}
    for found in (
        _incoherent(frf, band_hz, settings),
        _clipped(frf, settings),
        _dead(frf, band_hz, settings.dead_db),
        _missing(frf, settings.missing_share),
    ):  # the last that excludes; a remark takes no place
        faults |= {k: v for k, v in found.items() if k not in faults or v[1] is Verdict.EXCLUDED}
    faults = {row: _used(fault) if row in decided else fault for row, fault in faults.items()}
    of_row = {row: position_finding(frf, row, *fault) for row, fault in sorted(faults.items())}
    findings = list(of_row.values())
    exclusions = tuple(
        exclusion(row, told) for row, told in of_row.items() if told.verdict == Verdict.EXCLUDED
    )
    if len(exclusions) == frf.n_positions:
        raise InputError(
            "all channels",
            "; ".join(sorted({finding.detail for finding in findings})),
            "at least one response must be usable",
            "Check cables, ranges and the excitation",
        )
    usable = corrected(frf, exclusions)
    _require_one_place(usable, settings)
    findings += _disagreeing(usable, settings.disagreement_share)
    findings += _force_findings(frf, settings.few_clipped_share)
    return usable, findings + _hum_findings(usable, settings.hum_db), exclusions


def _require_one_place(frf: FRF, settings: CheckSettings) -> None:
    """Refuse averages of turned runs: their sensors were never at one place."""
    contradicts = frf.disagreement > settings.contradiction_share
    few = frf.disagreement.size < _FEWEST_AVERAGED
    if np.mean(contradicts) <= 0.5 or (few and not all(name.count("+") > 1 for name in frf.run)):
        return
    median = float(np.median(frf.disagreement))
    raise InputError(
        "positions",
        f"{np.count_nonzero(contradicts)} of {frf.n_positions} places, averaged over runs that "
        f"contradict each other (median {100 * median:.0f} % of their power)",
        "runs averaged at a place must have measured there, with the force at one place",
        "If the tyre was turned between runs, state the positions of each run: 'ringmodal init "
        "FOLDER' writes a manifest to fill in. If the hammer moved and one sensor stayed, add "
        "positions_deg = { FORCE = degrees, SENSOR = degrees } to every run",
    )


def _disagreeing(frf: FRF, share: float) -> list[Finding]:
    """Places where runs were averaged that did not see the same."""
    return [
        position_finding(
            frf,
            int(row),
            Check.AVERAGED_RUNS,
            Verdict.WARNING,
            f"the runs averaged here differ by {100 * frf.disagreement[row]:.0f} % of their "
            "power: sensors from different places under one node or position?",
        )
        for row in np.flatnonzero(frf.disagreement > share)
    ]


_Fault = tuple[Check, Verdict, str]  # and the detail


def _used(fault: _Fault) -> _Fault:
    """The fault of a row that is used by decision."""
    check, verdict, detail = fault
    left_out = verdict is Verdict.EXCLUDED
    return check, Verdict.WARNING, f"{detail}; used all the same, by hand" if left_out else detail


def _dead(frf: FRF, band_hz: tuple[float, float], limit_db: float) -> dict[int, _Fault]:
    lines = _lines(frf, band_hz)
    power = np.mean(np.abs(frf.values[:, lines]) ** 2, axis=1)
    level = _db(power, float(np.median(power)))
    return {
        int(row): (Check.DEAD, Verdict.EXCLUDED, _dead_text(level[row]))
        for row in np.flatnonzero(level < limit_db)
    }


def _dead_text(level_db: float) -> str:
    if np.isneginf(level_db):
        return "the signal is constant"
    return f"the signal is {-level_db:.0f} dB below the median of the channels"


def _clipped(frf: FRF, settings: CheckSettings) -> dict[int, _Fault]:
    return {
        int(row): (
            Check.CLIPPED,
            Verdict.EXCLUDED if frf.clipped[row] > settings.clipped_share else Verdict.WARNING,
            f"{100 * frf.clipped[row]:.2g} % of the samples sit on the limits of the signal",
        )
        for row in np.flatnonzero(frf.clipped > settings.few_clipped_share)
    }


def _missing(frf: FRF, share: float) -> dict[int, _Fault]:
    return {
        int(row): (
            Check.MISSING_SAMPLES,
            Verdict.EXCLUDED if frf.missing[row] > share else Verdict.WARNING,
            f"{100 * frf.missing[row]:.2g} % of the averages left out, as samples are missing",
        )
        for row in np.flatnonzero(frf.missing > 0)
    }


def _incoherent(
    frf: FRF, band_hz: tuple[float, float], settings: CheckSettings
) -> dict[int, _Fault]:
    coherence, over = frf.coherence, ""
    if frf.n_effective < _FEW_AVERAGES:
        coherence, over = line_coherence(frf), " over neighbouring lines"
    if frf.n_positions < 4 or not np.all(np.isfinite(coherence)):
        return {}
    median = np.median(coherence[:, _lines(frf, band_hz)], axis=1)
    usual = float(np.median(median))
    poor = (median < settings.incoherent_share * usual) & (median < settings.incoherent)
    return {
        int(row): (
            Check.INCOHERENT,
            Verdict.EXCLUDED,
            f"median coherence{over} {median[row]:.2f}, where the other channels have {usual:.2f}",
        )
        for row in np.flatnonzero(poor)
    }


def _hum_findings(frf: FRF, limit_db: float) -> list[Finding]:
    """Mains hum on all channels as one remark, and one for each channel that hums far louder."""
    findings = []
    for mains_hz in _HUM_HZ:
        level = _tone_db(frf, mains_hz)
        usual = float(np.median(level)) if level.size else 0.0
        if usual > limit_db:
            text = (
                f"{mains_hz:g} Hz hum on most channels, {usual:.0f} dB above the noise nearby; "
                "these lines are down-weighted"
            )
            findings.append(Finding("", "", None, Check.HUM, Verdict.OK, text))
        for row in np.flatnonzero(level > max(usual, 0) + limit_db):
            text = f"{mains_hz:g} Hz hum, {level[row]:.0f} dB above the noise nearby"
            findings.append(position_finding(frf, int(row), Check.HUM, Verdict.WARNING, text))
    return findings


def _tone_db(frf: FRF, tone_hz: float) -> NDArray[np.float64]:
    """How far the noise of each row sticks out at a frequency; empty where it cannot be told."""
    near = np.flatnonzero(np.abs(frf.frequency_hz - tone_hz) < 3)
    at = near[np.abs(frf.frequency_hz[near] - tone_hz) < 0.6]
    if near.size < 9 or not at.size or not np.all(np.isfinite(frf.std[:, near])):
        return np.zeros(0)
    power = frf.std**2
    return _db(np.max(power[:, at], axis=1), np.median(power[:, near], axis=1))


def _force_findings(frf: FRF, few: float) -> list[Finding]:
    worst = {
        run: float(np.max(frf.force_clipped[np.array(frf.run) == run])) for run in set(frf.run)
    }
    return [
        Finding(
            run=run,
            channel="force",
            position_deg=None,
            check=Check.CLIPPED,
            verdict=Verdict.WARNING,
            detail=f"{100 * share:.2g} % of the force's samples sit on the limits of the signal; "
            "all FRFs of this run are affected",
        )
        for run, share in sorted(worst.items())
        if share > few
    ]


def _lines(frf: FRF, band_hz: tuple[float, float]) -> NDArray[np.bool_]:
    return np.asarray((frf.frequency_hz >= band_hz[0]) & (frf.frequency_hz <= band_hz[1]))


def _db(power: NDArray[np.float64], over: NDArray[np.float64] | float) -> NDArray[np.float64]:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(10 * np.log10(power / over))
