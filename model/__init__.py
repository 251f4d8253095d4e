"""The flexible ring on an elastic foundation: a model of a tyre's in-plane vibration."""

from model.damping import DampingResult, damping_ratios, identify_damping
from model.equilibrium import Equilibrium, equilibrium
from model.errors import InstabilityError, ParameterError
from model.harmonics import Harmonics, harmonics
from model.parameters import RingDamping, RingParameters, Wheel
from model.ring import (
    displacement_ratio,
    extensional_frequencies_hz,
    modal_mass_kg,
    natural_frequencies_hz,
    radial_shape,
    torsion_frequency_hz,
)
from model.roots import characteristic_roots
from model.sensitivity import Sensitivity, frequency_sensitivity
from model.tuning import tune_ring
from model.tuning_result import TuningResult

__all__ = [
    "DampingResult",
    "Equilibrium",
    "Harmonics",
    "InstabilityError",
    "ParameterError",
    "RingDamping",
    "RingParameters",
    "Sensitivity",
    "TuningResult",
    "Wheel",
    "characteristic_roots",
    "damping_ratios",
    "displacement_ratio",
    "equilibrium",
    "extensional_frequencies_hz",
    "frequency_sensitivity",
    "harmonics",
    "identify_damping",
    "modal_mass_kg",
    "natural_frequencies_hz",
    "radial_shape",
    "torsion_frequency_hz",
    "tune_ring",
]
