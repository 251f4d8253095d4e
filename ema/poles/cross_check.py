"""Cross-check of the modes with a second pole estimator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ema.core.errors import FitError
from ema.core.frf import FRF
from ema.core.modes import Mode
from ema.core.settings import IDENTIFICATION, IdentificationSettings
from ema.poles.selection import select_poles
from ema.poles.stability import build_stability

OTHER = {"lsce": "plscf", "plscf": "lsce"}

# Model orders that show every mode of a tyre; a second look need not go further.
_ENOUGH = 40


@dataclass(frozen=True)
class Opinion:
    """What another estimator says about one mode; NaN where only one of the two sees it."""

    method: str  # the other estimator
    mode_hz: float  # frequency of the mode
    frequency_hz: float  # pole of the other estimator
    damping_ratio: float
    agrees: bool  # within `cross_check_frequency` and `cross_check_damping`


def second_opinion(
    frf: FRF,
    modes: Sequence[Mode],
    band_hz: tuple[float, float],
    method: str,
    max_order: int,
    settings: IdentificationSettings = IDENTIFICATION,
) -> tuple[Opinion, ...]:
    """Find the poles again with another `method` and compare them with the modes."""
    highest = min(max_order, _ENOUGH)
    try:
        selection = select_poles(
            build_stability(frf, band_hz, max_order=highest, method=method, settings=settings)
        ).poles
    except FitError:
        selection = np.zeros(0, dtype=complex)
    if frf.exponential_window is not None:
        selection = selection + frf.exponential_window.decay_per_s
    frequency_hz = (np.abs(selection) / (2 * np.pi)).tolist()
    damping_ratio = (-selection.real / np.abs(selection)).tolist()
    free = [k for k, f in enumerate(frequency_hz) if band_hz[0] <= f <= band_hz[1]]
    nothing, opinions = float("nan"), []
    for mode in modes:
        near = min(free, key=lambda k: abs(frequency_hz[k] - mode.frequency_hz), default=None)
        apart = np.inf if near is None else abs(frequency_hz[near] / mode.frequency_hz - 1)
        if near is None or apart > 4 * settings.cross_check_frequency:
            opinions.append(Opinion(method, mode.frequency_hz, nothing, nothing, False))
            continue
        free.remove(near)
        frequency, damping = frequency_hz[near], damping_ratio[near]
        alike = abs(damping / mode.damping_ratio - 1) < settings.cross_check_damping
        agrees = apart < settings.cross_check_frequency and alike
        opinions.append(Opinion(method, mode.frequency_hz, frequency, damping, agrees))
    opinions += [Opinion(method, nothing, frequency_hz[k], damping_ratio[k], False) for k in free]
    return tuple(opinions)
