"""Estimation of frequency response functions from recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ema.core.campaign import Campaign, Processing, Run
from ema.core.errors import InputError, require_type
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF, ForceRecord
from ema.core.frf_arrays import one_angle
from ema.core.numerics import available_threads, one_blas_thread
from ema.core.recording import BlockPlan
from ema.core.references import References, mapped
from ema.signals.damage import without_damage, without_lost_samples
from ema.signals.events import event_plans, find_events, is_one_early_hit, window_findings
from ema.signals.excitation import (
    SHORTEST_PERIOD_S,
    is_steady,
    period_samples,
    plan_blocks,
    repeats_after,
)
from ema.signals.frf_of_spectra import (
    ESTIMATORS,
    JointSpectra,
    at_force,
    joint_references,
    measure_jointly,
    positions_frf,
    reference_frf,
    with_given_averages,
)
from ema.signals.leakage import with_coherent_tones
from ema.signals.spectra import Spectra, measure_spectra

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
) -> FRF | References:
    """FRFs of all positions of a campaign, in the order of their angle (or node).

    A position measured in several runs enters with the spectra of all of them. The fixed
    reference sensor is kept apart, one row per run, in `FRF.reference`. Where forces act at several
    places, each has FRFs of its own; of those that act at the same time, the coherence is partial.

    Parameters
    ----------
    campaign : Campaign
        From `read_campaign`. FRFs found in its files are handed through.
    processing : Processing, optional
        Instead of the campaign's own.
    estimator : {"H1", "H2", "Hv"}
        H1 suits noise on the accelerations (the usual case), H2 noise on the force, Hv both
        (Bendat & Piersol 2010, ch. 6; Rocklin, Crowley & Vold 1985). Forces that act at the same
        time need H1.
    progress : callable, optional
        Called with (runs done, runs in all) as each run ends.
    averages, block_seconds, window, overlap : optional
        Single choices of `processing`, such as ``averages=10``.

    Returns
    -------
    FRF or References
        The latter where the campaign has forces at several places.

    Raises
    ------
    InputError
        If the blocks asked for do not fit, the runs differ in rate, a force is silent, or forces
        that act at the same time are not independent.

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
        found = _estimated(campaign, processing, estimator, progress)
    else:
        found = mapped(campaign.frf, lambda frf: _in_order(frf, processing.averages))
    if isinstance(found, FRF):
        found = replace(found, excitation_deg=one_angle(campaign.excitation_deg))
    return mapped(found, lambda frf: replace(frf, exponential_window=processing.exponential_window))


def _in_order(frf: FRF, averages: int | None) -> FRF:
    """FRFs of a file by their angle (or node), with the σ that averages give."""
    ordered = frf.rows(np.lexsort((frf.node, np.nan_to_num(frf.position_deg))))
    return with_given_averages(ordered, averages)


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


class _Measured(NamedTuple):
    """A run and its spectra, those of several forces that acted at the same time as well."""

    run: Run
    spectra: Spectra  # against the first force
    joint: JointSpectra | None
    plan: BlockPlan


def _estimated(
    campaign: Campaign,
    processing: Processing,
    estimator: str,
    progress: Callable[[int, int], None] | None,
) -> FRF | References:
    with ThreadPoolExecutor(available_threads()) as pool:
        runs, findings = without_damage(list(map(_forces_as_sensors, campaign.runs)), pool.map)
        plans, remarks = _plans(runs, processing)
        findings += remarks
        measured: list[_Measured] = []
        for part, slips in pool.map(lambda run: _run_spectra(run, plans[run.name]), runs):
            measured.append(part)
            findings += slips
            if progress is not None:
                progress(len(measured), len(runs))
    measured, silent = _excited(measured)
    findings += silent
    groups = [
        [each for each in measured if each.run.references == places]
        for places in dict.fromkeys(each.run.references for each in measured)
    ]
    frfs = [_of_one_place(each, campaign.reference_deg, estimator) for each in groups]
    if len(groups) == 1 and measured[0].joint is None:
        return replace(frfs[0], findings=findings)
    if any(each.joint is not None for each in measured):
        return _of_joint_forces(campaign, groups, replace(frfs[0], findings=findings))
    found = [at_force(frf, group[0].run.forces[0]) for frf, group in zip(frfs, groups, strict=True)]
    return References((replace(found[0], findings=findings), *found[1:]))


def _forces_as_sensors(run: Run) -> Run:
    """The run, the forces beside the first one behind its responses: all checks see them."""
    return replace(run, responses=(*run.responses, *run.forces[1:]))


def _forces_apart(run: Run) -> Run:
    """The run of `_forces_as_sensors` as it was, with the gaps that were found."""
    if len(run.forces) < 2:
        return run
    n = len(run.responses) - len(run.forces) + 1
    forces = replace(run.forces[0], channel=run.force), *run.responses[n:]
    return replace(run, responses=run.responses[:n], forces=forces)


def _of_one_place(
    measured: Sequence[_Measured], reference_deg: float | None, estimator: str
) -> FRF:
    """FRFs of runs whose first force acts at one place."""
    runs, spectra = [each.run for each in measured], [each.spectra for each in measured]
    plan = min((each.plan for each in measured), key=lambda each: each.n_blocks)
    frf = with_coherent_tones(positions_frf(runs, spectra, plan, estimator))
    reference = reference_frf(runs, reference_deg, spectra, plan, estimator)
    forces = {
        run.name: ForceRecord(run.force, each.plan)
        for run, each in zip(runs, measured, strict=True)
        if not run.force.gaps
    }
    return replace(frf, reference=reference, forces=forces)


def _of_joint_forces(
    campaign: Campaign, groups: Sequence[Sequence[_Measured]], against_first: FRF
) -> References:
    """FRFs against each of several forces that act at the same time in all runs."""
    runs = [each.run for each in groups[0]]
    parts = [each.joint for each in groups[0] if each.joint is not None]
    if len(groups) > 1 or len(parts) < len(runs):
        found, rule = "forces at other places in some runs", "forces at once must act so in all"
        raise InputError(campaign.name, found, rule, "Process these runs by themselves")
    if against_first.estimator != "H1":
        found, rule = f"estimator {against_first.estimator!r}", "forces at once need H1"
        raise InputError("FRF", found, rule, "Leave it out")
    return joint_references(runs, parts, against_first, campaign.checks)


def _plans(
    runs: Sequence[Run], processing: Processing
) -> tuple[dict[str, BlockPlan], tuple[Finding, ...]]:
    """The blocks of each run, at its hits or bursts if any."""
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
            return whole, ()
        found = whole, ()
    plans, remarks = found
    hits = all(event.pulses for each in events.values() for event in each)
    windows = window_findings(runs, plans, processing.exponential_window, hits=hits)
    return plans, (*remarks, *windows)


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


def _run_spectra(run: Run, plan: BlockPlan) -> tuple[_Measured, tuple[Finding, ...]]:
    """Spectra of a run, measured again where channels turn out to have lost samples."""
    spectra = measure_spectra(run, plan)
    usable, findings = without_lost_samples(run, spectra, plan)
    if findings:
        spectra = measure_spectra(usable, plan)
    _require_signal(usable, spectra, plan, findings)
    several = len(run.forces) > 1
    joint = measure_jointly(_forces_apart(usable), plan) if several else None
    return _Measured(_forces_apart(run), spectra, joint, plan), findings


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


def _excited(measured: list[_Measured]) -> tuple[list[_Measured], tuple[Finding, ...]]:
    """Runs without those of hardly any force, and findings about these."""
    fullest = [int(np.argmax(each.spectra.n_effective)) for each in measured]
    power = np.array(
        [
            np.sum(each.force[row]) / max(each.n_effective[row], 1.0)
            for (_, each, *_), row in zip(measured, fullest, strict=True)
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
        for (run, *_), level in zip(measured, level_db, strict=True)
        if level < _UNEXCITED_DB
    )
    kept = zip(measured, level_db, strict=True)
    return [each for each, level in kept if level >= _UNEXCITED_DB], findings
