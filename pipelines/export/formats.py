"""A result as tables that any spreadsheet opens: nodes, modes, shapes, FRFs."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ema.core.frf import FRF
from ema.io.uff.frf import SYNTHESISED
from ema.io.uff.write import (
    ShapeDataset,
    append_frfs,
    coordinate_system_2420,
    header_151,
    nodes_2411,
    shape_55,
    trace_lines_82,
    units_164,
)
from pipelines.export.data import FOLDER_MARKER, MEASURED, UNITS, ModalExport, mode_columns
from pipelines.results.provenance import software_version
from pipelines.storage.checksums import write_marker
from pipelines.storage.tables import write_csv


def write_tables(found: ModalExport, folder: Path) -> None:
    """Write ``nodes.csv``, ``modes.csv``, ``shapes.csv``, FRFs, and ``export.json`` with the rest.

    FRFs have one line per frequency and two columns per node, real and imaginary part.
    """
    write_csv(folder / "nodes.csv", _nodes(found))
    write_csv(folder / "modes.csv", _modes(found))
    write_csv(folder / "shapes.csv", _shapes(found))
    for name, frf in (("measured", found.measured), ("synthesised", found.synthesised)):
        if frf is not None:
            write_csv(folder / f"frf_{name}.csv", _frfs(frf))
    about = {
        "source": found.result.name,
        "notes": list(found.geometry.notes),
        "force_node": found.geometry.reference_node,
        "units": UNITS,
    }
    write_marker(folder / FOLDER_MARKER, about)


def _nodes(found: ModalExport) -> pd.DataFrame:
    geometry = found.geometry
    points = dict(zip(("x_m", "y_m", "z_m"), geometry.xyz_m.T, strict=True))
    return pd.DataFrame({"node": geometry.node, "position_deg": geometry.position_deg, **points})


def _modes(found: ModalExport) -> pd.DataFrame:
    """The modes; complex columns as two."""
    columns: dict[str, Any] = {}
    for name, values in mode_columns(found).items():
        if np.iscomplexobj(values):
            columns |= {f"{name}_real": values.real, f"{name}_imag": values.imag}
        else:
            columns[name] = values
    columns["order"] = pd.array([mode.order for mode in found.modes], dtype="Int64")
    return pd.DataFrame(columns)


def _shapes(found: ModalExport) -> pd.DataFrame:
    geometry, n_modes = found.geometry, len(found.modes)
    measured = slice(geometry.n_measured)
    shapes = np.concatenate(found.shapes).astype(complex)
    repeat = np.repeat(np.arange(n_modes), geometry.n_measured)
    return pd.DataFrame(
        {
            "mode": repeat + 1,
            "frequency_hz": np.array([mode.frequency_hz for mode in found.modes])[repeat],
            "node": np.tile(geometry.node[measured], n_modes),
            "position_deg": np.tile(geometry.position_deg[measured], n_modes),
            "real": shapes.real,
            "imag": shapes.imag,
        }
    )


def _frfs(frf: FRF) -> pd.DataFrame:
    """A row for each frequency, two columns for each node."""
    parts = np.ascontiguousarray(frf.values.T).view(np.float64)
    names = [f"{part}_node_{node}" for node in frf.node.tolist() for part in ("real", "imag")]
    return pd.DataFrame(
        np.column_stack([frf.frequency_hz, parts]), columns=["frequency_hz", *names]
    )


def write_uff(found: ModalExport, path: Path, *, binary: bool = True) -> None:
    """Write datasets 151, 164, 2420, 2411, 82, 55 and 58b (58 where `binary` is False).

    Shapes are in Cartesian components: the motion along the measured direction, as x, y, z.
    """
    geometry = found.geometry
    program = f"ringmodal {software_version()}"
    notes = "; ".join(geometry.notes)
    with path.open("wb") as file:
        file.write(header_151(found.result.name, notes, program, datetime.now().astimezone()))
        file.write(units_164() + coordinate_system_2420())
        file.write(nodes_2411(geometry.node, geometry.xyz_m))
        file.write(trace_lines_82("ring" if geometry.is_closed else "line", geometry.path))
        for number in range(1, len(found.modes) + 1):
            file.write(shape_55(_shape(found, number)))
        for kind, frf in ((MEASURED, found.measured), (SYNTHESISED, found.synthesised)):
            if frf is not None:
                append_frfs(
                    file,
                    frf,
                    reference_node=geometry.reference_node,
                    direction=geometry.direction_code,
                    note=_frf_note(found, kind),
                    byte_order="little" if binary else None,
                )


def _shape(found: ModalExport, number: int) -> ShapeDataset:
    mode, geometry = found.modes[number - 1], found.geometry
    along = found.shapes[number - 1]
    directions = geometry.direction[: geometry.n_measured]
    modal_a, mass_kg = complex(found.modal_a[number - 1]), float(found.modal_mass_kg[number - 1])
    return ShapeDataset(
        number=number,
        id_lines=_id_lines(found, number),
        pole=mode.pole,
        node=geometry.node[: geometry.n_measured],
        values=along[:, None] * directions,
        modal_a=0.0 if np.isnan(modal_a) else modal_a,
        modal_mass_kg=0.0 if np.isnan(mass_kg) else mass_kg,
    )


def _id_lines(found: ModalExport, number: int) -> tuple[str, ...]:
    mode = found.modes[number - 1]
    order = "" if mode.order is None else f", order {mode.order}{mode.member}"
    motion = "radial motion" if found.geometry.is_closed else "measured motion"
    return (
        f"Mode {number}{order}, {mode.frequency_hz:.4f} Hz, {100 * mode.damping_ratio:.4f} %",
        found.result.name,
        f"std {_known(mode.frequency_std_hz, 'Hz')}, {_known(100 * mode.damping_std, '%')} damping",
        f"{motion} as x, y, z; largest part 1",
        f"status {mode.status}",
    )


def _known(std: float, unit: str) -> str:
    return f"{std:.2g} {unit}" if np.isfinite(std) else f"unknown {unit}"


def _frf_note(found: ModalExport, kind: str) -> str:
    meaning = "radial, outward" if found.geometry.is_closed else "as measured"
    return f"{kind}; direction {found.geometry.direction_code} is {meaning}"
