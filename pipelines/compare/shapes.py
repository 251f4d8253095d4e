"""Shapes of two results where both can be compared: at common positions, or order by order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.circumference.orders import circle_basis, highest_order, on_circle
from ema.core.mac import mac
from ema.core.modes import ModalModel

#: Positions closer than this are the same.
SAME_PLACE_DEG = 0.5
#: Fewer common nodes say nothing about a shape.
FEWEST_NODES = 3

Shapes = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class CommonShapes:
    """Shapes of two results on a common ground.

    Parameters
    ----------
    first : ndarray of complex, shape (n_first, n_common)
    second : ndarray of complex, shape (n_second, n_common)
        One row per mode; no columns where nothing is common.
    how : str
        What was done, as a sentence.
    """

    first: Shapes
    second: Shapes
    how: str

    @property
    def mac(self) -> NDArray[np.float64]:
        """MAC of the first (rows) against the second; NaN where nothing is common."""
        if self.first.size == 0 or self.second.size == 0:
            return np.full((len(self.first), len(self.second)), np.nan)
        return mac(self.first, self.second)


def common_shapes(first: ModalModel, second: ModalModel) -> CommonShapes:
    """Bring the shapes of two results to a common ground.

    On a circle these are the positions that both have, if they can tell all orders found apart,
    and otherwise the amplitudes of the orders that both grids can tell. Without angles these are
    the nodes that both have.

    Parameters
    ----------
    first, second : ModalModel
    """
    if not (on_circle(first.position_deg) and on_circle(second.position_deg)):
        return _at_common_nodes(first, second)
    here, there = common_positions(first.position_deg, second.position_deg)
    orders = [mode.order for mode in first.modes + second.modes if mode.order is not None]
    if here.size and highest_order(first.position_deg[here]) >= max(orders, default=0):
        whole = here.size == first.position_deg.size == second.position_deg.size
        which = "all" if whole else "the"
        how = f"Shapes are compared at {which} {here.size} positions that both results have."
        return CommonShapes(_residues(first)[:, here], _residues(second)[:, there], how)
    return _order_by_order(first, second)


def common_positions(
    first_deg: NDArray[np.float64], second_deg: NDArray[np.float64]
) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """Rows of the positions that both have, within half a degree, those of the first ascending.

    Parameters
    ----------
    first_deg, second_deg : ndarray, shapes (n_first,), (n_second,)

    Returns
    -------
    first_rows, second_rows : ndarray of int, shape (n_common,)
        Each row at most once.
    """
    if not (first_deg.size and second_deg.size):
        return np.zeros(0, dtype=int), np.zeros(0, dtype=int)
    apart = np.abs((first_deg[:, None] - second_deg + 180) % 360 - 180)
    apart[~np.isfinite(apart)] = np.inf
    nearest = np.argmin(apart, axis=1)
    mutual = np.argmin(apart, axis=0)[nearest] == np.arange(first_deg.size)
    here = np.flatnonzero(mutual & (np.min(apart, axis=1) <= SAME_PLACE_DEG))
    return here, nearest[here]


def _at_common_nodes(first: ModalModel, second: ModalModel) -> CommonShapes:
    nodes, here, there = np.intersect1d(first.node, second.node, return_indices=True)
    if nodes.size < FEWEST_NODES:
        how = f"Shapes are not compared: the results have {nodes.size} nodes in common."
        return CommonShapes(_residues(first)[:, :0], _residues(second)[:, :0], how)
    how = f"Shapes are compared at the {nodes.size} nodes that both results have, by their numbers."
    return CommonShapes(_residues(first)[:, here], _residues(second)[:, there], how)


def _order_by_order(first: ModalModel, second: ModalModel) -> CommonShapes:
    highest = min(highest_order(model.position_deg) for model in (first, second))
    how = (
        "The grids differ: shapes are compared by their amplitudes of cos nθ and sin nθ, orders "
        f"0 to {highest}, that each grid resolves by itself."
    )
    return CommonShapes(_amplitudes(first, highest), _amplitudes(second, highest), how)


def _amplitudes(model: ModalModel, highest: int) -> Shapes:
    """Order amplitudes of all modes, scaled so that their MAC is that on the whole circle."""
    resolved = highest_order(model.position_deg)
    waves = np.linalg.pinv(circle_basis(model.position_deg, resolved))[: 2 * highest + 1]
    rms = np.full(len(waves), np.sqrt(0.5))
    rms[0] = 1.0
    return np.asarray(_residues(model) @ (waves * rms[:, None]).T)


def _residues(model: ModalModel) -> Shapes:
    rows = [mode.residues for mode in model.modes]
    return np.array(rows, dtype=complex).reshape(len(rows), model.node.size)
