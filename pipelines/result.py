"""Everything one campaign gave, in memory: what the result folder and the report hold."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.frf import FRF
from ema.modes import ModalModel
from ema.quality import Finding, ReferenceCheck
from ema.recording import Tyre
from ema.second_opinion import Opinion
from ema.stability import StabilityDiagram
from model.damping import DampingResult
from model.tuning_result import TuningResult
from pipelines import show_html


@dataclass(frozen=True, eq=False)
class Validation:
    """Measured modes against the ring model.

    Parameters
    ----------
    order : ndarray of int, shape (n_orders,)
    measured_hz, model_hz : ndarray, shape (n_orders,)
    measured_damping, model_damping : ndarray, shape (n_orders,)
    mac : ndarray, shape (n_orders, n_orders)
        Measured (rows) against model shapes, aligned in each order's (cos, sin) plane.
    auto_mac : ndarray, shape (n_modes, n_modes)
        The measured shapes among themselves.
    """

    order: NDArray[np.int_]
    measured_hz: NDArray[np.float64]
    model_hz: NDArray[np.float64]
    measured_damping: NDArray[np.float64]
    model_damping: NDArray[np.float64]
    mac: NDArray[np.float64]
    auto_mac: NDArray[np.float64]

    @property
    def error_percent(self) -> NDArray[np.float64]:
        """Deviation of the model's frequencies from the measured ones."""
        return 100 * (self.model_hz / self.measured_hz - 1)


@dataclass(frozen=True, eq=False)
class Result:
    """Result of `pipelines.process`; stages that did not apply are None.

    Parameters
    ----------
    name : str
        Campaign name.
    tyre : Tyre or None
        Identity; None for a structure that is no tyre.
    frf : FRF
    diagram : StabilityDiagram
    modal_model : ModalModel
    reference : ReferenceCheck or None
        None without a reference sensor.
    tuning, damping, validation : or None
        None where the ring steps were left out; `notes` says why.
    excitation_deg, reference_deg : float or None
        Angles of the force and of the reference sensor.
    opinions : tuple of Opinion
        What another pole estimator says about the modes.
    findings : tuple of Finding
        Lines of ``quality.csv``.
    notes : tuple of str
        What a reader of the report must know.
    provenance : dict
        Content of ``provenance.json``: versions, inputs with SHA-256, options, stage times.
    """

    name: str
    tyre: Tyre | None
    frf: FRF
    diagram: StabilityDiagram
    modal_model: ModalModel
    reference: ReferenceCheck | None
    tuning: TuningResult | None
    damping: DampingResult | None
    validation: Validation | None
    excitation_deg: float | None
    reference_deg: float | None
    opinions: tuple[Opinion, ...] = ()
    findings: tuple[Finding, ...] = ()
    notes: tuple[str, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        return show_html.result_line(self)

    def _repr_html_(self) -> str:
        return show_html.result_html(self)
