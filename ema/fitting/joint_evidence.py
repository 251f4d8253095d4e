"""What several forces say of the modes: how well these are known, and their masses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.core.references import driving_point
from ema.fitting.covariance import inverse_of, to_frequency_damping
from ema.fitting.joint_poles import Driven, JointPoint
from ema.fitting.variable_projection import Real

# Lines within this many half-widths make up a resonance …
_RESONANCE = 2.0
# … but never more than this part of all lines.
_FEWEST_PIECES = 8
# A force drives a mode if the residue at its place is this many standard deviations.
_LEAST_DRIVE = 3.0
# No residue is known better than this.
_EXACT = 1e-6
# A force contradicts the others beyond this many of its standard deviations.
_CLEAR = 3.3


@dataclass(frozen=True, eq=False)
class JointSpread:
    """How well a `JointPoint` is known.

    Parameters
    ----------
    covariance : ndarray, shape (2 n_modes, 2 n_modes)
        Of frequency in Hz and damping ratio, mode by mode.
    waves, forces : ndarray, shape (n_modes, 2)
        Standard deviations of the same where residuals are no white noise, and from what the
        forces say differently.
    participation : ndarray, shape (n_modes, n_forces)
        Standard deviation of real and imaginary part.
    """

    covariance: Real
    waves: Real
    forces: Real
    participation: Real


def spread_of(point: JointPoint, correlation: float) -> JointSpread:
    """± from the residuals as they are (White 1980; Newey & West 1987; Liang & Zeger 1986).

    All forces of a line count together, as they may have acted at the same time. Of poles no
    farther apart than their own ±, the distance is found too large by σ²/2d, at most σ.
    """
    driven, n = point.driven, point.driven.poles.size
    inverse = inverse_of(point.normal_matrix())
    scores = point.scores()
    transform = to_frequency_damping(driven.poles)
    towards = inverse[:, : 2 * n] @ transform.T
    influence = scores.sum(axis=0) @ towards
    covariance = correlation * influence.T @ influence
    step = float(np.diff(point.problem.forces[0].lines.omega[:2])[0])
    reach = np.repeat(np.ceil(_RESONANCE * -driven.poles.real / step).astype(int), 2)
    reach = np.clip(reach, 1, max(len(influence) // _FEWEST_PIECES, 1))
    variance = np.zeros(2 * n)
    for k, line in enumerate(influence.T):
        variance[k] = line @ line
        for lag in range(1, reach[k] + 1):
            variance[k] += 2 * (1 - lag / (reach[k] + 1)) * (line[lag:] @ line[:-lag])
    of_forces = scores.sum(axis=1) @ towards
    between = np.var(of_forces, axis=0, ddof=1) * len(of_forces)
    of_lines = correlation * np.sum((scores @ towards) ** 2, axis=(0, 1))
    everything = correlation * (inverse @ (scores.sum(axis=0).T @ scores.sum(axis=0)) @ inverse)
    drives = np.zeros(point.free.shape)
    own = np.diag(everything)[2 * n : 2 * (n + int(point.free.sum()))].reshape(-1, 2)
    drives[point.free] = np.sqrt(np.maximum(own.mean(axis=1), 0.0))
    # Few lines make up a narrow resonance: what they scatter by may be little by chance.
    white = correlation * point.reduced * (transform @ inverse[: 2 * n, : 2 * n] @ transform.T)
    covariance = covariance + np.diag(np.maximum(np.diag(white) - np.diag(covariance), 0.0))
    covariance = covariance + np.diag(_of_distance(driven, covariance))
    return JointSpread(
        covariance=np.asarray(covariance),
        waves=np.sqrt(np.maximum(variance, 0.0)).reshape(-1, 2),
        forces=np.sqrt(np.maximum(between - of_lines, 0.0)).reshape(-1, 2),
        participation=drives,
    )


def _of_distance(driven: Driven, covariance: Real) -> Real:
    """Variance from poles that are no farther apart than their ±: see `joint_pair`."""
    numbers = driven.numbers
    std = np.sqrt(np.diag(covariance)).reshape(-1, 2)
    width = np.column_stack([numbers[:, 0] * numbers[:, 1], numbers[:, 1]])
    variance = np.zeros_like(numbers)
    near = driven.shared & ~np.eye(driven.poles.size, dtype=bool)
    for k, others in enumerate(near):
        for other in np.flatnonzero(others):
            off = (numbers[k] - numbers[other]) / width[k]
            both = np.hypot(std[k], std[other]) / width[k]
            apart, known = float(np.hypot(*off)), float(np.hypot(*both)) / np.sqrt(2)
            bias = min(known**2 / (2 * max(apart, 1e-300)), known)
            variance[k] = np.maximum(variance[k], (bias * width[k]) ** 2)
    return np.asarray(variance.ravel())


def with_modal_masses(
    models: Sequence[ModalModel], frfs: Sequence[FRF], most: float
) -> tuple[list[ModalModel], list[Finding]]:
    """Models of several forces with the modal masses that their driving points give.

    At the point that a force drives, residue and shape give the mass of the mode:
    m = φ²/(2jω_d A), that of the shape as it is listed, its largest part 1. Weighted mean of all
    forces; ± from the residues, or from the scatter of the forces where that is more. Forces that
    differ by more than `most` give a finding.
    """
    masses: dict[int, tuple[float, float, float]] = {}
    apart = 0.0, ""
    for k, mode in enumerate(models[0].modes):
        seen = []
        for model, frf in zip(models, frfs, strict=True):
            own, place = counterpart(k, mode, model), driving_point(frf)
            if own is not None and place is not None:
                seen += _mass_at(own, *place)
        if not seen:
            continue
        mass, std = np.array(seen).T
        weight = std**-2.0 / np.sum(std**-2.0)
        mean = float(weight @ mass)
        off = np.abs(mass - mean)
        scatter = max(np.sum((off / std) ** 2) / max(mass.size - 1, 1), 1.0)
        known = np.sqrt(scatter / np.sum(std**-2.0))
        spread = np.sqrt(weight @ off**2) / mean if mass.size > 1 else np.nan
        masses[k] = mean, float(known), float(spread)
        clear = float(np.max(off / mean, where=off > _CLEAR * std, initial=0.0))
        apart = max(apart, (clear, f"{mode.frequency_hz:.2f} Hz"))
    doubt = []
    if apart[0] > most:
        detail = (
            f"modal masses from the driving points differ by {100 * apart[0]:.0f} % at {apart[1]}: "
            "check gains, places and directions of the forces"
        )
        doubt.append(Finding("", "", None, Check.FORCES, Verdict.WARNING, detail))
    scaled = []
    for model in models:
        modes = list(model.modes)
        for k, (mean, known, spread) in masses.items():
            own = counterpart(k, models[0].modes[k], model)
            if own is not None:
                modes[modes.index(own)] = replace(
                    own, modal_mass_kg=mean, modal_mass_std_kg=known, modal_mass_spread=spread
                )
        scaled.append(replace(model, modes=tuple(modes)))
    return scaled, doubt


def counterpart(k: int, mode: Mode, model: ModalModel) -> Mode | None:
    """The mode `k` of another force's model; poles that coincide follow each other there too."""
    alike = [
        (abs(other.pole - mode.pole), at != k, other)
        for at, other in enumerate(model.modes)
        if (other.order, other.member) == (mode.order, mode.member)
    ]
    away, _, nearest = min(alike, key=lambda each: each[:2], default=(np.inf, True, mode))
    return nearest if away < -mode.pole.real else None


def _mass_at(own: Mode, row: int, sign: int) -> list[tuple[float, float]]:
    """Modal mass and its ± from one driving point; nothing where the force is at a node."""
    residue = sign * complex(own.residues[row])
    std = float(own.residues_std[row])
    if not abs(residue) > _LEAST_DRIVE * std:
        return []
    mass = float((own.shape[row] ** 2 / (2j * own.pole.imag * residue)).real)
    return [(mass, abs(mass) * max(std / abs(residue), _EXACT))]
