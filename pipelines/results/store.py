"""Reading a result folder, and the part of an identification that is not in its tables."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from shutil import copyfile
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ema.checks.corrections import Correction, corrected
from ema.checks.quality import check_reference
from ema.checks.sensor_mass import SensorMass, without_mass
from ema.circumference.orders import highest_order
from ema.core.drift import NO_DRIFT, Drift
from ema.core.errors import InputError, require_type
from ema.core.files import require_regular
from ema.core.finding import Check, Finding, Verdict
from ema.core.frf import FRF, ForceRecord
from ema.core.modes import ModalModel, Mode, ResidualTerms
from ema.core.recording import FORCE, Channel
from ema.core.references import frfs_of
from ema.core.settings import CheckSettings
from ema.poles.stability import StabilityDiagram
from ema.poles.tracking import Cluster
from pipelines.results.edits_file import edits_of
from pipelines.results.provenance import CheckedResult, checked_result, with_inputs_at
from pipelines.results.result import Further, Result, Setup, Stored
from pipelines.results.tables import in_band, read_frfs, write_frfs
from pipelines.storage.atomic import MARKER, recover
from pipelines.storage.checksums import ACCEPTED, sha256
from pipelines.storage.tables import REMEDY, Table, repeating, write_parquet

if TYPE_CHECKING:
    from pipelines.results import schema

JSON_NAME = "identification.json"
RESIDUES_NAME = "residues.parquet"
REFERENCE_NAME = "reference.parquet"
FORCE_NAME = "force.parquet"
_OF_ROWS = ("clipped", "force_clipped", "missing", "disagreement")
_OF_FURTHER = (
    *("excitation_deg", "force_node", "force_axis"),
    *("blocks", "n_effective", "exponential_window"),
)
_ATTEMPTS = 20  # another process may keep replacing the result
_SMALLEST_RESIDUE = 1e-100  # far below any measured inertance; its square is still a double


def load(folder: Path | str, *, accept_changes: bool = False) -> Result:
    """Read a result folder back: everything but tuning, damping and validation.

    Those follow from the modes; `pipelines.process.ring.tune` adds them again.

    Parameters
    ----------
    folder : path
    accept_changes : bool
        Whether to accept parts that were changed; each becomes a warning among the findings, and
        its checksum a part of the provenance.

    Raises
    ------
    InputError
        If the folder is not a result, is damaged, or a part of it was changed, is missing or was
        added and is not accepted.

    Examples
    --------
    >>> import ringmodal as rm
    >>> rm.load("result").modal_model
    <ModalModel: 9 modes, 20 to 300 Hz>
    """
    folder = Path(require_type("result", folder, (str, Path), "Name a result folder"))
    if "\0" in str(folder):
        raise InputError("result", repr(str(folder)), "it must be a path", "Correct it")
    from pipelines.results import schema  # pydantic models: not for those who only write a result

    for attempts_left in reversed(range(_ATTEMPTS)):
        recover(folder)
        before = _marker_bytes(folder)
        try:
            checked = checked_result(folder, accept_changes=accept_changes)
            schema.require_provenance(folder / MARKER, checked.marker.content)
            stored = schema.read_identification_json(folder / JSON_NAME)
            result = _read_identification(folder, checked.marker.content, stored)
        except InputError:
            if not attempts_left or _marker_bytes(folder) == before:
                raise
        else:
            if not attempts_left or _marker_bytes(folder) == before:
                return _from_folder(result, checked)
    raise AssertionError("the last attempt returns or raises")


def _marker_bytes(folder: Path) -> bytes | None:
    """Content of the marker, by which a replaced result is recognised."""
    with suppress(OSError, InputError):
        return require_regular(folder / MARKER).read_bytes()
    return None


def _from_folder(result: Result, checked: CheckedResult) -> Result:
    """The result with where it is, or with its accepted changes among findings and provenance."""
    if not checked.accepted:
        stored = Stored(checked.folder, checked.marker.files, result.measured)
        return replace(result, stored=stored)
    changed = (
        Finding("", name, None, Check.CHANGED, Verdict.WARNING, f"{how.value}; accepted as it is")
        for name, how in checked.accepted.items()
    )
    provenance = result.provenance
    return replace(
        result,
        findings=tuple(dict.fromkeys([*result.findings, *changed])),
        provenance={**provenance, ACCEPTED: {**provenance.get(ACCEPTED, {}), **checked.sha256}},
    )


def write_identification(result: Result, folder: Path) -> None:
    """Write what `load` needs beside the tables: ``identification.json``, ``residues.parquet``."""
    model, diagram = result.modal_model, result.diagram
    sources: tuple[tuple[Any, tuple[str, ...]], ...] = (
        (result, ("name", "tyre", "excitation_deg", "reference_deg", "findings", "opinions")),
        (result, ("corrections", "sensor_mass", "other_modes")),
        (result, ("setup", "automatic", "automatic_misfit", "references")),
        (result.frf, ("blocks", "n_effective")),
        (model, ("band_hz", "fit_band_hz", "misfit", "covariance", "frac", "drift", "notes")),
        (model, ("orders", "modes", "guard_modes", "exponential_window", "widened_per_s")),
        (diagram, ("clusters", "indicator_hz", "indicator", "cmif", "mif")),
    )
    content = {name: getattr(source, name) for source, names in sources for name in names}
    measured = result.measured
    content |= _about_rows(measured)
    content["further"] = [
        _about_rows(each.measured)
        | {name: getattr(each.measured, name) for name in _OF_FURTHER}
        | {"corrections": each.corrections, "sensor_mass": each.sensor_mass}
        for each in result.further
    ]
    text = json.dumps(content, default=_as_json)
    (folder / JSON_NAME).write_text(text, encoding="utf-8", newline="\n")
    # One row per position: residues of modes and guard modes, then residual terms.
    modes, terms = (*model.modes, *model.guard_modes), model.residual_terms
    columns: dict[str, Any] = {f"real_{r}": mode.residues.real for r, mode in enumerate(modes)}
    columns |= {f"imag_{r}": mode.residues.imag for r, mode in enumerate(modes)}
    columns |= {f"std_{r}": mode.residues_std for r, mode in enumerate(modes)}
    columns |= {"lower": terms.lower, "upper": terms.upper, "row": np.arange(terms.lower.size)}
    write_parquet(folder / RESIDUES_NAME, columns)


def _about_rows(frf: FRF) -> dict[str, Any]:
    """What is known of the rows and forces of FRFs beside their table."""
    forces = [
        {"run": run, "channel": each.force.name, "plan": each.plan}
        for run, each in frf.forces.items()
    ]
    return {"rows": {name: getattr(frf, name) for name in _OF_ROWS}, "forces": forces}


def write_measured(result: Result, folder: Path) -> None:
    """Write the FRFs as measured and the forces, or copy them from where they were read."""
    stored, frf = result.stored, result.measured
    if stored is None or stored.measured is not frf or not _copied(stored, folder):
        every = frfs_of(result.frfs)
        write_frfs(every, folder)
        _write_forces(every, folder / FORCE_NAME)


def _copied(stored: Stored, folder: Path) -> bool:
    """Whether all files of FRFs could be copied as they were when they were read."""
    names = ("frf.uff", "frf.parquet", REFERENCE_NAME, FORCE_NAME)
    for name in (each for each in names if each in stored.sha256):
        try:
            copyfile(stored.folder / name, folder / name)
        except OSError:  # moved or replaced since
            return False
        if sha256(folder / name) != stored.sha256[name]:
            return False
    return True


def _write_forces(every: Sequence[FRF], path: Path) -> None:
    """Write the force of each run as far as blocks reach, run after run; nothing without any.

    Forces at several places have runs of their own.
    """
    samples = {
        run: each.force.block(0, each.plan.starts[-1] + each.plan.block_samples)
        for frf in every
        for run, each in frf.forces.items()
    }
    if not samples:
        return
    force = np.concatenate(list(samples.values()))
    single = force.astype(np.float32)
    force = single if np.array_equal(single, force) else force
    number = np.repeat(np.arange(len(samples), dtype=np.int32), [*map(len, samples.values())])
    write_parquet(path, {"run": repeating(number, list(samples)), "force_n": force})


def _read_forces(path: Path, forces: Sequence[schema.StoredForce]) -> dict[str, ForceRecord]:
    """Force of each run; none where they are not stored, as by earlier versions."""
    if not forces or not path.is_file():
        return {}
    table = Table(path)
    (of_run, names), force = table.texts("run"), table.numbers("force_n")
    found = {}
    for each in forces:
        own = force[of_run == names.index(each.run)] if each.run in names else force[:0]
        if own.size != each.plan.starts[-1] + each.plan.block_samples:
            raise table.unusable(f"{own.size} samples of {each.run}", "they must fill its blocks")
        channel = Channel(each.channel, FORCE, "N", own)
        found[each.run] = ForceRecord(channel, each.plan)
    return found


def _as_json(value: Any) -> Any:
    if isinstance(value, complex):
        return value.real, value.imag
    if isinstance(value, Mode):  # its residues are in a table
        return {name: part for name, part in vars(value).items() if "residues" not in name}
    if is_dataclass(value):
        return {field.name: getattr(value, field.name) for field in fields(value)}
    return value.tolist()


def _read_identification(folder: Path, record: dict[str, Any], stored: schema.Stored) -> Result:
    """Result without its ring steps from a folder and its provenance."""
    options = record["options"]
    measured, further = _read_measured(folder, stored, options.get("estimator", "H1"))
    mass = _mass(stored.sensor_mass)
    setup = None
    if (own := stored.setup) is not None:
        setup = Setup(**{**vars(own), "sensor_mass": _mass(own.sensor_mass)})
    frf = without_mass(corrected(measured, stored.corrections), mass)
    model = _read_model(stored, frf, folder / RESIDUES_NAME)
    recorded = record.get("settings", {}).get("checks", {})
    known = (each.name for each in fields(CheckSettings))
    checks = CheckSettings(**{name: recorded[name] for name in known if name in recorded})
    fixed = frf.reference
    here = with_inputs_at(record, lambda path: os.path.normpath(folder.resolve() / path))
    return Result(
        name=stored.name,
        tyre=stored.tyre,
        frf=frf,
        measured=measured,
        diagram=_read_diagram(stored, folder / "poles.parquet"),
        modal_model=model,
        reference=None if fixed is None else check_reference(fixed, model.band_hz, checks),
        excitation_deg=stored.excitation_deg,
        reference_deg=stored.reference_deg,
        findings=stored.findings,
        opinions=stored.opinions,
        notes=model.notes,
        corrections=stored.corrections,
        sensor_mass=mass,
        other_modes=stored.other_modes,
        provenance={key: value for key, value in here.items() if key != "warnings"},
        setup=setup,
        edits=edits_of(f"{folder / MARKER}", record.get("edits", ())),
        automatic=stored.automatic,
        automatic_misfit=stored.automatic_misfit,
        references=stored.references,
        further=further,
    )


def _mass(held: schema.StoredMass | None) -> SensorMass | None:
    if held is None:
        return None
    seats = {run: np.array(angles) for run, angles in held.sensors_deg.items()}
    drift = NO_DRIFT if held.drift is None else Drift(**vars(held.drift))
    own = {run: np.array(masses) for run, masses in held.own_kg.items()}
    across = {order: (_complex(one[0]), _complex(one[1])) for order, one in held.across.items()}
    mixed = held.mixed and (_complex(held.mixed[0]), _complex(held.mixed[1]))
    of_tyre = held.excitation_deg, held.live_mass_kg, drift
    return SensorMass(held.mass_kg, seats, *of_tyre, own, across, held.upper_hz, mixed)


def _complex(pairs: Sequence[Any]) -> NDArray[np.complex128]:
    return np.array(pairs, dtype=float).view(complex)[..., 0] if pairs else np.zeros(0, complex)


def _read_measured(
    folder: Path, stored: schema.Stored, estimator: str
) -> tuple[FRF, tuple[Further, ...]]:
    """FRFs as measured, those of the fixed sensor among them, and those of further forces."""
    frf, *others = (each for _, each in sorted(read_frfs(folder / "frf.parquet").items()))
    fixed = {}
    if (folder / REFERENCE_NAME).is_file():
        fixed = _read_references(folder / REFERENCE_NAME, stored.band_hz)
    of_rows = _of_rows(folder / JSON_NAME, stored.rows, frf)
    frf = replace(
        frf,
        blocks=stored.blocks,
        n_effective=stored.n_effective,
        forces=_read_forces(folder / FORCE_NAME, stored.forces),
        reference=_by(estimator, fixed.get(1)),
        excitation_deg=np.nan if stored.excitation_deg is None else stored.excitation_deg,
        exponential_window=stored.exponential_window,
        estimator=estimator,
        **of_rows,
    )
    _require_rows(folder / JSON_NAME, stored.corrections, frf.n_positions)
    if len(others) != len(stored.further):
        found, rule = f"{len(others)} in frf.parquet", f"{len(stored.further)} are described"
        raise InputError(f"{folder / JSON_NAME}, further", found, rule, REMEDY)
    further = []
    for number, (other, known) in enumerate(zip(others, stored.further, strict=True), 2):
        _require_rows(folder / JSON_NAME, known.corrections, other.n_positions)
        measured = replace(
            other,
            **{name: getattr(known, name) for name in _OF_FURTHER},
            forces=_read_forces(folder / FORCE_NAME, known.forces),
            reference=_by(estimator, fixed.get(number)),
            estimator=estimator,
            **_of_rows(folder / JSON_NAME, known.rows, other),
        )
        further.append(Further(measured, known.corrections, _mass(known.sensor_mass)))
    return frf, tuple(further)


def _by(estimator: str, fixed: FRF | None) -> FRF | None:
    return None if fixed is None else replace(fixed, estimator=estimator)


def _of_rows(path: Path, stored: Mapping[str, Sequence[float]], frf: FRF) -> dict[str, Any]:
    """What is stored of each row of FRFs beside their table."""
    of_rows: dict[str, Any] = {name: np.array(each) for name, each in stored.items()}
    if {*of_rows} - {*_OF_ROWS} or {each.size for each in of_rows.values()} - {frf.n_positions}:
        rule = f"one value for each of the {frf.n_positions} FRFs"
        raise InputError(f"{path}, rows", "another number", rule, REMEDY)
    return of_rows


def _require_rows(path: Path, corrections: Sequence[Correction], n_rows: int) -> None:
    """Refuse corrections of rows that the FRFs do not have, several of one, and of all."""
    rows = [each.row for each in corrections]
    named = {*rows, *(each.source_row for each in corrections)}
    out = [each.row for each in corrections if each.excluded]
    if not named <= set(range(n_rows)) or len(set(rows)) < len(rows) or len(out) == n_rows:
        rule = f"at most one for each of the {n_rows} FRFs, of which one or more must be used"
        raise InputError(f"{path}, corrections", f"rows {sorted(rows)}", rule, REMEDY)


def _read_references(path: Path, band_hz: schema.Two) -> dict[int, FRF]:
    """FRFs of the fixed sensor, by the number of the force."""
    every = read_frfs(path)
    for frf in every.values():
        n_lines = np.count_nonzero(in_band(frf.frequency_hz, band_hz))
        if frf.n_positions < 2 or not n_lines or np.any(frf.std == 0):
            found = f"{frf.n_positions} runs, {n_lines} frequencies in the band"
            rule = "the check needs two or more runs, frequencies in the band, and noise"
            raise InputError(str(path), found, rule, REMEDY)
    return every


def _read_model(stored: schema.Stored, frf: FRF, path: Path) -> ModalModel:
    residues, std, terms = _read_residues(path, stored, frf.n_positions)
    _require_positions(path.with_name(JSON_NAME), stored, frf)
    records = (*stored.modes, *stored.guard_modes)
    modes = tuple(
        Mode(**{**vars(entry), "pole": complex(*entry.pole)}, residues=own, residues_std=own_std)
        for entry, own, own_std in zip(records, residues, std, strict=True)
    )
    n_modes = len(stored.modes)
    return ModalModel(
        modes=modes[:n_modes],
        guard_modes=modes[n_modes:],
        residual_terms=terms,
        band_hz=stored.band_hz,
        fit_band_hz=stored.fit_band_hz,
        covariance=np.array(stored.covariance),
        frac=np.array(stored.frac),
        misfit=stored.misfit,
        node=frf.node,
        position_deg=frf.position_deg,
        axis=frf.axis,
        excitation_deg=frf.excitation_deg,
        drift=Drift(**vars(stored.drift)),
        orders=stored.orders,
        exponential_window=stored.exponential_window,
        widened_per_s=np.array(stored.widened_per_s),
        notes=stored.notes,
    )


def _require_positions(path: Path, stored: schema.Stored, frf: FRF) -> None:
    """Refuse modes that do not fit the positions of the FRFs."""
    if len(stored.frac) != frf.n_positions:
        found, rule = f"frac of {len(stored.frac)} positions", f"the FRFs have {frf.n_positions}"
        raise InputError(str(path), found, rule, REMEDY)
    orders = [mode.order for mode in (*stored.modes, *stored.guard_modes) if mode.order is not None]
    on_circle = bool(np.all(np.isfinite(frf.position_deg)))
    if orders and not (on_circle and max(orders) <= highest_order(frf.position_deg)):
        rule = "the positions of the FRFs must resolve the order"
        raise InputError(str(path), f"a mode of order {max(orders)}", rule, REMEDY)


def _read_residues(
    path: Path, stored: schema.Stored, n_positions: int
) -> tuple[NDArray[np.complex128], NDArray[np.float64], ResidualTerms]:
    """Residues and their deviations, one row per mode and guard mode, and the residual terms."""
    table = Table(path)
    count = range(len(stored.modes) + len(stored.guard_modes))
    if table.n_rows != n_positions or f"real_{len(count)}" in table.names:
        found = f"{table.n_rows} positions, columns {', '.join(table.names)}"
        raise table.unusable(found, f"it needs {n_positions} positions and {len(count)} modes")
    order = table.row_order()

    def column(name: str, *, unknown: bool = False) -> NDArray[np.float64]:
        return np.asarray(table.numbers(name, unknown=unknown), dtype=float)[order]

    residues = np.stack([column(f"real_{r}") + 1j * column(f"imag_{r}") for r in count])
    if np.any(np.abs(residues).max(axis=1) < _SMALLEST_RESIDUE):
        raise table.unusable("a mode without residues", "each mode needs residues")
    std = np.stack([column(f"std_{r}", unknown=True) for r in count])
    return residues, std, ResidualTerms(column("lower"), column("upper"))


def _read_diagram(stored: schema.Stored, path: Path) -> StabilityDiagram:
    table = Table(path)
    order = table.row_order()
    ratio = table.numbers("damping_ratio")[order]
    omega = 2 * np.pi * table.numbers("frequency_hz")[order]
    if np.any(np.abs(ratio) > 1) or np.any(omega <= 0):
        raise table.unusable("a pole without frequency", "ratios must be ≤ 1, frequencies > 0")
    return StabilityDiagram(
        band_hz=stored.band_hz,
        model_order=table.numbers("order")[order],
        poles=omega * (-ratio + 1j * np.sqrt(1 - ratio**2)),
        stable_frequency=table.flags("stable_frequency")[order],
        stable_damping=table.flags("stable_damping")[order],
        cluster=table.numbers("cluster")[order],
        clusters=tuple(
            Cluster(**{**vars(each), "pole": complex(*each.pole)}) for each in stored.clusters
        ),
        indicator_hz=np.array(stored.indicator_hz),
        indicator=np.array(stored.indicator),
        cmif=np.reshape(stored.cmif, (len(stored.cmif), -1)) if stored.cmif else np.zeros((0, 0)),
        mif=np.reshape(stored.mif, (len(stored.mif), -1)) if stored.mif else np.zeros((0, 0)),
    )
