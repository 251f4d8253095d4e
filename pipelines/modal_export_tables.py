"""A result as tables that any spreadsheet opens: nodes, modes, shapes, FRFs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ema.frf import FRF
from pipelines.checksums import write_marker
from pipelines.modal_export import FOLDER_MARKER, ModalExport
from pipelines.modal_export_data import UNITS, mode_columns
from pipelines.tables import Row, write_csv

NODES = ("node", "position_deg", "x_m", "y_m", "z_m")
SHAPES = ("mode", "frequency_hz", "node", "position_deg", "real", "imag")


def write_tables(found: ModalExport, folder: Path) -> None:
    """Write ``nodes.csv``, ``modes.csv``, ``shapes.csv``, FRFs, and ``export.json`` with the rest.

    FRFs have one line per frequency and two columns per node, real and imaginary part.
    """
    write_csv(folder / "nodes.csv", NODES, _node_rows(found))
    columns = _columns(found)
    rows: list[Row] = list(zip(*columns.values(), strict=True))
    write_csv(folder / "modes.csv", tuple(columns), rows)
    write_csv(folder / "shapes.csv", SHAPES, _shape_rows(found))
    for name, frf in (("measured", found.measured), ("synthesised", found.synthesised)):
        if frf is not None:
            write_csv(folder / f"frf_{name}.csv", _frf_columns(frf), _frf_rows(frf))
    about = {
        "source": found.result.name,
        "notes": list(found.geometry.notes),
        "force_node": found.geometry.reference_node,
        "units": UNITS,
    }
    write_marker(folder / FOLDER_MARKER, about)


def _node_rows(found: ModalExport) -> Iterator[Row]:
    geometry = found.geometry
    for node, angle, point in zip(
        geometry.node.tolist(), geometry.position_deg.tolist(), geometry.xyz_m.tolist(), strict=True
    ):
        yield (node, angle, *point)


def _columns(found: ModalExport) -> dict[str, list[Any]]:
    """Columns of the modes; complex ones as two."""
    columns: dict[str, list[Any]] = {}
    for name, values in mode_columns(found).items():
        if np.iscomplexobj(values):
            columns[f"{name}_real"] = values.real.tolist()
            columns[f"{name}_imag"] = values.imag.tolist()
        else:
            columns[name] = list(np.asarray(values).tolist())
    columns["order"] = [mode.order for mode in found.modes]
    return columns


def _shape_rows(found: ModalExport) -> Iterator[Row]:
    geometry = found.geometry
    places = list(zip(geometry.node.tolist(), geometry.position_deg.tolist(), strict=True))
    for number, (mode, shape) in enumerate(zip(found.modes, found.shapes, strict=True), start=1):
        for place, value in zip(places[: geometry.n_measured], shape.tolist(), strict=True):
            yield (number, mode.frequency_hz, *place, complex(value).real, complex(value).imag)


def _frf_columns(frf: FRF) -> tuple[str, ...]:
    parts = [f"{part}_node_{node}" for node in frf.node.tolist() for part in ("real", "imag")]
    return ("frequency_hz", *parts)


def _frf_rows(frf: FRF) -> Iterator[Row]:
    parts = np.ascontiguousarray(frf.values.T).view(np.float64)
    for frequency_hz, row in zip(frf.frequency_hz.tolist(), parts.tolist(), strict=True):
        yield (frequency_hz, *row)
