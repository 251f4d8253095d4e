"""A result as one JSON or MATLAB file, complete with units and standard deviations."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from ema.core.arrays import readonly
from ema.core.errors import escaped
from ema.core.frf import FRF
from ema.core.modes import Mode
from pipelines.results.provenance import software_version
from pipelines.results.result import Result
from pipelines.storage.plain_values import plain

UNITS = {
    "frequency_hz": "Hz",
    "damping_ratio": "1",
    "poles": "rad/s",
    "position_deg": "deg",
    "xyz_m": "m",
    "shapes": "1, largest part of each mode 1",
    "residues": "m/(N s)",
    "modal_a": "N s/m",
    "modal_mass_kg": "kg",
    "lower_residual": "(m/s^2)/N",
    "upper_residual": "m/N",
    "frf": "(m/s^2)/N",
    "coherence": "1",
}


def write_json(found: ModalExport, path: Path) -> None:
    """Write JSON: a complex array is an object of two arrays, ``real`` and ``imag``."""
    with path.open("w", encoding="utf-8", newline="\n") as file:
        text = json.dumps(_jsonable(content(found)), ensure_ascii=False, allow_nan=False)
        file.write(escaped(text) + "\n")


def write_mat(found: ModalExport, path: Path) -> None:
    """Write a MATLAB file (version 5); names as in JSON, FRFs with their kind in front.

    Groups become structures; texts become cells.
    """
    with path.open("wb") as file:  # savemat adds an ending to names
        savemat(file, _matlab(content(found)), do_compression=True)


def content(found: ModalExport) -> dict[str, Any]:
    """Everything by name; arrays as they are, modes as rows, positions as columns.

    Standard deviations stand beside their values, under the same name with ``_std``.
    """
    geometry, model = found.geometry, found.result.modal_model
    whole: dict[str, Any] = {
        "source": found.result.name,
        "software": f"ringmodal {software_version()}",
        "units": UNITS,
        "notes": [*geometry.notes, *found.result.notes],
        "nodes": {
            "node": geometry.node,
            "position_deg": geometry.position_deg,
            "xyz_m": geometry.xyz_m,
            "direction": geometry.direction,
            "n_measured": geometry.n_measured,
            "force_node": geometry.reference_node,
        },
        "modes": mode_columns(found),
        "covariance": model.covariance,
        "shapes": found.shapes,
        "residues": np.array([mode.residues for mode in found.modes]),
        "residues_std": np.array([mode.residues_std for mode in found.modes]),
        "lower_residual": model.residual_terms.lower,
        "upper_residual": model.residual_terms.upper,
        "band_hz": list(model.band_hz),
        "fit_band_hz": list(model.fit_band_hz),
    }
    for name, frf in (("measured", found.measured), ("synthesised", found.synthesised)):
        if frf is not None:
            whole[name] = _frf(frf)
    return whole


def mode_columns(found: ModalExport) -> dict[str, Any]:
    """The modes, column by column."""
    modes = found.modes
    missing = float("nan")
    return {
        "mode": np.arange(1, len(modes) + 1),
        "order": np.array([missing if m.order is None else float(m.order) for m in modes]),
        "member": [mode.member for mode in modes],
        "frequency_hz": np.array([mode.frequency_hz for mode in modes]),
        "frequency_hz_std": np.array([mode.frequency_std_hz for mode in modes]),
        "damping_ratio": np.array([mode.damping_ratio for mode in modes]),
        "damping_ratio_std": np.array([mode.damping_std for mode in modes]),
        "poles": np.array([mode.pole for mode in modes]),
        "modal_a": found.modal_a,
        "modal_mass_kg": found.modal_mass_kg,
        "mpc": np.array([mode.mpc for mode in modes]),
        "status": [mode.status for mode in modes],
        "pair": [mode.pair.value for mode in modes],
    }


def _frf(frf: FRF) -> dict[str, Any]:
    whole: dict[str, Any] = {"frequency_hz": frf.frequency_hz, "frf": frf.values}
    if np.isfinite(frf.std).any():
        whole["frf_std"] = frf.std
    if np.isfinite(frf.coherence).any():
        whole["coherence"] = frf.coherence
    return whole


def _jsonable(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _jsonable(entry) for name, entry in value.items()}
    if isinstance(value, np.ndarray):
        if np.iscomplexobj(value):
            return {"real": _numbers(value.real), "imag": _numbers(value.imag)}
        return _numbers(value)
    return plain(value)


def _numbers(array: NDArray[Any]) -> Any:
    """Nested lists; None where there is no number."""
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        return plain(array.tolist())
    return array.tolist()


def _matlab(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _matlab(entry) for name, entry in value.items()}
    if isinstance(value, list) and all(isinstance(entry, str) for entry in value):
        return np.array(value, dtype=object)
    return value


X, Y, Z = 1, 2, 3  # direction codes of universal files
_SAME_PLACE_DEG = 0.01
_UNIT_RADIUS_M = 1.0
_STEP_M = 0.1


@dataclass(frozen=True, eq=False)
class Geometry:
    """Where the nodes are, and which way each was measured.

    Parameters
    ----------
    node : ndarray of int, shape (n_nodes,)
        Node numbers from 1; the rows of the FRFs come first, in their order.
    position_deg : ndarray, shape (n_nodes,)
        Angles in the x-z plane, from x towards z; NaN where there is no circle.
    xyz_m : ndarray, shape (n_nodes, 3)
        Coordinates.
    direction : ndarray, shape (n_nodes, 3)
        Unit vector of the measured motion: radial and outward on a circle.
    direction_code : int
        What stands for this direction in the FRFs of a universal file.
    n_measured : int
        Nodes with a sensor; one more carries the force where that is elsewhere.
    reference_node : int
        Node of the force; 0 where unknown.
    is_closed : bool
        Whether the nodes form a circle.
    notes : tuple of str
        What was assumed.
    """

    node: NDArray[np.int_]
    position_deg: NDArray[np.float64]
    xyz_m: NDArray[np.float64]
    direction: NDArray[np.float64]
    direction_code: int
    n_measured: int
    reference_node: int
    is_closed: bool
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, dtype in (
            ("node", int),
            ("position_deg", float),
            ("xyz_m", float),
            ("direction", float),
        ):
            object.__setattr__(self, name, readonly(getattr(self, name), dtype))

    @property
    def path(self) -> list[int]:
        """Nodes in the order of a line through them, back at the first one on a circle."""
        if not self.is_closed:
            return list(self.node.tolist())
        around = self.node[np.argsort(self.position_deg, kind="stable")].tolist()
        return [*around, around[0]]


def node_numbers(frf: FRF) -> NDArray[np.int_]:
    """Node numbers as other programs take them: those of the FRFs, or 1, 2, 3 … by position.

    Grids count from 0, and some FRFs have no nodes; other programs need numbers from 1, each once.
    """
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
        notes.append("radius not given: drawn with 1 m")
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
        direction=np.column_stack([zeros, zeros, zeros + 1.0]),
        direction_code=Z,
        n_measured=node.size,
        reference_node=0,
        is_closed=False,
        notes=("no angles known: nodes on a line, 0.1 m apart; motion drawn along z",),
    )


@dataclass(frozen=True, eq=False)
class ModalExport:
    """What other programs get of a result.

    Parameters
    ----------
    result : Result
    geometry : Geometry
    shapes : ndarray, shape (n_modes, n_measured)
        Shapes with a largest part of 1, along the measured directions; complex, or real where
        real ones were asked for.
    modal_a : ndarray of complex, shape (n_modes,)
        Modal A of these shapes in N s/m: residue = shape × shape at the force / A; NaN where the
        force is at no sensor, at a node of the mode, or where its mass would be negative.
    measured, synthesised : FRF or None
        Inertances in (m/s²)/N under the nodes' exported numbers; None where not wanted.
    """

    result: Result
    geometry: Geometry
    shapes: NDArray[np.inexact]
    modal_a: NDArray[np.complex128]
    measured: FRF | None
    synthesised: FRF | None

    def __post_init__(self) -> None:
        object.__setattr__(self, "modal_a", readonly(self.modal_a, complex))

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
        """Modal mass A/(2j ω_d) of the shapes taken as real; NaN where unknown."""
        damped = np.array([mode.pole.imag for mode in self.modes])
        return np.asarray((self.modal_a / (2j * damped)).real)


FOLDER_MARKER = "export.json"  # names the files of an export that is a folder


MEASURED, BOTH, NONE = "measured", "both", "none"
