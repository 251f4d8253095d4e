"""The stability diagram: poles over model order, their clusters, and which clusters are modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema._arrays import readonly


@dataclass(frozen=True)
class Cluster:
    """Poles of many model orders that belong together.

    Parameters
    ----------
    label : int
        Number used in `StabilityDiagram.cluster`.
    pole : complex
        Representative pole in rad/s.
    size : int
        Number of model orders that contain it.
    kept : bool
        Whether it is taken for a mode.
    reason : str
        Why it was kept or dropped, in words.
    """

    label: int
    pole: complex
    size: int
    kept: bool
    reason: str

    @property
    def frequency_hz(self) -> float:
        """Undamped frequency |s|/2π."""
        return abs(self.pole) / (2 * np.pi)

    @property
    def damping_ratio(self) -> float:
        """Damping ratio −Re(s)/|s|."""
        return -self.pole.real / abs(self.pole)


@dataclass(frozen=True, eq=False)
class StabilityDiagram:
    """Every pole of every model order, with what is stable from one order to the next.

    Parameters
    ----------
    band_hz : tuple of float
        Band in which modes are sought.
    model_order : ndarray of int, shape (n_poles,)
        LSCE model order each pole comes from.
    poles : ndarray of complex, shape (n_poles,)
        Poles in rad/s, upper half plane.
    stable_frequency, stable_damping : ndarray of bool, shape (n_poles,)
        Whether the previous order has the pole within 1 % of frequency, 5 % of damping.
    cluster : ndarray of int, shape (n_poles,)
        Cluster label; −1 where the pole belongs to none.
    clusters : tuple of Cluster
        All clusters, kept or not.
    indicator_hz, indicator : ndarray
        Mode indicator function drawn behind the poles: RMS inertance over all positions.
    """

    band_hz: tuple[float, float]
    model_order: NDArray[np.int_]
    poles: NDArray[np.complex128]
    stable_frequency: NDArray[np.bool_]
    stable_damping: NDArray[np.bool_]
    cluster: NDArray[np.int_]
    clusters: tuple[Cluster, ...]
    indicator_hz: NDArray[np.float64]
    indicator: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name, dtype in (
            ("model_order", int),
            ("poles", complex),
            ("stable_frequency", bool),
            ("stable_damping", bool),
            ("cluster", int),
            ("indicator_hz", float),
            ("indicator", float),
        ):
            object.__setattr__(self, name, readonly(getattr(self, name), dtype))

    @property
    def frequency_hz(self) -> NDArray[np.float64]:
        """Undamped frequencies |s|/2π of all poles."""
        return np.asarray(np.abs(self.poles) / (2 * np.pi))

    @property
    def damping_ratio(self) -> NDArray[np.float64]:
        """Damping ratios −Re(s)/|s| of all poles."""
        return np.asarray(-self.poles.real / np.abs(self.poles))
