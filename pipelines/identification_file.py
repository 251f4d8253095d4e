"""What the tables of a result do not hold but later stages need: ``identification.json`` & co."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ema.blocks import BlockPlan
from ema.frf import FRF
from ema.modes import Drift, ModalModel, Mode, ResidualTerms
from ema.pairs import PairVerdict
from ema.quality import Finding, check_reference
from ema.recording import Tyre
from ema.resolution import OrderReport
from ema.second_opinion import Opinion
from ema.stability import Cluster, StabilityDiagram
from pipelines.parquet import read_parquet, write_parquet
from pipelines.result import Result

JSON_NAME = "identification.json"
RESIDUES_NAME = "residues.parquet"


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


def read_identification(folder: Path, record: dict[str, Any], frf: FRF) -> Result:
    """Rebuild a result without its ring steps from a folder, its provenance and its FRFs."""
    content = json.loads((folder / JSON_NAME).read_text(encoding="utf-8"))
    frf = replace(
        frf,
        blocks=None if content["blocks"] is None else BlockPlan(**content["blocks"]),
        n_effective=content["n_effective"],
    )
    if (folder / "reference.parquet").is_file():
        from pipelines.store import read_frf

        frf = replace(frf, reference=read_frf(folder / "reference.parquet"))
    band_hz = _both(content["band_hz"])
    model = _read_model(content, frf, folder / RESIDUES_NAME)
    return Result(
        name=content["name"],
        tyre=None if content["tyre"] is None else Tyre(**content["tyre"]),
        frf=frf,
        diagram=_read_diagram(content, folder / "poles.parquet"),
        modal_model=model,
        reference=None if frf.reference is None else check_reference(frf.reference, band_hz),
        tuning=None,
        damping=None,
        validation=None,
        excitation_deg=content["excitation_deg"],
        reference_deg=content["reference_deg"],
        findings=tuple(Finding(**finding) for finding in content["findings"]),
        opinions=tuple(Opinion(**opinion) for opinion in content["opinions"]),
        notes=model.notes,
        provenance={key: value for key, value in record.items() if key != "warnings"},
    )


def _mode_record(mode: Mode) -> dict[str, Any]:
    return {
        "pole": _pair(mode.pole),
        "frequency_std_hz": mode.frequency_std_hz,
        "damping_std": mode.damping_std,
        "order": mode.order,
        "member": mode.member,
        "order_purity": mode.order_purity,
        "status": mode.status,
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
    write_parquet(path, dict(zip(names, parts, strict=True)))


def _read_model(content: dict[str, Any], frf: FRF, path: Path) -> ModalModel:
    table = read_parquet(path)
    column = {name: np.asarray(table[name].to_numpy()) for name in table.column_names}
    records = content["modes"] + content["guard_modes"]
    modes = tuple(
        Mode(
            **{**entry, "pole": complex(*entry["pole"])},
            residues=column[f"real_{r}"] + 1j * column[f"imag_{r}"],
            residues_std=column[f"std_{r}"],
        )
        for r, entry in enumerate(records)
    )
    n_modes = len(content["modes"])
    return ModalModel(
        modes=modes[:n_modes],
        guard_modes=modes[n_modes:],
        residual_terms=ResidualTerms(column["lower"], column["upper"]),
        band_hz=_both(content["band_hz"]),
        fit_band_hz=_both(content["fit_band_hz"]),
        covariance=np.array(content["covariance"]),
        frac=np.array(content["frac"]),
        misfit=content["misfit"],
        node=frf.node,
        position_deg=frf.position_deg,
        drift=Drift(
            tuple(content["drift"]["run"]),
            np.array(content["drift"]["percent"]),
            np.array(content["drift"]["std_percent"]),
            content["drift"]["applied"],
            content["drift"]["chance"],
        ),
        orders=tuple(
            OrderReport(**{**report, "pair": PairVerdict(**report["pair"])})
            for report in content["orders"]
        ),
        notes=tuple(content["notes"]),
    )


def _read_diagram(content: dict[str, Any], path: Path) -> StabilityDiagram:
    table = read_parquet(path)
    column = {name: np.asarray(table[name].to_numpy()) for name in table.column_names}
    ratio, omega = column["damping_ratio"], 2 * np.pi * column["frequency_hz"]
    return StabilityDiagram(
        band_hz=_both(content["band_hz"]),
        model_order=column["order"],
        poles=omega * (-ratio + 1j * np.sqrt(1 - ratio**2)),
        stable_frequency=column["stable_frequency"],
        stable_damping=column["stable_damping"],
        cluster=column["cluster"],
        clusters=tuple(Cluster(**{**c, "pole": complex(*c["pole"])}) for c in content["clusters"]),
        indicator_hz=np.array(content["indicator_hz"]),
        indicator=np.array(content["indicator"]),
    )


def _pair(value: complex) -> list[float]:
    return [value.real, value.imag]


def _both(values: list[float]) -> tuple[float, float]:
    return float(values[0]), float(values[1])
