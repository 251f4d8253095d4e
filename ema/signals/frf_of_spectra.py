"""FRFs of spectra: against one force, or against several that act at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Response, Run
from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.frf_arrays import one_angle
from ema.core.recording import DERIVATIVES, BlockPlan
from ema.core.references import References
from ema.core.settings import CheckSettings
from ema.signals.leakage import incoherent_power
from ema.signals.spectra import Spectra, blocks_of, disagreement, pooled, ratio

_EXCITED = 1e-4  # of a force's largest power: on other lines it has none
_SINGULAR = 1e-10  # an eigenvalue of the scaled matrix below this is rounding


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


Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


class JointSpectra(NamedTuple):
    """Sums over the blocks of a run, one row for each response, the reference sensor last."""

    forces: tuple[Complex, ...]  # Σ F F^H over the blocks of a row, (n_forces, n_forces, n_lines)
    cross: Complex  # Σ X F*, (n_rows, n_forces, n_lines)
    response: Real  # Σ |X|², (n_rows, n_lines)
    n_effective: Real  # independent averages of each row

    def rows(self, chosen: slice) -> JointSpectra:
        """Keep the chosen rows only."""
        forces, cross, response, n_effective = self
        return JointSpectra(forces[chosen], cross[chosen], response[chosen], n_effective[chosen])


def measure_jointly(run: Run, plan: BlockPlan) -> JointSpectra:
    """Spectra of all responses of a run and of its reference sensor against all its forces.

    A block in which samples of a channel are missing is left out for that channel; without one of
    the forces, for all.
    """
    n_forces, n_lines = len(run.forces), plan.frequency_hz.size
    sensors = run.channels[1:]
    total = np.zeros((n_forces, n_forces, n_lines), dtype=complex)
    cross = np.zeros((len(sensors), n_forces, n_lines), dtype=complex)
    response, n_used = np.zeros((len(sensors), n_lines)), np.zeros(len(sensors))
    lacking: dict[int, Complex] = {}
    channels = (*(each.channel for each in run.forces), *sensors)
    for _, block in blocks_of(channels, plan):
        mean = block.mean(axis=1, keepdims=True)
        whole = np.isfinite(mean[:, 0])
        if not whole[:n_forces].all():
            continue
        block = np.where(whole[:, None], block - mean, 0.0) * plan.taper
        spectrum = np.fft.rfft(block, axis=1)[:, 1 : n_lines + 1]
        force, seen = spectrum[:n_forces], spectrum[n_forces:]
        product = force[:, None] * force.conj()
        total += product
        for row in np.flatnonzero(~whole[n_forces:]).tolist():
            lacking[row] = lacking.get(row, 0.0) + product
        cross += seen[:, None] * force.conj()
        response += np.abs(seen) ** 2
        n_used += whole[n_forces:]
    power = np.array([[DERIVATIVES.get(each.quantity, 0)] for each in sensors])
    to_acceleration = (2j * np.pi * plan.frequency_hz) ** power
    return JointSpectra(
        tuple(total - lacking[row] if row in lacking else total for row in range(len(sensors))),
        cross * to_acceleration[:, None],
        response * np.abs(to_acceleration) ** 2,
        plan.n_effective * n_used / plan.n_blocks,
    )


class _JointFRF(NamedTuple):
    """FRFs of some places against several forces."""

    values: Complex  # (n_forces, n_places, n_lines)
    coherence: Real  # partial: with each force, given all others; same shape
    std: Real  # of the real and of the imaginary part; same shape
    multiple_coherence: Real  # with all forces, (n_places, n_lines)
    n_effective: Real  # averages left for one force beside the others, (n_places,)


def joint_references(
    runs: Sequence[Run], parts: Sequence[JointSpectra], against_first: FRF, settings: CheckSettings
) -> References:
    """FRFs against each of several forces that act at the same time in all runs.

    `against_first` has the rows, and what else is known of them. `InputError` if the forces cannot
    be told apart.
    """
    condition, findings = _check_forces(runs, parts, settings)
    _, first, place = places_of_rows(runs)
    of_sensors = [
        each.rows(slice(len(run.responses))) for run, each in zip(runs, parts, strict=True)
    ]
    found, fixed = _joint_frfs(of_sensors, place, first.size), against_first.reference
    if fixed is not None:
        has = [run.reference is not None for run in runs]
        last = [each.rows(slice(-1, None)) for each, known in zip(parts, has, strict=True) if known]
        of_fixed = _joint_frfs(last, np.arange(fixed.n_positions), fixed.n_positions)
    frfs = []
    for number, force in enumerate(runs[0].forces):
        reference = None if fixed is None else _against(fixed, of_fixed, number)
        frf = replace(_against(against_first, found, number), reference=reference, forces={})
        frfs.append(at_force(frf, force))
    frfs[0] = replace(frfs[0], findings=(*against_first.findings, *findings))
    return References(tuple(frfs), condition, found.multiple_coherence)


def _against(frf: FRF, found: _JointFRF, force: int) -> FRF:
    """The rows of `frf` against one of several forces."""
    return replace(
        frf,
        values=found.values[force],
        coherence=found.coherence[force],
        std=found.std[force],
        n_effective=float(np.min(found.n_effective, where=frf.missing < 0.5, initial=np.inf)),
    )


def _joint_frfs(parts: Sequence[JointSpectra], place: NDArray[np.int_], n_places: int) -> _JointFRF:
    """FRFs from the spectra of all rows that belong to the same place.

    `place` numbers the places of the rows of all parts, one after the other. Partial coherence and
    σ belong together as those of a single force do: σ² = |H|² (1 − γ²)/(2 (n − 1) γ²).
    """
    rows = [(part, row) for part in parts for row in range(len(part.response))]
    found = []
    for number in range(n_places):
        here = [rows[k] for k in np.flatnonzero(place == number)]
        found.append(
            _solved(
                np.sum([part.forces[row] for part, row in here], axis=0),
                np.sum([part.cross[row] for part, row in here], axis=0),
                np.sum([part.response[row] for part, row in here], axis=0),
                float(np.sum([part.n_effective[row] for part, row in here])),
            )
        )
    *parted, multiple, n_effective = zip(*found, strict=True)
    values, coherence, std = (np.stack(each, axis=1) for each in parted)
    return _JointFRF(values, coherence, std, np.array(multiple), np.array(n_effective))


def _solved(
    forces: Complex, cross: Complex, response: Real, n_effective: float
) -> tuple[Complex, Real, Real, Real, float]:
    """One response: values, partial coherence and σ by force, multiple coherence, averages."""
    size, eigenvalues, vectors = _scaled(forces)
    usable = eigenvalues[:, 0] > _SINGULAR
    inverse = np.zeros(vectors.shape, dtype=complex)
    kept, weights = vectors[usable], 1 / eigenvalues[usable]
    inverse[usable] = (kept * weights[:, None]) @ kept.conj().swapaxes(1, 2)
    seen = np.divide(cross, size, out=np.zeros_like(cross), where=size > 0)
    scaled = np.einsum("kl,lkj->jl", seen, inverse)
    values = np.divide(scaled, size, out=np.zeros_like(scaled), where=size > 0)
    explained = np.sum((scaled * seen.conj()).real, axis=0)
    left = np.maximum(response - explained, 0.0)
    # Power of each force that the others do not explain.
    own = np.divide(1.0, np.einsum("ljj->jl", inverse).real, out=np.zeros(size.shape), where=usable)
    coherent = np.abs(scaled) ** 2 * own
    power = coherent + left
    coherence = np.divide(coherent, power, out=np.zeros(size.shape), where=power > 0)
    freedom = n_effective - len(forces)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = left / (own * size**2) / (2 * freedom)
    std = np.sqrt(np.where(usable & (freedom > 0.5), variance, np.nan))
    multiple = np.divide(explained, response, out=np.zeros(response.shape), where=response > 0)
    return values, coherence, std, np.clip(multiple, 0.0, 1.0), freedom + 1


def _scaled(forces: Complex) -> tuple[Real, Real, Complex]:
    """Root of the diagonal, and eigenvalues (rising) and vectors of the matrix scaled by it."""
    size = np.sqrt(np.einsum("jjl->jl", forces).real)
    below = np.where(size > 0, size, 1.0)
    scaled = np.moveaxis(forces / (below[:, None] * below), 2, 0)
    eigenvalues, vectors = np.linalg.eigh(scaled)
    return size, eigenvalues, vectors


def _conditions(parts: Sequence[JointSpectra]) -> tuple[Real, Real]:
    """Condition number by line, the worst of the runs, and its median where all forces excite."""
    worst, medians = None, []
    for part in parts:
        matrix = part.forces[int(np.argmax(part.n_effective))]
        size, eigenvalues, _ = _scaled(matrix)
        condition = eigenvalues[:, -1] / np.maximum(eigenvalues[:, 0], _SINGULAR)
        excited = np.all(size**2 >= _EXCITED * np.max(size**2, axis=1, keepdims=True), axis=0)
        medians.append(float(np.median(condition[excited])) if excited.any() else np.inf)
        worst = condition if worst is None else np.maximum(worst, condition)
    assert worst is not None
    return worst, np.array(medians)


def _check_forces(
    runs: Sequence[Run], parts: Sequence[JointSpectra], settings: CheckSettings
) -> tuple[Real, tuple[Finding, ...]]:
    """Condition number by line, and findings; `InputError` if the forces cannot be told apart."""
    n_forces = len(runs[0].forces)
    for run, part in zip(runs, parts, strict=True):
        if not part.n_effective.max() > n_forces + 0.5:
            found = f"{part.n_effective.max():.1f} independent averages for {n_forces} forces"
            rule = "forces that act at the same time need more averages than forces"
            raise InputError(run.name, found, rule, "Choose more averages, or shorter blocks")
    condition, medians = _conditions(parts)
    findings = []
    for run, median in zip(runs, medians, strict=True):
        names = ", ".join(each.channel.name for each in run.forces)
        if median > settings.force_condition_most:
            found = f"condition number {median:.3g} of the spectra of {names}"
            rule = (
                f"forces that act at the same time must be independent, up to "
                f"{settings.force_condition_most:g} (force_condition_most)"
            )
            remedy = "Drive each shaker by a noise of its own, or one after the other"
            raise InputError(run.name, found, rule, remedy)
        verdict = Verdict.WARNING if median > settings.force_condition_doubt else Verdict.OK
        detail = f"{names} act at the same time: condition number of their spectra {median:.3g}"
        if verdict is Verdict.WARNING:
            detail += f", above {settings.force_condition_doubt:g}: they are correlated"
        findings.append(Finding(run.name, "", None, Check.EXCITATION, verdict, detail))
    return condition, tuple(findings)
