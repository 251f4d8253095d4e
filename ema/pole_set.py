"""Which poles a fit ends with: surplus ones out, members of pairs in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.bounded_fit import fit_bounded, without_leakage
from ema.chance import chi_square_tail
from ema.circumference import label_modes, on_circle
from ema.covariance import line_correlation, parameter_covariance, residue_std
from ema.family import PURE, family
from ema.frf import FRF
from ema.modes import Mode
from ema.pole_fit import N_STAND_INS, Lines, PoleFit, evaluate
from ema.resolution import OrderReport, resolve_orders
from ema.stability import widened_band

# A mode is taken for real when chance would show residues as large once in 10 000 campaigns.
_RESIDUE_CHANCE = 1e-4
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class Refit:
    """The same fit from other poles."""

    frf: FRF
    lines: Lines
    drift: NDArray[np.float64] | None

    def __call__(self, poles: NDArray[np.complex128]) -> tuple[PoleFit, list[str]]:
        """Fit from other poles, and what is to be said about it."""
        shift = np.zeros(1) if self.drift is None else self.drift
        pairs = pairs_of(evaluate(self.lines, poles, shift), self.frf)
        fit = fit_bounded(self.lines, poles, self.drift, pairs=pairs)
        return without_leakage(self.frf, fit, poles)


def settled(
    refit: Refit, fit: PoleFit, notes: list[str], band_hz: tuple[float, float], *, pinned: bool
) -> tuple[PoleFit, list[str], tuple[OrderReport, ...]]:
    """Fit of a closed circle with the poles that its orders ask for.

    Until nothing changes: members of pairs are added or merged, poles that ran astray dropped, and
    the members of pairs share what is known of their damping. Pinned poles stay as they are.

    Returns
    -------
    fit : PoleFit
    notes : list of str
    reports : tuple of OrderReport
    """
    frf = refit.frf
    chosen, correlation = widened_band(frf, band_hz), line_correlation(frf.blocks)
    reports: tuple[OrderReport, ...] = ()
    for _ in range(_ROUNDS):
        labelled = _labelled(fit, frf)
        astray = _astray(labelled, fit)
        if np.any(astray) and not pinned:
            fit, notes = refit(fit.poles[~astray])
            continue
        poles, reports, changed = resolve_orders(frf, chosen, fit, labelled, band_hz, correlation)
        if changed and not pinned:
            fit, notes = refit(_last(poles, fit))
            continue
        if pairs_of(fit, frf) == fit.pairs:
            break
        fit, notes = refit(fit.poles)
    return fit, notes, reports


def _labelled(fit: PoleFit, frf: FRF) -> tuple[Mode, ...]:
    return label_modes(modes_of(fit), frf.position_deg)[:-N_STAND_INS]


def _astray(labelled: Sequence[Mode], fit: PoleFit) -> NDArray[np.bool_]:
    """Poles that ran to a bound of their damping and took on a shape of no single order.

    A surplus pole ends like this: it explains a little of everything.
    """
    astray = np.zeros(fit.poles.size, dtype=bool)
    impure = np.array([mode.order_purity < PURE for mode in labelled], dtype=bool)
    astray[: impure.size] = impure & fit.at_bound[0 : 2 * impure.size : 2]
    return astray


def pairs_of(fit: PoleFit, frf: FRF) -> tuple[tuple[int, int], ...]:
    """Poles that are the two members of one order; none without a circle or with unknown noise."""
    if not on_circle(frf.position_deg) or not np.all(np.isfinite(frf.std)):
        return ()
    members = family(_labelled(fit, frf)).values()
    pairs = [sorted(chosen) for chosen in members if len(chosen) == 2]
    return tuple((first, second) for first, second in sorted(pairs))


def _last(poles: NDArray[np.complex128], fit: PoleFit) -> NDArray[np.complex128]:
    """Poles with the stand-ins of a fit at the end, where they belong."""
    stand_ins = fit.poles[-N_STAND_INS:]
    others = poles[~np.isin(poles, stand_ins)]
    return np.append(others[np.argsort(np.abs(others))], stand_ins)


def significant(
    refit: Refit, fit: PoleFit, notes: list[str], band_hz: tuple[float, float]
) -> tuple[PoleFit, list[str]]:
    """Fit without the poles of the band whose residues are no larger than their uncertainty.

    A pole may be stable from model order to model order and yet be only a wiggle of the noise. Of
    two that share a resonance, neither may be determined: only the lesser one goes.
    """
    size = _residue_size(fit, line_correlation(refit.frf.blocks))
    frequency_hz = np.abs(fit.poles) / (2 * np.pi)
    inside = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    inside[-N_STAND_INS:] = False
    noise = inside & ~(chi_square_tail(size, 2 * fit.lines.scale.size) < _RESIDUE_CHANCE)
    lesser = size[:, None] > size
    noise &= ~np.any(noise & _share_resonance(fit.poles) & lesser, axis=1)
    if not np.any(noise) or np.all(noise | ~inside):
        return fit, notes
    again, notes = refit(fit.poles[~noise])
    dropped = [
        f"The pole at {hz:.2f} Hz was dropped: its residues are no larger than their uncertainty."
        for hz in frequency_hz[noise]
    ]
    return again, notes + dropped


def _residue_size(fit: PoleFit, correlation: float) -> NDArray[np.float64]:
    """Residues of each pole over their standard deviations, squared and summed over positions.

    What is uncertain about a pole moves its residues at all positions together. Where two poles
    share a resonance this says nothing about whether both are there: they are judged at the poles
    found.
    """
    covariance = parameter_covariance(fit, correlation)
    alone = residue_std(fit, covariance, correlation)
    beside = residue_std(fit, np.zeros_like(covariance), correlation)
    std = np.where(np.any(_share_resonance(fit.poles), axis=1), beside, alone)
    return np.asarray(np.sum(np.abs(fit.residues) ** 2 / std**2, axis=0))


def _share_resonance(poles: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Which poles lie within the half-width of each other's resonance, (n_poles, n_poles)."""
    near = np.abs(poles[:, None] - poles) < np.minimum.outer(-poles.real, -poles.real)
    return np.asarray(near & ~np.eye(poles.size, dtype=bool))


def modes_of(
    fit: PoleFit,
    covariance: NDArray[np.float64] | None = None,
    residues_std: NDArray[np.float64] | None = None,
) -> list[Mode]:
    """Modes of all poles of a fit, in its order; standard deviations NaN where not given."""
    if covariance is None or residues_std is None:
        unknown = 2 * fit.poles.size
        covariance = np.full((unknown, unknown), np.nan)
        residues_std = np.full(fit.residues.shape, np.nan)
    std = np.sqrt(np.diag(covariance)).reshape(-1, 2)
    bound = fit.at_bound.reshape(-1, 2)
    residues = fit.residues
    return [
        Mode(
            pole=complex(pole),
            frequency_std_hz=float(std[r, 0]),
            damping_std=float(std[r, 1]),
            residues=residues[:, r],
            residues_std=residues_std[:, r],
            status="at bound" if np.any(bound[r]) else "ok",
        )
        for r, pole in enumerate(fit.poles)
    ]
