"""FRFs of all positions from the spectra of the runs, by H1, H2 or Hv."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Response, Run
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.frf_arrays import one_angle
from ema.core.recording import BlockPlan
from ema.signals.leakage import incoherent_power
from ema.signals.spectra import Spectra, disagreement, pooled, ratio


def at_force(frf: FRF, force: Response) -> FRF:
    """FRFs with the place of their force."""
    return replace(
        frf,
        excitation_deg=one_angle(force.position_deg),
        force_node=force.node or 0,
        force_axis=force.channel.axis,
    )


def places_of_rows(
    runs: Sequence[Run],
) -> tuple[list[tuple[Run, Response]], NDArray[np.int_], NDArray[np.int_]]:
    """Responses of all runs, the first one at each place, and the number of the place of each."""
    responses = [(run, response) for run in runs for response in run.responses]
    angle = np.array([one_angle(response.position_deg) for _, response in responses])
    node = np.array([_node(response) for _, response in responses])
    key = np.where(np.isfinite(angle), np.round(angle, 6), node)
    _, first, place = np.unique(key, return_index=True, return_inverse=True)
    return responses, first, place


def _node(response: Response) -> int:
    return -1 if response.node is None else response.node


def positions_frf(
    runs: Sequence[Run], spectra: list[Spectra], plan: BlockPlan, estimator: str
) -> FRF:
    """FRFs of all places; spectra of several runs at one place are added up."""
    responses, first, place = places_of_rows(runs)
    at = [responses[k][1] for k in first.tolist()]
    angle = np.array([one_angle(response.position_deg) for response in at])
    node = np.array([_node(response) for response in at])
    run = _joined([run.name for run, _ in responses], place)
    channel = _joined([response.channel.name for _, response in responses], place)
    parts = [part.rows(slice(len(run.responses))) for part, run in zip(spectra, runs, strict=True)]
    spectra_here = pooled(parts, place, first.size)
    frf = _as_frf(spectra_here, plan, estimator, node, angle, run, channel)
    return replace(frf, disagreement=disagreement(parts, place, first.size))


def _joined(words: list[str], place: NDArray[np.int_]) -> list[str]:
    """Words that share a place, joined; each only once."""
    there: dict[int, dict[str, None]] = {int(p): {} for p in np.unique(place)}
    for word, p in zip(words, place, strict=True):
        there[int(p)][word] = None
    return ["+".join(there[p]) for p in sorted(there)]


def reference_frf(
    runs: Sequence[Run],
    reference_deg: float | None,
    spectra: list[Spectra],
    plan: BlockPlan,
    estimator: str,
) -> FRF | None:
    """FRFs of the fixed reference sensor, a row for each run; None where there are not two."""
    pairs = [(r, s) for r, s in zip(runs, spectra, strict=True) if r.reference is not None]
    if len(pairs) < 2:
        return None
    last_rows = [part.rows(slice(-1, None)) for _, part in pairs]
    last = pooled(last_rows, np.arange(len(pairs)), len(pairs))
    nodes = np.full(len(pairs), -1)
    angle = np.full(len(pairs), one_angle(reference_deg))
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
