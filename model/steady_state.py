"""Where the inflated, spinning ring rests: the steady state of eq 5."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import finite_array, readonly
from model.errors import ParameterError
from model.parameters import LARGEST_HOOP_STRAIN, RingParameters

#: ``"dead"``: pressure keeps its direction (as in the paper); ``"follower"``: normal to the belt.
PressureLoad = Literal["dead", "follower"]


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Axisymmetric steady state (u_r°, u_θ° = 0) of the ring at one or many speeds.

    Parameters
    ----------
    speed_rad_s : ndarray
        Angular speeds Ω, rad/s, any shape.
    hoop_strain : ndarray
        ε = u_r°/a, of the same shape.
    tension_stiffness_n_m3 : ndarray
        N0/a² with the hoop tension N0 = K(ε + ε²/2), N/m³, of the same shape.
    mean_radius_m : float
        Mean radius a before inflation, m.
    pressure_load : {"dead", "follower"}
        How the pressure follows the belt.
    """

    speed_rad_s: NDArray[np.float64]
    hoop_strain: NDArray[np.float64]
    tension_stiffness_n_m3: NDArray[np.float64]
    mean_radius_m: float
    pressure_load: PressureLoad

    def __post_init__(self) -> None:
        for name in ("speed_rad_s", "hoop_strain", "tension_stiffness_n_m3"):
            object.__setattr__(self, name, readonly(getattr(self, name)))

    @property
    def radial_displacement_m(self) -> NDArray[np.float64]:
        """u_r°, m."""
        return self.mean_radius_m * self.hoop_strain

    @property
    def radius_m(self) -> NDArray[np.float64]:
        """Radius a + u_r° of the spinning ring, m."""
        return self.mean_radius_m * (1.0 + self.hoop_strain)

    @property
    def hoop_tension_n_m(self) -> NDArray[np.float64]:
        """Hoop tension N0 per unit of belt width, N/m."""
        return self.mean_radius_m**2 * self.tension_stiffness_n_m3


def equilibrium(
    ring: RingParameters,
    speed_rad_s: ArrayLike = 0.0,
    *,
    pressure_load: PressureLoad = "dead",
) -> Equilibrium:
    """Solve eq 5 for the steady radial displacement (u_θ° = 0).

    With a radial load that is not negative the cubic changes sign once, so exactly one root is
    positive; that root is taken. The other two are negative or complex (the ring turned inside
    out). A follower load replaces p_o by p_o(1 + ε).

    Parameters
    ----------
    ring : RingParameters
        The ring.
    speed_rad_s : array_like
        Angular speeds Ω, rad/s, any shape; the sign does not matter here.
    pressure_load : {"dead", "follower"}
        Pressure as the paper's dead load or normal to the deformed belt.

    Returns
    -------
    Equilibrium
        In the shape of `speed_rad_s`.

    Raises
    ------
    ParameterError
        Where the root lies beyond a hoop strain of 0.2: no acceptable equilibrium.
    """
    require_pressure_load(pressure_load)
    speed = finite_array("speed_rad_s", speed_rad_s)
    strain = _positive_root(ring, speed, pressure_load)
    _require_acceptable(speed, strain)
    tension = ring.axial_stiffness_n_m / ring.mean_radius_m**2 * (strain + 0.5 * strain**2)
    return Equilibrium(speed, strain, tension, ring.mean_radius_m, pressure_load)


def require_pressure_load(pressure_load: str) -> None:
    """Refuse anything but the two known pressure loads."""
    if pressure_load not in ("dead", "follower"):
        raise ParameterError(
            "pressure_load",
            f"{pressure_load!r}",
            "pressure is a 'dead' or a 'follower' load",
            "Choose one of the two",
        )


def _positive_root(
    ring: RingParameters, speed: NDArray[np.float64], pressure_load: PressureLoad
) -> NDArray[np.float64]:
    """Newton's method from the right of the root; the cubic is convex there, so it cannot miss."""
    membrane = ring.axial_stiffness_n_m / ring.mean_radius_m
    centrifugal = ring.mass_per_area_kg_m2 * ring.mean_radius_m * speed**2
    load = centrifugal + ring.inflation_pressure_pa
    softening = load if pressure_load == "follower" else centrifugal
    linear = membrane + ring.radial_stiffness_n_m3 * ring.mean_radius_m - softening
    with np.errstate(divide="ignore"):
        strain = np.where(linear > 0, load / np.where(linear > 0, linear, 1.0), np.inf)
    strain = np.minimum(strain, 10.0 * LARGEST_HOOP_STRAIN)  # farther right is refused anyway
    for _ in range(60):
        value = membrane * (1.5 + 0.5 * strain) * strain**2 + linear * strain - load
        slope = membrane * (3.0 + 1.5 * strain) * strain + linear
        step = np.where(slope > 0, value / np.where(slope > 0, slope, 1.0), 0.0)
        strain = strain - step
        if np.all(np.abs(step) <= 4.0 * np.finfo(float).eps * np.abs(strain)):
            break
    return np.asarray(strain)


def _require_acceptable(speed: NDArray[np.float64], strain: NDArray[np.float64]) -> None:
    beyond = strain > LARGEST_HOOP_STRAIN
    if np.any(beyond):
        first = float(np.abs(speed[beyond]).min())
        raise ParameterError(
            "speed_rad_s",
            f"{first:g}",
            f"no acceptable equilibrium: the hoop strain would exceed {LARGEST_HOOP_STRAIN:g}",
            "Lower the speed or the pressure, or raise K or k_r",
        )
