"""Channel screening before the fit: dead, clipped, incoherent or incomplete channels, and hum."""

from __future__ import annotations

from collections.abc import Container

import numpy as np
from numpy.typing import NDArray

from ema.checks.corrections import Correction, corrected, exclusion
from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF, position_finding
from ema.core.settings import CHECKS, CheckSettings
from ema.signals.bias_and_noise import line_coherence

_HUM_HZ = (50.0, 60.0)
# One or two places may have a fault of their own, unless more than two runs differ there.
_FEWEST_AVERAGED = 3
# Noise has a coherence of one over the number of averages: fewer do not tell it from a response.
_FEW_AVERAGES = 6.0


def screen(
    frf: FRF,
    band_hz: tuple[float, float],
    settings: CheckSettings = CHECKS,
    decided: Container[int] = (),
) -> tuple[FRF, list[Finding], tuple[Correction, ...]]:
    """Leave out channels that are dead, clipped, incoherent or full of gaps; remark on hum.

    Parameters
    ----------
    frf : FRF
    band_hz : tuple of float
        Band in which the channels are judged.
    settings : CheckSettings
    decided : container of int
        Rows that a person decided on: what speaks against them is told, and they are used.

    Returns
    -------
    usable : FRF
        Without the excluded rows.
    findings : list of Finding
        One for everything that is not in order.
    exclusions : tuple of Correction
        What makes `usable` of `frf`.

    Raises
    ------
    InputError
        If no channel is usable, or most places were averaged from runs that contradict each other.
    """
    faults = {
        **_incoherent(frf, band_hz, settings),
        **_clipped(frf, settings),
        **_dead(frf, band_hz, settings.dead_db),
        **_missing(frf, settings.missing_share),
    }
    faults = {row: _used(fault) if row in decided else fault for row, fault in faults.items()}
    of_row = {row: position_finding(frf, row, *found) for row, found in sorted(faults.items())}
    findings = list(of_row.values())
    exclusions = tuple(
        exclusion(row, found) for row, found in of_row.items() if found.verdict == Verdict.EXCLUDED
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
