"""Labels of figures, charts and tables: short names, units, and room for them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import isotonic_regression

from ema.core.display import signed
from ema.core.errors import visible_line
from ema.core.frf import FRF
from ema.core.modes import ModalModel, Mode
from ema.poles.stability import StabilityDiagram

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


def row_names(frf: FRF | ModalModel, rows: NDArray[np.int_]) -> list[str]:
    """Names of rows of FRFs or shapes, each once: the angle, else the node or the row's number."""
    names = [
        f"{frf.position_deg[row]:g}°"
        if np.isfinite(frf.position_deg[row])
        else str(frf.node[row] if frf.node[row] >= 0 else row + 1)
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
    return np.asarray(isotonic_regression(wanted).x + gap * np.arange(wanted.size))


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
