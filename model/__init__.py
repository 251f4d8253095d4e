"""The flexible ring on an elastic foundation: a model of a tyre's in-plane vibration."""

from model.cleat import Cleat, CleatTest
from model.coefficients import Harmonics, harmonics
from model.contact import ContactPatch, contact_patch
from model.damping import DampingResult, damping_ratios, identify_damping
from model.errors import InstabilityError, ParameterError
from model.forced import inertance, inextensional_inertance
from model.hub import HubResponse, free_hub_roots, hub_response
from model.loaded import LoadedRing, load_ring, loaded_frequencies_hz
from model.loaded_modes import LoadedModes
from model.parameters import RingDamping, RingParameters, Wheel
from model.ring import (
    displacement_ratio,
    extensional_frequencies_hz,
    modal_mass_kg,
    natural_frequencies_hz,
    radial_shape,
    torsion_frequency_hz,
)
from model.roots import characteristic_roots, eigenvector_ratios
from model.rotation import Bifurcation, bifurcation, critical_speeds_rad_s
from model.sensitivity import Sensitivity, frequency_sensitivity
from model.steady_state import Equilibrium, equilibrium
from model.transfer import ForcedRing
from model.tuning import tune_ring
from model.tuning_result import TuningResult
from model.waves import WavePair, wave_pair

__all__ = [
    "Bifurcation",
    "Cleat",
    "CleatTest",
    "ContactPatch",
    "DampingResult",
    "Equilibrium",
    "ForcedRing",
    "Harmonics",
    "HubResponse",
    "InstabilityError",
    "LoadedModes",
    "LoadedRing",
    "ParameterError",
    "RingDamping",
    "RingParameters",
    "Sensitivity",
    "TuningResult",
    "WavePair",
    "Wheel",
    "bifurcation",
    "characteristic_roots",
    "contact_patch",
    "critical_speeds_rad_s",
    "damping_ratios",
    "displacement_ratio",
    "eigenvector_ratios",
    "equilibrium",
    "extensional_frequencies_hz",
    "free_hub_roots",
    "frequency_sensitivity",
    "harmonics",
    "hub_response",
    "identify_damping",
    "inertance",
    "inextensional_inertance",
    "load_ring",
    "loaded_frequencies_hz",
    "modal_mass_kg",
    "natural_frequencies_hz",
    "radial_shape",
    "torsion_frequency_hz",
    "tune_ring",
    "wave_pair",
]
