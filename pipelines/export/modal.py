"""Export of a result's modes to other programs: universal file, Excel, tables, JSON, MATLAB."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.core.display import jsonable
from ema.core.errors import InputError, escaped, unknown
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.fitting.variable_projection import project, stacked
from ema.io.uff import write as uff
from ema.io.uff.reader import SYNTHESISED
from pipelines.export.data import (
    BOTH,
    MEASURED,
    NONE,
    Geometry,
    ModalExport,
    geometry_of,
    of_force,
    write_workbook,
)
from pipelines.results.parameter_set import read_parameter_set
from pipelines.results.provenance import accepted_notes, software_version
from pipelines.results.result import Result
from pipelines.results.store import load
from pipelines.results.tables import axis_letters, in_band, references
from pipelines.storage.atomic import file_written_whole, require_free_file, written_whole
from pipelines.storage.checksums import write_marker
from pipelines.storage.tables import write_csv

FRF_CHOICES = (BOTH, MEASURED, SYNTHESISED, NONE)
FOLDER_MARKER = "export.json"  # lists the files of an export that is a folder
UNITS = {
    **{"frequency_hz": "Hz", "damping_ratio": "1", "poles": "rad/s", "position_deg": "deg"},
    **{"xyz_m": "m", "shapes": "1, largest part of each mode 1", "residues": "m/(N s)"},
    **{"modal_a": "N s/m", "modal_mass_kg": "kg", "modal_mass_kg_std": "kg"},
    **{"lower_residual": "(m/s^2)/N", "upper_residual": "m/N"},
    **{"frf": "(m/s^2)/N", "coherence": "1"},
}
_LEAST_DRIVE = 3.0  # smallest residue at the force for modal A, in standard deviations
FOLDERS = ("csv",)  # formats that write a folder


@dataclass(frozen=True)
class Written:
    """An export and its place."""

    path: Path
    file_format: str
    export: ModalExport


def export(
    folder: Path | str,
    out: Path | str | None = None,
    file_format: str = "",
    *,
    real: bool = False,
    frfs: str = BOTH,
    text: bool = False,
    decimal_comma: bool = False,
    cylindrical: bool = False,
    force: bool = False,
    accept_changes: bool = False,
) -> Written:
    """Write a result folder's modes for other programs, atomically.

    Parameters
    ----------
    folder : path
        A result folder.
    out : path, optional
        File, or folder for ``"csv"``; default: named after the result, in the current folder.
    file_format : {"uff", "xlsx", "csv", "json", "mat"}, optional
        Default: the ending of `out`, or ``"uff"``.
    real, frfs, text
        As for `gather`.
    decimal_comma : bool
        CSV with semicolons and decimal commas, for Excel in countries that use these.
    cylindrical : bool
        Universal file whose shapes and FRFs are along radius, circle and axle, which a cylindrical
        displacement system states; by default shapes are in x, y, z.
    force : bool
        Replace an earlier export.
    accept_changes : bool
        Accept a result of which parts were changed; the notes name them.

    Raises
    ------
    InputError
        If the folder is not a result, or was changed and that is not accepted, a choice is
        unknown, or the place is taken.
    """
    if frfs not in FRF_CHOICES:
        raise unknown("--frfs", frfs, f"it must be one of {', '.join(FRF_CHOICES)}", FRF_CHOICES)
    chosen = _format_of(out, file_format)
    folder = Path(folder)
    loaded = load(folder, accept_changes=accept_changes)
    if decimal_comma and chosen != "csv":
        rule = "only CSV has decimal commas; in a workbook numbers are shown as your Excel does"
        raise InputError("--decimal-comma", f"format {chosen}", rule, "Use --format csv")
    tyre = folder / "tyre.toml"
    found = replace(
        gather(loaded, real=real, frfs=frfs, text=text),
        decimal_comma=decimal_comma,
        is_cylindrical=cylindrical,
        ring=read_parameter_set(tyre) if tyre.is_file() else None,
    )
    name = folder.resolve().name
    target = Path(out) if out else Path(f"{name}_csv" if chosen == "csv" else f"{name}.{chosen}")
    if chosen in FOLDERS:
        writing = written_whole(target, force=force, marker=FOLDER_MARKER)
    else:
        require_free_file(target, force=force)
        writing = file_written_whole(target)
    with writing as place:
        FORMATS[chosen](found, place)
    return Written(target, chosen, found)


def _format_of(out: Path | str | None, file_format: str) -> str:
    ending = Path(out).suffix.lower().lstrip(".") if out else "uff"
    wanted = file_format.casefold() or {"unv": "uff", "": "csv"}.get(ending, ending)
    if wanted not in FORMATS:
        where = "--format" if file_format else str(out)
        rule = f"it must be one of {', '.join(FORMATS)}"
        raise unknown(where, file_format or wanted, rule, FORMATS)
    return wanted


def gather(
    result: Result, *, real: bool = False, frfs: str = BOTH, text: bool = False
) -> ModalExport:
    """Collect modes, geometry and FRFs of a result.

    Synthesised FRFs cover the fitted band; with both, the measured ones are cut to it, as many
    programs need the same frequencies in all FRFs of a file.
    """
    geometry, model = geometry_of(result), result.modal_model
    notes = accepted_notes(result.provenance, result.name)
    if result.corrections or result.sensor_mass is not None:
        notes = (*notes, "measured FRFs as fitted: corrected, masses compensated (see the result)")
    geometry = replace(geometry, notes=(*geometry.notes, *notes))
    shapes = np.array([mode.shape for mode in model.modes]).reshape(-1, geometry.row_node.size)
    every = geometry.frfs
    synthesised: tuple[FRF, ...] = ()
    if frfs in (BOTH, SYNTHESISED):
        fitted = in_band(result.frf.frequency_hz, model.fit_band_hz)
        every = tuple(_at_lines(frf, fitted) for frf in every)
        synthesised = tuple(_synthesised(model, every))
    measured = every if frfs in (BOTH, MEASURED) else ()
    return ModalExport(
        result=result,
        geometry=geometry,
        shapes=shapes.real if real else shapes.astype(complex),
        modal_a=np.array([_modal_a(mode, geometry) for mode in model.modes], dtype=complex),
        measured=measured[0] if measured else None,
        synthesised=synthesised[0] if synthesised else None,
        further_measured=measured[1:],
        further_synthesised=synthesised[1:],
        frfs_as_text=text,
    )


def _at_lines(frf: FRF, lines: NDArray[np.bool_]) -> FRF:
    parts = {name: getattr(frf, name)[:, lines] for name in ("values", "coherence", "std")}
    return replace(frf, frequency_hz=frf.frequency_hz[lines], **parts)


def _synthesised(model: ModalModel, every: Sequence[FRF]) -> Iterator[FRF]:
    """Inertances of the model, force by force.

    It has residues and residual terms of the first force only; those of further ones are fitted to
    their FRFs with the same poles.
    """
    poles = model.poles_and_residues(as_measured=True)[0]
    for number, frf in enumerate(every):
        if number == 0:
            values = model.synthesise(frf.frequency_hz, frf.run)
        else:
            alike = np.ones(frf.frequency_hz.size)
            given = stacked(frf.values, alike)
            left = project(2 * np.pi * frf.frequency_hz, given, alike, poles).misfit
            real, imag = np.split((given - left).T, 2, axis=1)
            values = real + 1j * imag
        blank = np.full(values.shape, np.nan)
        yield replace(frf, values=values, coherence=blank, std=blank)


def _modal_a(mode: Mode, geometry: Geometry) -> complex:
    if np.isfinite(mode.modal_mass_kg):  # from the driving points of several forces
        return 2j * mode.pole.imag * mode.modal_mass_kg
    unknown_a = complex(np.nan, np.nan)
    if (row := geometry.driving_row) is None:
        return unknown_a
    at_force = complex(mode.residues[row])
    noise = float(mode.residues_std[row])
    if not abs(at_force) > _LEAST_DRIVE * (noise if np.isfinite(noise) else 0.0):
        return unknown_a
    modal_a = complex(mode.shape[row]) ** 2 / at_force
    is_mass = (modal_a / (2j * mode.pole.imag)).real > 0  # else the force acts elsewhere
    return modal_a if is_mass else unknown_a


def write_json(found: ModalExport, path: Path) -> None:
    """Write JSON; complex arrays are objects of two arrays, ``real`` and ``imag``."""
    text = json.dumps(_jsonable(content(found)), ensure_ascii=False, allow_nan=False)
    path.write_text(escaped(text) + "\n", encoding="utf-8", newline="\n")


def write_mat(found: ModalExport, path: Path) -> None:
    """Write a MATLAB file (version 5) with the names of JSON; groups are structs, texts cells."""
    with path.open("wb") as file:  # savemat adds an ending to names
        scipy.io.savemat(file, _matlab(content(found)), do_compression=True)


def content(found: ModalExport) -> dict[str, Any]:
    """Everything by name; modes as rows, positions as columns, standard deviations as ``…_std``."""
    geometry, model = found.geometry, found.result.modal_model
    everything: dict[str, Any] = {
        "source": found.result.name,
        "software": f"ringmodal {software_version()}",
        "units": UNITS,
        "notes": [*geometry.notes, *found.result.notes],
        "nodes": _places(geometry) | geometry.force,
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
    if found.result.references:
        everything["references"] = found.references
    for kind, number, frf in found.frfs:
        part: dict[str, Any] = {"frequency_hz": frf.frequency_hz, "frf": frf.values}
        everything[of_force(kind, number)] = part
        if number > 1:
            part |= {"node": frf.node, "axis": frf.axis}
        if np.isfinite(frf.std).any():
            part["frf_std"] = frf.std
        if np.isfinite(frf.coherence).any():
            part["coherence"] = frf.coherence
    return everything


def _places(geometry: Geometry) -> dict[str, Any]:
    """Node and direction of each row of FRFs, then the nodes that have none."""
    rows, nodes = geometry.row_node.tolist(), geometry.node.tolist()
    at = [nodes.index(each) for each in (*rows, *(each for each in nodes if each not in rows))]
    direction = np.zeros((len(at), 3))
    direction[: len(rows)] = geometry.direction
    found = {name: getattr(geometry, name)[at] for name in ("node", "position_deg", "xyz_m")}
    return found | {"direction": direction, "n_measured": len(rows)}


def mode_columns(found: ModalExport) -> dict[str, Any]:
    """The modes, column by column."""
    modes = found.modes

    def column(name: str) -> NDArray[Any]:
        return np.array([getattr(mode, name) for mode in modes])

    return {
        "mode": np.arange(1, len(modes) + 1),
        "order": np.array([np.nan if m.order is None else float(m.order) for m in modes]),
        "member": [mode.member for mode in modes],
        "frequency_hz": column("frequency_hz"),
        "frequency_hz_std": column("frequency_std_hz"),
        "damping_ratio": column("damping_ratio"),
        "damping_ratio_std": column("damping_std"),
        "poles": column("pole"),
        "modal_a": found.modal_a,
        "modal_mass_kg": found.modal_mass_kg,
        "modal_mass_kg_std": column("modal_mass_std_kg"),
        "mpc": column("mpc"),
        "status": [mode.status for mode in modes],
        "pair": [mode.pair.value for mode in modes],
    }


def _jsonable(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _jsonable(entry) for name, entry in value.items()}
    if isinstance(value, np.ndarray):
        if np.iscomplexobj(value):
            return {"real": _jsonable(value.real), "imag": _jsonable(value.imag)}
        if value.dtype.kind != "f" or np.isfinite(value).all():
            return value.tolist()  # faster than number by number
        value = value.tolist()
    return jsonable(value)


def _matlab(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _matlab(entry) for name, entry in value.items()}
    if isinstance(value, list) and all(isinstance(entry, str) for entry in value):
        return np.array(value, dtype=object)
    return value


def write_tables(found: ModalExport, folder: Path) -> None:
    """Write ``nodes.csv``, ``modes.csv``, ``shapes.csv``, FRFs, and ``export.json`` with the rest.

    FRFs have one line per frequency and two columns per row.
    """
    geometry = found.geometry
    write = partial(write_csv, decimal_comma=found.decimal_comma)
    points = dict(zip(("x_m", "y_m", "z_m"), geometry.xyz_m.T, strict=True))
    nodes = {"node": geometry.node, "position_deg": geometry.position_deg, **points}
    write(folder / "nodes.csv", nodes)
    write(folder / "modes.csv", _modes(found))
    write(folder / "shapes.csv", _shapes(found))
    for kind, number, frf in found.frfs:
        parts = np.ascontiguousarray(frf.values.T).view(np.float64)
        rows = list(zip(frf.node.tolist(), axis_letters(frf.axis), strict=True))
        names = [f"{part}_node_{n}_{a}".rstrip("_") for n, a in rows for part in ("real", "imag")]
        cells = dict(zip(names, parts.T, strict=True))
        table = {"frequency_hz": frf.frequency_hz, **cells}
        write(folder / f"frf_{of_force(kind, number)}.csv", table)
    about: dict[str, Any] = {"source": found.result.name, "notes": list(geometry.notes)}
    about |= geometry.force | {"units": UNITS}
    if found.result.references:
        write(folder / "references.csv", references(found.result))
        about["force_nodes"] = geometry.reference_nodes
    write_marker(folder / FOLDER_MARKER, about)


def write_xlsx(found: ModalExport, path: Path) -> None:
    """Write an Excel workbook: the tables of a result, and the FRFs."""
    frfs = {of_force(kind, number).replace("_", " "): frf for kind, number, frf in found.frfs}
    write_workbook(path, found.result, found.ring, frfs)


def _modes(found: ModalExport) -> dict[str, Any]:
    """The modes; complex columns as two."""
    columns: dict[str, Any] = {}
    for name, values in mode_columns(found).items():
        if np.iscomplexobj(values):
            columns |= {f"{name}_real": values.real, f"{name}_imag": values.imag}
        else:
            columns[name] = values
    return columns | {"order": [mode.order for mode in found.modes]}


def _shapes(found: ModalExport) -> dict[str, Any]:
    geometry, n_modes = found.geometry, len(found.modes)
    frf, shapes = geometry.frfs[0], np.concatenate(found.shapes).astype(complex)
    repeat = np.repeat(np.arange(n_modes), frf.n_positions)
    return {
        "mode": repeat + 1,
        "frequency_hz": np.array([mode.frequency_hz for mode in found.modes])[repeat],
        "node": np.tile(frf.node, n_modes),
        "position_deg": np.tile(frf.position_deg, n_modes),
        "direction": geometry.directions(frf) * n_modes,
        "real": shapes.real,
        "imag": shapes.imag,
    }


def write_uff(found: ModalExport, path: Path) -> None:
    """Write datasets 151, 164, 2420, 2411, 82, 55 and 58b or 58.

    Shapes are in Cartesian components: the motion along the measured direction as x, y, z. With
    `is_cylindrical`, shapes and FRFs on a circle are along a cylindrical system's axes: radial is
    the first.
    """
    geometry = found.geometry
    wheel = geometry.is_closed and found.is_cylindrical
    program = f"ringmodal {software_version()}"
    notes = "; ".join(geometry.notes)
    with path.open("wb") as file:
        file.write(uff.header_151(found.result.name, notes, program, datetime.now().astimezone()))
        file.write(uff.units_164() + uff.coordinate_systems_2420(is_wheel=wheel))
        moving = uff.CYLINDRICAL if wheel else uff.CARTESIAN
        file.write(uff.nodes_2411(geometry.node, geometry.xyz_m, moving))
        file.write(uff.trace_lines_82("ring" if geometry.is_closed else "line", geometry.path))
        for number in range(1, len(found.modes) + 1):
            file.write(uff.shape_55(_shape(found, number)))
        meaning = "radial, outward" if geometry.is_closed else "as measured"
        for kind, number, frf in found.frfs:
            uff.append_frfs(
                file,
                frf,
                reference_node=geometry.reference_nodes[number - 1],
                force_deg=frf.excitation_deg if geometry.frfs[1:] else np.nan,
                direction=geometry.direction_code,
                note=f"{kind}; direction {geometry.direction_code} is {meaning}",
                byte_order=None if found.frfs_as_text else "little",
            )


def _shape(found: ModalExport, number: int) -> uff.ShapeDataset:
    mode, geometry = found.modes[number - 1], found.geometry
    along = found.shapes[number - 1]
    wheel = geometry.is_closed and found.is_cylindrical
    axes = np.eye(3)[:1] if wheel else geometry.direction
    nodes, row_of = np.unique(geometry.row_node, return_inverse=True)
    values = np.zeros((nodes.size, 3), dtype=along.dtype)
    np.add.at(values, row_of, along[:, None] * axes)
    modal_a, mass_kg = complex(found.modal_a[number - 1]), float(found.modal_mass_kg[number - 1])
    order = "" if mode.order is None else f", order {mode.order}{mode.member}"
    motion = "radial motion" if geometry.is_closed else "measured motion"
    stds = f"{_known(mode.frequency_std_hz, 'Hz')}, {_known(100 * mode.damping_std, '%')}"
    return uff.ShapeDataset(
        number=number,
        id_lines=(
            f"Mode {number}{order}, {mode.frequency_hz:.4f} Hz, {100 * mode.damping_ratio:.4f} %",
            found.result.name,
            f"std {stds} damping",
            f"{motion}{'' if wheel else ' as x, y, z'}; largest part 1",
            f"status {mode.status}",
        ),
        pole=mode.pole,
        node=nodes,
        values=values,
        modal_a=0.0 if np.isnan(modal_a) else modal_a,
        modal_mass_kg=0.0 if np.isnan(mass_kg) else mass_kg,
    )


def _known(std: float, unit: str) -> str:
    return f"{std:.2g} {unit}" if np.isfinite(std) else f"unknown {unit}"


#: Writers by the name of their format; each takes the content and the place.
FORMATS: dict[str, Callable[[ModalExport, Path], None]] = {
    "uff": write_uff,
    "xlsx": write_xlsx,
    "csv": write_tables,
    "json": write_json,
    "mat": write_mat,
}
