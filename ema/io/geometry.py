"""Angles of nodes that lie on a circle somewhere in space."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

_ROUND = 0.05  # radii may differ by this part of the radius
_SENSELESS = 1e100  # larger than any structure in any unit
PLANES = {0: (1, 2), 1: (0, 2), 2: (0, 1)}  # normal axis: the axes angles are counted between


def angles_on_circle(nodes: Mapping[int, NDArray[np.float64]]) -> dict[int, float]:
    """Angle of each node in the plane where the circle lies; empty where they lie on none.

    Parameters
    ----------
    nodes : mapping of int to ndarray, shape (3,)
        Coordinates of the nodes that carry sensors.

    Returns
    -------
    dict of int to float
        Degrees in 0…360, counter-clockwise from the plane's first axis (x, or y in the y-z plane)
        to its second, about the origin, or about the circle's own centre where it lies elsewhere.
    """
    if not nodes:
        return {}
    points = np.array(list(nodes.values()), dtype=np.float64)
    if not (np.abs(points) < _SENSELESS).all():  # NaN is not smaller than anything
        return {}
    first, second = PLANES[int(np.argmin(np.ptp(points, axis=0)))]
    if len(points) == 1 and not points[0, [first, second]].any():
        return {}
    plane = points[:, [first, second]]
    if not is_round(plane):
        if len(points) < 4:  # three points lie on a circle whatever they are
            return {}
        plane = plane - centre_of_circle(plane)
        if not is_round(plane):
            return {}
    angles = np.degrees(np.arctan2(plane[:, 1], plane[:, 0])) % 360.0
    return dict(zip(nodes, angles.tolist(), strict=True))


def is_round(plane: NDArray[np.float64]) -> bool:
    """Whether points (n, 2) lie about equally far from the origin."""
    radii = np.hypot(plane[:, 0], plane[:, 1])
    mean = float(radii.mean())
    return mean > 0.0 and float(np.ptp(radii)) <= _ROUND * mean


def centre_of_circle(plane: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre of the least-squares circle of points (n, 2).

    x² + y² = 2 x₀ x + 2 y₀ y + c (Kåsa 1976).
    """
    system = np.column_stack([2.0 * plane, np.ones(len(plane))])
    solution: NDArray[np.float64] = np.linalg.lstsq(system, (plane**2).sum(axis=1), rcond=None)[0]
    return solution[:2]
