"""Tables of a result folder, column by column as other programs rely on them, and their labels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import chain, takewhile
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ema.checks.corrections import Correction
from ema.core.display import signed
from ema.core.errors import visible_line
from ema.core.frf import FRF
from ema.core.modes import MODE_COLUMNS, ModalModel, Mode
from ema.core.numerics import columns_of
from ema.core.references import References, driving_point
from ema.io.uff.reader import OF_A_RESULT
from ema.io.uff.write import write_frfs as write_universal
from ema.poles.stability import StabilityDiagram
from pipelines.results.result import Result, Validation
from pipelines.storage.tables import Columns, Table, repeating, write_parquet

# Keys of [tyre] in the order of a test report.
KNOWN = (
    *("manufacturer", "model", "construction", "serial", "dot", "rim", "load_n", "temperature_c"),
    *("boundary", "laboratory", "operator", "date"),
)
_NAMES = {
    **{"serial": "Serial number", "dot": "DOT code"},
    **{"boundary": "Boundary condition", "date": "Date of test"},
}
_UNITS = {
    **{
        f"_{unit.lower()}": unit
        for unit in ("Hz", "N", "kg", "Pa", "bar", "m", "mm", "km", "h", "s")
    },
    **{"_deg": "°", "_c": "°C", "_percent": "%", "_m_s": "m/s", "_km_h": "km/h"},
}
#: Columns of ``modes.csv``.
MODES = ("mode", *MODE_COLUMNS)
# Columns of ``orders.csv``, and where an `OrderReport` has them.
_ORDERS = {
    **{"order": "order", "verdict": "pair.verdict", "chance": "pair.chance"},
    **{"frequency_hz": "frequency_hz", "frequency_std_hz": "frequency_std_hz"},
    **{"damping_ratio": "damping_ratio", "damping_ratio_std": "damping_std"},
    "evidence": "pair.evidence",
    **{name: name for name in ("antinode_deg", "antinode_std_deg")},
}
# Columns of ``other_modes.csv``, and where an `OtherMode` has them.
_OTHER = {
    **{name: name for name in ("direction", "force_direction", "order", "name")},
    **{name: name for name in ("frequency_hz", "frequency_std_hz", "damping_ratio")},
    **{"damping_ratio_std": "damping_std"},
    **{name: name for name in ("order_purity", "n_positions")},
}
_CORRECTIONS = {each.name: each.name for each in fields(Correction)}
_VALIDATION = (
    *("order", "measured_hz", "model_hz", "error_percent"),
    *("measured_damping", "model_damping", "mac"),
)
_DIRECTIONS = ("", "X", "Y", "Z")
_OF_FORCE = ("force_node", "force_axis")  # in the metadata of Parquet files


def named(key: str, text: str) -> tuple[str, str]:
    """Name and value of a key of the manifest, its unit by the key's ending.

    ``("load_n", "4000")`` → ``("Load", "4000 N")``.
    """
    endings = (ending for ending in _UNITS if key.endswith(ending) and key != ending)
    ending = max(endings, key=len, default="")
    name, unit = key.removesuffix(ending).replace("_", " "), _UNITS.get(ending, "")
    name = _NAMES.get(key, name[:1].upper() + name[1:])
    if not unit:
        return name, text
    return name, f"{text.removesuffix('.0')}{'' if unit == '°' else ' '}{unit}"


def place_name(node: int, position_deg: float) -> str:
    """Name of a position as labels show it: "node 20, 100°"."""
    where = [f"node {node}"] if node >= 0 else []
    if np.isfinite(position_deg):
        where.append(f"{position_deg:g}°")
    return ", ".join(where) or "unnamed position"


def axis_letters(axis: NDArray[np.int_]) -> list[str]:
    """Letters of axes 1 to 3; nothing where none is stated."""
    return [_DIRECTIONS[each] for each in axis.clip(0, 3).tolist()]


def row_names(frf: FRF | ModalModel, rows: NDArray[np.int_]) -> list[str]:
    """Names of rows of FRFs or shapes, each once: the angle, else the node or the row's number."""
    axes = axis_letters(frf.axis) or [""] * frf.node.size  # no axis is known of a model's rows
    names = [
        f"{frf.position_deg[row]:g}°"
        if np.isfinite(frf.position_deg[row])
        else f"{frf.node[row] if frf.node[row] >= 0 else row + 1}{axes[row]}"
        for row in rows
    ]
    return each_once(names)


def each_once(names: Sequence[str]) -> list[str]:
    """Names of which no two are the same: a second one is followed by (2)."""
    seen: Counter[str] = Counter()
    found = []
    for name in names:
        seen[name] += 1
        found.append(f"{name} ({seen[name]})" if seen[name] > 1 else name)
    return found


def numbered(every: Sequence[FRF]) -> tuple[FRF, ...]:
    """FRFs of a structure whose rows are told apart by node, from 1, and axis.

    Node numbers are those of the FRFs where they do so, else each place gets one of its own.
    """
    rows = [[*zip(frf.node.tolist(), frf.axis.tolist(), strict=True)] for frf in every]
    if all(min(each)[0] > 0 and len(set(each)) == len(each) for each in rows):
        return tuple(every)
    places = [
        each_once([f"{node} {axis} {name}" for (node, axis), name in zip(row, names, strict=True)])
        for row, names in zip(rows, (frf.channel for frf in every), strict=True)
    ]
    numbers = {name: k for k, name in enumerate(dict.fromkeys(chain(*places)), start=1)}
    found = []
    for frf, names in zip(every, places, strict=True):
        node, force_node, at = np.array([numbers[n] for n in names]), 0, driving_point(frf)
        if at is not None:
            force_node = int(node[at[0]])
        elif frf.force_node > 0:
            force_node = numbers.setdefault(f"force {frf.force_node}", len(numbers) + 1)
        found.append(replace(frf, node=node, force_node=force_node))
    return tuple(found)


def mode_name(mode: Mode) -> str:
    """Short name of a mode: order and member where known, and frequency."""
    frequency = f"{mode.frequency_hz:.1f} Hz"
    return frequency if mode.order is None else f"n = {mode.order}{mode.member}, {frequency}"


def short(text: str, length: int = 28) -> str:
    """`text`, cut in the middle where it is longer than `length`."""
    if len(text) <= length:
        return text
    tail = (length - 1) // 2
    return f"{text[: length - 1 - tail]}…{text[-tail:]}"


def apart(names: Sequence[str], length: int = 16) -> list[str]:
    """Names for a legend; if one is longer than `length`, without what all of them share."""
    if max(map(len, names), default=0) <= length:
        return list(names)
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    shared = len(list(alike))
    # A single name, or equal names, share everything: they are only shortened.
    if shared < 2 or len(set(names)) == 1:
        return [short(name, length) for name in names]
    return [short(f"…{name[shared:]}", length) for name in names]


def literal(text: str) -> str:
    """`text` without markup: dollar signs are escaped, control characters named."""
    return visible_line(text).replace("$", r"\$")


def signed_cell(value: float) -> str:
    """A value with its sign and two digits; zero has a plus."""
    return signed(round(float(value), 2) + 0.0, 2)


def spread(positions: ArrayLike, gap: float) -> NDArray[np.float64]:
    """Positions at least `gap` apart, nearest to the given ascending ones by least squares."""
    wanted = np.asarray(positions, dtype=float) - gap * np.arange(np.size(positions))
    if not wanted.size:
        return np.zeros(0)
    return np.asarray(scipy.optimize.isotonic_regression(wanted).x + gap * np.arange(wanted.size))


def sparse_labels(labels: Sequence[str], at_most: int = 13) -> tuple[list[int], list[str]]:
    """Every k-th index and label, so that at most `at_most` ticks are drawn."""
    # Steps that people count in; grids of 5° then show 30° or 60°.
    steps = (1, 2, 3, 6, 12, 24, 48, 120, 240, 600, 1200)
    step = next((step for step in steps if len(labels) / step <= at_most), len(labels))
    indices = list(range(0, len(labels), step))
    return indices, [labels[index] for index in indices]


@dataclass(frozen=True, eq=False)
class CoherenceMap:
    """Coherence by position and frequency, averaged over neighbouring lines."""

    frequency_hz: NDArray[np.float64]  # shape (n_columns,); middle of each column
    names: tuple[str, ...]  # name of each row, in ascending angle
    values: NDArray[np.float64]  # shape (n_rows, n_columns); NaN where unknown
    averaged: int  # lines in one column
    band_hz: tuple[float, float]


def coherence_map(frf: FRF, band_hz: tuple[float, float], most_columns: int) -> CoherenceMap:
    """Coherence sorted by position, in at most `most_columns` columns."""
    inside = in_band(frf.frequency_hz, band_hz)
    rows = np.argsort(frf.position_deg, kind="stable")
    lines_hz, values = frf.frequency_hz[inside], frf.coherence[rows][:, inside]
    width = max(1, -(-lines_hz.size // most_columns))
    return CoherenceMap(
        _mean_by_column(lines_hz[None, :], width)[0],
        tuple(row_names(frf, rows)),
        _mean_by_column(values, width),
        width,
        band_hz,
    )


def in_band(frequency_hz: NDArray[np.float64], band_hz: tuple[float, float]) -> NDArray[np.bool_]:
    """Which frequencies, shape (n_lines,), lie in a band in Hz, its ends included."""
    return np.asarray((frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1]))


def pole_marks(diagram: StabilityDiagram) -> dict[str, NDArray[np.bool_]]:
    """Legend entries of the stability diagram with their poles; each pole of the band has one."""
    kept_labels = [cluster.label for cluster in diagram.clusters if cluster.kept]
    kept = np.isin(diagram.cluster, kept_labels)
    stable = diagram.stable_frequency & diagram.stable_damping
    inside = in_band(diagram.frequency_hz, diagram.band_hz)
    return {
        "not stable": ~stable & ~kept & inside,
        "stable, not in a mode": stable & ~kept & inside,
        "in a mode, not stable": ~stable & kept & inside,
        "in a mode": stable & kept & inside,
    }


def wrapped_phase_deg(values: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Phase of complex values, shape (n_lines,), in degrees; NaN where it wraps."""
    phase = np.rad2deg(np.angle(values))
    phase[1:][np.abs(np.diff(phase)) > 180] = np.nan
    return np.asarray(phase)


def _mean_by_column(values: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Mean over `width` neighbouring columns, unknown ones left out."""
    padding = -values.shape[1] % width
    padded = np.pad(values, ((0, 0), (0, padding)), constant_values=np.nan)
    bins = padded.reshape(values.shape[0], -1, width)
    known = np.isfinite(bins).sum(axis=2)
    total = np.nansum(bins, axis=2)
    mean = np.full(total.shape, np.nan)
    return np.asarray(np.divide(total, known, out=mean, where=known > 0))


def csv_tables(result: Result) -> dict[str, Columns]:
    """Tables of a result folder that are CSV, by file name."""
    several = {"references.csv": references(result)} if result.references else {}
    return several | {
        "modes.csv": result.modal_model.to_columns(),
        "shapes.csv": shapes(result),
        "orders.csv": columns_of(result.modal_model.orders, _ORDERS),
        "quality.csv": result.to_columns(),
        "corrections.csv": columns_of(result.corrections, _CORRECTIONS),
        "other_modes.csv": columns_of(result.other_modes, _OTHER),
        "validation.csv": validation(result.validation),
    }


def shapes(result: Result) -> Columns:
    """``shapes.csv``: a row for each mode and position (on a circle) or node (elsewhere)."""
    frf, modes = result.frf, result.modal_model.modes
    place = "position_deg" if np.all(np.isfinite(frf.position_deg)) else "node"
    shape = np.concatenate([np.zeros(0), *(mode.shape for mode in modes)])
    known = place == "node" and frf.axis.any()
    directions = {"direction": axis_letters(frf.axis) * len(modes)} if known else {}
    return {
        "mode": np.repeat(np.arange(1, len(modes) + 1), frf.n_positions),
        place: np.tile(getattr(frf, place), len(modes)),
        "real": shape.real,
        "imag": shape.imag,
        **directions,
    }


def references(result: Result) -> Columns:
    """``references.csv``: a row for each of several forces and each mode that it drives."""
    found = [(each, result.modal_model.modes[each.mode - 1]) for each in result.references]
    return {
        "reference": [each.reference for each, _ in found],
        "position_deg": [each.position_deg for each, _ in found],
        "node": [each.node for each, _ in found],
        "direction": axis_letters(np.array([each.axis for each, _ in found])),
        "mode": [each.mode for each, _ in found],
        "order": [mode.order for _, mode in found],
        "member": [mode.member for _, mode in found],
        "frequency_hz": [mode.frequency_hz for _, mode in found],
        "share": [each.share for each, _ in found],
        "drive": [each.drive for each, _ in found],
        "participation_real": [each.participation[0] for each, _ in found],
        "participation_imag": [each.participation[1] for each, _ in found],
    }


def validation(found: Validation | None) -> Columns:
    """``validation.csv``: a row for each order; none where the ring steps were left out."""
    if found is None:
        return dict.fromkeys(_VALIDATION, ())
    columns = {name: getattr(found, name) for name in _VALIDATION}
    return {**columns, "mac": np.diag(found.mac)}


def poles(diagram: StabilityDiagram) -> Columns:
    """``poles.parquet``: every pole of every model order, in the order it was found."""
    return {**diagram.to_columns(), "row": np.arange(diagram.cluster.size)}


def frfs(*every: FRF, numbers: tuple[int, ...] = ()) -> Columns:
    """``frf.parquet`` and ``reference.parquet``, position by position, force after force.

    `numbers` are those of the forces, by default 1, 2, …; a column where there are others than 1.
    """
    numbers = numbers or tuple(range(1, len(every) + 1))
    n_lines = np.concatenate([np.full(frf.n_positions, frf.frequency_hz.size) for frf in every])

    def of_rows(name: str) -> NDArray[Any]:
        return np.concatenate([np.asarray(getattr(frf, name)) for frf in every])

    def of_lines(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(frf, name).ravel() for frf in every])

    values = of_lines("values")
    named = {name: np.unique(of_rows(name), return_inverse=True) for name in ("run", "channel")}
    columns = {
        **{name: np.repeat(of_rows(name), n_lines) for name in ("position_deg", "node")},
        "frequency_hz": np.concatenate([np.tile(f.frequency_hz, f.n_positions) for f in every]),
        **{"real": values.real, "imag": values.imag},
        **{name: of_lines(name).astype(np.float32) for name in ("coherence", "std")},
        "axis": np.repeat(of_rows("axis").astype(np.int8), n_lines),
        "row": np.repeat(np.arange(n_lines.size, dtype=np.int32), n_lines),
        **{
            name: repeating(np.repeat(number, n_lines), known.tolist())
            for name, (known, number) in named.items()
        },
    }
    if numbers != (1,):
        force = np.repeat(numbers, [f.n_positions for f in every])
        columns["reference"] = np.repeat(force, n_lines)
    return columns


def write_frfs(every: Sequence[FRF], folder: Path) -> None:
    """Write the FRFs of all positions, and those of the reference sensor if there are any.

    FRFs of several forces follow each other, and a column tells whose they are.
    """
    frf = every[0]
    universal = References(tuple(every)) if every[1:] else frf
    write_universal(folder / "frf.uff", universal, note=OF_A_RESULT)
    metadata = {name: str(getattr(frf, name)) for name in _OF_FORCE}
    metadata["n_positions"] = str(sum(each.n_positions for each in every))
    write_parquet(folder / "frf.parquet", frfs(*every), metadata)
    fixed = {k: each.reference for k, each in enumerate(every, 1) if each.reference is not None}
    if fixed:
        metadata |= {"n_positions": str(sum(each.n_positions for each in fixed.values()))}
        table = frfs(*fixed.values(), numbers=tuple(fixed))
        write_parquet(folder / "reference.parquet", table, metadata)


def read_frfs(path: Path) -> dict[int, FRF]:
    """Read the FRFs of ``frf.parquet`` or ``reference.parquet``, by the number of their force."""
    every, table = read_frf(path), Table(path)
    if "reference" not in table.names:
        return {1: every}
    of_line, row = (table.numbers(name).astype(int) for name in ("reference", "row"))
    of_row = np.zeros(every.n_positions, dtype=int)
    of_row[row] = of_line
    if np.any(of_row < 1) or np.any(of_row[row] != of_line):
        numbers = np.unique(of_line).tolist()
        raise table.unusable(f"references {numbers}", "they count from 1, one for a row")
    return {int(number): every.rows(of_row == number) for number in np.unique(of_row)}


def read_frf(path: Path) -> FRF:
    """Read the FRFs of ``frf.parquet`` (or ``reference.parquet``), their rows in any order.

    Raises
    ------
    InputError
        If it is not what was written.
    """
    table = Table(path)
    frequency_hz = table.numbers("frequency_hz")
    row = table.numbers("row").astype(int)
    if np.any(row < 0) or np.any(row >= max(table.n_rows, 1)):
        raise table.unusable(f"row {row.min()} to {row.max()}", "they count from 0")
    order = np.lexsort((frequency_hz, row))
    row, lines = row[order], frequency_hz[order]
    n_rows = int(row[-1]) + 1 if row.size else 0
    n_lines = row.size // max(n_rows, 1)
    if not n_rows or row.size % n_rows or np.any(row != np.arange(row.size) // n_lines):
        rule = "each FRF must have the same lines"
        raise table.unusable("rows missing, doubled or misnumbered", rule)

    def grid(values: NDArray[Any]) -> NDArray[Any]:
        return values[order].reshape(n_rows, -1)

    def of_row(name: str, values: NDArray[Any]) -> NDArray[Any]:
        by_line = grid(values)
        same = (by_line == by_line[:, :1]) | (np.isnan(by_line) & np.isnan(by_line[:, :1]))
        if not np.all(same):
            raise table.unusable(f"several values of {name}", "an FRF has one")
        return np.asarray(by_line[:, 0])

    def words(name: str) -> tuple[str, ...]:
        index, texts = table.texts(name)
        return tuple(texts[at] for at in of_row(name, index))

    by_row = lines.reshape(n_rows, -1)
    if n_lines < 2 or np.any(by_row != by_row[0]):
        rule = "all must have the same two or more"
        raise table.unusable("frequencies differ between FRFs", rule)
    if by_row[0, 0] < 0 or np.any(np.diff(by_row[0]) <= 0):
        raise table.unusable("negative or repeated frequencies", "must be ≥ 0 and rise")
    return FRF(
        frequency_hz=lines[:n_lines],
        values=grid(table.numbers("real")) + 1j * grid(table.numbers("imag")),
        coherence=grid(table.numbers("coherence", unknown=True)),
        std=grid(table.numbers("std", unknown=True)),
        node=of_row("node", table.numbers("node")),
        position_deg=of_row("position_deg", table.numbers("position_deg", unknown=True)),
        run=words("run"),
        channel=words("channel"),
        axis=of_row("axis", table.numbers("axis")).astype(int),
        force_node=table.stated("force_node"),
        force_axis=table.stated("force_axis"),
    )
