"""Export of a result's modes to other programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ema.core.errors import unknown
from ema.core.modes import Mode
from ema.io.uff.frf import SYNTHESISED
from pipelines.export.data import BOTH, MEASURED, NONE, Geometry, ModalExport, geometry_of
from pipelines.export.formats import FOLDER_MARKER, write_json, write_mat, write_tables, write_uff
from pipelines.results.labels import in_band
from pipelines.results.provenance import accepted_notes
from pipelines.results.result import Result
from pipelines.results.store import load
from pipelines.storage.atomic import file_written_whole, require_free_file
from pipelines.storage.result_folder import written_whole

FRF_CHOICES = (BOTH, MEASURED, SYNTHESISED, NONE)

_LEAST_DRIVE = 3.0  # smallest residue at the force for modal A, in standard deviations

#: Writers by the name of their format; each takes the content and the place.
FORMATS: dict[str, Callable[[ModalExport, Path], None]] = {
    "uff": write_uff,
    "csv": write_tables,
    "json": write_json,
    "mat": write_mat,
}
FOLDERS = ("csv",)  # formats that write a folder


@dataclass(frozen=True)
class Written:
    """An export and its place."""

    path: Path
    file_format: str
    export: ModalExport


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
    shapes = np.array([mode.shape for mode in model.modes]).reshape(-1, geometry.n_measured)
    frf = replace(result.frf, node=geometry.node[: geometry.n_measured])
    synthesised = None
    if frfs in (BOTH, SYNTHESISED):
        fitted = in_band(frf.frequency_hz, model.fit_band_hz)
        parts = {name: getattr(frf, name)[:, fitted] for name in ("values", "coherence", "std")}
        frf = replace(frf, frequency_hz=frf.frequency_hz[fitted], **parts)
        values = model.synthesise(frf.frequency_hz, frf.run)
        blank = np.full(values.shape, np.nan)
        synthesised = replace(frf, values=values, coherence=blank, std=blank)
    return ModalExport(
        result=result,
        geometry=geometry,
        shapes=shapes.real if real else shapes.astype(complex),
        modal_a=np.array([_modal_a(mode, geometry) for mode in model.modes], dtype=complex),
        measured=frf if frfs in (BOTH, MEASURED) else None,
        synthesised=synthesised,
        frfs_as_text=text,
    )


def export(
    folder: Path | str,
    out: Path | str | None = None,
    file_format: str = "",
    *,
    real: bool = False,
    frfs: str = BOTH,
    text: bool = False,
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
    file_format : {"uff", "csv", "json", "mat"}, optional
        Default: the ending of `out`, or ``"uff"``.
    real, frfs, text
        As for `gather`.
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
    found = gather(loaded, real=real, frfs=frfs, text=text)
    name = folder.resolve().name
    target = Path(out) if out else Path(f"{name}_csv" if chosen == "csv" else f"{name}.{chosen}")
    if chosen in FOLDERS:
        writing = written_whole(target, force=force, marker=FOLDER_MARKER)
    else:
        require_free_file(target, force=force)
        writing = file_written_whole(target)
    with writing as partial:
        FORMATS[chosen](found, partial)
    return Written(target, chosen, found)


def _format_of(out: Path | str | None, file_format: str) -> str:
    ending = Path(out).suffix.lower().lstrip(".") if out else "uff"
    wanted = file_format.casefold() or {"unv": "uff", "": "csv"}.get(ending, ending)
    if wanted not in FORMATS:
        where, rule = "--format" if file_format else str(out), "it must be one of "
        raise unknown(where, file_format or wanted, rule + ", ".join(FORMATS), FORMATS)
    return wanted


def _modal_a(mode: Mode, geometry: Geometry) -> complex:
    unknown_a = complex(np.nan, np.nan)
    rows = np.flatnonzero(geometry.node[: geometry.n_measured] == geometry.reference_node)
    if rows.size == 0:
        return unknown_a
    at_force = complex(mode.residues[rows[0]])
    noise = float(mode.residues_std[rows[0]])
    if not abs(at_force) > _LEAST_DRIVE * (noise if np.isfinite(noise) else 0.0):
        return unknown_a
    modal_a = complex(mode.shape[rows[0]]) ** 2 / at_force
    is_mass = (modal_a / (2j * mode.pole.imag)).real > 0  # else the force acts elsewhere
    return modal_a if is_mass else unknown_a
