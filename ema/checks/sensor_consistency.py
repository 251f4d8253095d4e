"""Sensor consistency: inverted, wrongly scaled or swapped sensors, found from the modes.

A correction is a claim about the set-up. It is made only where all ring modes say the same, where
it is significant, and for few sensors: what makes many of them look wrong is the tyre.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from ema.checks.corrections import OF_GAINS, Correction, corrected
from ema.checks.ring_shapes import MAJORITY, RingShapes, ring_shapes
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF, position_finding
from ema.core.modes import ModalModel
from ema.core.settings import CHECKS, CheckSettings

_DONE = {
    Check.FLIPPED: "polarity inverted for the fit",
    Check.SCALED: "gain corrected by this factor for the fit",
    Check.SWAPPED: "both corrected for the fit",
    Check.INCONSISTENT: "left out of the fit",
}
_BY_HAND = "not corrected, as the row was decided on by hand"
_AS_IT_IS = "not corrected, as [checks] correct_sensors is false"

_Evidence = tuple[float, float, float]
_NOTHING: Mapping[int, float] = MappingProxyType({})

# Fewer modes could hardly agree on a gain.
_FEWEST_WAVES = 2
# Gains of one fault agree within this share.
_SAME_GAIN = 0.15
# A run of which more than this share of the sensors contradicts the others is odd as a whole.
_ODD_RUN = 0.5
# A run's force is of wrong sign or scale where nearly all its sensors show one and the same gain.
_WHOLE_RUN = 0.9
# The reduced χ² of the fit may rise by this factor for reasons of the search.
SLACK = 1.02
# … or by any, where the shapes come this much closer: orders that were hidden then have one pole
# each instead of several that follow the errors.
_FAR_CLOSER = 0.1


@dataclass(frozen=True)
class _Change:
    """What is to be done with a row, and the finding that says so."""

    correction: Correction
    finding: Finding


@dataclass(frozen=True)
class ConsistencyCheck:
    """FRFs after the check of the sensors against the ring modes."""

    frf: FRF
    findings: tuple[Finding, ...]  # per sensor corrected or left out, or why none was
    corrections: tuple[Correction, ...] = ()  # make `frf` of the FRFs checked; rows count those

    @property
    def changed(self) -> bool:
        """Whether `frf` differs from what was checked."""
        return bool(self.corrections)

    def beside(self, findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
        """Findings of before, without those on factors that are given anew."""
        anew = {(each.run, each.channel, each.position_deg) for each in self.corrections}
        return tuple(
            each
            for each in findings
            if each.check not in OF_GAINS or (each.run, each.channel, each.position_deg) not in anew
        )

    @property
    def withheld(self) -> Finding:
        """The finding for corrections that were tried and did not help."""
        detail = (
            f"{len(self.findings)} corrections of sensors were tried; the modes did not come "
            "closer to pure shapes. Nothing was changed"
        )
        return Finding("", "", None, Check.CORRECTIONS_WITHHELD, Verdict.WARNING, detail)


def check_consistency(
    frf: FRF,
    model: ModalModel,
    *,
    exclude: bool = True,
    settings: CheckSettings = CHECKS,
    decided: Container[int] = (),
    applied: Mapping[int, float] = _NOTHING,
) -> ConsistencyCheck:
    """Compare every sensor with the shapes that all sensors together show.

    Each ring mode is cos n(θ − θ_n) all around; fitted robustly, the few sensors that disagree
    stand out by the gain and the mismatch over all modes. Inverted, wrongly scaled and swapped
    sensors are corrected; what else contradicts the modes is left out, with `exclude`.

    The FRFs are of a closed circle of positions, and the modes fitted to them. Of the rows that a
    person `decided` on, what speaks against them is told, and nothing is changed. Of factors that
    were `applied` to rows before, a new one takes the place: the first fit followed the errors.
    """
    changes = _force_changes(frf, ring_shapes(frf, model, followed_by=MAJORITY), settings)
    if changes:  # of whole runs: single sensors are judged once those are right
        return _checked(frf, changes, [], settings, decided)
    shapes = ring_shapes(frf, model)
    if shapes.n_waves < _FEWEST_WAVES:
        return ConsistencyCheck(frf, ())
    changes = _sensor_changes(frf, shapes, settings, applied, exclude=exclude)
    odd_runs = _odd_runs(frf, changes)
    changes = {
        row: change
        for row, change in changes.items()
        if not change.correction.excluded or frf.run[row] not in odd_runs
    }
    odd = [_odd_run_finding(frf, run, count) for run, count in odd_runs.items()]
    if _too_many(frf, changes, settings):
        return ConsistencyCheck(frf, (*odd, _withheld_finding(frf, model, changes, settings)))
    return _checked(frf, changes, odd, settings, decided)


def is_better(before: tuple[FRF, ModalModel], after: tuple[FRF, ModalModel]) -> bool:
    """Whether corrections brought the shapes closer to waves without a worse fit of the FRFs."""
    shapes_before, shapes_after = (
        ring_shapes(*state, followed_by=MAJORITY) for state in (before, after)
    )
    left, was = shapes_after.misfit(), shapes_before.misfit()
    worse_fit = after[1].misfit > SLACK * before[1].misfit
    return left < was and (not worse_fit or left < _FAR_CLOSER * was)


def _force_changes(frf: FRF, shapes: RingShapes, settings: CheckSettings) -> dict[int, _Change]:
    """Changes for runs whose force has another sign or scale than that of the others."""
    changes: dict[int, _Change] = {}
    for run in frf.run_names if shapes.n_waves >= _FEWEST_WAVES else ():
        rows = [row for row in range(frf.n_positions) if frf.run[row] == run]
        gains = {row: shapes.gain(row) for row in rows if shapes.n_telling(row)}
        if len(gains) < max(2, _WHOLE_RUN * len(rows)) or len(rows) == frf.n_positions:
            continue
        common = float(np.median([gain for gain, _ in gains.values()]))
        agreeing = [
            row
            for row, (gain, std) in gains.items()
            if abs(gain - common) < max(_SAME_GAIN * abs(common), 3 * std)
            and shapes.mismatch(row, gain) <= settings.contradiction_std
        ]
        if _is_usual(common, settings) or len(agreeing) < _WHOLE_RUN * len(gains):
            continue
        if not _reference_agrees(frf, run, common):
            continue
        std = float(np.median([std for _, std in gains.values()]))
        for row in rows:
            evidence = common, std, shapes.mismatch(row, common)
            changes[row] = _gain_change(frf, row, evidence, settings, whole_run=True)
    return changes if len(changes) < frf.n_positions / 2 else {}


def _reference_agrees(frf: FRF, run: str, gain: float) -> bool:
    """Whether the fixed sensor shows a run's gain too; so it does without a fixed sensor."""
    fixed = frf.reference
    if fixed is None or run not in fixed.run or fixed.n_positions < 3:
        return True
    own = fixed.run.index(run)
    usual = np.median(fixed.values.real, axis=0) + 1j * np.median(fixed.values.imag, axis=0)
    weight = 1 / np.nan_to_num(fixed.std[own], nan=1.0) ** 2 if np.all(fixed.std[own]) else 1.0
    power = float(np.sum(weight * np.abs(usual) ** 2))
    seen = float(np.sum(weight * np.real(usual.conj() * fixed.values[own]))) / power if power else 0
    return abs(seen - gain) < _SAME_GAIN * abs(gain)


def _sensor_changes(
    frf: FRF,
    shapes: RingShapes,
    settings: CheckSettings,
    applied: Mapping[int, float],
    *,
    exclude: bool,
) -> dict[int, _Change]:
    changes: dict[int, _Change] = {}
    suspects = []
    for row in range(frf.n_positions):
        gain, std = shapes.gain(row)
        mismatch = shapes.mismatch(row, gain)
        if mismatch > settings.contradiction_std:
            suspects.append(row)
        elif _is_wrong(gain, std, settings) and shapes.n_telling(row) >= _FEWEST_WAVES:
            change = _gain_change(frf, row, (gain, std, mismatch), settings, applied.get(row, 1.0))
            changes[row] = change
    for first, second in _swapped(frf, shapes, suspects, settings):
        for row, other in ((first, second), (second, first)):
            text = f"swapped with {frf.channel[other]}"
            evidence = _evidence(shapes, other, row)
            changes[row] = _change(frf, row, Check.SWAPPED, text, evidence, source_row=other)
    for row in suspects:
        if row not in changes and exclude:
            text, evidence = _contradiction(shapes, row), _evidence(shapes, row, row)
            changes[row] = _change(frf, row, Check.INCONSISTENT, text, evidence, excluded=True)
    return changes


def _evidence(shapes: RingShapes, row: int, place: int) -> _Evidence:
    """Gain of a row at a place, its standard deviation, and the mismatch left."""
    gain, std = shapes.gain(row, place)
    return gain, std, shapes.mismatch(row, gain, place)


def _change(
    frf: FRF,
    row: int,
    check: Check,
    text: str,
    evidence: _Evidence,
    *,
    factor: float = 1.0,
    source_row: int | None = None,
    excluded: bool = False,
) -> _Change:
    finding = position_finding(
        frf, row, check, Verdict.EXCLUDED if excluded else Verdict.WARNING, text
    )
    place = finding.run, finding.channel, finding.position_deg
    source = row if source_row is None else source_row
    gain, std, mismatch = (number if np.isfinite(number) else None for number in evidence)
    known = gain, std, mismatch
    return _Change(Correction(row, *place, check, factor, source, excluded, *known), finding)


def _gain_change(
    frf: FRF,
    row: int,
    evidence: _Evidence,
    settings: CheckSettings,
    applied: float = 1.0,
    *,
    whole_run: bool = False,
) -> _Change:
    """Change for a sensor that reads the modes by a factor, beside one that is applied already.

    An inverted sensor of right sensitivity keeps its own calibration.
    """
    gain = evidence[0] / applied
    evidence = gain, evidence[1] / abs(applied), evidence[2]
    where = ", as do all sensors of this run: the force's sign or scale is wrong" * whole_run
    if _is_usual(gain, settings):
        text = "fits the modes as it was measured, once the other sensors are right"
        change = _change(frf, row, Check.SCALED, text, evidence, factor=1 / applied)
        return replace(change, finding=replace(change.finding, verdict=Verdict.OK))
    if _is_usual(-gain, settings):
        text = f"fits the modes with a factor of {gain:.2f}{where}"
        return _change(frf, row, Check.FLIPPED, text, evidence, factor=-1.0 / applied)
    turned = " and with the wrong sign" * (gain < 0)
    text = f"reads {abs(gain):.3g} times the value expected from the modes{turned}{where}"
    return _change(frf, row, Check.SCALED, text, evidence, factor=1 / gain / applied)


def _is_usual(gain: float, settings: CheckSettings) -> bool:
    return settings.usual_gain_min <= gain <= settings.usual_gain_max


def _is_wrong(gain: float, std: float, settings: CheckSettings) -> bool:
    significant = abs(gain - 1) > settings.gain_significance_std * std
    return significant and not _is_usual(gain, settings)


def _contradiction(shapes: RingShapes, row: int) -> str:
    gain, _ = shapes.gain(row)
    left = np.linalg.norm(shapes.measured[row] - gain * shapes.expected[row])
    size = np.linalg.norm(shapes.measured[row])
    share = 100 * left / size if size else 100.0
    return f"contradicts the modes of all other sensors: {share:.0f} % of it is not theirs"


def _swapped(
    frf: FRF, shapes: RingShapes, suspects: Sequence[int], settings: CheckSettings
) -> list[tuple[int, int]]:
    """Pairs of one run's suspects of which each fits the other's place."""
    pairs: list[tuple[int, int]] = []
    taken: set[int] = set()
    for number, first in enumerate(suspects):
        for second in suspects[number + 1 :]:
            if frf.run[first] != frf.run[second] or {first, second} & taken:
                continue
            if _fits(shapes, first, second, settings) and _fits(shapes, second, first, settings):
                pairs.append((first, second))
                taken |= {first, second}
    return pairs


def _fits(shapes: RingShapes, row: int, as_if: int, settings: CheckSettings) -> bool:
    gain, _ = shapes.gain(row, as_if)
    mismatch = shapes.mismatch(row, gain, as_if)
    return _is_usual(gain, settings) and mismatch <= settings.contradiction_std


def _odd_runs(frf: FRF, changes: dict[int, _Change]) -> dict[str, int]:
    """Runs most sensors of which would be left out, and how many those are."""
    lost = [frf.run[row] for row, change in changes.items() if change.correction.excluded]
    return {
        run: lost.count(run)
        for run in sorted(set(lost))
        if lost.count(run) > _ODD_RUN * frf.run.count(run)
    }


def _odd_run_finding(frf: FRF, run: str, count: int) -> Finding:
    detail = (
        f"{count} of {frf.run.count(run)} sensors contradict the modes of the other runs together: "
        "the run saw the tyre in another state, or its positions are those of another run; it was "
        "left in"
    )
    return Finding(run, "", None, Check.INCONSISTENT, Verdict.WARNING, detail)


def _too_many(frf: FRF, changes: dict[int, _Change], settings: CheckSettings) -> bool:
    """Whether more rows would be changed than sensors fail."""
    in_run = [frf.run[row] for row in changes]
    if any(in_run.count(run) > settings.most_corrections_per_run for run in set(in_run)):
        return True
    of_sensor: dict[str, list[float]] = {}
    for row, change in changes.items():
        of_sensor.setdefault(frf.channel[row], []).append(change.correction.gain or 0.0)
    counted = sum(
        1 if _one_fault(gains, frf.channel.count(name)) else len(gains)
        for name, gains in of_sensor.items()
    )
    # Two sensors swapped in all their runs are one mistake.
    swapped = {
        frf.channel[row] for row in changes if changes[row].correction.check == Check.SWAPPED
    }
    counted -= len(swapped) // 2
    return counted > max(1.0, settings.most_corrections_share * frf.n_positions)


def _one_fault(gains: Sequence[float], n_runs: int) -> bool:
    """Whether a sensor shows one and the same gain in all its runs."""
    median = float(np.median(gains))
    same = all(abs(gain - median) <= _SAME_GAIN * abs(median) for gain in gains)
    return len(gains) == n_runs and same


def _withheld_finding(
    frf: FRF, model: ModalModel, changes: dict[int, _Change], settings: CheckSettings
) -> Finding:
    most, share = settings.most_corrections_per_run, settings.most_corrections_share
    first = "; ".join(
        f"{change.finding.run} {change.finding.channel} {change.finding.check}"
        for change in list(changes.values())[:most]
    )
    detail = (
        f"{len(changes)} sensors seem to contradict the modes ({first} …), more than fail at a "
        f"time (at most {most} in a run and {100 * share:.0f} % of all). "
        f"{_looks_like(frf, model, list(changes))}. Nothing was changed"
    )
    return Finding("", "", None, Check.CORRECTIONS_WITHHELD, Verdict.WARNING, detail)


def _looks_like(frf: FRF, model: ModalModel, rows: Sequence[int]) -> str:
    """The likely cause where it is not the sensors; wrong positions were tried before."""
    if model.drift.applied:
        moved = float(np.max(np.abs(model.drift.percent)))
        return f"It looks like drift: natural frequencies moved by {moved:.2g} % between the runs"
    run, count = Counter(frf.run[row] for row in rows).most_common(1)[0]
    if len(frf.run_names) > 1 and count > _ODD_RUN * len(rows):
        return (
            f"{count} of them are in {run}: it looks like wrong positions or another tyre, or the "
            "same one in another state, in this run"
        )
    return (
        "They are spread over the runs: it looks like a structure that is no even ring, or "
        "positions that are wrong in several runs"
    )


def _checked(
    frf: FRF,
    changes: dict[int, _Change],
    odd: Sequence[Finding],
    settings: CheckSettings,
    decided: Container[int],
) -> ConsistencyCheck:
    """Changes made, or only told where the user does not want any."""
    findings, corrections = list[Finding](), list[Correction]()
    for row in sorted(changes):
        each = changes[row]
        by_hand = row in decided or each.correction.source_row in decided
        if by_hand or not settings.correct_sensors:
            why = _BY_HAND if by_hand else _AS_IT_IS
            detail = f"{each.finding.detail}: {why}"
            findings.append(replace(each.finding, verdict=Verdict.WARNING, detail=detail))
        else:
            done = "" if each.finding.is_ok else f": {_DONE[each.finding.check]}"
            findings.append(replace(each.finding, detail=f"{each.finding.detail}{done}"))
            corrections.append(each.correction)
    made = tuple(corrections)
    return ConsistencyCheck(corrected(frf, made), (*findings, *odd), made)
