"""Curve fit: from the poles of the stability diagram to modes with residues and error bars."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from ema.core.drift import Drift
from ema.core.errors import FitError
from ema.core.modes import Mode
from ema.fitting.covariance import (
    frequency_damping_covariance,
    parameter_covariance,
    residue_std,
    std_between_runs,
)
from ema.fitting.evidence import is_no_mode, with_model_error
from ema.fitting.fit_steps import (
    beside_ring,
    in_other_orders,
    is_undetermined,
    modes_of,
    rows_of,
    shift_beside,
    std_of_unseen_pairs,
    with_states,
)
from ema.fitting.listing import Row, Settled
from ema.fitting.mode_pairs import RingOrder
from ema.fitting.pole_fit import PoleFit, evaluate
from ema.fitting.search import CurveFit
from ema.fitting.variable_projection import Real


def settled(curve: CurveFit) -> Settled:
    """Rows of all poles with their uncertainty."""
    frf = curve.frf
    fit, owner, place = _one_pole_per_order(curve)
    covariance = parameter_covariance(fit, curve.correlation)
    both = frequency_damping_covariance(fit.poles, covariance)
    residues_std = residue_std(fit, covariance, curve.correlation)
    shifts, scatter = curve.sensitivity
    modes = _with_band_shift(modes_of(fit, both, residues_std), shifts[place])
    if not curve.circle:
        modes, both = with_model_error(modes, both, fit, scatter)
    drift = _final_drift(curve, fit, covariance)
    unseen = std_of_unseen_pairs(fit, modes, owner, frf.position_deg, curve.correlation)
    between = np.hypot(std_between_runs(fit, curve.correlation), unseen)
    mixed = in_other_orders(fit, owner, residues_std, frf.position_deg)
    beside = beside_ring(modes, frf.position_deg, owner)
    if curve.circle and not curve.selection.pinned:
        between = np.hypot(between, shift_beside(modes, beside))
    seen = rows_of(modes, owner, both, between, mixed, drift, frf.position_deg, curve.settings)
    judged_by = [rows[0] for rows, _ in seen] if curve.circle else modes
    in_band, doubts = _doubts(curve, judged_by, fit, beside)
    ascending = [int(r) for r in np.argsort(np.abs(fit.poles))]
    return Settled(
        frf=frf,
        fit=fit,
        band_hz=curve.band_hz,
        rows=tuple(
            Row(mode, (place[r], member), r in in_band, doubts.get(r, ""))
            for r in ascending
            for member, mode in enumerate(seen[r][0])
        ),
        covariance=block_diag(*(seen[r][1] for r in ascending)),
        ring=curve.ring,
        drift=drift,
        misfit=curve.fit.misfit if np.all(np.isfinite(frf.std)) else float("nan"),
        notes=(*curve.leakage_notes, *curve.notes),
    )


def _one_pole_per_order(curve: CurveFit) -> tuple[PoleFit, dict[int, RingOrder], list[int]]:
    """Residues with the mean pole of each order in the place of its members.

    Residues of two poles closer than their width are not determined one by one; those of one
    pole are. Also: which order each of these poles belongs to, and the pole it stands for.
    """
    fit = curve.fit
    if curve.selection.pinned or not curve.ring:
        return fit, {}, list(range(fit.poles.size))
    means = {o.key: (o, o.pair.mean) for o in curve.ring if o.pair is not None}
    gone = {k for order, _ in means.values() for k in order.members if k != order.key}
    kept = [k for k in range(fit.poles.size) if k not in gone]
    poles = np.array([means[k][1] if k in means else fit.poles[k] for k in kept])
    bound = fit.at_bound.reshape(-1, 2)[kept]
    bound[[kept.index(k) for k in means]] = False
    again = replace(evaluate(fit.lines, poles, fit.drift), at_bound=bound.ravel())
    return again, {kept.index(k): order for k, (order, _) in means.items()}, kept


def _doubts(
    curve: CurveFit, modes: Sequence[Mode], fit: PoleFit, beside: set[int]
) -> tuple[set[int], dict[int, str]]:
    """Poles in the band, and why some of them are no part of the result; never all of them."""
    low, high = curve.band_hz
    inside = {r for r, mode in enumerate(modes) if low <= mode.frequency_hz <= high}
    if not inside:
        raise FitError("all poles left the band during the curve fit. Pin frequencies.")
    lost = is_no_mode(fit, curve.settings.visible_share) & (not curve.circle)
    why = {
        r: f"it is not determined (± {modes[r].frequency_std_hz:.2g} Hz, "
        f"{modes[r].frequency_band_shift_hz:.2g} Hz with another band)"
        for r in inside
        if is_undetermined(modes[r], r in beside, curve.settings)
    } | {r: "it hardly shows at its own resonance" for r in inside if lost[r]}
    return inside, {} if len(why) == len(inside) or curve.selection.pinned else why


def _with_band_shift(modes: Sequence[Mode], shifts: Real) -> list[Mode]:
    """Modes with what the ends of the band change in their poles."""
    return [
        replace(mode, frequency_band_shift_hz=float(hz), damping_band_shift=float(ratio))
        for mode, (hz, ratio) in zip(modes, shifts, strict=True)
    ]


def _final_drift(curve: CurveFit, fit: PoleFit, covariance: Real) -> Drift:
    if not curve.drift.applied or len(fit.drift) == 1:
        return curve.drift
    own = slice(2 * fit.poles.size, None)
    return with_states(curve.drift, fit.drift[1:], covariance[own, own])
