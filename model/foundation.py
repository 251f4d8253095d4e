"""Foundation stiffness: from the two rigid-belt modes, and under the other pressure model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from model.arguments import require_number
from model.coefficients import PressureLoad, equilibrium, harmonics, require_pressure_load
from model.errors import ParameterError
from model.parameters import RingParameters
from model.tuning_problem import TuningProblem

_MOST_STEPS = 100


@dataclass(frozen=True)
class Foundation:
    """Stiffness of the foundation, and the membrane stiffness assumed with it.

    Parameters
    ----------
    radial_stiffness_n_m3, circumferential_stiffness_n_m3 : float
        k_r and k_θ, N/m³.
    axial_stiffness_n_m : float
        K, N/m.
    """

    radial_stiffness_n_m3: float
    circumferential_stiffness_n_m3: float
    axial_stiffness_n_m: float


def foundation_from_belt_modes(
    translation_hz: float,
    torsion_hz: float,
    *,
    mean_radius_m: float,
    mass_per_area_kg_m2: float,
    inflation_pressure_pa: float,
    axial_stiffness_n_m: float | None = None,
    bending_stiffness_n_m: float = 0.0,
    pressure_load: PressureLoad = "follower",
) -> Foundation:
    """Find k_r and k_θ such that the ring has these two frequencies on a fixed rim.

    The inverse of `natural_frequencies_hz` for order 1 and of `torsion_frequency_hz`, both for
    one pressure model. They depend a little on the belt's membrane stiffness K, which two
    frequencies do not determine.

    Parameters
    ----------
    translation_hz : float
        Frequency of order 1, Hz.
    torsion_hz : float
        Frequency of the torsion, Hz.
    mean_radius_m, mass_per_area_kg_m2, inflation_pressure_pa : float
        a, ρh and p_o.
    axial_stiffness_n_m : float, optional
        K. Default: from the typical growth on inflation (eq 16), as in a tuning without order 0.
    bending_stiffness_n_m : float
        D; it changes order 1 in the eighth digit.
    pressure_load : {"dead", "follower"}
        Pressure model that the stiffnesses belong to.

    Raises
    ------
    ParameterError
        For values that are not positive, or frequencies that no ring can have together.
    """
    for frequency_hz in (translation_hz, torsion_hz):
        require_number("frequencies", frequency_hz)
    growth = TuningProblem(
        np.array([1]),
        np.array([translation_hz]),
        mean_radius_m,
        inflation_pressure_pa,
        pressure_load=pressure_load,
    )
    both = mass_per_area_kg_m2 * (2.0 * np.pi * translation_hz) ** 2
    around = mass_per_area_kg_m2 * (2.0 * np.pi * torsion_hz) ** 2
    pair = f"translation {translation_hz:g} Hz, torsion {torsion_hz:g} Hz"
    radial, circumferential = 2.0 * both - around, around  # an inextensible belt
    for _ in range(_MOST_STEPS):
        if radial <= 0:
            rule = "torsion must be below √2 times translation"
            raise ParameterError("frequencies", pair, rule, "Check both frequencies")
        axial = axial_stiffness_n_m
        if axial is None:
            axial = growth.axial_stiffness_n_m(radial)
        stiffnesses = radial, max(circumferential, 0.0), axial, bending_stiffness_n_m
        ring = RingParameters(
            mean_radius_m, mass_per_area_kg_m2, *stiffnesses, inflation_pressure_pa
        )
        before = radial, circumferential
        # k_r and k_θ from the belt's share at the present ones: about two more digits per step.
        torsion = harmonics(ring, 0, pressure_load=pressure_load)
        circumferential = around - float(torsion.m22 - ring.circumferential_stiffness_n_m3)
        belt = float(harmonics(ring, 1, pressure_load=pressure_load).c)  # m11 − k_r and m22 − k_θ
        rest = circumferential - both
        radial = both - belt * rest / (belt + rest)  # (m11 − ρhω²)(m22 − ρhω²) = c²
        if np.allclose(before, (radial, circumferential), rtol=1e-14, atol=1e-14 * both):
            return Foundation(radial, circumferential, axial)
    rule = "the search for k_r and k_θ does not converge"
    raise ParameterError("frequencies", pair, rule, "Check both frequencies")


def with_pressure_load(
    ring: RingParameters, have: PressureLoad, want: PressureLoad
) -> RingParameters:
    """The ring with the same motion under the other pressure model.

    A follower load acts as p_o/a more on k_r and less on k_θ. With k_r ∓ p_o/a, k_θ ± p_o/a and
    the K that leaves the hoop tension as it is, torsion and all bending waves of an inextensible
    belt are the same; extension changes frequencies by 0.1 % or less.

    Parameters
    ----------
    ring : RingParameters
    have, want : {"dead", "follower"}
        Pressure model that the ring belongs to, and the one to convert to.

    Raises
    ------
    ParameterError
        Where a stiffness would be negative: k_θ of a dead load.
    """
    require_pressure_load(have)
    require_pressure_load(want)
    if have == want:
        return ring
    a, pressure = ring.mean_radius_m, ring.inflation_pressure_pa
    normal = pressure / a if want == "follower" else -pressure / a
    radial = ring.radial_stiffness_n_m3 - normal
    around = ring.circumferential_stiffness_n_m3 + normal
    if min(radial, around) < 0:
        found = (
            f"k_r = {ring.radial_stiffness_n_m3:g}, k_θ = {ring.circumferential_stiffness_n_m3:g}"
        )
        rule = f"as {want} load one of them would be negative: p₀/a is {pressure / a:g} N/m³"
        raise ParameterError("pressure_load", found, rule, "Keep the pressure model of the set")
    rest = equilibrium(ring, pressure_load=have)
    tension = float(rest.tension_stiffness_n_m3)
    # tension·a·(1 + e) + k_r·a·e = p_o, or p_o·(1 + e) for a follower load
    follows = pressure if want == "follower" else 0.0
    strain = (pressure - tension * a) / (tension * a + radial * a - follows)
    axial = tension * a**2 / (strain + 0.5 * strain**2)
    return replace(
        ring,
        radial_stiffness_n_m3=radial,
        circumferential_stiffness_n_m3=around,
        axial_stiffness_n_m=axial,
    )
