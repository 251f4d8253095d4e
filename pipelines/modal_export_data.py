"""A result as one JSON or MATLAB file, complete with units and standard deviations."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.frf import FRF
from ema.visible import escaped
from pipelines.console import plain
from pipelines.modal_export import ModalExport
from pipelines.versions import software_version

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
    from scipy.io import savemat

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
