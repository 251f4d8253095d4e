"""What two campaigns have in common and what not: tyre, conditions, set-up and processing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pipelines.results.conditions import named
from pipelines.results.labels import short
from pipelines.results.result import Result
from pipelines.storage.rounding import plain

#: Free keys of ``[tyre]`` that say who, when and on what paper: they move no frequency.
RECORD_KEEPING = frozenset(
    {"comment", "customer", "date", "job", "note", "notes", "number_of_positions", "operator"}
    | {"order_number", "origin", "project", "remark", "remarks", "report", "test_number", "time"}
)
#: Free keys that say how the tyre was held.
BOUNDARY = frozenset(
    {"boundary", "boundary_condition", "boundary_conditions", "mounting", "support"}
)
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
NO_TYRE = "structure, not described as a tyre"
BARE = "Corrected to the bare tyre"


@dataclass(frozen=True)
class Contrast:
    """One thing that was stated or chosen for two results.

    Parameters
    ----------
    name : str
    first, second : str
        With the unit; empty where it was not stated.
    differs : bool
        Whether both are stated and differ, as numbers where they are numbers.
    counts : bool
        Whether it may change frequencies; who measured when does not.
    boundary : bool
        Whether it says how the tyre was held.
    """

    name: str
    first: str
    second: str
    differs: bool
    counts: bool = True
    boundary: bool = False

    @property
    def change(self) -> str:
        """From the first to the second, ``"Load from 4000 N to 5000 N"``; long texts are cut."""
        return f"{self.name} from {short(self.first)} to {short(self.second)}"

    @property
    def is_open(self) -> bool:
        """Whether one only is stated, so that nobody can tell."""
        return bool(self.first) != bool(self.second)


def condition_contrasts(first: Result, second: Result) -> tuple[Contrast, ...]:
    """Tyre, conditions and set-up that at least one of two results states."""
    one, two = _stated(first), _stated(second)
    keys = dict.fromkeys([*one, *two])
    contrasts = [
        Contrast(
            _name(key),
            _value(key, one.get(key, "")),
            _value(key, two.get(key, "")),
            _differ(one.get(key, ""), two.get(key, "")),
            counts=key.lower() not in RECORD_KEEPING,
            boundary=key.lower() in BOUNDARY,
        )
        for key in keys
    ]
    return tuple(each for each in contrasts if each.first or each.second)


def processing_contrasts(first: Result, second: Result) -> tuple[Contrast, ...]:
    """Choices in force that change numbers, where at least one result records them."""
    pairs = [
        *((title, _option(first, at), _option(second, at)) for at, title in OPTIONS.items()),
        ("mass of the sensors", _sensor_mass(first), _sensor_mass(second)),
        ("drift between runs", _drift(first), _drift(second)),
        ("version of ringmodal", _version(first), _version(second)),
    ]
    return tuple(
        Contrast(title, one, two, _differ(one, two), counts=title != AVERAGES)
        for title, one, two in pairs
        if one or two
    )


def same_recordings(first: Result, second: Result) -> bool:
    """Whether results share a recording, told by its checksum."""
    one, two = _checksums(first), _checksums(second)
    return bool(one & two)


def _stated(result: Result) -> dict[str, str]:
    stated = {"tyre": NO_TYRE}
    tyre = result.tyre
    if tyre is not None:
        stated = {"tyre": tyre.designation}
        if tyre.inflation_pressure_pa is not None:
            stated["inflation_pressure_bar"] = _text(tyre.inflation_pressure_pa / 1e5)
        for name in ("mean_radius_m", "belt_width_m"):
            stated[name] = _text(getattr(tyre, name))
        stated |= tyre.details
    stated["force_position_deg"] = _text(result.excitation_deg)
    stated["number_of_positions"] = str(result.frf.n_positions)
    return stated


def _name(key: str) -> str:
    return named(key, "")[0]


def _value(key: str, text: str) -> str:
    return named(key, text)[1] if text else ""


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
    return "compensated" if bare else "not compensated"


def _drift(result: Result) -> str:
    return "corrected, state of the first run" if result.modal_model.drift.applied else "none found"


def _version(result: Result) -> str:
    return str(result.provenance.get("software", {}).get("ringmodal", ""))


def _checksums(result: Result) -> set[str]:
    """Checksums of the recordings; manifests are alike wherever a lab works from a pattern."""
    inputs = result.provenance.get("inputs", ())
    return {entry["sha256"] for entry in inputs if not entry["file"].endswith(".toml")}


def _differ(first: str, second: str) -> bool:
    if not (first and second):
        return False
    try:
        return float(first) != float(second)
    except ValueError:
        return first.strip() != second.strip()
