"""What two campaigns have in common and what not: tyre, conditions, set-up and processing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipelines.numbers import plain
from pipelines.result import Result

#: Free keys of ``[tyre]`` that say who, when and on what paper: they move no frequency.
RECORD_KEEPING = frozenset(
    {"comment", "customer", "date", "job", "note", "notes", "number_of_positions", "operator"}
    | {"order_number", "origin", "project", "remark", "remarks", "report", "test_number", "time"}
)
#: Free keys that say how the tyre was held.
BOUNDARY = frozenset(
    {"boundary", "boundary_condition", "boundary_conditions", "mounting", "support"}
)
_UNITS = {"c": "°C", "n": "N", "pa": "Pa", "kpa": "kPa", "bar": "bar", "m": "m", "mm": "mm"}
_UNITS |= {"kg": "kg", "deg": "°", "hz": "Hz", "km": "km", "inch": "inch", "percent": "%"}
BAND = "band / Hz"
AVERAGES = "averages a run"  # follows from the length of a run; σ knows it
#: Options in force that change numbers: place in ``provenance.json``, and what an engineer says.
OPTIONS = {
    "processing.band_hz": BAND,
    "processing.block_seconds": "block length / s",
    "processing.window": "window",
    "processing.overlap": "overlap",
    "processing.averages_per_run": AVERAGES,
    "processing.sampling_rate_hz": "sampling rate / Hz",
    "estimator": "FRF estimator",
    "method": "pole estimator",
    "max_order": "highest model order",
    "pinned_hz": "frequencies pinned / Hz",
    "excluded_hz": "frequencies excluded / Hz",
    "objective": "objective of the tuning",
    "given": "ring parameters given",
}
BARE = "Corrected to the bare tyre"


@dataclass(frozen=True)
class Contrast:
    """One thing that was stated or chosen for two results.

    Parameters
    ----------
    name : str
        What it is, with its unit.
    first, second : str
        As text; empty where it was not stated.
    counts : bool
        Whether it may change frequencies; who measured when does not.
    boundary : bool
        Whether it says how the tyre was held.
    """

    name: str
    first: str
    second: str
    counts: bool = True
    boundary: bool = False

    @property
    def differs(self) -> bool:
        """Whether both are stated and differ, as numbers where they are numbers."""
        return bool(self.first and self.second) and not _same(self.first, self.second)

    @property
    def is_open(self) -> bool:
        """Whether one only is stated, so that nobody can tell."""
        return bool(self.first) != bool(self.second)


def condition_contrasts(first: Result, second: Result) -> tuple[Contrast, ...]:
    """Tyre, conditions and set-up that at least one of two results states."""
    one, two = _stated(first), _stated(second)
    names = list(dict.fromkeys([*one, *two]))
    contrasts = [
        Contrast(
            _title(name),
            one.get(name, ""),
            two.get(name, ""),
            counts=name.lower() not in RECORD_KEEPING,
            boundary=name.lower() in BOUNDARY,
        )
        for name in names
    ]
    return tuple(each for each in contrasts if each.first or each.second)


def processing_contrasts(first: Result, second: Result) -> tuple[Contrast, ...]:
    """Choices in force that change numbers, where at least one result records them."""
    contrasts = [
        Contrast(title, _option(first, place), _option(second, place), counts=title != AVERAGES)
        for place, title in OPTIONS.items()
    ]
    contrasts += [
        Contrast("mass of the sensors", _sensor_mass(first), _sensor_mass(second)),
        Contrast("drift between runs", _drift(first), _drift(second)),
        Contrast("version of ringmodal", _version(first), _version(second)),
    ]
    return tuple(each for each in contrasts if each.first or each.second)


def same_recordings(first: Result, second: Result) -> bool:
    """Whether results share a recording, told by its checksum."""
    one, two = _checksums(first), _checksums(second)
    return bool(one & two)


def _stated(result: Result) -> dict[str, str]:
    stated = {"designation": "structure, no tyre"}
    tyre = result.tyre
    if tyre is not None:
        stated = {"designation": tyre.designation}
        for name in ("inflation_pressure_pa", "mean_radius_m", "belt_width_m"):
            stated[name] = _text(getattr(tyre, name))
        stated |= tyre.details
    stated["force_position_deg"] = _text(result.excitation_deg)
    stated["number_of_positions"] = str(result.frf.n_positions)
    return stated


def _title(name: str) -> str:
    """Name with its unit: ``load_n`` becomes ``"load / N"``."""
    stem, _, ending = name.rpartition("_")
    if stem and ending.lower() in _UNITS:
        return f"{stem.replace('_', ' ')} / {_UNITS[ending.lower()]}"
    return name.replace("_", " ")


def _option(result: Result, place: str) -> str:
    value: Any = result.provenance.get("options", {})
    for key in place.split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    return _text(value)


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} = {_text(each)}" for key, each in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, value)) or "none"
    if isinstance(value, int | float) and not isinstance(value, bool):
        return plain(value)
    return "" if value is None else str(value)


def _sensor_mass(result: Result) -> str:
    bare = any(note.startswith(BARE) for note in result.notes)
    return "taken off" if bare else "left on"


def _drift(result: Result) -> str:
    return "corrected, state of the first run" if result.modal_model.drift.applied else "none found"


def _version(result: Result) -> str:
    return str(result.provenance.get("software", {}).get("ringmodal", ""))


def _checksums(result: Result) -> set[str]:
    """Checksums of the recordings; manifests are alike wherever a lab works from a pattern."""
    inputs = result.provenance.get("inputs", ())
    return {entry["sha256"] for entry in inputs if not entry["file"].endswith(".toml")}


def _same(first: str, second: str) -> bool:
    try:
        return float(first) == float(second)
    except ValueError:
        return first.strip() == second.strip()
