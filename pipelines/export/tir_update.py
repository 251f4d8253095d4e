"""Tyre property files updated from a parameter set, and parameter sets from such files."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from ema.core.errors import InputError, visible_line
from model.errors import ParameterError
from model.foundation import foundation_from_belt_modes
from model.identifiability import NOT_IDENTIFIED
from model.tuning_problem import BENDING, TYPICAL
from pipelines.export.belt import BeltValue, belt_values, require_belt_width
from pipelines.export.tir_file import TirFile, TirUnits, clear_si_value, positive_si_value, units_of
from pipelines.results.options import DEFAULT_LOAD
from pipelines.results.parameter_set import Parameter, ParameterSet
from pipelines.results.provenance import software_version
from pipelines.results.verdict import Basis, accepted_verdict

SECTIONS = {
    "INFLPRES": "OPERATING_CONDITIONS",
    **dict.fromkeys(("BELT_MASS", "BELT_IYY"), "INERTIA"),
    **dict.fromkeys(("FREQ_LONG", "FREQ_WINDUP", "DAMP_LONG", "DAMP_WINDUP"), "STRUCTURAL"),
}
_FEWEST_DIGITS, _MOST_DIGITS = 4, 6  # significant ones; between them the ± decides
_PRESSURE_TOLERANCE = 0.01  # relative difference of INFLPRES and NOMPRES without a note
_WINDUP_OVER_LONG = (0.75, 1.0)  # published sets have 0.86 to 0.88: note outside
_BELT_RADIUS = (0.8, 1.0)  # belt radius over outer radius of a tyre: note outside
_OUT_OF_PLANE = "out of plane; the ring moves in the plane of the wheel"
_WHOLE_TYRE = "of the complete tyre; the ring describes the belt"
_CONTACT = "static, through the contact patch; the ring is measured without load"

#: Related keys that a ring does not determine, with the reason.
LEFT_ALONE = {
    **dict.fromkeys(("MASS", "IXX", "IYY"), _WHOLE_TYRE),
    **dict.fromkeys(("BELT_IXX", "FREQ_LAT", "FREQ_YAW", "DAMP_LAT", "DAMP_YAW"), _OUT_OF_PLANE),
    **dict.fromkeys(("LATERAL_STIFFNESS", "YAW_STIFFNESS"), _OUT_OF_PLANE),
    **dict.fromkeys(("VERTICAL_STIFFNESS", "LONGITUDINAL_STIFFNESS"), _CONTACT),
    **dict.fromkeys(
        ("DAMP_RESIDUAL", "DAMP_VLOW", "Q_BVX", "Q_BVT"), "from tests with a rolling tyre"
    ),
    "NOMPRES": "the pressure at which the rest of the file was measured",
    **dict.fromkeys(("UNLOADED_RADIUS", "WIDTH"), "of the outline; the ring is the belt"),
}


@dataclass(frozen=True)
class TirChange:
    """A line that changes, in the file's unit; `BeltValue` explains basis and doubts.

    A new line has no number; `old` is None where there was no value.
    """

    key: str
    section: str
    line: int | None
    old: float | None
    new: float
    std: float | None
    unit: str
    basis: str
    doubts: tuple[str, ...]
    text: str  # as written: the ± decides on the digits

    @property
    def percent(self) -> float | None:
        """Change in percent of the old value; None without one."""
        return 100.0 * (self.new / self.old - 1.0) if self.old else None


@dataclass(frozen=True)
class TirUpdate:
    """Update of a file."""

    before: TirFile
    after: TirFile
    changes: tuple[TirChange, ...]
    unchanged: tuple[str, ...]  # keys that have the ring's value already
    missing: tuple[str, ...]  # keys that the ring determines and the file does not have
    # keys that this set does not determine, and why
    open_ones: Mapping[str, str] = field(default_factory=dict)
    # keys of the file that no ring determines, by reason
    left_alone: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def plan_update(
    tir: TirFile,
    parameters: ParameterSet,
    width_m: float | None = None,
    *,
    add: bool = False,
    comment: str = "",
    accept_warnings: bool = False,
) -> TirUpdate:
    """Update the keys that a ring determines; no other line changes.

    Order 1 is that measured, where the set states it; the ring's fills the gap.

    Parameters
    ----------
    tir : TirFile
    parameters : ParameterSet
    width_m : float, optional
        Belt width b, m. Default: that of the set.
    add : bool
        Whether missing keys are added to their section.
    comment : str
        Name of the set, to be stated in a comment line at the end with date and verdict. Default:
        no such line.
    accept_warnings : bool
        Whether to accept a set whose verdict is not good.

    Raises
    ------
    InputError
        For a set whose verdict is not good, unless that is accepted, an unknown unit, a value that
        is not a number, or a key that is given twice.
    ParameterError
        If the values of the set do not describe a ring.
    """
    accepted_verdict(parameters.designation, parameters.basis, accept_warnings=accept_warnings)
    units = units_of(tir)
    values, open_ones = belt_values(parameters, width_m)
    measured = _measured(parameters, values)
    values |= measured
    open_ones = {key: reason for key, reason in open_ones.items() if key not in measured}
    after, changes, unchanged, missing = tir, [], [], []
    for key, value in values.items():
        entry = after.find(key)
        if entry is None and not add:
            missing.append(key)
            continue
        size = units.size(key)
        digits = _digits(value)
        text = _written(value.value / size, digits)
        change = TirChange(
            key=key,
            section=entry.section if entry else SECTIONS[key],
            line=entry.line if entry else None,
            old=after.number(key),
            new=value.value / size,
            std=None if value.std is None else value.std / size,
            unit=units.unit(key),
            basis=value.basis,
            doubts=value.doubts,
            text=text,
        )
        if entry is None:
            after = after.with_entry(SECTIONS[key], key, text)
        elif change.old is not None and _written(change.old, digits) == text:
            unchanged.append(key)
            continue
        else:
            after = after.with_value(entry, text)
        changes.append(change)
    present = {entry.key for entry in tir.entries if entry.is_in(None)}
    left_alone: dict[str, tuple[str, ...]] = {}
    for key, reason in LEFT_ALONE.items():
        if key in present:
            left_alone[reason] = (*left_alone.get(reason, ()), key)
    if comment and changes:
        after = after.with_comment(_origin(comment, parameters, changes))
    keys = tuple(unchanged), tuple(missing), open_ones, left_alone
    notes = *_torsion_note(values), *_notes(after, units, changes)
    return TirUpdate(tir, after, tuple(changes), *keys, notes)


def _torsion_note(values: Mapping[str, BeltValue]) -> list[str]:
    """Doubt about a torsion that is far from that of published sets."""
    if not {"FREQ_WINDUP", "FREQ_LONG"} <= set(values):
        return []
    ratio = values["FREQ_WINDUP"].value / values["FREQ_LONG"].value
    least, most = _WINDUP_OVER_LONG
    if least <= ratio <= most:
        return []
    return [
        f"FREQ_WINDUP is {ratio:.2f} of FREQ_LONG; published sets have about 0.87. Where k_θ was "
        "not measured with tangential sensors, check it."
    ]


def _measured(parameters: ParameterSet, ring: Mapping[str, BeltValue]) -> dict[str, BeltValue]:
    """Frequency and damping of order 1 as measured, beside those of the ring."""
    found = parameters.basis.on_fixed_rim.get(1)
    if found is None:
        return {}

    def beside(key: str, value: float, std: float | None) -> BeltValue:
        model = f"; ring {ring[key].value:.5g}" if key in ring else ""
        return BeltValue(value, std, f"order 1 as measured{model}")

    return {
        "FREQ_LONG": beside("FREQ_LONG", found.frequency_hz, found.frequency_std_hz),
        "DAMP_LONG": beside("DAMP_LONG", found.damping_ratio, found.damping_ratio_std),
    }


def _written(value: float, digits: int) -> str:
    """A number of so many significant digits, as people write it: 220000, not 2.2e+05."""
    return f"{float(f'{value:.{digits}g}'):.15g}"


def _digits(value: BeltValue) -> int:
    """Significant digits: to the second one of the ±."""
    if not value.value or not value.std:
        return _MOST_DIGITS
    digits = math.floor(math.log10(abs(value.value))) - math.floor(math.log10(value.std)) + 2
    return min(max(digits, _FEWEST_DIGITS), _MOST_DIGITS)


def _origin(name: str, parameters: ParameterSet, changes: list[TirChange]) -> str:
    """Where changed values come from, on one line."""
    keys = ", ".join(change.key for change in changes)
    state = parameters.basis.state or "none"
    when = datetime.now(UTC).date().isoformat()
    text = f"{keys}: ringmodal {software_version()}, set {name}, verdict {state}, {when}"
    return visible_line(text)


def _notes(after: TirFile, units: TirUnits, changes: list[TirChange]) -> list[str]:
    notes = [
        f"{change.key} depends on {', '.join(change.doubts)}, not identified."
        for change in changes
        if change.doubts
    ]
    for part, whole in (("BELT_MASS", "MASS"), ("BELT_IYY", "IYY")):
        belt, tyre = (clear_si_value(after, units, key) for key in (part, whole))
        if belt is not None and tyre is not None and belt > tyre:
            notes.append(f"{part} is now above {whole}: check the belt width and {whole}.")
    pressure, nominal = (clear_si_value(after, units, key) for key in ("INFLPRES", "NOMPRES"))
    if nominal is not None and nominal <= 0:
        rule = "pressure must be > 0"
        raise InputError(f"{after.name}, NOMPRES", f"{nominal:g} Pa", rule, "Correct the value")
    if (
        pressure is not None
        and nominal is not None
        and abs(pressure - nominal) > _PRESSURE_TOLERANCE * nominal
    ):
        notes.append(
            "INFLPRES and NOMPRES differ: a program may scale stiffnesses from one to the other, "
            "but the values of the ring apply at INFLPRES."
        )
    return notes + unit_notes(units)


def unit_notes(units: TirUnits) -> list[str]:
    """Notes about the units of a file."""
    notes = []
    if units.assumed:
        names = ", ".join(units.assumed)
        notes.append(f"The file does not state its unit of {names}: SI is assumed.")
    if units.names["TIME"] != "s":
        notes.append(f"Frequencies are in Hz, although TIME is in {units.names['TIME']}.")
    return notes


@dataclass(frozen=True)
class RingFromTir:
    """A parameter set from a tyre property file, with notes.

    It has no damping: two damping ratios do not determine three parameters.
    """

    parameters: ParameterSet
    notes: tuple[str, ...]


def ring_from_tir(
    tir: TirFile, width_m: float | None = None, like: ParameterSet | None = None
) -> RingFromTir:
    """Find a, ρh, k_r and k_θ from a tyre property file; the inverse of an update.

    Parameters
    ----------
    tir : TirFile
        With BELT_MASS, BELT_IYY, FREQ_LONG, FREQ_WINDUP and INFLPRES.
    width_m : float, optional
        Belt width b, m. Default: that of `like`.
    like : ParameterSet, optional
        Gives pressure model, K and D, which are not in such a file. Default: a dead load, or a
        follower load where the torsion needs one; K from a typical growth on inflation (eq 16),
        D of a typical tyre.

    Raises
    ------
    InputError
        If a value is missing or not a number, the width is unknown, or no ring has these values.
    """
    units = units_of(tir)
    width = _width(tir, units, width_m, like)
    mass, inertia, translation, torsion, pressure = (
        positive_si_value(tir, units, key)
        for key in ("BELT_MASS", "BELT_IYY", "FREQ_LONG", "FREQ_WINDUP", "INFLPRES")
    )
    radius = math.sqrt(inertia / mass)
    per_area = mass / (2 * math.pi * radius * width)
    known: dict[str, Any] = {
        "mean_radius_m": radius,
        "mass_per_area_kg_m2": per_area,
        "inflation_pressure_pa": pressure,
        "axial_stiffness_n_m": like.ring["axial_stiffness_n_m"].value if like else None,
    }
    stated = like.basis.pressure_load if like else DEFAULT_LOAD
    load = stated or DEFAULT_LOAD
    if stated is None:  # a set of before 0.2 has waves for a dead load, torsion for a follower's
        torsion = math.hypot(torsion, math.sqrt(pressure / (radius * per_area)) / (2 * math.pi))
    try:
        found = foundation_from_belt_modes(translation, torsion, **known, pressure_load=load)
        if found.circumferential_stiffness_n_m3 < 0 and load == "dead":
            load = "follower"  # a dead load itself holds the belt better than this torsion
            found = foundation_from_belt_modes(translation, torsion, **known, pressure_load=load)
    except ParameterError as error:
        where = f"{tir.name}, {error.where}"
        raise InputError(where, error.found, error.rule, error.remedy) from error
    names = ("axial_stiffness_n_m", "bending_stiffness_n_m")
    typical = found.axial_stiffness_n_m, TYPICAL[BENDING]
    assumed = {n: Parameter(value, NOT_IDENTIFIED) for n, value in zip(names, typical, strict=True)}
    parameters = ParameterSet(
        designation=tir.name.rpartition(".")[0] or tir.name,
        conditions={"inflation_pressure_pa": pressure},
        ring={
            "mean_radius_m": Parameter(radius),
            "belt_width_m": Parameter(width),
            "mass_per_area_kg_m2": Parameter(per_area),
            "radial_stiffness_n_m3": Parameter(found.radial_stiffness_n_m3),
            "circumferential_stiffness_n_m3": Parameter(found.circumferential_stiffness_n_m3),
            **({name: like.ring[name] for name in names} if like else assumed),
        },
        provenance={
            "software": f"ringmodal {software_version()}",
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "source": tir.name,
            "source_sha256": hashlib.sha256(tir.content).hexdigest(),
        },
        basis=Basis(stated and load),
    )
    return RingFromTir(parameters, tuple(_ring_notes(tir, units, radius, like)))


def _width(
    tir: TirFile, units: TirUnits, width_m: float | None, like: ParameterSet | None
) -> float:
    if width_m is None and like and "belt_width_m" in like.ring:
        return like.ring["belt_width_m"].value
    if width_m is None:
        outline = clear_si_value(tir, units, "WIDTH")
        hint = f"; its WIDTH of {outline:g} m is that of the complete section" if outline else ""
        rule = f"a .tir file does not have it{hint}"
        raise InputError(tir.name, "no belt width", rule, "Give --belt-width-m")
    require_belt_width(width_m)
    return width_m


def _ring_notes(
    tir: TirFile, units: TirUnits, radius: float, like: ParameterSet | None
) -> list[str]:
    source = (
        "they are taken from the set given with --like."
        if like
        else "K follows from a typical growth on inflation, D is that of a typical tyre. k_r and "
        "k_θ depend slightly on K; --like SET takes K and D from a set."
    )
    notes = [
        f"K and D are not in a .tir file: {source}",
        "Damping is not used: two damping ratios do not determine three parameters.",
    ]
    outer = clear_si_value(tir, units, "UNLOADED_RADIUS")
    if outer and not _BELT_RADIUS[0] <= radius / outer <= _BELT_RADIUS[1]:
        notes.append(
            f"The belt's radius √(BELT_IYY/BELT_MASS) is {radius:.3f} m, the tyre's "
            f"UNLOADED_RADIUS {outer:.3f} m: check both belt values."
        )
    return notes + unit_notes(units)
