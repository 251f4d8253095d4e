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
    """What another estimator says about one mode.

    Parameters
    ----------
    method : str
        The other estimator.
    mode_hz : float
        Frequency of the mode; NaN where only the other estimator sees one.
    frequency_hz, damping_ratio : float
        The other estimator's pole; NaN where it sees none.
    agrees : bool
        Within 0.5 % of frequency and 10 % of damping.
    """

    method: str
    mode_hz: float
    frequency_hz: float
    damping_ratio: float
    agrees: bool


def second_opinion(
    frf: FRF,
    modes: Sequence[Mode],
    band_hz: tuple[float, float],
    method: str,
    max_order: int,
    settings: IdentificationSettings = IDENTIFICATION,
) -> tuple[Opinion, ...]:
    """Find the poles again with another method and compare them with the modes.

    Parameters
    ----------
    frf : FRF
    modes : sequence of Mode
    band_hz : tuple of float
    method : str
        The other method, see `build_stability`.
    max_order : int
    settings : IdentificationSettings
    """
    highest = min(max_order, _ENOUGH)
    try:
        selection = select_poles(
            build_stability(frf, band_hz, max_order=highest, method=method, settings=settings)
        ).poles
    except FitError:
        selection = np.zeros(0, dtype=complex)
    if frf.exponential_window is not None:
        selection = selection + frf.exponential_window.decay_per_s
    frequency_hz = np.abs(selection) / (2 * np.pi)
    free = [k for k, f in enumerate(frequency_hz) if band_hz[0] <= f <= band_hz[1]]
    opinions = []
    for mode in modes:
        near = min(free, key=lambda k: abs(frequency_hz[k] - mode.frequency_hz), default=None)
        apart = np.inf if near is None else abs(frequency_hz[near] / mode.frequency_hz - 1)
        if near is None or apart > 4 * settings.cross_check_frequency:
            nothing = float("nan")
            opinions.append(Opinion(method, mode.frequency_hz, nothing, nothing, False))
            continue
        free.remove(near)
        ratio = float(-selection[near].real / np.abs(selection[near]))
        agrees = (
            apart < settings.cross_check_frequency
            and abs(ratio / mode.damping_ratio - 1) < settings.cross_check_damping
        )
        seen = float(frequency_hz[near])
        opinions.append(Opinion(method, mode.frequency_hz, seen, ratio, bool(agrees)))
    for k in free:
        ratio = float(-selection[k].real / np.abs(selection[k]))
        opinions.append(Opinion(method, float("nan"), float(frequency_hz[k]), ratio, False))
    return tuple(opinions)
