"""Inertance of the ring model: values with their unit, columns and peaks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import ForcedRing, inertance, inextensional_inertance
from model._arrays import readonly

PER_FORCE = "(m/s²)/N"
PER_LINE_FORCE = "(m/s²)/(N/m)"


@dataclass(frozen=True, eq=False)
class SimulatedInertance:
    """Inertance over frequency.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_frequencies,)
        Hz.
    values : ndarray of complex, shape (n_frequencies,)
        Acceleration over force.
    unit : str
        ``"(m/s²)/N"``, or ``"(m/s²)/(N/m)"`` for a force per unit of belt width.
    """

    frequency_hz: NDArray[np.float64]
    values: NDArray[np.complex128]
    unit: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency_hz", readonly(self.frequency_hz, float))
        object.__setattr__(self, "values", readonly(self.values, complex))

    @property
    def magnitude(self) -> NDArray[np.float64]:
        """Modulus."""
        return np.abs(self.values)

    @property
    def phase_deg(self) -> NDArray[np.float64]:
        """Phase between −180° and 180°."""
        return np.asarray(np.rad2deg(np.angle(self.values)))

    @property
    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Columns of a table."""
        return {
            "frequency_hz": self.frequency_hz,
            "real": self.values.real,
            "imag": self.values.imag,
            "magnitude": self.magnitude,
            "phase_deg": self.phase_deg,
        }

    @property
    def peaks(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Frequencies in Hz and heights of the peaks of the magnitude, on the given lines."""
        inner = self.magnitude[1:-1]
        top = (inner > self.magnitude[:-2]) & (inner >= self.magnitude[2:])
        at = np.flatnonzero(top) + 1
        return self.frequency_hz[at], self.magnitude[at]


def simulate_inertance(
    forced: ForcedRing,
    frequency_hz: ArrayLike,
    at_deg: float,
    force_deg: float = 0.0,
    *,
    inextensional: bool = False,
) -> SimulatedInertance:
    """Radial inertance between two angles; per unit of width where the belt width is unknown.

    Parameters
    ----------
    forced : ForcedRing
    frequency_hz : array_like, shape (n_frequencies,)
        Hz.
    at_deg, force_deg : float
        Angles of response and force, degrees.
    inextensional : bool
        Whether to take the belt as inextensible (eq 33).
    """
    per_width = forced.ring.belt_width_m is None
    form = inextensional_inertance if inextensional else inertance
    values = form(
        forced, frequency_hz, np.deg2rad(at_deg), float(np.deg2rad(force_deg)), per_width=per_width
    )
    unit = PER_LINE_FORCE if per_width else PER_FORCE
    return SimulatedInertance(np.asarray(frequency_hz), values.astype(complex), unit)
