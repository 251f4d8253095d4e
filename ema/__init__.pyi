from .curve_fit import fit_modes
from .errors import DataQualityWarning, FitError, InputError
from .frf import FRF, estimate_frf
from .identify import Identification, SensorMass, identify_modes
from .io.campaign import read_campaign
from .io.shapes import ShapeSet, read_shapes
from .modes import ModalModel, Mode
from .pole_selection import select_poles
from .recording import Campaign, Processing
from .stability import StabilityDiagram, build_stability

__all__ = [
    "FRF",
    "Campaign",
    "DataQualityWarning",
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
