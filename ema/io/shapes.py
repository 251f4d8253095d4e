"""Mode shapes that other programs made, to compare with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema._arrays import readonly
from ema.errors import RecordingFormatError
from ema.io.content import remark
from ema.io.uff_kinds import SHAPES
from ema.io.uff_scan import COPY_AGAIN, scan
from ema.io.uff_shapes import ModeRecord, read_mode
from ema.io.uff_surroundings import read_surroundings
from ema.quality import Finding

_MOST_GAPS = 8  # cells of the whole table for each value given: files of one structure have about 1


@dataclass(frozen=True, eq=False)
class ShapeSet:
    """Mode shapes of a universal file, as stored: each has a scale of its own.

    Parameters
    ----------
    frequency_hz : ndarray, shape (n_modes,)
        Undamped natural frequencies.
    damping_ratio : ndarray, shape (n_modes,)
        NaN where the file states none.
    node : ndarray of int, shape (n_rows,)
        Node of each row.
    direction : ndarray of int, shape (n_rows,)
        1 to 3 translation along X, Y, Z, 4 to 6 rotation about them, 0 where there is none.
    angle_deg : ndarray, shape (n_rows,)
        Angle of the row's node; NaN where the file has no geometry, or it is no circle.
    values : ndarray of complex, shape (n_modes, n_rows)
        NaN where a mode says nothing about a row.
    findings : tuple of Finding
        What was left out or assumed.
    """

    frequency_hz: NDArray[np.float64]
    damping_ratio: NDArray[np.float64]
    node: NDArray[np.int_]
    direction: NDArray[np.int_]
    angle_deg: NDArray[np.float64]
    values: NDArray[np.complex128]
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        for name, dtype in (
            ("frequency_hz", float),
            ("damping_ratio", float),
            ("node", int),
            ("direction", int),
            ("angle_deg", float),
            ("values", complex),
        ):
            object.__setattr__(self, name, readonly(getattr(self, name), dtype))

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return int(self.values.shape[0])


def read_shapes(path: Path | str) -> ShapeSet:
    """Read the mode shapes of a universal file from its datasets 55 and 2414.

    Normal modes and complex eigenvalues, real or complex, are modes; results of other analyses
    are named in a finding and left out.

    Parameters
    ----------
    path : Path or str
        A universal file.

    Raises
    ------
    RecordingFormatError
        If the file is missing or damaged, or holds no mode shapes.
    """
    path = Path(path)
    datasets = scan(path)
    modes: list[ModeRecord] = []
    left_out: list[str] = []
    for dataset in datasets:
        if dataset.number not in SHAPES:
            continue
        found = read_mode(path, dataset)
        if isinstance(found, ModeRecord):
            modes.append(found)
        else:
            left_out.append(f"dataset {dataset.index} ({dataset.number}): {found}")
    if not any(len(mode.node) for mode in modes):
        held = "; ".join(left_out[:3]) or f"{len(datasets)} datasets, none of them 55 or 2414"
        rule = "mode shapes are normal or complex modes in datasets 55 or 2414"
        raise RecordingFormatError(path.name, held, rule, "Export the modes of the analysis")
    findings = tuple(remark(path, "", "content", f"{each}, left out") for each in left_out)
    node, direction, values = _table(path, modes)
    around = read_surroundings(path, datasets, set(node.tolist()))
    return ShapeSet(
        frequency_hz=np.array([mode.frequency_hz for mode in modes]),
        damping_ratio=np.array([mode.damping_ratio for mode in modes]),
        node=node,
        direction=direction,
        angle_deg=np.array([around.angle_deg.get(each, np.nan) for each in node.tolist()]),
        values=values,
        findings=findings + around.findings,
    )


def _table(
    path: Path, modes: Sequence[ModeRecord]
) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.complex128]]:
    """Nodes and directions of all modes, in order of appearance, and (n_modes, n_rows) values."""
    nodes = list(dict.fromkeys(int(node) for mode in modes for node in mode.node))
    directions = sorted({each for mode in modes for each in mode.directions})
    n_cells = len(modes) * len(nodes) * len(directions)
    if n_cells > _MOST_GAPS * sum(mode.values.size for mode in modes):
        found = f"{len(modes)} modes over {len(nodes)} nodes, most of which lack most of them"
        rule = "modes of one structure share their nodes"
        raise RecordingFormatError(path.name, found, rule, COPY_AGAIN)
    table = np.empty((len(modes), len(nodes), len(directions)), dtype=np.complex128)
    row_of = {node: row for row, node in enumerate(nodes)}
    for number, mode in enumerate(modes):
        rows = [row_of[int(node)] for node in mode.node]
        columns = [directions.index(each) for each in mode.directions]
        table[number] = np.nan
        table[number][:, columns] = mode.absent
        table[number][np.ix_(rows, columns)] = mode.values
    return (
        np.repeat(np.array(nodes), len(directions)),
        np.tile(np.array(directions), len(nodes)),
        table.reshape(len(modes), -1),
    )
