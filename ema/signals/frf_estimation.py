"""Estimation of frequency response functions from recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Campaign, Processing, Run
from ema.core.errors import InputError, require_type
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF, ForceRecord
from ema.core.numerics import available_threads, one_blas_thread
from ema.core.recording import BlockPlan
from ema.signals.damage import without_damage, without_lost_samples
from ema.signals.events import event_plans, find_events, is_one_early_hit, window_findings
from ema.signals.excitation import (
    SHORTEST_PERIOD_S,
    is_steady,
    period_samples,
    plan_blocks,
    repeats_after,
)
from ema.signals.leakage import incoherent_power
from ema.signals.spectra import Spectra, disagreement, measure_spectra, pooled, ratio

# A run whose force is this far below the median of the runs has no excitation: hits by hand and
# steps of the level differ by 20 dB at most.
_UNEXCITED_DB = -40.0


@one_blas_thread
def estimate_frf(
    campaign: Campaign,
    processing: Processing | None = None,
    *,
    estimator: str = "H1",
    progress: Callable[[int, int], None] | None = None,
    averages: int | None = None,
    block_seconds: float | None = None,
    window: str | None = None,
    overlap: float | None = None,
) -> FRF:
    """FRFs of all positions of a campaign, in the order of their angle (or node).

    A position measured in several runs enters with the spectra of all of them. The fixed
    reference sensor is kept apart, one row per run, in `FRF.reference`.

    Parameters
    ----------
    campaign : Campaign
        From `read_campaign`. FRFs found in its files are handed through.
    processing : Processing, optional
        Instead of the campaign's own.
    estimator : {"H1", "H2", "Hv"}
        H1 suits noise on the accelerations (the usual case), H2 noise on the force, Hv both
        (Bendat & Piersol 2010, ch. 6; Rocklin, Crowley & Vold 1985).
    progress : callable, optional
        Called with (runs done, runs in all) as each run ends.
    averages, block_seconds, window, overlap : optional
        Single choices of `processing`, such as ``averages=10``.

    Returns
    -------
    FRF

    Raises
    ------
    InputError
        If the blocks asked for do not fit, the runs differ in rate or the force is silent.

    Examples
    --------
    >>> import ringmodal as rm
    >>> campaign = rm.read_campaign("sample_data/tyre_225_55R17")
    >>> frf = rm.estimate_frf(campaign)
    >>> frf
    <FRF: 72 positions, 0.25 to 999.75 Hz in steps of 0.25 Hz, 6 runs>
    >>> frf.values.shape == (frf.n_positions, frf.frequency_hz.size)
    True
    """
    require_type("campaign", campaign, Campaign, "Use read_campaign, or FRF.from_arrays for FRFs")
    if str(estimator) not in ESTIMATORS:
        rule = f"it must be one of {', '.join(ESTIMATORS)}"
        raise InputError("FRF", f"estimator {estimator!r}", rule, "Choose one")
    processing = processing or campaign.processing
    require_type("processing", processing, Processing, "Write e.g. averages=10")
    choices: dict[str, Any] = {"averages": averages, "block_seconds": block_seconds}
    choices |= {"window": window, "overlap": overlap}
    processing = replace(processing, **{k: v for k, v in choices.items() if v is not None})
    _require_usable(processing)
    if campaign.frf is None:
        frf = _estimated(campaign, processing, estimator, progress)
    else:
        frf = campaign.frf
        ordered = frf.rows(np.lexsort((frf.node, np.nan_to_num(frf.position_deg))))
        frf = with_given_averages(ordered, processing.averages)
    return replace(
        frf,
        excitation_deg=_number(campaign.excitation_deg),
        exponential_window=processing.exponential_window,
    )


def _require_usable(processing: Processing) -> None:
    """Refuse choices that are no numbers or cannot be met, also where no manifest was read."""
    faults: dict[str, tuple[Any, str, Callable[[Any], bool]]] = {
        "averages": (processing.averages, "a whole number ≥ 1", lambda v: v >= 1 and v == int(v)),
        "block_seconds": (processing.block_seconds, "seconds > 0", lambda v: 0 < v < np.inf),
        "overlap": (processing.overlap, "a share from 0 to 0.95", lambda v: 0 <= v <= 0.95),
    }
    for name, (value, rule, holds) in faults.items():
        number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
        if value is not None and not (number and np.isfinite(value) and holds(value)):
            raise InputError(f"processing, {name}", repr(value), f"it must be {rule}", "Correct it")


def _estimated(
    campaign: Campaign,
    processing: Processing,
    estimator: str,
    progress: Callable[[int, int], None] | None,
) -> FRF:
    with ThreadPoolExecutor(available_threads()) as pool:
        runs, findings = without_damage(campaign.runs, pool.map)
        steady, plans, remarks = _plans(runs, processing)
        findings += remarks
        spectra = []
        for part, slips in pool.map(lambda run: _run_spectra(run, plans[run.name]), runs):
            spectra.append(part)
            findings += slips
            if progress is not None:
                progress(len(spectra), len(runs))
    runs, spectra, silent = _excited(runs, spectra)
    findings += silent
    plan = min((plans[run.name] for run in runs), key=lambda each: each.n_blocks)
    frf = _positions_frf(runs, spectra, plan, estimator)
    reference = _reference_frf(runs, campaign.reference_deg, spectra, plan, estimator)
    forces = {
        run.name: ForceRecord(run.force, plans[run.name], steady)
        for run in runs
        if not run.force.gaps
    }
    return replace(frf, reference=reference, findings=findings, forces=forces)


def _plans(
    runs: Sequence[Run], processing: Processing
) -> tuple[bool, dict[str, BlockPlan], tuple[Finding, ...]]:
    """Whether the force is steady, and the blocks of each run, at its hits or bursts if any."""
    rate = runs[0].recording.sampling_rate_hz
    events = {run.name: find_events(run.force, rate) for run in runs}
    separate = all(len(each) > 1 for each in events.values())
    steady = not separate and all(is_steady(run.force) for run in runs)
    plan = _common_plan(runs, processing, steady=steady)
    chosen = (processing.averages, processing.block_seconds, processing.window, processing.overlap)
    free = not plan.period_samples and all(each is None for each in chosen)
    found = event_plans(runs, events, plan) if separate and free else None
    if found is None:
        whole = {run.name: plan.for_length(run.recording.n_samples) for run in runs}
        if not all(is_one_early_hit(events[run.name], whole[run.name]) for run in runs):
            return steady, whole, ()
        found = whole, ()
    plans, remarks = found
    hits = all(event.pulses for each in events.values() for event in each)
    windows = window_findings(runs, plans, processing.exponential_window, hits=hits)
    return False, plans, (*remarks, *windows)


def _common_plan(runs: Sequence[Run], processing: Processing, *, steady: bool) -> BlockPlan:
    """Blocks for the shortest run; all runs share their length, so that their lines agree."""
    shortest = min(runs, key=lambda run: run.recording.n_samples)
    rate = shortest.recording.sampling_rate_hz
    for run in runs:
        if not np.isclose(run.recording.sampling_rate_hz, rate, rtol=1e-6):
            found = f"{run.recording.sampling_rate_hz:g} Hz sampling rate"
            rule = f"{shortest.name} has {rate:g} Hz; all runs must have the same rate"
            remedy = "Resample one of them or process them separately"
            raise InputError(run.name, found, rule, remedy)
    period = period_samples(shortest.force, round(SHORTEST_PERIOD_S * rate))
    repeats = period > 0 and all(repeats_after(run.force, period) for run in runs)
    return plan_blocks(
        shortest.recording.n_samples,
        rate,
        processing,
        shortest.name,
        steady=steady,
        period_samples=period if repeats else 0,
    )


def _run_spectra(run: Run, plan: BlockPlan) -> tuple[Spectra, tuple[Finding, ...]]:
    """Spectra of a run, measured again where channels turn out to have lost samples."""
    spectra = measure_spectra(run, plan)
    usable, findings = without_lost_samples(run, spectra, plan)
    if findings:
        spectra = measure_spectra(usable, plan)
    _require_signal(usable, spectra, plan, findings)
    return spectra, findings


def _require_signal(
    run: Run, spectra: Spectra, plan: BlockPlan, findings: Sequence[Finding]
) -> None:
    where = f"{run.name}, channel {run.force.name!r}"
    if not np.any(spectra.n_effective):
        lost = "samples missing" if not run.force.gaps else "samples missing or wrong"
        said = "".join(f": {finding.detail}" for finding in findings)
        found = f"{lost} in every block of {plan.block_s:g} s{said}"
        rule = "spectra need blocks in which no sample is missing"
        raise InputError(where, found, rule, "Export the run again or leave it out")
    if not np.any(spectra.force > 0):
        remedy = "Check the load cell cable, or choose another excitation channel"
        raise InputError(where, "a constant signal", "the force must excite the tyre", remedy)


def _excited(
    runs: Sequence[Run], spectra: list[Spectra]
) -> tuple[list[Run], list[Spectra], tuple[Finding, ...]]:
    """Runs with their spectra, without those of hardly any force, and findings about these."""
    fullest = [int(np.argmax(each.n_effective)) for each in spectra]
    power = np.array(
        [
            np.sum(each.force[row]) / max(each.n_effective[row], 1.0)
            for each, row in zip(spectra, fullest, strict=True)
        ]
    )
    level_db = 10 * np.log10(np.maximum(power / np.median(power), 1e-30))
    findings = tuple(
        Finding(
            run.name,
            run.force.name,
            None,
            Check.EXCITATION,
            Verdict.EXCLUDED,
            f"the force is {-level:.0f} dB below that of the other runs: no hit in the recording, "
            "or the excitation was off; the run is left out",
        )
        for run, level in zip(runs, level_db, strict=True)
        if level < _UNEXCITED_DB
    )
    kept = [k for k in range(len(runs)) if level_db[k] >= _UNEXCITED_DB]
    return [runs[k] for k in kept], [spectra[k] for k in kept], findings


def _positions_frf(
    runs: Sequence[Run], spectra: list[Spectra], plan: BlockPlan, estimator: str
) -> FRF:
    responses = [(run, response) for run in runs for response in run.responses]
    angle = np.array([_number(response.position_deg) for _, response in responses])
    node = np.array([-1 if response.node is None else response.node for _, response in responses])
    key = np.where(np.isfinite(angle), np.round(angle, 6), node)
    _, first, place = np.unique(key, return_index=True, return_inverse=True)
    run = _joined([run.name for run, _ in responses], place)
    channel = _joined([response.channel.name for _, response in responses], place)
    parts = [part.rows(slice(len(run.responses))) for part, run in zip(spectra, runs, strict=True)]
    spectra_here = pooled(parts, place, first.size)
    frf = _as_frf(spectra_here, plan, estimator, node[first], angle[first], run, channel)
    return replace(frf, disagreement=disagreement(parts, place, first.size))


def _joined(words: list[str], place: NDArray[np.int_]) -> list[str]:
    """Words that share a place, joined; each only once."""
    there: dict[int, dict[str, None]] = {int(p): {} for p in np.unique(place)}
    for word, p in zip(words, place, strict=True):
        there[int(p)][word] = None
    return ["+".join(there[p]) for p in sorted(there)]


def _reference_frf(
    runs: Sequence[Run],
    reference_deg: float | None,
    spectra: list[Spectra],
    plan: BlockPlan,
    estimator: str,
) -> FRF | None:
    pairs = [(r, s) for r, s in zip(runs, spectra, strict=True) if r.reference is not None]
    if len(pairs) < 2:
        return None
    last_rows = [part.rows(slice(-1, None)) for _, part in pairs]
    last = pooled(last_rows, np.arange(len(pairs)), len(pairs))
    nodes = np.full(len(pairs), -1)
    angle = np.full(len(pairs), _number(reference_deg))
    run_names = [run.name for run, _ in pairs]
    names = [run.reference.name for run, _ in pairs if run.reference is not None]
    return _as_frf(last, plan, estimator, nodes, angle, run_names, names)


def _as_frf(
    spectra: Spectra,
    plan: BlockPlan,
    estimator: str,
    node: NDArray[np.int_],
    position_deg: NDArray[np.float64],
    run: list[str],
    channel: list[str],
) -> FRF:
    power = spectra.force * spectra.response
    coherence = np.divide(
        np.abs(spectra.cross) ** 2, power, out=np.zeros(power.shape), where=power > 0
    )
    values = ESTIMATORS[estimator](spectra)
    missing = 1 - spectra.n_effective / spectra.n_planned
    return FRF(
        frequency_hz=plan.frequency_hz,
        values=values,
        coherence=np.clip(coherence, 0, 1),
        std=_random_error(spectra, coherence),
        node=node,
        position_deg=position_deg,
        run=tuple(run),
        channel=tuple(channel),
        blocks=plan,
        n_effective=float(np.min(spectra.n_effective, where=missing < 0.5, initial=np.inf)),
        clipped=spectra.clipped,
        force_clipped=spectra.force_clipped,
        missing=missing,
        estimator=estimator,
    )


def _random_error(spectra: Spectra, coherence: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviation of each quadrature of H1 (Bendat & Piersol 2010, eq. 9.89, unbiased).

    One average says nothing about its error: NaN.
    """
    freedom = spectra.n_effective[:, None] - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = spectra.response / spectra.force * (1 - coherence) / (2 * freedom)
    return np.sqrt(np.where((freedom > 0.5) & (variance >= 0), variance, np.nan))


def _h1(spectra: Spectra) -> NDArray[np.complex128]:
    return ratio(spectra.cross, spectra.force)


def _h2(spectra: Spectra) -> NDArray[np.complex128]:
    return ratio(spectra.response, spectra.cross.conj())


def _hv(spectra: Spectra) -> NDArray[np.complex128]:
    """Geometric mean of H1 and H2, with the phase they share."""
    direction = ratio(spectra.cross, np.abs(spectra.cross))
    return np.asarray(direction * np.sqrt(ratio(spectra.response, spectra.force)))


ESTIMATORS: dict[str, Callable[[Spectra], NDArray[np.complex128]]] = {
    "H1": _h1,
    "H2": _h2,
    "Hv": _hv,
}


def restated(frf: FRF, estimator: str) -> FRF:
    """The same FRFs from recordings by another estimator: H1 = γ² H2, |Hv|² = |H1 H2|."""
    if estimator == frf.estimator:
        return frf
    power = {"H1": 0.0, "Hv": 0.5, "H2": 1.0}
    change, known = power[frf.estimator] - power[estimator], frf.coherence > 0
    factor = np.power(frf.coherence, change, out=np.zeros(known.shape), where=known)
    values = frf.values * factor
    fixed = None if frf.reference is None else restated(frf.reference, estimator)
    return replace(frf, values=values, estimator=estimator, reference=fixed)


def with_given_averages(frf: FRF, averages: int | None) -> FRF:
    """FRFs of a file with the standard deviation that coherence and averages give.

    σ² = |H|² (1 − γ²)/(2 (n − 1) γ²) for each quadrature (Bendat & Piersol 2010, eq. 9.89).
    Without the number of averages, coherence only weighs the lines.
    """
    known = int(np.count_nonzero(np.isfinite(frf.coherence).all(axis=1)))
    if not known:
        return frf
    said = "weights only, as the number of averages is unknown; state processing.averages"
    if averages is not None and averages > 1:
        said = f"σ of the FRFs from it and {averages} averages (stated)"
        std = np.sqrt(incoherent_power(frf.values, frf.coherence) / (2 * (averages - 1)))
        frf = replace(frf, std=std, n_effective=float(averages))
    said = f"coherence of {known} of {frf.n_positions} FRFs from the file: {said}"
    finding = Finding("", "", None, Check.COHERENCE, Verdict.OK, said)
    return replace(frf, findings=(*frf.findings, finding))


def _number(value: float | None) -> float:
    return float("nan") if value is None else value
