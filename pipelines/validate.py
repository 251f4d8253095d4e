"""Measured modes against the ring model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ema.circumference import order_content
from ema.mac import auto_mac, mac
from ema.modes import ModalModel, Mode
from model.damping import DampingResult
from model.tuning_result import TuningResult
from pipelines.result import Validation

# A shape with less of its power in one order is not one of the ring's.
PUREST_ENOUGH = 0.5


def ring_modes(model: ModalModel) -> tuple[Mode, ...]:
    """Choose the mode that stands for each circumferential order n ≥ 1 of the ring.

    Of several modes of one order the one that the force drives most, |A|ω, is the ring's own:
    it has the smallest modal mass.
    """
    chosen: dict[int, Mode] = {}
    for mode in model.modes:
        if not mode.order or mode.order_purity < PUREST_ENOUGH:
            continue
        rival = chosen.get(mode.order)
        if rival is None or _drive(mode) > _drive(rival):
            chosen[mode.order] = mode
    return tuple(chosen[order] for order in sorted(chosen))


def validate(
    model: ModalModel,
    modes: tuple[Mode, ...],
    tuning: TuningResult,
    damping: DampingResult | None,
) -> Validation:
    """Compare frequencies, damping and shapes of the measured modes with the tuned ring.

    Parameters
    ----------
    model : ModalModel
        All measured modes, for the AutoMAC.
    modes : tuple of Mode
        One per order, from `ring_modes`.
    tuning : TuningResult
    damping : DampingResult or None
    """
    measured = np.array([mode.residues for mode in modes])
    return Validation(
        order=np.array([mode.order for mode in modes]),
        measured_hz=np.array([mode.frequency_hz for mode in modes]),
        model_hz=tuning.model_hz,
        measured_damping=np.array([mode.damping_ratio for mode in modes]),
        model_damping=damping.model if damping else np.full(len(modes), np.nan),
        mac=mac(measured, np.array([aligned_shape(m, model.position_deg) for m in modes])),
        auto_mac=auto_mac(np.array([mode.residues for mode in model.modes])),
    )


def aligned_shape(mode: Mode, position_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shape of the ring's mode of the same order, turned in its (cos, sin) plane to the measured.

    A ring's order is a two-dimensional space; where in it a measured shape lies depends on the
    shaker, not on the ring.
    """
    content = order_content(mode.shape, position_deg)
    order = mode.order or 0
    cosine, sine = content.cosine[order].real, content.sine[order].real
    angle = np.deg2rad(position_deg) * order
    return np.asarray(cosine * np.cos(angle) + sine * np.sin(angle))


def _drive(mode: Mode) -> float:
    return float(np.sqrt(np.mean(np.abs(mode.residues) ** 2)) * abs(mode.pole))
