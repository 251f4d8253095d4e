"""Modal results for other programs, in memory: geometry, shapes, scaling, FRFs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ema.core.frf import FRF
from ema.core.modes import Mode
from model.arguments import ReadonlyArrays
from pipelines.results.parameter_set import ParameterSet
from pipelines.results.result import Result

MEASURED, BOTH, NONE = "measured", "both", "none"
X, Y, Z = 1, 2, 3  # direction codes of universal files
_SAME_PLACE_DEG = 0.01  # the force is at a sensor within this angle
_UNIT_RADIUS_M = 1.0  # where the radius is unknown
_STEP_M = 0.1  # between nodes on a line


@dataclass(frozen=True, eq=False)
class Geometry(ReadonlyArrays):
    """Positions and directions of the nodes."""

    # shape (n_nodes,); node numbers from 1; the rows of the FRFs come first, in their order
    node: NDArray[np.int_]
    # shape (n_nodes,); angles in the x-z plane, from x towards z; NaN without a circle
    position_deg: NDArray[np.float64]
    xyz_m: NDArray[np.float64]  # shape (n_nodes, 3)
    # shape (n_nodes, 3); unit vector of the measured motion: radial and outward on a circle, else
    # the axis in the file
    direction: NDArray[np.float64]
    direction_code: int  # of this direction in a universal file: on a circle 1, the radius
    n_measured: int  # nodes with a sensor; the force has a further node where it acts elsewhere
    reference_node: int  # node of the force; 0 where unknown
    is_closed: bool  # whether the nodes form a circle
    notes: tuple[str, ...] = ()  # assumptions

    @property
    def path(self) -> list[int]:
        """Nodes in the order of a line through them; closed on a circle."""
        if not self.is_closed:
            return list(self.node.tolist())
        around = self.node[np.argsort(self.position_deg, kind="stable")].tolist()
        return [*around, around[0]]


def node_numbers(frf: FRF) -> NDArray[np.int_]:
    """Unique node numbers from 1, for other programs: those of the FRFs where they are so."""
    own = frf.node
    if own.min() > 0 and np.unique(own).size == own.size:
        return np.array(own)
    return np.arange(1, own.size + 1)


def geometry_of(result: Result) -> Geometry:
    """Nodes on the circle of the mean radius, or on a line where there are no angles."""
    if np.isfinite(result.frf.position_deg).all():
        return _circle(result)
    return _line(result.frf)


def _circle(result: Result) -> Geometry:
    node, angles = node_numbers(result.frf), np.array(result.frf.position_deg)
    n_measured, reference = node.size, 0
    notes = ["x-z plane, angles from x towards z; 0 deg is the zero of the grid"]
    force_deg = result.excitation_deg
    if force_deg is not None:
        away = np.abs((angles - force_deg + 180.0) % 360.0 - 180.0)
        if away.min() < _SAME_PLACE_DEG:
            reference = int(node[np.argmin(away)])
        else:
            reference = int(node.max()) + 1
            node, angles = np.append(node, reference), np.append(angles, force_deg)
    radius_m = None if result.tyre is None else result.tyre.mean_radius_m
    if radius_m is None:
        radius_m = _UNIT_RADIUS_M
        notes.append(f"radius not given: drawn with {_UNIT_RADIUS_M:g} m")
    turn = np.deg2rad(angles)
    direction = np.column_stack([np.cos(turn), np.zeros(turn.size), np.sin(turn)])
    return Geometry(
        node=node,
        position_deg=angles,
        xyz_m=radius_m * direction,
        direction=direction,
        direction_code=X,
        n_measured=n_measured,
        reference_node=reference,
        is_closed=True,
        notes=tuple(notes),
    )


def _line(frf: FRF) -> Geometry:
    node = node_numbers(frf)
    along = _STEP_M * np.arange(node.size)
    zeros = np.zeros(node.size)
    return Geometry(
        node=node,
        position_deg=np.full(node.size, np.nan),
        xyz_m=np.column_stack([along, zeros, zeros]),
        direction=np.eye(3)[np.where(frf.axis > 0, frf.axis, Z) - 1],
        direction_code=Z,
        n_measured=node.size,
        reference_node=0,
        is_closed=False,
        notes=("no angles known: nodes on a line, 0.1 m apart; motion without an axis along z",),
    )


@dataclass(frozen=True, eq=False)
class ModalExport(ReadonlyArrays):
    """A result as exported to other programs."""

    result: Result
    geometry: Geometry
    # shape (n_modes, n_measured); along the measured directions, largest part 1; complex or real
    shapes: NDArray[np.inexact]
    # shape (n_modes,); modal A of these shapes in N s/m: residue = shape × shape at the force / A;
    # NaN where the force is not at a sensor or at a node of the mode, or the modal mass would be
    # negative
    modal_a: NDArray[np.complex128]
    # inertances (accelerances) in (m/s²)/N under the exported node numbers
    measured: FRF | None
    synthesised: FRF | None
    ring: ParameterSet | None = None  # as in ``tyre.toml``
    # whether CSV has semicolons and decimal commas, as Excel expects it in many countries
    decimal_comma: bool = False
    # whether a universal file has the FRFs as text (58) instead of binary (58b)
    frfs_as_text: bool = False
    # whether a universal file has shapes and FRFs along the axes of a cylindrical system; else
    # shapes are in x, y, z
    is_cylindrical: bool = False

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The modes of the result."""
        return self.result.modal_model.modes

    @property
    def is_real(self) -> bool:
        """Whether the shapes are real."""
        return not np.iscomplexobj(self.shapes)

    @property
    def modal_mass_kg(self) -> NDArray[np.float64]:
        """Modal mass A/(2j ω_d) of the shapes as real shapes; NaN where unknown."""
        damped = np.array([mode.pole.imag for mode in self.modes])
        return np.asarray((self.modal_a / (2j * damped)).real)
