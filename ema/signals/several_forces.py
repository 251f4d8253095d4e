"""FRFs of forces that act at the same time: H1 with the spectral matrix of the forces.

On every line H = G_xf G_ff⁻¹ (Bendat & Piersol 2010, ch. 7; Allemang, Rost & Brown 1983). Forces
must not be copies of each other: their matrix, scaled to ones on its diagonal, tells by its
condition number how far each is known from the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ema.core.campaign import Run
from ema.core.errors import InputError
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.recording import DERIVATIVES, BlockPlan
from ema.core.references import References
from ema.core.settings import CheckSettings
from ema.signals.frf_of_spectra import at_force, places_of_rows
from ema.signals.spectra import blocks_of

_EXCITED = 1e-4  # of a force's largest power: on other lines it has none
_SINGULAR = 1e-10  # an eigenvalue of the scaled matrix below this is rounding

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
