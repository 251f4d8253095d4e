"""A tyre property file brought up to date with a parameter set: what changes, what does not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ema.core.errors import InputError
from pipelines.export.tir_belt import BeltValue, belt_values
from pipelines.export.tir_file import TirEntry, TirFile
from pipelines.export.tir_units import TirUnits, clear_si_value, units_of
from pipelines.results.parameter_set import ParameterSet

SECTIONS = {
    "INFLPRES": "OPERATING_CONDITIONS",
    **dict.fromkeys(("BELT_MASS", "BELT_IYY"), "INERTIA"),
    **dict.fromkeys(("FREQ_LONG", "FREQ_WINDUP", "DAMP_LONG", "DAMP_WINDUP"), "STRUCTURAL"),
}
_DIGITS = 12  # enough to find the ring again within 1e-9
_OUT_OF_PLANE = "out of the wheel's plane, in which the ring does not move"
_WHOLE_TYRE = "of the whole tyre; the ring knows the belt"
_CONTACT = "static, through the contact patch; the ring was measured without load"

#: Related keys that a ring does not determine, and why.
LEFT_ALONE = {
    **dict.fromkeys(("MASS", "IXX", "IYY"), _WHOLE_TYRE),
    **dict.fromkeys(("BELT_IXX", "FREQ_LAT", "FREQ_YAW", "DAMP_LAT", "DAMP_YAW"), _OUT_OF_PLANE),
    **dict.fromkeys(("LATERAL_STIFFNESS", "YAW_STIFFNESS"), _OUT_OF_PLANE),
    **dict.fromkeys(("VERTICAL_STIFFNESS", "LONGITUDINAL_STIFFNESS"), _CONTACT),
    **dict.fromkeys(
        ("DAMP_RESIDUAL", "DAMP_VLOW", "Q_BVX", "Q_BVT"), "from tests with a rolling tyre"
    ),
    "NOMPRES": "the pressure at which the rest of the file was measured",
    **dict.fromkeys(("UNLOADED_RADIUS", "WIDTH"), "of the outline; the ring lies in the belt"),
}


@dataclass(frozen=True)
class TirChange:
    """A line that changes, in the file's unit.

    Parameters
    ----------
    key, section : str
    line : int or None
        Its number; None where it is added.
    old : float or None
        None where there was no value.
    new : float
    std : float or None
    unit : str
    basis : str
        Where the new value comes from.
    doubts : tuple of str
        Symbols of parameters that it rests on and that were not identified.
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

    @property
    def percent(self) -> float | None:
        """Change in percent of the old value; None without one."""
        return 100.0 * (self.new / self.old - 1.0) if self.old else None


@dataclass(frozen=True)
class TirUpdate:
    """What an update does to a file.

    Parameters
    ----------
    before, after : TirFile
    changes : tuple of TirChange
    unchanged : tuple of str
        Keys that hold the ring's value already.
    missing : tuple of str
        Keys that the ring determines and the file does not hold.
    open_ones : dict of str to str
        Keys that this set does not determine, and why.
    left_alone : dict of str to tuple of str
        Keys of the file that no ring determines, by the reason.
    notes : tuple of str
        What a reader must know, in sentences.
    """

    before: TirFile
    after: TirFile
    changes: tuple[TirChange, ...]
    unchanged: tuple[str, ...]
    missing: tuple[str, ...]
    open_ones: Mapping[str, str] = field(default_factory=dict)
    left_alone: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def plan_update(
    tir: TirFile, parameters: ParameterSet, width_m: float | None = None, *, add: bool = False
) -> TirUpdate:
    """Bring those keys up to date that a ring determines; no other line changes.

    Parameters
    ----------
    tir : TirFile
    parameters : ParameterSet
    width_m : float, optional
        Belt width b, m. Default: that of the set.
    add : bool
        Whether keys that the file does not hold are added to their section.

    Returns
    -------
    TirUpdate

    Raises
    ------
    InputError
        For an unknown unit, a value that is no number, or a key that stands there twice.
    ParameterError
        If the values of the set make no ring.
    """
    units = units_of(tir)
    values, open_ones = belt_values(parameters, width_m)
    after, changes = tir, []
    unchanged, missing = [], []
    for key, value in values.items():
        entry = after.find(key)
        if entry is None and not add:
            missing.append(key)
            continue
        change = _change(after, units, key, value, entry)
        text = f"{change.new:.{_DIGITS}g}"
        if entry is None:
            after = after.with_entry(SECTIONS[key], key, text)
        elif change.old is not None and f"{change.old:.{_DIGITS}g}" == text:
            unchanged.append(key)
            continue
        else:
            after = after.with_value(entry, text)
        changes.append(change)
    return TirUpdate(
        before=tir,
        after=after,
        changes=tuple(changes),
        unchanged=tuple(unchanged),
        missing=tuple(missing),
        open_ones=open_ones,
        left_alone=_left_alone(tir),
        notes=tuple(_notes(after, units, changes)),
    )


def _change(
    tir: TirFile, units: TirUnits, key: str, value: BeltValue, entry: TirEntry | None
) -> TirChange:
    size = units.size(key)
    return TirChange(
        key=key,
        section=entry.section if entry else SECTIONS[key],
        line=entry.line if entry else None,
        old=tir.number(key),
        new=value.value / size,
        std=None if value.std is None else value.std / size,
        unit=units.unit(key),
        basis=value.basis,
        doubts=value.doubts,
    )


def _left_alone(tir: TirFile) -> dict[str, tuple[str, ...]]:
    present = {entry.key for entry in tir.entries() if entry.stands_in(None)}
    found: dict[str, tuple[str, ...]] = {}
    for key, reason in LEFT_ALONE.items():
        if key in present:
            found[reason] = (*found.get(reason, ()), key)
    return found


def _notes(after: TirFile, units: TirUnits, changes: list[TirChange]) -> list[str]:
    notes = [
        f"{change.key} rests on {', '.join(change.doubts)}, which was not identified."
        for change in changes
        if change.doubts
    ]
    for part, whole in (("BELT_MASS", "MASS"), ("BELT_IYY", "IYY")):
        belt, tyre = (clear_si_value(after, units, key) for key in (part, whole))
        if belt is not None and tyre is not None and belt > tyre:
            notes.append(f"{part} is now above {whole}: check the belt width and {whole}.")
    pressure, nominal = (clear_si_value(after, units, key) for key in ("INFLPRES", "NOMPRES"))
    if nominal is not None and nominal <= 0:
        rule = "tyres are measured under a pressure above zero"
        raise InputError(f"{after.name}, NOMPRES", f"{nominal:g} Pa", rule, "Correct the value")
    if pressure is not None and nominal is not None and abs(pressure - nominal) > 0.01 * nominal:
        notes.append(
            "INFLPRES and NOMPRES differ: a program may scale stiffnesses from one to the other, "
            "while the values of the ring hold at INFLPRES."
        )
    return notes + unit_notes(units)


def unit_notes(units: TirUnits) -> list[str]:
    """What a reader must know of the units of a file."""
    notes = []
    if units.assumed:
        names = ", ".join(units.assumed)
        notes.append(f"The file does not state its unit of {names}: SI is taken.")
    if units.names["TIME"] != "s":
        notes.append(f"Frequencies are in Hz, although TIME is in {units.names['TIME']}.")
    return notes
