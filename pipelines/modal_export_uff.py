"""A result as one universal file: header, units, nodes, trace line, shapes, FRFs."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np

from ema.io.uff_frf import SYNTHESISED
from ema.io.uff_write import append_frfs
from ema.io.uff_write_model import (
    ShapeDataset,
    coordinate_system_2420,
    header_151,
    nodes_2411,
    shape_55,
    trace_lines_82,
    units_164,
)
from pipelines.modal_export import MEASURED, ModalExport
from pipelines.versions import software_version


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
