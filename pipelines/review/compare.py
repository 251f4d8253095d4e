"""Several results side by side: their modes as tracks over the conditions, and their FRFs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ema.core.errors import InputError
from ema.core.modes import Mode
from pipelines.results.labels import in_band
from pipelines.results.result import Result
from pipelines.review.curves import blob
from pipelines.review.sight import mode_label

MOST_RESULTS = 12
_SAME_MODE = 0.05  # of modes without order: relative distance of their frequencies
# Conditions over which modes are tracked: key of [tyre], name, unit, factor.
_AXES = (
    ("inflation_pressure_pa", "pressure", "bar", 1e-5),
    ("load_n", "load", "N", 1.0),
    ("temperature_c", "temperature", "°C", 1.0),
)


@dataclass
class _Track:
    """A mode through the results, None where one does not have it."""

    name: str
    order: int | None
    modes: list[Mode | None] = field(default_factory=list)

    @property
    def frequency_hz(self) -> float:
        """Where it was seen last."""
        return next(mode.frequency_hz for mode in reversed(self.modes) if mode is not None)


def compared(results: Sequence[Result], names: Sequence[str]) -> dict[str, Any]:
    """Modes of several results as tracks, and the conditions that all of them state."""
    axes = [axis for axis in (_axis(results, *each) for each in _AXES) if axis is not None]
    return {
        "results": [
            {"id": name, "name": result.name, "condition": _condition(result)}
            for name, result in zip(names, results, strict=True)
        ],
        "tracks": [
            {"name": each.name, "order": each.order, "points": [_point(m) for m in each.modes]}
            for each in sorted(_tracks(results), key=lambda each: each.frequency_hz)
        ],
        "axes": axes,
    }


def frf_blob(results: Sequence[Result], names: Sequence[str], position_deg: float) -> bytes:
    """The FRF of each result at the position nearest to an angle."""
    arrays, rows = {}, []
    for number, result in enumerate(results):
        frf = result.frf
        away = np.abs((frf.position_deg - position_deg + 180) % 360 - 180)
        row = 0 if np.all(np.isnan(away)) else int(np.nanargmin(away))
        lines = in_band(frf.frequency_hz, result.modal_model.fit_band_hz)
        values = frf.values[row, lines]
        arrays[f"frequency_hz_{number}"] = frf.frequency_hz[lines]
        arrays |= {f"real_{number}": values.real, f"imag_{number}": values.imag}
        angle = float(frf.position_deg[row])
        rows.append({"row": row, "position_deg": angle if np.isfinite(angle) else None})
    return blob({"results": list(names), "rows": rows}, arrays)


def _tracks(results: Sequence[Result]) -> list[_Track]:
    """Modes of one order and member belong together; those without order, by frequency."""
    tracks: list[_Track] = []
    for number, result in enumerate(results):
        free = list(tracks)
        for mode in result.modal_model.modes:
            track = _track_of(mode, free)
            if track is None:
                track = _Track(mode_label(mode), mode.order, [None] * number)
                tracks.append(track)
            else:
                free.remove(track)
            track.modes.append(mode)
            if mode.member and track.order is not None:  # seen as a pair in any of the results
                track.name = mode_label(mode)
        for track in tracks:
            track.modes += [None] * (number + 1 - len(track.modes))
    return tracks


def _track_of(mode: Mode, free: Sequence[_Track]) -> _Track | None:
    alike = [
        each
        for each in free
        if each.order == mode.order and (mode.order is not None or _is_near(each, mode))
    ]
    own = [each for each in alike if each.name == mode_label(mode)]
    if mode.order is not None and mode.member:
        # A single mode of another result is either member.
        own = own or [each for each in alike if each.name == str(mode.order)]
        return own[0] if own else None
    return min(
        own or alike, key=lambda each: abs(each.frequency_hz - mode.frequency_hz), default=None
    )


def _is_near(track: _Track, mode: Mode) -> bool:
    return abs(track.frequency_hz / mode.frequency_hz - 1) < _SAME_MODE


def _point(mode: Mode | None) -> dict[str, Any] | None:
    if mode is None:
        return None
    names = "frequency_hz", "frequency_std_hz", "damping_ratio", "damping_std"
    return {name: getattr(mode, name) for name in names} | {
        **{"purity": mode.order_purity, "mpc": mode.mpc, "status": mode.status}
    }


def _stated(result: Result, key: str) -> float | None:
    tyre = result.tyre
    if tyre is None:
        return None
    value = getattr(tyre, key, None)
    try:
        return float(tyre.details[key] if value is None else value)
    except (KeyError, ValueError):
        return None


def _axis(
    results: Sequence[Result], key: str, name: str, unit: str, factor: float
) -> dict[str, Any] | None:
    values = [_stated(result, key) for result in results]
    if any(value is None for value in values):
        return None
    return {
        "name": name,
        "unit": unit,
        "values": [factor * value for value in values if value is not None],
    }


def _condition(result: Result) -> str:
    parts = []
    for key, _, unit, factor in _AXES:
        value = _stated(result, key)
        if value is not None:
            parts.append(f"{factor * value:.4g} {unit}")
    return ", ".join(parts)


def require_few(names: Sequence[str]) -> None:
    """Refuse a comparison of one result, or of too many."""
    if not 2 <= len(set(names)) <= MOST_RESULTS:
        rule = f"2 to {MOST_RESULTS} different ones are compared"
        raise InputError("results", str(len(names)), rule, "Choose others")
