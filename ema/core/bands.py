"""Lines of a band, and of a margin beside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ema.core.errors import FitError, InputError, require_type
from ema.core.frf import FRF
from ema.core.frf_arrays import band_of

NO_FRF = "Use estimate_frf or FRF.from_arrays"
# Beyond the band, lines are used up to this share of its width, for modes just outside it …
_MARGIN = 0.25
# … as long as they are not noisier than the noisiest part of the band by more than this factor.
_MARGIN_NOISE = 2.0
_FEWEST_LINES = 32


def widened_band(frf: FRF, band_hz: tuple[float, float]) -> slice:
    """Lines of the band and, where their noise allows, of a margin on both sides.

    `FitError` where the band holds too few lines to identify anything.
    """
    require_type("frf", frf, FRF, NO_FRF)
    band_hz = band_of(band_hz)
    frequency_hz = frf.frequency_hz
    low = int(np.searchsorted(frequency_hz, band_hz[0], side="left"))
    high = int(np.searchsorted(frequency_hz, band_hz[1], side="right"))
    if high - low < _FEWEST_LINES:
        raise FitError(
            f"only {max(high - low, 0)} frequency lines between {band_hz[0]:g} and "
            f"{band_hz[1]:g} Hz; at least {_FEWEST_LINES} are needed, and the FRFs end at "
            f"{frequency_hz[-1]:g} Hz. Widen the band, use longer blocks or correct the sampling "
            "rate."
        )
    margin = int(_MARGIN * (high - low))
    first, last = max(low - margin, 0), min(high + margin, frequency_hz.size)
    noise = np.median(frf.std[:, first:last], axis=0)
    # FRFs without σ get no verdict on their noise: the margin stays whole.
    allowed = _MARGIN_NOISE * np.max(noise[low - first : high - first])
    barred = first + np.flatnonzero((noise > allowed) | (frequency_hz[first:last] <= 0))
    below, above = barred[barred < low], barred[barred >= high]
    return slice(int(below.max(initial=first - 1)) + 1, int(above.min(initial=last)))


def frequencies_of(name: str, values: ArrayLike) -> tuple[float, ...]:
    """Frequencies in Hz that a user gives, one or several."""
    try:
        found = np.atleast_1d(np.asarray(values, dtype=float)).ravel()
    except (TypeError, ValueError):
        found = np.zeros(0)
    if not found.size or not np.all(np.isfinite(found) & (found > 0)):
        rule = "they must be numbers > 0 in Hz"
        raise InputError(name, f"{values!r:.60}", rule, "Write e.g. [78.7, 100.3]")
    return tuple(found.tolist())
