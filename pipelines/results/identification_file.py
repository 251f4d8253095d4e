"""What the tables of a result do not hold but later stages need: ``identification.json`` & co."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ema.checks.quality import check_reference
from ema.circumference.orders import highest_order
from ema.core.errors import InputError
from ema.core.frf import FRF
from ema.core.modes import Drift, ModalModel, Mode, ResidualTerms
from ema.poles.stability import Cluster, StabilityDiagram
from pipelines.results.frf_file import read_frf
from pipelines.results.result import Result
from pipelines.results.schema import read_stored
from pipelines.storage.tables import Table, write_parquet

if TYPE_CHECKING:
    from pipelines.results.schema import StoredIdentification

JSON_NAME = "identification.json"
RESIDUES_NAME = "residues.parquet"
REFERENCE_NAME = "reference.parquet"
# Far below any inertance that is measured, and large enough for its square.
_SMALLEST_RESIDUE = 1e-100


def write_identification(result: Result, folder: Path) -> None:
    """Write everything of the identification that `read_identification` brings back."""
    model, diagram = result.modal_model, result.diagram
    content = {
        "name": result.name,
        "tyre": None if result.tyre is None else asdict(result.tyre),
        "excitation_deg": result.excitation_deg,
        "reference_deg": result.reference_deg,
        "findings": [asdict(finding) for finding in result.findings],
        "opinions": [asdict(opinion) for opinion in result.opinions],
        "blocks": None if result.frf.blocks is None else asdict(result.frf.blocks),
        "n_effective": result.frf.n_effective,
        "band_hz": model.band_hz,
        "fit_band_hz": model.fit_band_hz,
        "misfit": model.misfit,
        "covariance": model.covariance.tolist(),
        "frac": model.frac.tolist(),
        "drift": {
            "run": model.drift.run,
            "percent": model.drift.percent.tolist(),
            "std_percent": model.drift.std_percent.tolist(),
            "applied": model.drift.applied,
            "chance": model.drift.chance,
        },
        "notes": model.notes,
        "orders": [asdict(report) for report in model.orders],
        "modes": [_mode_record(mode) for mode in model.modes],
        "guard_modes": [_mode_record(mode) for mode in model.guard_modes],
        "clusters": [{**asdict(c), "pole": _pair(c.pole)} for c in diagram.clusters],
        "indicator_hz": diagram.indicator_hz.tolist(),
        "indicator": diagram.indicator.tolist(),
    }
    (folder / JSON_NAME).write_text(json.dumps(content), encoding="utf-8", newline="\n")
    _write_residues(model, folder / RESIDUES_NAME)


def read_identification(folder: Path, record: dict[str, Any]) -> Result:
    """Rebuild a result without its ring steps from a folder and its provenance.

    Raises
    ------
    InputError
        If a file is missing, or holds what no identification gives; names it.
    """
    stored = read_stored(folder / JSON_NAME)
    frf = replace(
        read_frf(folder / "frf.parquet"), blocks=stored.blocks, n_effective=stored.n_effective
    )
    if (folder / REFERENCE_NAME).is_file():
        frf = replace(frf, reference=_read_reference(folder / REFERENCE_NAME, stored.band_hz))
    model = _read_model(stored, frf, folder / RESIDUES_NAME)
    return Result(
        name=stored.name,
        tyre=stored.tyre,
        frf=frf,
        diagram=_read_diagram(stored, folder / "poles.parquet"),
        modal_model=model,
        reference=None if frf.reference is None else check_reference(frf.reference, model.band_hz),
        tuning=None,
        damping=None,
        validation=None,
        excitation_deg=stored.excitation_deg,
        reference_deg=stored.reference_deg,
        findings=stored.findings,
        opinions=stored.opinions,
        notes=model.notes,
        provenance={key: value for key, value in record.items() if key != "warnings"},
    )


def _read_reference(path: Path, band_hz: tuple[float, float]) -> FRF:
    frf = read_frf(path)
    in_band = (frf.frequency_hz >= band_hz[0]) & (frf.frequency_hz <= band_hz[1])
    if frf.n_positions < 2 or not np.any(in_band) or np.any(frf.std == 0):
        raise InputError(
            str(path),
            f"{frf.n_positions} runs, {np.count_nonzero(in_band)} frequencies in the band",
            "two runs or more are compared in the band, each with its noise",
            "Process the recordings again",
        )
    return frf


def _mode_record(mode: Mode) -> dict[str, Any]:
    return {
        "pole": _pair(mode.pole),
        "frequency_std_hz": mode.frequency_std_hz,
        "damping_std": mode.damping_std,
        "order": mode.order,
        "member": mode.member,
        "order_purity": mode.order_purity,
        "pair": mode.pair,
        "flags": mode.flags,
        "remark": mode.remark,
        "frequency_band_shift_hz": mode.frequency_band_shift_hz,
        "damping_band_shift": mode.damping_band_shift,
    }


def _write_residues(model: ModalModel, path: Path) -> None:
    """One column per position; rows: residues of modes and guard modes, then residual terms."""
    everything = model.modes + model.guard_modes
    residues = np.stack([mode.residues for mode in everything])
    std = np.stack([mode.residues_std for mode in everything])
    terms = model.residual_terms
    parts = [*residues.real, *residues.imag, *std, terms.lower, terms.upper]
    names = [
        *(f"real_{r}" for r in range(len(everything))),
        *(f"imag_{r}" for r in range(len(everything))),
        *(f"std_{r}" for r in range(len(everything))),
        "lower",
        "upper",
    ]
    columns = dict(zip(names, parts, strict=True))
    write_parquet(path, pd.DataFrame({**columns, "row": np.arange(parts[0].size)}))


def _read_model(stored: StoredIdentification, frf: FRF, path: Path) -> ModalModel:
    residues, std, terms = _read_residues(path, stored, frf.n_positions)
    records = stored.modes + stored.guard_modes
    modes = tuple(
        Mode(**{**vars(entry), "pole": complex(*entry.pole)}, residues=own, residues_std=own_std)
        for entry, own, own_std in zip(records, residues, std, strict=True)
    )
    n_modes = len(stored.modes)
    _require_places(path.with_name(JSON_NAME), stored, frf)
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
        drift=Drift(
            stored.drift.run,
            np.array(stored.drift.percent),
            np.array(stored.drift.std_percent),
            stored.drift.applied,
            stored.drift.chance,
        ),
        orders=stored.orders,
        notes=stored.notes,
    )


def _require_places(path: Path, stored: StoredIdentification, frf: FRF) -> None:
    """Refuse modes that do not go with the positions of the FRFs."""
    remedy = "Process the recordings again"
    if len(stored.frac) != frf.n_positions:
        found, rule = f"frac of {len(stored.frac)} positions", f"the FRFs are of {frf.n_positions}"
        raise InputError(str(path), found, rule, remedy)
    orders = [mode.order for mode in stored.modes + stored.guard_modes if mode.order is not None]
    if not orders:
        return
    on_circle = bool(np.all(np.isfinite(frf.position_deg)))
    if not on_circle or max(orders) > highest_order(frf.position_deg):
        rule = "the positions of the FRFs must be able to tell the order"
        raise InputError(str(path), f"a mode of order {max(orders)}", rule, remedy)


def _read_residues(
    path: Path, stored: StoredIdentification, n_positions: int
) -> tuple[NDArray[np.complex128], NDArray[np.float64], ResidualTerms]:
    """Residues and their deviations, one row per mode and guard mode, and the residual terms."""
    table = Table(path)
    count = range(len(stored.modes) + len(stored.guard_modes))
    if table.n_rows != n_positions or f"real_{len(count)}" in table.names:
        found = f"{table.n_rows} positions, columns {', '.join(table.names)}"
        rule = f"the FRFs are of {n_positions} positions, and there are {len(count)} modes"
        raise table.unusable(found, rule)
    order, _ = table.row_order()

    def column(name: str, *, unknown: bool = False) -> NDArray[np.float64]:
        return np.asarray(table.numbers(name, unknown=unknown), dtype=float)[order]

    residues = np.stack([column(f"real_{r}") + 1j * column(f"imag_{r}") for r in count])
    if np.any(np.abs(residues).max(axis=1) < _SMALLEST_RESIDUE):
        raise table.unusable("a mode without residues", "a mode moves somewhere")
    std = np.stack([column(f"std_{r}", unknown=True) for r in count])
    return residues, std, ResidualTerms(column("lower"), column("upper"))


def _read_diagram(stored: StoredIdentification, path: Path) -> StabilityDiagram:
    table = Table(path)
    order, _ = table.row_order()
    ratio = table.numbers("damping_ratio")[order]
    omega = 2 * np.pi * table.numbers("frequency_hz")[order]
    if np.any(np.abs(ratio) > 1) or np.any(omega <= 0):
        raise table.unusable("a pole without frequency", "damping ratios are below 1")
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
    )


def _pair(value: complex) -> list[float]:
    return [value.real, value.imag]
