"""The tyre pressed on the road: frequencies over load, and how it deflects under the largest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import RingParameters, contact_patch, equilibrium, load_ring, loaded_frequencies_hz
from model._arrays import readonly
from model.steady_state import PressureLoad

MOST_LOADS = 200  # each takes a tenth of a second and more: a state and its modes


@dataclass(frozen=True, eq=False)
class LoadedSweep:
    """Frequencies of a standing tyre over vertical load.

    Parameters
    ----------
    load_n : ndarray, shape (n_loads,)
        N.
    frequency_hz : ndarray, shape (n_loads, n_modes)
        Ascending, Hz.
    dominant_order : ndarray of int, shape (n_loads, n_modes)
        Order with the largest share of each shape.
    angle_deg : ndarray, shape (n_angles,)
        Angles from the contact, degrees.
    deflection_m : ndarray, shape (n_angles,)
        Radial deflection by the largest load, against the inflated tyre, m.
    """

    load_n: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    dominant_order: NDArray[np.int_]
    angle_deg: NDArray[np.float64]
    deflection_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("load_n", "frequency_hz", "angle_deg", "deflection_m"):
            object.__setattr__(self, name, readonly(getattr(self, name), float))
        object.__setattr__(self, "dominant_order", readonly(self.dominant_order, int))

    @property
    def contact_deflection_m(self) -> float:
        """Deflection towards the axle in the middle of the contact, at the largest load."""
        return 0.0 - float(self.deflection_m[np.argmin(np.abs(self.angle_deg))])

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns of a table, load by load and mode by mode."""
        n_loads, n_modes = self.frequency_hz.shape
        return {
            "load_n": np.repeat(self.load_n, n_modes),
            "mode": np.tile(np.arange(1, n_modes + 1), n_loads),
            "frequency_hz": self.frequency_hz.ravel(),
            "dominant_order": self.dominant_order.ravel(),
        }


def simulate_loaded(
    ring: RingParameters,
    load_n: ArrayLike,
    n_modes: int,
    *,
    highest_order: int = 60,
    pressure_load: PressureLoad = "dead",
) -> LoadedSweep:
    """Frequencies over vertical load, and the deflection by the largest one.

    Parameters
    ----------
    ring : RingParameters
        With belt width.
    load_n : array_like, shape (n_loads,)
        Vertical loads, N; 0 is the free tyre.
    n_modes : int
        How many of the lowest modes.
    highest_order, pressure_load
        As `model.load_ring`.
    """
    loads = np.asarray(load_n, dtype=float)
    frequencies, orders = loaded_frequencies_hz(
        ring, loads, n_modes, highest_order=highest_order, pressure_load=pressure_load
    )
    angle, deflection = _deflection(ring, float(loads.max()), highest_order, pressure_load)
    return LoadedSweep(loads, frequencies, orders, angle, deflection)


def _deflection(
    ring: RingParameters, load_n: float, highest_order: int, pressure_load: PressureLoad
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angles from −180° and the deflection against the inflated tyre there."""
    if load_n == 0:
        angle = np.arange(-180.0, 180.0)
        return angle, np.zeros(angle.size)
    state = load_ring(
        ring,
        contact_patch(ring, load_n),
        highest_order=highest_order,
        pressure_load=pressure_load,
    )
    inflated = float(equilibrium(ring, pressure_load=pressure_load).radial_displacement_m)
    angle = np.remainder(np.rad2deg(state.angles_rad) + 180.0, 360.0) - 180.0
    rising = np.argsort(angle)
    return angle[rising], state.radial_m[rising] - inflated
