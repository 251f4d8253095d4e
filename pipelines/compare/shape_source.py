"""Mode shapes of a result, a universal file or a table, and the places that two of them share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ema.core.errors import InputError
from ema.core.files import require_regular
from ema.io.uff.shape_sets import AXES, read_radial_shapes
from model.arguments import ReadonlyArrays
from pipelines.results.provenance import accepted_notes
from pipelines.results.result import Result
from pipelines.results.store import load
from pipelines.results.tables import axis_letters, numbered
from pipelines.storage.atomic import MARKER, named

SHAPES_TABLE = "shapes.csv"
ANGLE, NODE = "angle", "node"
WAYS = (ANGLE, NODE)

_MOST_NAMED = 6  # places named in a note
_OFF_CIRCLE_M = 1e-6  # distance from the measured circle that is worth a note
_REMEDY = "Write the columns mode, position_deg or node, real and imag"
_DEFAULTS = {"node": 0.0, "position_deg": np.nan, "imag": 0.0, "frequency_hz": np.nan}


@dataclass(frozen=True, eq=False)
class ShapeSource(ReadonlyArrays):
    """Mode shapes with one value per place."""

    name: str  # result, file or table
    # shape (n_modes,); NaN where unknown
    frequency_hz: NDArray[np.float64]
    frequency_std_hz: NDArray[np.float64]
    damping_ratio: NDArray[np.float64]
    mode_name: tuple[str, ...]
    node: NDArray[np.int_]  # shape (n_places,); 0 where there are no numbers
    angle_deg: NDArray[np.float64]  # shape (n_places,); NaN where unknown
    values: NDArray[np.complex128]  # shape (n_modes, n_places)
    # shape (n_places,); distance from the axle, and along the axle from the middle; NaN where
    # unknown
    radius_m: NDArray[np.float64]
    across_m: NDArray[np.float64]
    notes: tuple[str, ...] = ()  # assumptions

    @property
    def has_angles(self) -> bool:
        """Whether any place has an angle."""
        return bool(np.isfinite(self.angle_deg).any())

    @property
    def has_nodes(self) -> bool:
        """Whether any place has a node number."""
        return bool((self.node > 0).any())


def of_result(result: Result, name: str, direction: str = "") -> ShapeSource:
    """Shapes of a result, with the node numbers of its export.

    Where nodes move along several axes, `direction` (x, y, z) chooses one of them.
    """
    frf = numbered([result.frf])[0]
    rows = np.arange(frf.n_positions)
    if np.unique(frf.node).size < rows.size:
        rows = np.flatnonzero([letter == direction.upper() for letter in axis_letters(frf.axis)])
        if direction not in AXES or not rows.size:
            letters = sorted(set(axis_letters(frf.axis)))
            found, rule = f"motion along {', '.join(letters)}", "shapes are compared along one axis"
            raise InputError(name, found, rule, f"Add --direction {letters[-1].lower()}")
    model, places = result.modal_model, rows.size
    radius_m = None if result.tyre is None else result.tyre.mean_radius_m
    return ShapeSource(
        name=name,
        frequency_hz=model.frequencies_hz,
        frequency_std_hz=np.array([mode.frequency_std_hz for mode in model.modes]),
        damping_ratio=model.damping_ratios,
        mode_name=tuple(
            f"{number}" if mode.order is None else f"{number} (n = {mode.order}{mode.member})"
            for number, mode in enumerate(model.modes, start=1)
        ),
        node=frf.node[rows],
        angle_deg=frf.position_deg[rows],
        values=np.array([mode.shape[rows] for mode in model.modes]).reshape(-1, places),
        radius_m=np.full(places, np.nan if radius_m is None else radius_m),
        across_m=np.zeros(places),
        notes=accepted_notes(result.provenance, name),
    )


def read_source(
    path: Path | str, direction: str = "", *, on_wheel: bool = True, accept_changes: bool = False
) -> ShapeSource:
    """Read shapes from a result folder, a folder or file of tables, or a universal file.

    `direction` and `on_wheel` choose the motion in a universal file, see `ema.io.uff.shape_sets`.
    With `accept_changes` parts of a result may have been changed; the notes name them.
    """
    path = Path(path)
    if path.is_dir() and (path / MARKER).is_file():
        loaded = load(path, accept_changes=accept_changes)
        return of_result(loaded, path.resolve().name, direction)
    if path.is_dir():
        path = path / SHAPES_TABLE
    if not path.is_file():
        rule = "shapes are read from a result folder, a universal file or a table"
        raise InputError(str(path), "no such file", rule, "Check the name")
    if path.suffix.lower() == ".csv":
        return _of_table(path, direction)
    found = read_radial_shapes(path, direction, on_wheel=on_wheel)
    n_modes = found.frequency_hz.size
    notes = tuple(f"{path.name}: {note}" for note in found.notes)
    return ShapeSource(
        name=path.name,
        mode_name=tuple(str(number) for number in range(1, n_modes + 1)),
        frequency_std_hz=np.full(n_modes, np.nan),
        **{**vars(found), "notes": notes},
    )


def _of_table(path: Path, direction: str) -> ShapeSource:
    """Shapes of a table with the columns mode, node or position_deg, real, imag, frequency_hz.

    Rows of other axes than `direction` are left out where the table has a column of that name.
    """
    rows = _read_table(path)
    if direction in AXES and rows["direction"].isin([*AXES]).any():
        rows = rows[rows["direction"] == direction]
    # A place is a node, an angle, or both.
    place = rows.groupby(["node", "position_deg"], dropna=False, sort=False).ngroup()
    twice = rows.duplicated(["mode", "node", "position_deg"])
    if twice.any():  # the direction of the second one is unknown
        row = rows[twice].iloc[0]
        where = f"node {row['node']:g}" if row["node"] else f"{row['position_deg']:g} degrees"
        found, rule = f"two values of mode {row['mode']:g} at {where}", "a mode has one value"
        remedy = "Keep one direction, or choose one of a column direction with --direction"
        raise InputError(str(path), found, f"{rule} at each place", remedy)
    modes, mode_at = np.unique(rows["mode"], return_inverse=True)
    places = rows[~place.duplicated()]
    values = np.full((modes.size, len(places)), complex(np.nan, np.nan))
    values[mode_at, place] = rows["real"] + 1j * rows["imag"]
    frequency_hz = np.full(modes.size, np.nan)
    frequency_hz[mode_at] = rows["frequency_hz"]
    unknown = np.full(len(places), np.nan)
    return ShapeSource(
        name=path.name,
        frequency_hz=frequency_hz,
        frequency_std_hz=np.full(modes.size, np.nan),
        damping_ratio=np.full(modes.size, np.nan),
        mode_name=tuple(f"{mode:g}" for mode in modes),
        node=places["node"].to_numpy(int),
        angle_deg=places["position_deg"].to_numpy(),
        values=values,
        radius_m=unknown,
        across_m=unknown,
    )


def _read_table(path: Path) -> pd.DataFrame:
    try:
        cells = pd.read_csv(
            require_regular(path), dtype=str, keep_default_na=False, encoding="utf-8-sig"
        )
    except InputError:
        raise
    except ValueError as error:  # UTF-8, or what pandas raises
        raise InputError(str(path), str(error), "it must be a table in UTF-8", _REMEDY) from error
    held = set(map(str, cells))
    if not {"mode", "real"} <= held or not held & {"node", "position_deg"}:
        found = f"columns {', '.join(sorted(held))}"
        raise InputError(str(path), found, "columns for mode, place and value needed", _REMEDY)
    if cells.empty:
        raise InputError(str(path), "no lines", "values needed", _REMEDY)
    rows = pd.DataFrame(index=cells.index)
    for name in ("mode", "real", *_DEFAULTS):
        text = cells[name].str.strip() if name in cells else pd.Series("", cells.index)
        rows[name] = pd.to_numeric(text, errors="coerce").astype(float)
        is_empty = text == ""
        _require(path, rows[name].notna() | is_empty | (text.str.lower() == "nan"), name, text)
        if name in _DEFAULTS:
            rows.loc[is_empty, name] = _DEFAULTS[name]
        elif is_empty.any():
            where = f"{path}, line {is_empty.argmax() + 2}"
            rule = "each line needs a mode and a value"
            raise InputError(where, f"no {name}", rule, "Complete the line")
        if name in ("mode", "node"):
            _require(path, (rows[name] >= 0) & (rows[name] % 1 == 0), name, text, "a whole number")
    rows["direction"] = cells["direction"].str.strip().str.lower() if "direction" in cells else ""
    return rows


def _require(
    path: Path, good: pd.Series[bool], name: str, text: pd.Series[str], what: str = "a number"
) -> None:
    """Refuse the first bad cell of a column."""
    if not good.all():
        row = int(np.argmin(good))
        where, rule = f"{path}, line {row + 2}", f"{name} must be {what}"
        raise InputError(where, f"{name} {text.iloc[row]}", rule, "Write e.g. 1, or 1.5e-3")


@dataclass(frozen=True)
class Alignment:
    """How places of other shapes are matched with those of a result."""

    by: str = ""  # {"", "angle", "node"}; default: angles where both have them
    tolerance_deg: float = 2.0  # largest difference of angles
    rotate_deg: float = 0.0  # added to the other's angles
    mirror: bool = False  # whether the other's angles count the other way round
    # {"", "radial", "x", "y", "z"}; component of the motion in a universal file
    direction: str = ""


@dataclass(frozen=True, eq=False)
class Places(ReadonlyArrays):
    """Rows of two sets of shapes at the same places, matched by angle or node.

    `how` is the way and its accuracy, for messages; the notes also name missing places.
    """

    by: str
    row: NDArray[np.int_]
    other_row: NDArray[np.int_]
    how: str
    notes: tuple[str, ...]


def common_places(result: ShapeSource, other: ShapeSource, alignment: Alignment) -> Places:
    """Find the place of the other shapes for each place of the result, each used once.

    By angle: the nearest node within the tolerance; of several over the cross-section the one
    nearest to the measured circle, in the middle of the width.
    """
    way = alignment.by or (ANGLE if result.has_angles and other.has_angles else NODE)
    for each in (result, other):
        if not (each.has_angles if way == ANGLE else each.has_nodes):
            what = "angles" if way == ANGLE else "node numbers"
            remedy = f"Choose --by {NODE if way == ANGLE else ANGLE}"
            raise InputError(each.name, f"no {what}", f"places are matched by {way}", remedy)
    usable = np.asarray(np.isfinite(other.values).all(axis=0))
    if way == ANGLE:
        pairs, how = _by_angle(result, other, usable, alignment)
        names = [f"{angle:g}°" for angle in result.angle_deg]
    else:
        row_of = {n: row for row, n in enumerate(other.node.tolist()) if n > 0 and usable[row]}
        pairs = [(row, row_of[n]) for row, n in enumerate(result.node.tolist()) if n in row_of]
        how, names = "matched by node number", [f"{node}" for node in result.node]
    notes = [f"{len(pairs)} of {result.node.size} places of {result.name} {how}"]
    found = {row for row, _ in pairs}
    missing = [name for row, name in enumerate(names) if row not in found]
    if missing:
        what = ("position" if way == ANGLE else "node") + "s" * (len(missing) > 1)
        notes.append(
            f"places of {result.name} left out, without a counterpart: {what} "
            f"{named(missing, _MOST_NAMED)}"
        )
    rows = np.array(pairs, dtype=int).reshape(-1, 2)
    return Places(way, rows[:, 0], rows[:, 1], how, tuple(notes))


def _by_angle(
    result: ShapeSource, other: ShapeSource, usable: NDArray[np.bool_], alignment: Alignment
) -> tuple[list[tuple[int, int]], str]:
    """Matched rows, and how far apart they are."""
    turned = (-other.angle_deg if alignment.mirror else other.angle_deg) + alignment.rotate_deg
    radii = [each.radius_m for each in (result, other) if np.isfinite(each.radius_m).any()]
    radius_m = float(np.nanmax(radii[0])) if radii else np.nan  # the measured circle, if known
    aside_m = np.nan_to_num(np.hypot(other.radius_m - radius_m, other.across_m))
    arc_m_per_deg = np.deg2rad(radius_m) if radii else 1.0
    away = np.abs((turned - result.angle_deg[:, None] + 180.0) % 360.0 - 180.0)
    away[:, ~usable | ~np.isfinite(turned)] = np.inf
    own = np.argmin(away, axis=0)  # a node serves the measured position nearest to it
    pairs: list[tuple[int, int]] = []
    for row in range(result.angle_deg.size):
        near = np.flatnonzero((own == row) & (away[row] <= alignment.tolerance_deg))
        if near.size:
            distance = np.hypot(away[row, near] * arc_m_per_deg, aside_m[near])
            pairs.append((row, int(near[np.argmin(distance)])))
    how = f"matched by angle within {alignment.tolerance_deg:g}°"
    if pairs:
        how += f", at most {round(max(float(away[pair]) for pair in pairs), 3):g}° apart"
        off_m = aside_m[[row for _, row in pairs]].max()
        if off_m > _OFF_CIRCLE_M:
            how += f" and {1e3 * off_m:.3g} mm off the measured circle"
    return pairs, how
