"""Comparison of a result's mode shapes with others: finite elements, another program."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from ema.core.display import DASH, number, signed, value_with_std
from ema.core.errors import InputError, unknown
from ema.core.mac import mac
from ema.io.uff.shape_sets import DIRECTIONS
from model.arguments import ReadonlyArrays
from pipelines.compare.shape_source import (
    WAYS,
    Alignment,
    Places,
    ShapeSource,
    common_places,
    of_result,
    read_source,
)
from pipelines.results.store import load
from pipelines.storage.tables import write_csv

#: MAC from which shapes are called the same (customary limit), or similar.
SAME, SIMILAR = 0.9, 0.6
#: Modes with frequencies this close, in percent, may form a pair.
PAIR_PERCENT = 1.0

_FEWEST_PLACES = 3
_RANK = 1e-9  # of the largest singular value: linearly dependent shapes are below
MATCH_HEAD = (
    *("mode", "frequency / Hz", "other mode", "other / Hz", "difference / Hz", "difference / %"),
    *("MAC", "MAC with pair", "verdict"),
)
TEXTS = ("mode", "verdict")


class Likeness(StrEnum):
    """Verdict on a shape and its best match, as tables and ``--json`` show it."""

    SAME_SHAPE = "same shape"
    SIMILAR = "similar"
    NO_COUNTERPART = "no counterpart"


@dataclass(frozen=True)
class Match:
    """The other shape most similar to a mode of the result; modes count from 0."""

    mode: int
    other: int
    mac: float
    # share of the shape explained by the best linear combination of the other's modes near this
    # frequency: a symmetric ring has pairs of modes of arbitrary orientation. Equals `mac` where
    # there is only one such mode.
    mac_pair: float
    # other minus result; NaN where a frequency is unknown
    difference_hz: float
    difference_percent: float

    @property
    def verdict(self) -> Likeness:
        """By the larger MAC."""
        best = max(self.mac, self.mac_pair)
        if best >= SAME:
            return Likeness.SAME_SHAPE
        return Likeness.SIMILAR if best >= SIMILAR else Likeness.NO_COUNTERPART


@dataclass(frozen=True, eq=False)
class ShapeComparison(ReadonlyArrays):
    """All shapes of a result compared with all other shapes; one match for each of its modes.

    `mac` has shape (n_modes, n_other); the notes are assumptions, and what is missing.
    """

    result: ShapeSource
    other: ShapeSource
    places: Places
    mac: NDArray[np.float64]
    matches: tuple[Match, ...]
    notes: tuple[str, ...]


def compare_shapes(
    result: Path | str,
    other: Path | str,
    alignment: Alignment | None = None,
    *,
    accept_changes: bool = False,
) -> ShapeComparison:
    """Compare the mode shapes of a result folder with others.

    Scale, sign and phase of a shape do not matter, nor whether it is real or complex.

    Parameters
    ----------
    result : path
        A result folder.
    other : path
        A universal file, a result folder, or a table of shapes (CSV).
    alignment : Alignment, optional
    accept_changes : bool
        Accept results of which parts were changed; the notes name them.

    Raises
    ------
    InputError
        If one cannot be read, was changed and is not accepted, or fewer than three places match.
    """
    alignment = alignment or Alignment()
    _check(alignment)
    loaded = load(result, accept_changes=accept_changes)
    own = of_result(loaded, Path(result).resolve().name, alignment.direction)
    there = read_source(
        other, alignment.direction, on_wheel=own.has_angles, accept_changes=accept_changes
    )
    return compare_sources(own, there, alignment)


def compare_sources(
    result: ShapeSource, other: ShapeSource, alignment: Alignment | None = None
) -> ShapeComparison:
    """As `compare_shapes`, for shapes that are already read."""
    for each in (result, other):
        if each.frequency_hz.size == 0:
            raise InputError(each.name, "no modes", "mode shapes needed", "Choose another one")
    places = common_places(result, other, alignment or Alignment())
    if places.row.size < _FEWEST_PLACES:
        found = f"{places.row.size} places in common, {places.how}"
        rule = f"at least {_FEWEST_PLACES} common places needed"
        remedy = "Use --by, --tolerance-deg or --rotate-deg, or add the nodes (dataset 2411)"
        raise InputError(f"{result.name} and {other.name}", found, rule, remedy)
    own, there = result.values[:, places.row], other.values[:, places.other_row]
    table = mac(own, there)
    matches = []
    for mode, row in enumerate(table):
        best = int(np.argmax(row))
        here_hz, there_hz = float(result.frequency_hz[mode]), float(other.frequency_hz[best])
        near = np.abs(other.frequency_hz - there_hz) <= PAIR_PERCENT / 100 * there_hz
        near[best] = True
        alike, alone = float(row[best]), np.count_nonzero(near) == 1
        pair = alike if alone else explained_share(own[mode], there[near])
        change = there_hz - here_hz, 100 * (there_hz / here_hz - 1)
        matches.append(Match(mode, best, alike, pair, *change))
    notes = (*result.notes, *other.notes, *places.notes)
    return ShapeComparison(result, other, places, table, tuple(matches), notes)


def explained_share(shape: NDArray[np.complex128], basis: NDArray[np.complex128]) -> float:
    """Share of a shape explained by the best linear combination of other shapes.

    MAC of the shape, (n_places,), with its projection on the span of the others, (n_shapes,
    n_places): 1 − ‖φ − Pφ‖²/‖φ‖².
    """
    power = float(np.vdot(shape, shape).real)
    inside = scipy.linalg.orth(basis.T, _RANK).conj().T @ shape
    return float(np.vdot(inside, inside).real) / power if power > 0 else 0.0


def _check(chosen: Alignment) -> None:
    choices = {"--by": (chosen.by, WAYS), "--direction": (chosen.direction, DIRECTIONS)}
    for option, (value, known) in choices.items():
        if value and value not in known:
            raise unknown(option, value, f"it must be one of {', '.join(known)}", known)
    if not 0 < chosen.tolerance_deg <= 180:
        found, rule = f"{chosen.tolerance_deg:g} degrees", "it must be above 0 and up to 180"
        raise InputError("--tolerance-deg", found, rule, "Write e.g. 2")
    if not isfinite(chosen.rotate_deg):
        found = f"{chosen.rotate_deg:g} degrees"
        raise InputError("--rotate-deg", found, "it must be a finite angle", "Write e.g. 90")


def match_rows(found: ShapeComparison) -> list[tuple[str, ...]]:
    """Best match of each mode, as printed; dashes where there is no counterpart."""
    result, other = found.result, found.other
    rows: list[tuple[str, ...]] = []
    for match in found.matches:
        own_hz, std_hz = result.frequency_hz[match.mode], result.frequency_std_hz[match.mode]
        counterpart = (
            other.mode_name[match.other],
            number(float(other.frequency_hz[match.other]), 5),
            signed(match.difference_hz, 2),
            signed(match.difference_percent, 2),
        )
        if match.verdict is Likeness.NO_COUNTERPART:
            counterpart = (DASH,) * 4
        own = result.mode_name[match.mode], value_with_std(own_hz, std_hz, 5)
        macs = f"{match.mac:.3f}", f"{match.mac_pair:.3f}"
        rows.append((*own, *counterpart, *macs, match.verdict))
    return rows


def comparison_record(found: ShapeComparison) -> dict[str, Any]:
    """Everything for other programs, full digits; modes count from 1."""
    return {
        "result": found.result.name,
        "other": found.other.name,
        "matched_by": found.places.by,
        "places": int(found.places.row.size),
        "notes": list(found.notes),
        "modes": [_record(found, match) for match in found.matches],
        "other_frequency_hz": found.other.frequency_hz.tolist(),
        "mac": found.mac.tolist(),
    }


def write_table(found: ShapeComparison, path: Path) -> None:
    """Write best matches as CSV, followed by a column of MACs for each other mode."""
    others = {f"mac_{other}": column for other, column in enumerate(found.mac.T, 1)}
    rows = [_record(found, match) for match in found.matches]
    matches = {name: [row[name] for row in rows] for name in rows[0]}  # every mode has one
    write_csv(path, matches | others)


def _record(found: ShapeComparison, match: Match) -> dict[str, Any]:
    return {
        "mode": match.mode + 1,
        "name": found.result.mode_name[match.mode],
        "frequency_hz": float(found.result.frequency_hz[match.mode]),
        "frequency_std_hz": float(found.result.frequency_std_hz[match.mode]),
        "other_mode": match.other + 1,
        "other_frequency_hz": float(found.other.frequency_hz[match.other]),
        "difference_hz": match.difference_hz,
        "difference_percent": match.difference_percent,
        "mac": match.mac,
        "mac_with_pair": match.mac_pair,
        "verdict": match.verdict,
    }
