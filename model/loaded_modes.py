"""Modes around a loaded state, whose shapes mix the orders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model._arrays import readonly
from model.circle_fields import Array, CircleFields


@dataclass(frozen=True, eq=False)
class LoadedModes:
    """Modes of a loaded ring.

    Parameters
    ----------
    fields : CircleFields
        Basis of the shapes.
    frequency_hz : ndarray, shape (n_modes,)
        Natural frequencies seen from space, ascending, Hz.
    shapes : ndarray, shape (n_coefficients, n_modes)
        Shapes in the coefficients of the fields; complex where the ring turns.
    """

    fields: CircleFields
    frequency_hz: Array
    shapes: NDArray[np.inexact[Any]]

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency_hz", readonly(self.frequency_hz))
        object.__setattr__(self, "shapes", readonly(self.shapes, self.shapes.dtype))

    @property
    def share_of_order(self) -> Array:
        """Share of each order in the power of each shape, (highest_order + 1, n_modes)."""
        power = np.abs(self.shapes) ** 2
        orders = self.fields.orders
        shares = np.stack(
            [power[orders == order].sum(axis=0) for order in range(self.fields.highest_order + 1)]
        )
        return np.asarray(shares / shares.sum(axis=0))

    @property
    def dominant_order(self) -> NDArray[np.int_]:
        """Order with the largest share, per mode."""
        return np.asarray(self.share_of_order.argmax(axis=0))

    def radial(self, mode: int) -> NDArray[np.inexact[Any]]:
        """Radial shape of one mode at the points of the circle."""
        return np.asarray(self.fields.radial @ self.shapes[:, mode])
