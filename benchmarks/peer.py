"""Another toolbox on the same FRFs: sdypy-EMA, with all the help there is."""

from __future__ import annotations

import contextlib
import io

import numpy as np
from scoring import FoundMode
from sdypy import EMA

from ema.core.frf import FRF

ORDER = {"lscf": 60, "lsce": 30}
# Its LSCE errs by several percent where the band does not start at 0 Hz; its LSCF fails there.
LOWER_HZ = {"lscf": 20.0, "lsce": 0.0}
# Lines above the band keep modes at its end away from the edge, as our own margin does.
UPPER_HZ = 296.0
# Its search wanders off over this window around a given frequency; this is the narrowest it takes.
WINDOW_HZ = 6


def closest_poles(frf: FRF, method: str, true_hz: list[float]) -> list[FoundMode]:
    """Stable poles closest to the true frequencies, each at most once."""
    with contextlib.redirect_stderr(io.StringIO()):  # its progress bars
        model = _poles(frf, method)
        model.select_closest_poles(true_hz, f_window=WINDOW_HZ)
    found = zip(model.nat_freq, model.nat_xi, strict=True)
    return [FoundMode(float(f), float(zeta)) for f, zeta in sorted(set(found)) if f > 0]


def poles_of_orders(frf: FRF, method: str) -> list[np.ndarray]:
    """Poles in the upper half plane of each model order, rad/s."""
    with contextlib.redirect_stderr(io.StringIO()):
        found = _poles(frf, method).all_poles
    return [np.asarray(poles)[np.imag(poles) > 0] for poles in found]


def _poles(frf: FRF, method: str) -> EMA.Model:
    model = EMA.Model(
        frf.values,
        frf.frequency_hz,
        lower=LOWER_HZ[method],
        upper=UPPER_HZ,
        pol_order_high=ORDER[method],
    )
    model.get_poles(method, show_progress=False)
    return model
