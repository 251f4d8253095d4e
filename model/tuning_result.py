"""The outcome of a tuning: a ring, and how far each of its parameters can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model import _show
from model._arrays import readonly
from model.identifiability import Correlation
from model.parameters import RingParameters
from model.sensitivity import Sensitivity


@dataclass(frozen=True, eq=False)
class TuningResult:
    """A ring tuned on measured natural frequencies.

    Parameters
    ----------
    ring : RingParameters
        The tuned ring.
    std : dict of str to float
        Standard deviation of each parameter in its unit; absent where unknown.
    how : dict of str to str
        ``"given"``, ``"identified"``, ``"not identified"`` or ``"at bound"``, per parameter.
    orders : ndarray of int, shape (n_orders,)
        Circumferential orders used.
    measured_hz, model_hz : ndarray, shape (n_orders,)
        Measured natural frequencies and those of the tuned ring at Ω = 0.
    relative_std : ndarray, shape (n_orders,)
        Relative standard deviation of each frequency that `std` rests on; NaN where none is known.
    correlation : Correlation
        Of the free parameters.
    sensitivity : Sensitivity
        d ln f / d ln parameter at the solution.
    objective : str
        ``"frequency"`` or ``"paper"``.
    notes : tuple of str
        What a reader must know, in sentences.
    """

    ring: RingParameters
    std: dict[str, float]
    how: dict[str, str]
    orders: NDArray[np.int_]
    measured_hz: NDArray[np.float64]
    model_hz: NDArray[np.float64]
    relative_std: NDArray[np.float64]
    correlation: Correlation
    sensitivity: Sensitivity
    objective: str
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "orders", readonly(self.orders, int))
        for name in ("measured_hz", "model_hz", "relative_std"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    @property
    def error_percent(self) -> NDArray[np.float64]:
        """Deviation of the model from the measurement, percent of the measured frequency."""
        return 100.0 * (self.model_hz / self.measured_hz - 1.0)

    def __repr__(self) -> str:
        return _show.tuning_line(self)

    def _repr_html_(self) -> str:
        return _show.tuning_html(self)
