"""The road under the tyre: a contact pressure on a patch of the belt."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.arrays import finite_array
from model.errors import ParameterError
from model.parameters import RingParameters
from model.ring import belt_width_m


@dataclass(frozen=True)
class ContactPatch:
    """Parabolic contact pressure, directed to the axle.

    Parameters
    ----------
    mean_pressure_pa : float
        Mean pressure over the patch, Pa.
    half_angle_rad : float
        Half the angle that the patch covers, rad.
    contact_rad : float
        Angle of its middle, rad.
    """

    mean_pressure_pa: float
    half_angle_rad: float
    contact_rad: float = 0.0

    def __post_init__(self) -> None:
        values = (self.mean_pressure_pa, self.half_angle_rad, self.contact_rad)
        finite_array("contact patch", values)
        if not (0 < self.half_angle_rad < np.pi / 2 and self.mean_pressure_pa >= 0):
            raise ParameterError(
                "contact patch",
                f"half angle {self.half_angle_rad:g} rad, pressure {self.mean_pressure_pa:g} Pa",
                "a half angle between 0 and π/2 and a pressure that is not negative",
                "Check the load, the pressure and the belt width",
            )

    def pressure_pa(self, angles_rad: ArrayLike) -> NDArray[np.float64]:
        """Contact pressure at `angles_rad`, Pa."""
        off = finite_array("angles_rad", angles_rad) - self.contact_rad
        inside = (np.remainder(off + np.pi, 2.0 * np.pi) - np.pi) / self.half_angle_rad
        return 1.5 * self.mean_pressure_pa * np.maximum(1.0 - inside**2, 0.0)


def contact_patch(ring: RingParameters, load_n: float, *, contact_rad: float = 0.0) -> ContactPatch:
    """Patch that carries a vertical load at a mean pressure equal to the inflation pressure.

    The length L = F/(p_o·b) is that of a belt without stiffness; measured patches are close to it.

    Parameters
    ----------
    ring : RingParameters
        Ring with belt width and inflation pressure.
    load_n : float
        Vertical load, N, greater than zero.
    contact_rad : float
        Angle of the contact, rad.

    Returns
    -------
    ContactPatch
        Its pressure's component along the load adds up to `load_n`.

    Raises
    ------
    ParameterError
        For a load that is not positive or too large for the tyre, or a ring without width.
    """
    if not load_n > 0:
        raise ParameterError("load_n", f"{load_n:g}", "a load above zero", "Raise it")
    if ring.inflation_pressure_pa == 0:
        raise ParameterError(
            "inflation_pressure_pa", "0", "the patch follows from it", "Give a ContactPatch"
        )
    width, a = belt_width_m(ring), ring.mean_radius_m
    half = load_n / (ring.inflation_pressure_pa * width) / (2.0 * a)
    patch = ContactPatch(ring.inflation_pressure_pa, half, contact_rad)
    # ∫ 1.5(1 − (x/h)²) cos x dx over the patch, against 2h for a flat one
    vertical = 6.0 * (math.sin(half) - half * math.cos(half)) / half**2
    return replace(patch, mean_pressure_pa=patch.mean_pressure_pa * 2.0 * half / vertical)
