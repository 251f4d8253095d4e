"""Conditions and processing of two results side by side, and caveats of their comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ema.core.display import plain
from pipelines.compare.modes import LOWEST_MAC, MatchedMode
from pipelines.results.options import Units, quantity
from pipelines.results.provenance import accepted_notes
from pipelines.results.result import Result
from pipelines.results.tables import named, short

#: Free keys of ``[tyre]`` about who, when and for whom: they do not affect frequencies.
RECORD_KEEPING = frozenset(
    {"comment", "customer", "date", "job", "note", "notes", "number_of_positions", "operator"}
    | {"order_number", "origin", "project", "remark", "remarks", "report", "test_number", "time"}
)
#: Free keys about how the tyre was supported.
BOUNDARY = frozenset(
    {"boundary", "boundary_condition", "boundary_conditions", "mounting", "support"}
)
BAND = "options.processing.band_hz"
AVERAGES = "options.processing.averages_per_run"  # follows from the length of a run; part of σ
SENSORS, LIVE_MASS = "corrections.sensor_mass_kg", "corrections.live_mass_kg"
DRIFT = "drift"
#: What affects results: place in ``provenance.json``, and its title.
OPTIONS = {
    BAND: "band / Hz",
    "options.processing.block_seconds": "block length / s",
    "options.processing.window": "window",
    "options.processing.overlap": "overlap",
    AVERAGES: "averages a run",
    "options.processing.exponential_window_s": "exponential window / s",
    "options.processing.sampling_rate_hz": "sampling rate / Hz",
    "options.estimator": "FRF estimator",
    "options.method": "pole estimator",
    "options.max_order": "highest model order",
    "options.pinned_hz": "frequencies pinned / Hz",
    "options.excluded_hz": "frequencies excluded / Hz",
    "options.objective": "objective of the tuning",
    "options.given": "ring parameters given",
    SENSORS: "mass of the sensors",
    LIVE_MASS: "live mass at the load cell",
    DRIFT: "drift between runs",
    "software.ringmodal": "version of ringmodal",
}
NO_TYRE = "structure, not described as a tyre"
_QUANTITIES = {"inflation_pressure_bar": ("Pa", 1e5)} | dict.fromkeys(
    ("mean_radius_m", "belt_width_m"), ("m", 1.0)
)


@dataclass(frozen=True)
class Contrast:
    """One condition or option of two results."""

    key: str  # in ``[tyre]``, or place in ``provenance.json``
    name: str
    # with the unit; empty where not stated
    first: str
    second: str
    differs: bool  # whether both are stated and differ, as numbers where they are numbers

    @property
    def counts(self) -> bool:
        """Whether it may affect frequencies; who measured when does not."""
        return self.key.lower() not in RECORD_KEEPING and self.key != AVERAGES

    @property
    def change(self) -> str:
        """From the first to the second, ``"Load from 4000 N to 5000 N"``; long texts are cut."""
        return f"{self.name} from {short(self.first)} to {short(self.second)}"

    @property
    def is_open(self) -> bool:
        """Whether only one of both is stated."""
        return bool(self.first) != bool(self.second)


def condition_contrasts(first: Result, second: Result, units: Units) -> tuple[Contrast, ...]:
    """Tyre, conditions and set-up that at least one of two results states."""
    one, two = _stated(first), _stated(second)
    contrasts = []
    for key in dict.fromkeys([*one, *two]):
        texts = one.get(key, ""), two.get(key, "")
        one_text, two_text = (_with_unit(key, text, units) for text in texts)
        contrasts.append(Contrast(key, named(key, "")[0], one_text, two_text, _differ(*texts)))
    return tuple(each for each in contrasts if each.first or each.second)


def _with_unit(key: str, text: str, units: Units) -> str:
    if not text or key not in _QUANTITIES:
        return named(key, text)[1] if text else ""
    unit, factor = _QUANTITIES[key]
    return quantity(float(text) * factor, unit, units)


def processing_contrasts(first: Result, second: Result) -> tuple[Contrast, ...]:
    """Options in force that affect results, where at least one result records them."""
    one, two = _processing(first), _processing(second)
    return tuple(
        Contrast(key, title, one[key], two[key], _differ(one[key], two[key]))
        for key, title in OPTIONS.items()
        if one[key] or two[key]
    )


def same_recordings(first: Result, second: Result) -> bool:
    """Whether two results share a recording, by checksum."""
    return bool(_checksums(first) & _checksums(second))


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


def _processing(result: Result) -> dict[str, str]:
    """Texts of everything in `OPTIONS`; empty where a result does not record it."""
    texts = {place: _text(_at(result.provenance, place)) for place in OPTIONS}
    if "corrections" in result.provenance:
        for place in (SENSORS, LIVE_MASS):
            mass_kg = _at(result.provenance, place)
            texts[place] = f"{_text(mass_kg)} kg compensated" if mass_kg else "not compensated"
    drifting = result.modal_model.drift.applied
    texts[DRIFT] = "corrected, state of the first run" if drifting else "none found"
    return texts


def _at(value: Any, place: str) -> Any:
    for key in place.split("."):
        value = value.get(key) if isinstance(value, Mapping) else None
    return value


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} = {_text(each)}" for key, each in value.items()) or "none"
    if isinstance(value, list | tuple):
        return ", ".join(map(_text, value)) or "none"
    if isinstance(value, int | float) and not isinstance(value, bool):
        return plain(value)
    return "" if value is None else str(value)


def _checksums(result: Result) -> set[str]:
    """Checksums of the recordings; manifests are often copied from one campaign to the next."""
    inputs = result.provenance.get("inputs", ())
    return {entry["sha256"] for entry in inputs if not entry["file"].endswith(".toml")}


def _differ(first: str, second: str) -> bool:
    if not (first and second):
        return False
    try:
        return float(first) != float(second)
    except ValueError:
        return first.strip() != second.strip()


def doubts(
    first: Result,
    second: Result,
    modes: Sequence[MatchedMode],
    conditions: Sequence[Contrast],
    processing: Sequence[Contrast],
) -> tuple[str, ...]:
    """Caveats of a comparison, as sentences."""
    sides = (first, "The first result"), (second, "The second result")
    found = [f"{note}." for each, name in sides for note in accepted_notes(each.provenance, name)]
    if same_recordings(first, second):
        found.append(
            "Both results come from the same recordings: most of their noise cancels in the "
            "differences, so σ is too large and z too small. What remains is due to processing."
        )
    tyres = [NO_TYRE if each.tyre is None else each.tyre.designation for each in (first, second)]
    if tyres[0] != tyres[1]:
        found.append(
            f"Different tyres: {short(tyres[0])} and {short(tyres[1])}. The differences include "
            "construction and every other change."
        )
    found += [
        f"The tyre was supported differently: {each.change}. This alone shifts the low orders."
        for each in conditions
        if each.key.lower() in BOUNDARY and each.differs
    ]
    (low, high), (lowest, highest) = (each.modal_model.band_hz for each in (first, second))
    if (low, high) != (lowest, highest):
        found.append(
            f"Different bands: {low:g} to {high:g} Hz and {lowest:g} to {highest:g} Hz. The effect "
            "of the band ends on each mode is part of σ; modes outside one band have no partner."
        )
    others = [e.name for e in processing if e.counts and e.differs and e.key != BAND]
    if others:
        found.append(
            f"Processed differently ({', '.join(others)}). Process both alike before "
            "interpreting small differences."
        )
    unlike = [f"{mode.name} (MAC {mode.mac:.2f})" for mode in modes if mode.mac < LOWEST_MAC]
    if unlike:
        found.append(
            f"Shapes differ: {', '.join(unlike)}. These may be different modes, or the tyre was "
            "turned on its rim, or the shaker was moved."
        )
    untested = [mode.name for mode in modes if not mode.frequency.std > 0]
    if not modes:
        found.append("No mode of one result was found in the other.")
    elif untested:
        found.append(
            f"σ is unknown for {', '.join(untested)}: their differences cannot be tested. One "
            "average per run gives no σ; use shorter blocks."
        )
    return tuple(found)
