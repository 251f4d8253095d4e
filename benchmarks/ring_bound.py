"""What noise allows of the modes of a ring of which all else is known (Cramér–Rao)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipelines.simulate.truth import TruthMode, modal_sum

Real = NDArray[np.float64]

# Of each order: two frequencies and damping ratios (log), one modal mass (log), one direction (rad
# of the wave).
_OF_ORDER = 6
_STEP = 1e-4


def ring_bound(
    modes: Sequence[TruthMode],
    lines_hz: Real,
    angles_deg: Real,
    forces_deg: Sequence[float],
    std: Sequence[float],
) -> Real:
    """Least relative standard deviations of frequency and damping ratio, (n_modes, 2).

    Members a and b follow each other. Angles, gains and state of the ring are known exactly, as no
    method knows them; of members that coincide the direction is taken as known too.
    """
    n_orders, omega = len(modes) // 2, 2 * np.pi * lines_hz

    def frfs(change: Real) -> Real:
        moved = tuple(_moved(mode, change[k // 2], k % 2) for k, mode in enumerate(modes))
        parts = []
        for force_deg, noise in zip(forces_deg, std, strict=True):
            system = modal_sum(moved, angles_deg, force_deg)
            values = [system.inertance(row, omega) / noise for row in range(angles_deg.size)]
            parts.append(np.ravel(values))
        whole = np.concatenate(parts)
        return np.concatenate([whole.real, whole.imag])

    steps = _STEP * np.eye(_OF_ORDER * n_orders).reshape(-1, n_orders, _OF_ORDER)
    slopes = np.array([(frfs(step) - frfs(-step)) / (2 * _STEP) for step in steps])
    size = np.linalg.norm(slopes, axis=1)
    seen = size > 1e-6 * size.max()
    unit = slopes[seen] / size[seen, None]
    variance = np.full(size.size, np.nan)
    variance[seen] = np.diag(np.linalg.inv(unit @ unit.T)) / size[seen] ** 2
    of_order = np.sqrt(variance).reshape(n_orders, _OF_ORDER)
    return of_order[:, [0, 2, 1, 3]].reshape(-1, 2)


def _moved(mode: TruthMode, change: Real, member: int) -> TruthMode:
    return replace(
        mode,
        frequency_hz=mode.frequency_hz * np.exp(change[member]),
        damping_ratio=mode.damping_ratio * np.exp(change[2 + member]),
        modal_mass_kg=mode.modal_mass_kg * np.exp(change[4]),
        orientation_deg=mode.orientation_deg + np.rad2deg(change[5]) / mode.order,
    )
