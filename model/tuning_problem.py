"""The question behind a tuning: what was measured, what is given, how deviations are weighed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.arrays import readonly
from model.coefficients import harmonics
from model.errors import ParameterError
from model.parameters import RingParameters
from model.ring import natural_frequencies_hz
from model.steady_state import PressureLoad, require_pressure_load

MASS = "mass_per_area_kg_m2"
RADIAL = "radial_stiffness_n_m3"
CIRCUMFERENTIAL = "circumferential_stiffness_n_m3"
AXIAL = "axial_stiffness_n_m"
BENDING = "bending_stiffness_n_m"
PARAMETERS = (MASS, RADIAL, CIRCUMFERENTIAL, AXIAL, BENDING)
OBJECTIVES = ("frequency", "paper")

#: Radial growth of a belt on inflation over its radius, where nobody measured it.
TYPICAL_GROWTH = 0.00277


@dataclass(frozen=True, eq=False)
class TuningProblem:
    """Measured frequencies of a tyre and what else is known about it.

    Parameters
    ----------
    orders : ndarray of int, shape (n_orders,)
        Circumferential orders.
    measured_hz : ndarray, shape (n_orders,)
        Measured natural frequencies, Hz.
    mean_radius_m, inflation_pressure_pa : float
        Mean radius a and pressure p_o.
    belt_width_m : float or None
        Belt width b.
    objective : {"frequency", "paper"}
        Relative frequencies or eq 18.
    given, start : mapping of str to float
        Known parameters, and starting values of others.
    bounds : mapping of str to (float, float)
        Bounds that replace the default ones.
    radial_growth_m : float or None
        Measured u_r° of eq 16.
    pressure_load : {"dead", "follower"}
        See `model.steady_state`.

    Raises
    ------
    ParameterError
        For unknown names, values that are not positive, or contradictions.
    """

    orders: NDArray[np.int_]
    measured_hz: NDArray[np.float64]
    mean_radius_m: float
    inflation_pressure_pa: float
    belt_width_m: float | None = None
    objective: str = "frequency"
    given: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    radial_growth_m: float | None = None
    pressure_load: PressureLoad = "dead"

    def __post_init__(self) -> None:
        object.__setattr__(self, "orders", readonly(self.orders, int))
        object.__setattr__(self, "measured_hz", readonly(self.measured_hz))
        for name in ("given", "start", "bounds"):
            object.__setattr__(self, name, dict(getattr(self, name)))
            _require_known(name, getattr(self, name))
        for name in ("mean_radius_m", "inflation_pressure_pa", "radial_growth_m"):
            _require_positive(name, getattr(self, name))
        require_pressure_load(self.pressure_load)
        self._require_consistent()

    @property
    def growth_m(self) -> float:
        """Radial growth u_r° on inflation: the measured one, or a typical one."""
        if self.radial_growth_m is not None:
            return self.radial_growth_m
        return TYPICAL_GROWTH * self.mean_radius_m

    def ring(self, parameters: Mapping[str, float]) -> RingParameters:
        """Ring with these `parameters`; K by eq 16 where it is not among them."""
        complete = dict(parameters)
        if AXIAL not in complete:
            complete[AXIAL] = self.axial_stiffness_n_m(complete[RADIAL])
        return RingParameters(
            mean_radius_m=self.mean_radius_m,
            inflation_pressure_pa=self.inflation_pressure_pa,
            belt_width_m=self.belt_width_m,
            **complete,
        )

    def axial_stiffness_n_m(self, radial_stiffness_n_m3: float) -> float:
        """K from the radial growth u_r° (eq 16 at Ω = 0), N/m."""
        a, w = self.mean_radius_m, self.growth_m
        follows = 1.0 + w / a if self.pressure_load == "follower" else 1.0
        carried = self.inflation_pressure_pa * follows - radial_stiffness_n_m3 * w
        return carried / (w**3 / (2.0 * a**4) + 3.0 * w**2 / (2.0 * a**3) + w / a**2)

    def frequencies_hz(self, ring: RingParameters) -> NDArray[np.float64]:
        """Natural frequencies of `ring` for the measured orders, Hz."""
        return natural_frequencies_hz(ring, self.orders, pressure_load=self.pressure_load)

    def residual(self, ring: RingParameters) -> NDArray[np.float64]:
        """Deviation per order: relative frequency, or FUN_n of eq 18."""
        if self.objective == "frequency":
            return self.frequencies_hz(ring) / self.measured_hz - 1.0
        a3, a2, _, a0 = self._polynomial(ring)
        squared = (2.0 * np.pi * self.measured_hz) ** 2
        return np.asarray((a3 * squared + a2) * squared + a0)

    def data_slope(self, ring: RingParameters) -> NDArray[np.float64]:
        """Slope of each residual over the logarithm of its measured frequency."""
        if self.objective == "frequency":
            return -self.frequencies_hz(ring) / self.measured_hz
        a3, a2, _, _ = self._polynomial(ring)
        squared = (2.0 * np.pi * self.measured_hz) ** 2
        return np.asarray((4.0 * a3 * squared + 2.0 * a2) * squared)

    def _polynomial(self, ring: RingParameters) -> tuple[Any, Any, Any, Any]:
        return harmonics(ring, self.orders, pressure_load=self.pressure_load).polynomial

    def _require_consistent(self) -> None:
        if self.objective not in OBJECTIVES:
            raise ParameterError(
                "objective", f"{self.objective!r}", f"one of {OBJECTIVES}", "Choose one of them"
            )
        if self.objective == "paper" and 0 in self.orders:
            raise ParameterError(
                "orders", "0", "eq 18 is for n ≥ 1", "Use objective='frequency' with order 0"
            )
        if self.radial_growth_m is not None and (AXIAL in self.given or 0 in self.orders):
            raise ParameterError(
                "radial_growth_m",
                f"{self.radial_growth_m:g}",
                "K would be determined twice: by eq 16 and by a given K or the breathing mode",
                "Give one of the two",
            )


def _require_known(where: str, names: Mapping[str, object]) -> None:
    unknown = [name for name in names if name not in PARAMETERS]
    if unknown:
        raise ParameterError(
            where,
            f"{unknown[0]!r}",
            f"no such parameter among {', '.join(PARAMETERS)}",
            "Correct the name",
        )


def _require_positive(name: str, value: float | None) -> None:
    if value is not None and not (math.isfinite(value) and value > 0):
        raise ParameterError(name, f"{value}", "must be a number above zero", "Correct the value")
