"""A comparison of shapes as rows: for a screen, a page, a table and other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipelines.numbers import DASH, number, signed, value_with_std
from pipelines.shape_comparison import NO_COUNTERPART, Match, ShapeComparison
from pipelines.tables import write_csv

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
    write_csv(path, (*_COLUMNS, *others), rows)


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
