"""Mode shapes to compare with: of a result, a universal file or a table."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import isnan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ema.core.arrays import readonly
from ema.core.errors import InputError
from ema.core.files import require_regular
from ema.io.uff.shape_sets import read_radial_shapes
from pipelines.export.data import node_numbers
from pipelines.results.check import accepted_notes
from pipelines.results.result import Result
from pipelines.results.store import load
from pipelines.storage.result_folder import MARKER

SHAPES_TABLE = "shapes.csv"


@dataclass(frozen=True, eq=False)
class ShapeSource:
    """Shapes as one value per place.

    Parameters
    ----------
    name : str
        What they are from.
    frequency_hz, damping_ratio : ndarray, shape (n_modes,)
        NaN where unknown.
    mode_name : tuple of str
    node : ndarray of int, shape (n_places,)
        0 where there are no numbers.
    angle_deg : ndarray, shape (n_places,)
        NaN where there are none.
    values : ndarray of complex, shape (n_modes, n_places)
    radius_m, across_m : ndarray, shape (n_places,)
        Distance from the axle, and along it from the middle; NaN where unknown.
    frequency_std_hz : ndarray, shape (n_modes,)
        NaN where unknown; the same where left out.
    notes : tuple of str
        What was assumed.
    """

    name: str
    frequency_hz: NDArray[np.float64]
    damping_ratio: NDArray[np.float64]
    mode_name: tuple[str, ...]
    node: NDArray[np.int_]
    angle_deg: NDArray[np.float64]
    values: NDArray[np.complex128]
    radius_m: NDArray[np.float64]
    across_m: NDArray[np.float64]
    frequency_std_hz: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.frequency_std_hz.size:
            unknown = readonly(np.full(self.frequency_hz.size, np.nan))
            object.__setattr__(self, "frequency_std_hz", unknown)
        for name in ("frequency_hz", "damping_ratio", "angle_deg", "radius_m", "across_m"):
            object.__setattr__(self, name, readonly(getattr(self, name), float))
        object.__setattr__(self, "node", readonly(self.node, int))
        object.__setattr__(self, "values", readonly(self.values, complex))

    @property
    def has_angles(self) -> bool:
        """Whether any place has an angle."""
        return bool(np.isfinite(self.angle_deg).any())

    @property
    def has_nodes(self) -> bool:
        """Whether any place has a number."""
        return bool((self.node > 0).any())


def of_result(result: Result, name: str) -> ShapeSource:
    """Shapes of a result; node numbers are those it is exported with."""
    model, places = result.modal_model, result.frf.n_positions
    radius_m = None if result.tyre is None else result.tyre.mean_radius_m
    return ShapeSource(
        name=name,
        frequency_hz=model.frequencies_hz,
        damping_ratio=model.damping_ratios,
        mode_name=tuple(
            f"{number}" if mode.order is None else f"{number} (n = {mode.order}{mode.member})"
            for number, mode in enumerate(model.modes, start=1)
        ),
        node=node_numbers(result.frf),
        angle_deg=result.frf.position_deg,
        values=np.array([mode.shape for mode in model.modes]).reshape(-1, places),
        radius_m=np.full(places, np.nan if radius_m is None else radius_m),
        across_m=np.zeros(places),
        frequency_std_hz=np.array([mode.frequency_std_hz for mode in model.modes]),
        notes=accepted_notes(result.provenance, name),
    )


def read_source(
    path: Path | str,
    direction: str = "",
    *,
    on_wheel: bool = True,
    accept_changes: bool = False,
) -> ShapeSource:
    """Read shapes from a result folder, a folder or file of tables, or a universal file.

    Parameters
    ----------
    path : path
    direction, on_wheel
        What is taken of the motion in a universal file; see `ema.io.uff.shape_sets`.
    accept_changes : bool
        Whether to take a result although parts of it were changed; the notes say so.

    Raises
    ------
    InputError
        If it is none of these, or damaged.
    """
    path = Path(path)
    if path.is_dir() and (path / MARKER).is_file():
        return of_result(load(path, accept_changes=accept_changes), path.resolve().name)
    if path.is_dir():
        path = path / SHAPES_TABLE
    if not path.is_file():
        rule = "shapes come from a result folder, a universal file or a table"
        raise InputError(str(path), "no such file", rule, "Check the name")
    if path.suffix.lower() == ".csv":
        return _of_table(path)
    found = read_radial_shapes(path, direction, on_wheel=on_wheel)
    return ShapeSource(
        name=path.name,
        frequency_hz=found.frequency_hz,
        damping_ratio=found.damping_ratio,
        mode_name=tuple(str(number) for number in range(1, found.frequency_hz.size + 1)),
        node=found.node,
        angle_deg=found.angle_deg,
        values=found.values,
        radius_m=found.radius_m,
        across_m=found.across_m,
        notes=tuple(f"{path.name}: {note}" for note in found.notes),
    )


def _of_table(path: Path) -> ShapeSource:
    """Shapes of a table with the columns mode, node or position_deg, real, and what else is known.

    ``imag`` and ``frequency_hz`` may be left out.
    """
    rows = list(_rows(path))
    modes = sorted({row["mode"] for row in rows})
    places = list(dict.fromkeys((row["node"], row["position_deg"]) for row in rows))
    mode_at = {mode: at for at, mode in enumerate(modes)}
    place_at = {place: at for at, place in enumerate(places)}
    values = np.full((len(modes), len(places)), complex(np.nan, np.nan))
    frequency_hz = np.full(len(modes), np.nan)
    seen: set[tuple[float, ...]] = set()
    for row in rows:
        at, place = mode_at[row["mode"]], (row["node"], row["position_deg"])
        _require_new(path, seen, (row["mode"], *place))
        values[at, place_at[place]] = complex(row["real"], row["imag"])
        frequency_hz[at] = row["frequency_hz"]
    unknown = np.full(len(places), np.nan)
    return ShapeSource(
        name=path.name,
        frequency_hz=frequency_hz,
        damping_ratio=np.full(len(modes), np.nan),
        mode_name=tuple(f"{mode:g}" for mode in modes),
        node=np.array([int(node) for node, _ in places]),
        angle_deg=np.array([np.nan if angle == _NO_ANGLE else angle for _, angle in places]),
        values=values,
        radius_m=unknown,
        across_m=unknown,
    )


_NO_ANGLE = float("inf")  # NaN is no key: it differs from itself
_DEFAULTS = {"node": 0.0, "position_deg": _NO_ANGLE, "imag": 0.0, "frequency_hz": float("nan")}


def _rows(path: Path) -> Iterator[dict[str, float]]:
    remedy = "Write the columns mode, position_deg or node, real and imag"
    try:
        with require_regular(path).open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file)
            held = set(reader.fieldnames or ())
            if not {"mode", "real"} <= held or not held & {"node", "position_deg"}:
                found = f"columns {', '.join(sorted(held)) or 'none'}"
                raise InputError(
                    str(path), found, "a table of shapes names place and value", remedy
                )
            for row in reader:
                numbers = {
                    name: float(row[name]) if row.get(name) else _default(path, reader, name)
                    for name in ("mode", "real", *_DEFAULTS)
                }
                _require_counts(path, reader.line_num, numbers)
                if isnan(numbers["position_deg"]):
                    numbers["position_deg"] = _NO_ANGLE
                yield numbers
            if reader.line_num < 2:
                raise InputError(str(path), "no lines", "a table of shapes has values", remedy)
    except (ValueError, UnicodeDecodeError, csv.Error) as error:
        if isinstance(error, InputError):
            raise
        where = f"{path}, line {reader.line_num}"
        raise InputError(where, str(error), "cells hold numbers with a point", remedy) from error


def _require_counts(path: Path, line: int, numbers: dict[str, float]) -> None:
    for name in ("mode", "node"):
        if not (numbers[name].is_integer() and numbers[name] >= 0):
            where, rule = f"{path}, line {line}", f"a {name} is a whole number"
            raise InputError(where, f"{name} {numbers[name]:g}", rule, "Number them 1, 2, 3 …")


def _require_new(path: Path, seen: set[tuple[float, ...]], key: tuple[float, ...]) -> None:
    """Refuse a second value of a mode at a place: nobody knows which one is meant."""
    if key in seen:
        mode, node, angle = key
        place = f"node {node:g}" if node else f"{angle:g} degrees"
        rule = "a mode has one value at each place"
        raise InputError(
            str(path), f"two values of mode {mode:g} at {place}", rule, "Keep one direction"
        )
    seen.add(key)


def _default(path: Path, reader: csv.DictReader[str], name: str) -> float:
    if name not in _DEFAULTS:
        where = f"{path}, line {reader.line_num}"
        rule = "each line names a mode and a value"
        raise InputError(where, f"no {name}", rule, "Complete the line")
    return _DEFAULTS[name]


ANGLE, NODE = "angle", "node"
WAYS = (ANGLE, NODE)

_MOST_NAMED = 6


@dataclass(frozen=True, eq=False)
class Places:
    """Rows of two sets of shapes that are of the same places.

    Parameters
    ----------
    by : str
        ``"angle"`` or ``"node"``.
    row, other_row : ndarray of int, shape (n_places,)
    says : str
        How they were found, in words.
    notes : tuple of str
        The same, and what is missing.
    """

    by: str
    row: NDArray[np.int_]
    other_row: NDArray[np.int_]
    says: str
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in ("row", "other_row"):
            object.__setattr__(self, name, readonly(getattr(self, name), int))


def common_places(
    result: ShapeSource,
    other: ShapeSource,
    *,
    by: str = "",
    tolerance_deg: float = 2.0,
    rotate_deg: float = 0.0,
    mirror: bool = False,
) -> Places:
    """Find the place of the other shapes for each place of the result, each used once.

    By angle the nearest node within the tolerance counts; of several around the wheel's section
    the one that is nearest to the circle of the result, in the middle of its width.

    Raises
    ------
    InputError
        If the chosen way needs angles or nodes that one of them lacks.
    """
    way = by or (ANGLE if result.has_angles and other.has_angles else NODE)
    for each in (result, other):
        if not (each.has_angles if way == ANGLE else each.has_nodes):
            what = "angles" if way == ANGLE else "node numbers"
            rule = f"places are matched by {way} here"
            remedy = f"Choose --by {NODE if way == ANGLE else ANGLE}"
            raise InputError(each.name, f"no {what}", rule, remedy)
    usable: NDArray[np.bool_] = np.asarray(np.isfinite(other.values).all(axis=0))
    if way == NODE:
        return _by_node(result, other, usable)
    turned = (-other.angle_deg if mirror else other.angle_deg) + rotate_deg
    return _by_angle(result, other, usable, turned, tolerance_deg)


def _by_node(result: ShapeSource, other: ShapeSource, usable: NDArray[np.bool_]) -> Places:
    row_of = {node: row for row, node in enumerate(other.node.tolist()) if node > 0 and usable[row]}
    pairs = [(row, row_of[node]) for row, node in enumerate(result.node.tolist()) if node in row_of]
    missing = [f"{node}" for node in result.node.tolist() if node not in row_of]
    return _places(NODE, result, pairs, missing, "matched by node number", "node")


def _by_angle(
    result: ShapeSource,
    other: ShapeSource,
    usable: NDArray[np.bool_],
    turned_deg: NDArray[np.float64],
    tolerance_deg: float,
) -> Places:
    radius_m = _radius(result, other)
    aside_m = np.hypot(other.radius_m - radius_m, other.across_m)
    aside_m = np.where(np.isfinite(aside_m), aside_m, 0.0)
    arc_m_per_deg = np.deg2rad(radius_m) if np.isfinite(radius_m) else 1.0
    away = np.abs((turned_deg - result.angle_deg[:, None] + 180.0) % 360.0 - 180.0)
    away[:, ~usable | ~np.isfinite(turned_deg)] = np.inf
    own = np.argmin(away, axis=0)  # a node serves the measured position that is nearest to it
    pairs: list[tuple[int, int]] = []
    for row in range(result.angle_deg.size):
        near = np.flatnonzero((own == row) & (away[row] <= tolerance_deg))
        if near.size:
            distance = np.hypot(away[row, near] * arc_m_per_deg, aside_m[near])
            pairs.append((row, int(near[np.argmin(distance)])))
    offsets = [float(away[pair]) for pair in pairs]
    found = {row for row, _ in pairs}
    missing = [f"{each:g}°" for row, each in enumerate(result.angle_deg) if row not in found]
    says = f"matched by angle within {tolerance_deg:g}°"
    if offsets:
        says += f", at most {round(max(offsets), 3):g}° apart"
        sections = aside_m[[row for _, row in pairs]]
        if sections.max() > 1e-6:
            says += f" and {1e3 * sections.max():.3g} mm off the measured circle"
    return _places(ANGLE, result, pairs, missing, says, "position")


def _radius(result: ShapeSource, other: ShapeSource) -> float:
    """Radius of the measured circle; the other's largest one where it is not known."""
    for known in (result.radius_m, other.radius_m):
        if np.isfinite(known).any():
            return float(np.nanmax(known))
    return float("nan")


def _places(
    by: str,
    result: ShapeSource,
    pairs: list[tuple[int, int]],
    missing: list[str],
    says: str,
    what: str,
) -> Places:
    notes = [f"{len(pairs)} of {result.node.size} places of {result.name} {says}"]
    if missing:
        more = f" and {len(missing) - _MOST_NAMED} more" if len(missing) > _MOST_NAMED else ""
        names = ", ".join(missing[:_MOST_NAMED])
        plural = "s" if len(missing) > 1 else ""
        notes.append(
            f"places of {result.name} left out, without a counterpart: {what}{plural} {names}{more}"
        )
    rows = np.array(pairs, dtype=int).reshape(-1, 2)
    return Places(by, rows[:, 0], rows[:, 1], says, tuple(notes))
