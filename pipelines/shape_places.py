"""Places at which two sets of shapes are both known, by angle or by node number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema._arrays import readonly
from ema.errors import InputError
from pipelines.shape_source import ShapeSource

ANGLE, NODE = "angle", "node"
WAYS = (ANGLE, NODE)

_MOST_NAMED = 6


@dataclass(frozen=True, eq=False)
class Places:
    """Rows of two sets of shapes that are of the same places.

    Parameters
    ----------
    by : str
        ``"angle"`` or ``"node"``.
    row, other_row : ndarray of int, shape (n_places,)
    says : str
        How they were found, in words.
    notes : tuple of str
        The same, and what is missing.
    """

    by: str
    row: NDArray[np.int_]
    other_row: NDArray[np.int_]
    says: str
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in ("row", "other_row"):
            object.__setattr__(self, name, readonly(getattr(self, name), int))


def common_places(
    result: ShapeSource,
    other: ShapeSource,
    *,
    by: str = "",
    tolerance_deg: float = 2.0,
    rotate_deg: float = 0.0,
    mirror: bool = False,
) -> Places:
    """Find the place of the other shapes for each place of the result, each used once.

    By angle the nearest node within the tolerance counts; of several around the wheel's section
    the one that is nearest to the circle of the result, in the middle of its width.

    Raises
    ------
    InputError
        If the chosen way needs angles or nodes that one of them lacks.
    """
    way = by or (ANGLE if result.has_angles and other.has_angles else NODE)
    for each in (result, other):
        if not (each.has_angles if way == ANGLE else each.has_nodes):
            what = "angles" if way == ANGLE else "node numbers"
            rule = f"places are matched by {way} here"
            remedy = f"Choose --by {NODE if way == ANGLE else ANGLE}"
            raise InputError(each.name, f"no {what}", rule, remedy)
    usable: NDArray[np.bool_] = np.asarray(np.isfinite(other.values).all(axis=0))
    if way == NODE:
        return _by_node(result, other, usable)
    turned = (-other.angle_deg if mirror else other.angle_deg) + rotate_deg
    return _by_angle(result, other, usable, turned, tolerance_deg)


def _by_node(result: ShapeSource, other: ShapeSource, usable: NDArray[np.bool_]) -> Places:
    row_of = {node: row for row, node in enumerate(other.node.tolist()) if node > 0 and usable[row]}
    pairs = [(row, row_of[node]) for row, node in enumerate(result.node.tolist()) if node in row_of]
    missing = [f"{node}" for node in result.node.tolist() if node not in row_of]
    return _places(NODE, result, pairs, missing, "matched by node number", "node")


def _by_angle(
    result: ShapeSource,
    other: ShapeSource,
    usable: NDArray[np.bool_],
    turned_deg: NDArray[np.float64],
    tolerance_deg: float,
) -> Places:
    radius_m = _radius(result, other)
    aside_m = np.hypot(other.radius_m - radius_m, other.across_m)
    aside_m = np.where(np.isfinite(aside_m), aside_m, 0.0)
    arc_m_per_deg = np.deg2rad(radius_m) if np.isfinite(radius_m) else 1.0
    away = np.abs((turned_deg - result.angle_deg[:, None] + 180.0) % 360.0 - 180.0)
    away[:, ~usable | ~np.isfinite(turned_deg)] = np.inf
    own = np.argmin(away, axis=0)  # a node serves the measured position that is nearest to it
    pairs: list[tuple[int, int]] = []
    for row in range(result.angle_deg.size):
        near = np.flatnonzero((own == row) & (away[row] <= tolerance_deg))
        if near.size:
            distance = np.hypot(away[row, near] * arc_m_per_deg, aside_m[near])
            pairs.append((row, int(near[np.argmin(distance)])))
    offsets = [float(away[pair]) for pair in pairs]
    found = {row for row, _ in pairs}
    missing = [f"{each:g}°" for row, each in enumerate(result.angle_deg) if row not in found]
    says = f"matched by angle within {tolerance_deg:g}°"
    if offsets:
        says += f", at most {round(max(offsets), 3):g}° apart"
        sections = aside_m[[row for _, row in pairs]]
        if sections.max() > 1e-6:
            says += f" and {1e3 * sections.max():.3g} mm off the measured circle"
    return _places(ANGLE, result, pairs, missing, says, "position")


def _radius(result: ShapeSource, other: ShapeSource) -> float:
    """Radius of the measured circle; the other's largest one where it is not known."""
    for known in (result.radius_m, other.radius_m):
        if np.isfinite(known).any():
            return float(np.nanmax(known))
    return float("nan")


def _places(
    by: str,
    result: ShapeSource,
    pairs: list[tuple[int, int]],
    missing: list[str],
    says: str,
    what: str,
) -> Places:
    notes = [f"{len(pairs)} of {result.node.size} places of {result.name} {says}"]
    if missing:
        more = f" and {len(missing) - _MOST_NAMED} more" if len(missing) > _MOST_NAMED else ""
        names = ", ".join(missing[:_MOST_NAMED])
        plural = "s" if len(missing) > 1 else ""
        notes.append(
            f"places of {result.name} left out, without a counterpart: {what}{plural} {names}{more}"
        )
    rows = np.array(pairs, dtype=int).reshape(-1, 2)
    return Places(by, rows[:, 0], rows[:, 1], says, tuple(notes))
