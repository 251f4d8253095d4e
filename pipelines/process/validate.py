"""Measured modes against the ring model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import order_content
from ema.circumference.ring_modes import family
from ema.core.mac import auto_mac, mac
from ema.core.modes import ModalModel, Mode
from model.damping import DampingResult
from model.tuning import TuningResult
from pipelines.results.result import Validation


@dataclass(frozen=True, eq=False)
class RingOrder:
    """One circumferential order of the ring as measured: one mode, or both of a pair.

    The ring model knows no split: for it a pair has the mean of its two frequencies.
    """

    order: int
    modes: tuple[Mode, ...]

    @property
    def frequency_hz(self) -> float:
        """Mean frequency of the members."""
        return float(np.mean([mode.frequency_hz for mode in self.modes]))

    @property
    def frequency_std_hz(self) -> float:
        """Standard deviation of `frequency_hz`."""
        return _std_of_mean([mode.frequency_std_hz for mode in self.modes])

    @property
    def damping_ratio(self) -> float:
        """Mean damping ratio of the members."""
        return float(np.mean([mode.damping_ratio for mode in self.modes]))

    @property
    def damping_std(self) -> float:
        """Standard deviation of `damping_ratio`."""
        return _std_of_mean([mode.damping_std for mode in self.modes])


def ring_orders(model: ModalModel) -> tuple[RingOrder, ...]:
    """Modes of the ring's family by order, the stronger member of a pair first."""
    members = family(model.modes)
    return tuple(
        RingOrder(order, tuple(model.modes[k] for k in members[order])) for order in sorted(members)
    )


def validate(
    model: ModalModel,
    orders: tuple[RingOrder, ...],
    tuning: TuningResult,
    damping: DampingResult | None,
) -> Validation:
    """Compare frequencies, damping and shapes of the measured modes with the tuned ring.

    Parameters
    ----------
    model : ModalModel
        All measured modes, for the AutoMAC.
    orders : tuple of RingOrder
        From `ring_orders`.
    tuning : TuningResult
    damping : DampingResult or None
    """
    main = [order.modes[0] for order in orders]
    expected = [aligned_shape(mode, model.position_deg) for mode in main]
    return Validation(
        order=np.array([order.order for order in orders]),
        measured_hz=np.array([order.frequency_hz for order in orders]),
        model_hz=tuning.model_hz,
        measured_damping=np.array([order.damping_ratio for order in orders]),
        model_damping=damping.model if damping else np.full(len(orders), np.nan),
        mac=mac(np.array([mode.residues for mode in main]), np.array(expected)),
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


def _std_of_mean(stds: list[float]) -> float:
    return float(np.sqrt(np.sum(np.square(stds))) / len(stds))
