from .core.campaign import Campaign, Processing
from .core.errors import FitError, InputError
from .core.frf import FRF
from .core.modes import ModalModel, Mode
from .fitting.curve_fit import fit_modes
from .identify import Identification, SensorMass, identify_modes
from .io.campaign.read import read_campaign
from .io.uff.shape_sets import ShapeSet, read_shapes
from .poles.selection import select_poles
from .poles.stability import StabilityDiagram, build_stability
from .signals.frf_estimation import estimate_frf

__all__ = [
    "FRF",
    "Campaign",
    "FitError",
    "Identification",
    "InputError",
    "ModalModel",
    "Mode",
    "Processing",
    "SensorMass",
    "ShapeSet",
    "StabilityDiagram",
    "build_stability",
    "estimate_frf",
    "fit_modes",
    "identify_modes",
    "read_campaign",
    "read_shapes",
    "select_poles",
]
