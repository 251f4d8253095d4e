"""What is known of a tyre besides its frequencies: priors, their widths, modal masses, torsion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arguments import Array, ReadonlyArrays, measured_orders, require_number

#: Radial growth of a belt on inflation over its radius where it was not measured, and its standard
#: deviation: tyres grow by 0.05 to 1 %.
GROWTH, GROWTH_STD = 0.0035, 0.003
#: Deviation of a single modal mass from that of the ring, besides its own error.
_MASS_FORM_STD = 0.02


@dataclass(frozen=True)
class TuningPriors:
    """Standard deviations of what a tuning takes as known.

    All but `parameters` are shares of the value.

    Parameters
    ----------
    pressure_std : float
        Of the inflation pressure: gauge and temperature.
    radius_std : float
        Of the mean radius of the belt.
    width_std : float
        Of the mean belt width, where one is given.
    calibration_std : float
        Of force and acceleration together, the same for all modal masses.
    model_form_std : float
        Deviation of a tyre's frequencies from those of a ring; the paper's are within 0.5 %.
    parameters : mapping of str to (float, float)
        Value and standard deviation in SI of parameters of `RingParameters` or of
        ``radial_growth_m``.

    Raises
    ------
    ParameterError
        For a negative or infinite standard deviation.
    """

    pressure_std: float = 0.01
    radius_std: float = 0.005
    width_std: float = 0.03
    calibration_std: float = 0.01
    model_form_std: float = 0.005
    parameters: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for entry in fields(self):
            if entry.name != "parameters":
                require_number(entry.name, getattr(self, entry.name), zero_allowed=True)
        for name, (value, std) in self.parameters.items():
            require_number(f"prior of {name}", value, zero_allowed=True)
            require_number(f"standard deviation of {name}", std)


@dataclass(frozen=True, eq=False)
class ModalMasses(ReadonlyArrays):
    """Measured modal masses, a share of the tuning's orders.

    Parameters
    ----------
    orders : ndarray of int, shape (n_masses,)
        Orders n ≥ 1.
    mass_kg : ndarray, shape (n_masses,)
        Modal masses of radial shapes cos nθ of unit amplitude, kg.
    relative_std : ndarray, shape (n_masses,)
        Relative standard deviations of each alone.
    """

    orders: NDArray[np.int_]
    mass_kg: Array
    relative_std: Array

    def errors(self, priors: TuningPriors, *, width_given: bool) -> Array:
        """Independent errors of the logarithms, one per column: single ones, common ones.

        The last column is that of the belt width.
        """
        single = np.hypot(self.relative_std, _MASS_FORM_STD)
        common = np.ones((self.orders.size, 1))
        width = priors.width_std if width_given else 0.0
        return np.hstack([np.diag(single), common * priors.calibration_std, common * width])


def modal_masses(
    orders: ArrayLike, mass_kg: ArrayLike | None, std_kg: ArrayLike | None
) -> ModalMasses | None:
    """Modal masses of these orders; the breathing mode is left out."""
    if mass_kg is None:
        return None
    numbers, masses, std = measured_orders(
        "modal_mass_kg", orders, mass_kg, "modal_mass_std_kg", std_kg
    )
    used = numbers > 0
    relative = np.zeros(numbers.size) if std is None else std
    return ModalMasses(numbers[used], masses[used], relative[used])
