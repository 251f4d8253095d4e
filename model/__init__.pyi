from .circle_fields import LoadedModes
from .cleat import Cleat, CleatTest
from .coefficients import (
    Equilibrium,
    Harmonics,
    characteristic_roots,
    eigenvector_ratios,
    equilibrium,
    harmonics,
)
from .damping import DampingResult, damping_ratios, identify_damping, torsion_damping_ratio
from .errors import InstabilityError, ParameterError
from .forced import ForcedRing, inertance, inextensional_inertance
from .foundation import Foundation, foundation_from_belt_modes
from .hub import HubResponse, free_hub_roots, hub_response
from .identifiability import Sensitivity, frequency_sensitivity
from .loaded import ContactPatch, LoadedRing, contact_patch, load_ring, loaded_frequencies_hz
from .parameters import RingDamping, RingParameters, Wheel
from .ring import (
    Bifurcation,
    WavePair,
    bifurcation,
    displacement_ratio,
    modal_mass_kg,
    natural_frequencies_hz,
    torsion_frequency_hz,
    wave_pair,
)
from .road import PressedRing, Tread, press_on_road
from .tuning import TuningResult, tune_ring

__all__ = [
    "Bifurcation",
    "Cleat",
    "CleatTest",
    "ContactPatch",
    "DampingResult",
    "Equilibrium",
    "ForcedRing",
    "Foundation",
    "Harmonics",
    "HubResponse",
    "InstabilityError",
    "LoadedModes",
    "LoadedRing",
    "ParameterError",
    "PressedRing",
    "RingDamping",
    "RingParameters",
    "Sensitivity",
    "Tread",
    "TuningResult",
    "WavePair",
    "Wheel",
    "bifurcation",
    "characteristic_roots",
    "contact_patch",
    "damping_ratios",
    "displacement_ratio",
    "eigenvector_ratios",
    "equilibrium",
    "foundation_from_belt_modes",
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
    "press_on_road",
    "torsion_damping_ratio",
    "torsion_frequency_hz",
    "tune_ring",
    "wave_pair",
]
