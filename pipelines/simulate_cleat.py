"""The cleat test in numbers: what a point feels after a blow at the contact, and its spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import CleatTest
from model._arrays import readonly
from model.cleat import Quantity
from model.forced import Direction
from model.rotation import Frame

UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s²"}


@dataclass(frozen=True)
class Observer:
    """A point that watches, and what it reads.

    Parameters
    ----------
    at_deg : float
        Angle, degrees: on the tyre, or in space.
    frame : {"rotating", "absolute"}
        Whether it stays on the tyre or in space.
    direction : {"radial", "circumferential"}
    quantity : {"displacement", "velocity", "acceleration"}
    """

    at_deg: float
    frame: Frame = "rotating"
    direction: Direction = "radial"
    quantity: Quantity = "acceleration"

    @property
    def unit(self) -> str:
        """Unit of what it reads."""
        return UNITS[self.quantity]


@dataclass(frozen=True, eq=False)
class CleatResponse:
    """Response to a blow in time and frequency.

    Parameters
    ----------
    observer : Observer
    time_s : ndarray, shape (n_times,)
        From the start of the blow, s.
    response : ndarray, shape (n_times,)
        In the observer's unit.
    frequency_hz : ndarray, shape (n_frequencies,)
        Hz.
    spectrum : ndarray of complex, shape (n_frequencies,)
        ∫x(t)e^{−jωt}dt, in the observer's unit times s.
    """

    observer: Observer
    time_s: NDArray[np.float64]
    response: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    spectrum: NDArray[np.complex128]

    def __post_init__(self) -> None:
        for name in ("time_s", "response", "frequency_hz"):
            object.__setattr__(self, name, readonly(getattr(self, name), float))
        object.__setattr__(self, "spectrum", readonly(self.spectrum, complex))

    @property
    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Columns of a table over time."""
        return {"time_s": self.time_s, self.observer.quantity: self.response}

    @property
    def spectrum_columns(self) -> dict[str, NDArray[np.float64]]:
        """Columns of a table over frequency."""
        return {
            "frequency_hz": self.frequency_hz,
            "real": self.spectrum.real,
            "imag": self.spectrum.imag,
            "magnitude": np.abs(self.spectrum),
            "phase_deg": np.rad2deg(np.angle(self.spectrum)),
        }


def simulate_cleat(
    test: CleatTest, observer: Observer, times_s: ArrayLike, frequency_hz: ArrayLike
) -> CleatResponse:
    """Response of the rolling tyre to a blow, exact for the harmonics summed.

    Parameters
    ----------
    test : CleatTest
        Ring and blow.
    observer : Observer
    times_s : array_like, shape (n_times,)
        s.
    frequency_hz : array_like, shape (n_frequencies,)
        Hz.
    """
    angle = float(np.deg2rad(observer.at_deg))
    response = test.response(
        times_s,
        angle,
        frame=observer.frame,
        direction=observer.direction,
        quantity=observer.quantity,
    )
    spectrum = test.spectrum(
        frequency_hz,
        angle,
        frame=observer.frame,
        direction=observer.direction,
        quantity=observer.quantity,
    )
    return CleatResponse(
        observer,
        np.asarray(times_s),
        response,
        np.asarray(frequency_hz),
        spectrum.astype(complex),
    )
