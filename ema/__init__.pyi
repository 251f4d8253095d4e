from .checks.sensor_mass import SensorMass
from .core.campaign import Campaign, Processing
from .core.edits import ChannelName, Edit, EditKind, PoleName
from .core.errors import FitError, InputError, SupersededError
from .core.frf import FRF
from .core.modes import ModalModel, Mode
from .core.references import References
from .identify import Identification, fit_modes, identify_modes
from .io.campaign.read import read_campaign
from .io.uff.shape_sets import ShapeSet, read_shapes
from .poles.stability import StabilityDiagram, build_stability, select_poles
from .refit import EditCost, edit_cost, refit_modes
from .signals.frf_estimation import estimate_frf

__all__ = [
    "FRF",
    "Campaign",
    "ChannelName",
    "Edit",
    "EditCost",
    "EditKind",
    "FitError",
    "Identification",
    "InputError",
    "ModalModel",
    "Mode",
    "PoleName",
    "Processing",
    "References",
    "SensorMass",
    "ShapeSet",
    "StabilityDiagram",
    "SupersededError",
    "build_stability",
    "edit_cost",
    "estimate_frf",
    "fit_modes",
    "identify_modes",
    "read_campaign",
    "read_shapes",
    "refit_modes",
    "select_poles",
]
