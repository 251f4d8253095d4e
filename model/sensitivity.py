"""How much each parameter moves each frequency: d ln f / d ln parameter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import readonly, whole_orders
from model.parameters import RingParameters
from model.ring import natural_frequencies_hz
from model.steady_state import PressureLoad

#: Parameters that the frequencies of a ring depend on, besides its radius.
SENSITIVE = (
    "mass_per_area_kg_m2",
    "radial_stiffness_n_m3",
    "circumferential_stiffness_n_m3",
    "axial_stiffness_n_m",
    "bending_stiffness_n_m",
    "inflation_pressure_pa",
)
_STEP = 1e-4  # relative; central differences then err by about 1e-8


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Logarithmic sensitivities of natural frequencies.

    Parameters
    ----------
    orders : ndarray of int, shape (n_orders,)
        Circumferential orders, the rows.
    parameters : tuple of str
        Parameter names, the columns.
    values : ndarray, shape (n_orders, n_parameters)
        d ln f / d ln parameter, without unit; the other parameters held.
    """

    orders: NDArray[np.int_]
    parameters: tuple[str, ...]
    values: NDArray[np.float64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "orders", readonly(self.orders, int))
        object.__setattr__(self, "values", readonly(self.values))

    def of(self, parameter: str) -> NDArray[np.float64]:
        """Column of one parameter, shape (n_orders,)."""
        return np.asarray(self.values[:, self.parameters.index(parameter)])


def frequency_sensitivity(
    ring: RingParameters, orders: ArrayLike, *, pressure_load: PressureLoad = "dead"
) -> Sensitivity:
    """Sensitivities of the natural frequencies at Ω = 0 to every parameter of `SENSITIVE`.

    The rows add up to zero: scaling mass, stiffnesses and pressure together changes no frequency,
    which is why one of them must be given.
    """
    numbers = np.atleast_1d(whole_orders(orders))

    def log_frequency(name: str, factor: float) -> NDArray[np.float64]:
        moved = replace(ring, **{name: getattr(ring, name) * factor})
        return np.log(natural_frequencies_hz(moved, numbers, pressure_load=pressure_load))

    width = np.log1p(_STEP) - np.log1p(-_STEP)
    columns = [
        (log_frequency(name, 1.0 + _STEP) - log_frequency(name, 1.0 - _STEP)) / width
        for name in SENSITIVE
    ]
    return Sensitivity(numbers, SENSITIVE, np.column_stack(columns))
