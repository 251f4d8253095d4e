"""Shapes of a result against shapes from elsewhere: a finite-element model, another program."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ema.core.arrays import readonly
from ema.core.errors import InputError, nearest
from ema.core.mac import mac
from ema.io.uff.shape_sets import DIRECTIONS
from pipelines.compare.shape_source import (
    WAYS,
    Places,
    ShapeSource,
    common_places,
    of_result,
    read_source,
)
from pipelines.results.store import load
from pipelines.storage.rounding import DASH, number, signed, value_with_std
from pipelines.storage.tables import table_of, write_csv

SAME, SIMILAR = 0.9, 0.6  # MAC from which shapes are called the same, or similar
SAME_SHAPE, SIMILAR_SHAPE, NO_COUNTERPART = "same shape", "similar", "no counterpart"
PAIR_PERCENT = 1.0  # modes whose frequencies are this close may be the two of a pair

_FEWEST_PLACES = 3
_NO_PART = 1e-9  # of the largest singular value: shapes that add nothing to the others


@dataclass(frozen=True)
class Alignment:
    """How the places of the other shapes are brought to those of the result.

    Parameters
    ----------
    by : {"", "angle", "node"}
        What places are matched by; default: angles where both have them.
    tolerance_deg : float
        Largest difference of angles.
    rotate_deg : float
        Added to the other's angles.
    mirror : bool
        Whether the other's angles count the other way round.
    direction : {"", "radial", "x", "y", "z"}
        What is taken of the motion in a universal file.
    """

    by: str = ""
    tolerance_deg: float = 2.0
    rotate_deg: float = 0.0
    mirror: bool = False
    direction: str = ""


@dataclass(frozen=True)
class Match:
    """The other shape that is most like a mode of the result.

    Parameters
    ----------
    mode, other : int
        Indices from 0.
    mac : float
    mac_pair : float
        Share of the shape that the best sum of the other's modes near this frequency explains:
        the modes of a symmetric ring are pairs, which a model may turn at will. Equals `mac`
        where there is one such mode only.
    difference_hz, difference_percent : float
        Other minus result; NaN where a frequency is unknown.
    """

    mode: int
    other: int
    mac: float
    mac_pair: float
    difference_hz: float
    difference_percent: float

    @property
    def verdict(self) -> str:
        """What the larger MAC says."""
        best = max(self.mac, self.mac_pair)
        return SAME_SHAPE if best >= SAME else SIMILAR_SHAPE if best >= SIMILAR else NO_COUNTERPART


@dataclass(frozen=True, eq=False)
class ShapeComparison:
    """All shapes of a result against all shapes from elsewhere.

    Parameters
    ----------
    result, other : ShapeSource
    places : Places
        Where both are known.
    mac : ndarray, shape (n_modes, n_other)
    matches : tuple of Match
        One for each mode of the result.
    notes : tuple of str
        What was assumed or is missing, in words.
    """

    result: ShapeSource
    other: ShapeSource
    places: Places
    mac: NDArray[np.float64]
    matches: tuple[Match, ...]
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "mac", readonly(self.mac, float))


def compare_shapes(
    result: Path | str,
    other: Path | str,
    alignment: Alignment | None = None,
    *,
    accept_changes: bool = False,
) -> ShapeComparison:
    """Compare the shapes of a result folder with shapes from elsewhere.

    Scale, sign and phase of a shape do not matter, nor whether it is real or complex.

    Parameters
    ----------
    result : path
        A result folder.
    other : path
        A universal file, a result folder, or a table of shapes (CSV).
    alignment : Alignment, optional
    accept_changes : bool
        Whether to take results although parts of them were changed; the notes say so.

    Raises
    ------
    InputError
        If one cannot be read, was changed and is not accepted, or they have fewer than three
        places in common.
    """
    chosen = alignment or Alignment()
    _check(chosen)
    loaded = load(result, accept_changes=accept_changes)
    own = of_result(loaded, Path(result).resolve().name)
    there = read_source(
        other, chosen.direction, on_wheel=own.has_angles, accept_changes=accept_changes
    )
    return compare_sources(own, there, chosen)


def compare_sources(
    result: ShapeSource, other: ShapeSource, alignment: Alignment | None = None
) -> ShapeComparison:
    """As `compare_shapes`, for shapes that have been read already.

    Raises
    ------
    InputError
        If they have fewer than three places in common, or one has no modes.
    """
    chosen = alignment or Alignment()
    for each in (result, other):
        if each.frequency_hz.size == 0:
            raise InputError(each.name, "no modes", "there must be shapes", "Choose another one")
    places = common_places(
        result,
        other,
        by=chosen.by,
        tolerance_deg=chosen.tolerance_deg,
        rotate_deg=chosen.rotate_deg,
        mirror=chosen.mirror,
    )
    if places.row.size < _FEWEST_PLACES:
        raise InputError(
            f"{result.name} and {other.name}",
            f"{places.row.size} places in common, {places.says}",
            f"shapes are compared at {_FEWEST_PLACES} places or more",
            "Choose other ones with --by, --tolerance-deg or --rotate-deg, "
            "or write the nodes (dataset 2411) to the file",
        )
    own, there = result.values[:, places.row], other.values[:, places.other_row]
    table = mac(own, there)
    return ShapeComparison(
        result=result,
        other=other,
        places=places,
        mac=table,
        matches=tuple(_match(result, other, table, own, there, mode) for mode in range(len(table))),
        notes=(*result.notes, *other.notes, *places.notes),
    )


def explained_share(shape: NDArray[np.complex128], basis: NDArray[np.complex128]) -> float:
    """Share of a shape that the best sum of other shapes explains.

    The MAC of the shape with its projection on their span: 1 − ‖φ − Pφ‖²/‖φ‖².

    Parameters
    ----------
    shape : ndarray, shape (n_places,)
    basis : ndarray, shape (n_shapes, n_places)
    """
    left, sizes, _ = np.linalg.svd(basis.T, full_matrices=False)
    span = left[:, sizes > _NO_PART * sizes[0]] if sizes[0] > 0 else left[:, :0]
    power = float(np.vdot(shape, shape).real)
    inside = span.conj().T @ shape
    return float(np.vdot(inside, inside).real) / power if power > 0 else 0.0


def _match(
    result: ShapeSource,
    other: ShapeSource,
    table: NDArray[np.float64],
    own: NDArray[np.complex128],
    there: NDArray[np.complex128],
    mode: int,
) -> Match:
    best = int(np.argmax(table[mode]))
    here_hz, there_hz = float(result.frequency_hz[mode]), float(other.frequency_hz[best])
    near = np.abs(other.frequency_hz - there_hz) <= PAIR_PERCENT / 100 * there_hz
    near[best] = True
    alone = np.count_nonzero(near) == 1
    return Match(
        mode=mode,
        other=best,
        mac=float(table[mode, best]),
        mac_pair=float(table[mode, best]) if alone else explained_share(own[mode], there[near]),
        difference_hz=there_hz - here_hz,
        difference_percent=100 * (there_hz / here_hz - 1),
    )


def _check(chosen: Alignment) -> None:

    for option, value, known in (
        ("--by", chosen.by, WAYS),
        ("--direction", chosen.direction, DIRECTIONS),
    ):
        if value and value not in known:
            rule = f"it must be one of {', '.join(known)}"
            raise InputError(option, repr(value), rule, nearest(value, known))
    if not 0 < chosen.tolerance_deg <= 180:
        found, rule = f"{chosen.tolerance_deg:g} degrees", "it must be above 0 and up to 180"
        raise InputError("--tolerance-deg", found, rule, "Write e.g. 2")
    if not isfinite(chosen.rotate_deg):
        found = f"{chosen.rotate_deg:g} degrees"
        raise InputError("--rotate-deg", found, "it must be a finite angle", "Write e.g. 90")


MATCH_HEAD = (
    "mode",
    "frequency / Hz",
    "other mode",
    "other / Hz",
    "difference / Hz",
    "difference / %",
    "MAC",
    "MAC with pair",
    "verdict",
)
TEXTS = ("mode", "verdict")
_COLUMNS = (
    "mode",
    "name",
    "frequency_hz",
    "frequency_std_hz",
    "other_mode",
    "other_frequency_hz",
    "difference_hz",
    "difference_percent",
    "mac",
    "mac_with_pair",
    "verdict",
)


def match_rows(found: ShapeComparison) -> list[tuple[str, ...]]:
    """Best match of each mode, as printed; dashes where the shapes have nothing in common."""
    return [
        (
            found.result.mode_name[match.mode],
            value_with_std(
                float(found.result.frequency_hz[match.mode]),
                float(found.result.frequency_std_hz[match.mode]),
                5,
            ),
            *_counterpart(found, match),
            f"{match.mac:.3f}",
            f"{match.mac_pair:.3f}",
            match.verdict,
        )
        for match in found.matches
    ]


def _counterpart(found: ShapeComparison, match: Match) -> tuple[str, ...]:
    if match.verdict == NO_COUNTERPART:
        return (DASH,) * 4
    return (
        found.other.mode_name[match.other],
        number(float(found.other.frequency_hz[match.other]), 5),
        signed(match.difference_hz, 2),
        signed(match.difference_percent, 2),
    )


def comparison_record(found: ShapeComparison) -> dict[str, Any]:
    """Everything for other programs, full digits; modes count from 1."""
    return {
        "result": found.result.name,
        "other": found.other.name,
        "matched_by": found.places.by,
        "places": int(found.places.row.size),
        "notes": list(found.notes),
        "modes": [
            dict(zip(_COLUMNS, _values(found, match), strict=True)) for match in found.matches
        ],
        "other_frequency_hz": found.other.frequency_hz.tolist(),
        "mac": found.mac.tolist(),
    }


def write_table(found: ShapeComparison, path: Path) -> None:
    """Write best matches and, in the columns after them, the MAC with each other mode."""
    others = [f"mac_{other + 1}" for other in range(found.mac.shape[1])]
    rows = [
        (*_values(found, match), *macs)
        for match, macs in zip(found.matches, found.mac.tolist(), strict=True)
    ]
    write_csv(path, table_of((*_COLUMNS, *others), rows))


def _values(found: ShapeComparison, match: Match) -> tuple[Any, ...]:
    return (
        match.mode + 1,
        found.result.mode_name[match.mode],
        float(found.result.frequency_hz[match.mode]),
        float(found.result.frequency_std_hz[match.mode]),
        match.other + 1,
        float(found.other.frequency_hz[match.other]),
        match.difference_hz,
        match.difference_percent,
        match.mac,
        match.mac_pair,
        match.verdict,
    )
