"""Measurement: recordings become FRFs, FRFs become poles and modes with error bars."""

from ema.curve_fit import fit_modes
from ema.errors import DataQualityWarning, FitError, InputError
from ema.frf import FRF, estimate_frf
from ema.identify import Identification, SensorMass, identify_modes
from ema.io.campaign import read_campaign
from ema.io.shapes import ShapeSet, read_shapes
from ema.modes import ModalModel, Mode
from ema.recording import Campaign, Processing
from ema.stability import StabilityDiagram, build_stability, select_poles

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
