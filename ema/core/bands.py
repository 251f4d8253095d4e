"""Lines within a frequency band."""

from __future__ import annotations

import numpy as np

from ema.core.errors import FitError
from ema.core.frf import FRF


def widened_band(frf: FRF, band_hz: tuple[float, float]) -> slice:
    """Lines of the band and, where their noise allows, of a margin on both sides.

    Raises
    ------
    FitError
        Where the band holds too few lines to identify anything.
    """
    frequency_hz = frf.frequency_hz
    low, high = np.searchsorted(frequency_hz, band_hz, side="left")
    high = int(np.searchsorted(frequency_hz, band_hz[1], side="right"))
    if high - low < _FEWEST_LINES:
        raise FitError(
            f"only {max(high - low, 0)} frequency lines between {band_hz[0]:g} and "
            f"{band_hz[1]:g} Hz; at least {_FEWEST_LINES} are needed, and the FRFs end at "
            f"{frequency_hz[-1]:g} Hz. Widen the band, use longer blocks or correct the sampling "
            "rate."
        )
    margin = int(_MARGIN * (high - low))
    first, last = max(int(low) - margin, 0), min(high + margin, frequency_hz.size)
    noise = np.median(frf.std[:, first:last], axis=0)
    # FRFs without σ get no verdict on their noise: the margin stays whole.
    allowed = _MARGIN_NOISE * np.max(noise[low - first : high - first])
    barred = first + np.flatnonzero((noise > allowed) | (frequency_hz[first:last] <= 0))
    below, above = barred[barred < low], barred[barred >= high]
    return slice(
        int(below.max()) + 1 if below.size else first, int(above.min()) if above.size else last
    )


# Beyond the band, lines are used up to this share of its width, for modes just outside it …
_MARGIN = 0.25


# … as long as they are not noisier than the noisiest part of the band by more than this factor.
_MARGIN_NOISE = 2.0


_FEWEST_LINES = 32
